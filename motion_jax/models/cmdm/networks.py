"""CMDM's networks with their weights, compiled: the base of generation, multi-prompt motion and streams."""
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.latents import VaeCodec
from motion_jax.models import cmdm
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.cmdm import streaming
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.shapes import Array, Bool, Float, Num
from motion_jax.text.clauses import Clause
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields

if TYPE_CHECKING:
  from motion_jax.runs import Run
  from motion_jax.text.contrast import Contrast
  from motion_jax.text.encoder import TextEncoder


class Compiled(NamedTuple):
  """The functions that a model runs, compiled on first use for each new shape. A step has one shape for motions of any
  length and kind."""
  advance: Callable    # of `streaming`: one step
  constants: Callable  # of `sampling`, as those below
  words: Callable
  control: Callable
  pull: Callable       # of a window, and of finished motions that are no longer
  encode: Callable
  decode: Callable     # one block
  decode_whole: Callable  # all latents of a motion, for a tokenizer that looks both ways
  generate_whole: Callable
  chain_segment: Callable


def _compile(dit: CausalDiT) -> Compiled:
  program = lambda fn, num_static, *modules: cache.Program(
      fn.__name__, partial(fn, *modules), num_static, modules, light=True)
  return Compiled(
      advance=program(streaming.advance, 1, dit), constants=program(cmdm.block_constants, 2, dit),
      words=program(cmdm.block_words, 1, dit), control=program(cmdm.block_control, 0, dit),
      pull=program(cmdm.block_pull, 0), encode=program(VaeCodec.encode, 0),
      decode=program(VaeCodec.decode_step, 0), decode_whole=program(VaeCodec.decode, 0),
      generate_whole=program(cmdm.generate_whole, 2, dit),
      chain_segment=program(cmdm.chain_segment, 2, dit))


class CmdmNetworks(TextToMotionModel):
  """A trained denoiser with its tokenizer and text encoder, each compiled on first use."""

  def __init__(self, run: "Run", encoder: "TextEncoder") -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), data__max_words=(1, 10_000),
                      sampler__num_steps=(1, 10_000), sampler__lag=(1, 10_000), sampler__guidance_scale=(-1e3, 1e3))
    self.vae = CausalVAE(**module_fields(config.tokenizer))
    self.dit = CausalDiT(**module_fields(config.model))
    super().__init__(run, encoder, self.dit.text_dim, self.vae.frames_per_latent,
                     cache.kept_shapes("cmdm.frozen", self.vae, lambda: cmdm.frozen_shapes(self.vae)),
                     cache.kept_shapes("cmdm.denoiser", self.dit, lambda: cmdm.denoiser_shapes(self.dit)))
    self.codec = VaeCodec.of(self.vae, self.frozen)
    self.context = config.data.max_frames // self.vae.frames_per_latent // self.dit.block * self.dit.block
    self.compiled = _compile(self.dit)
    self._constants: dict[Any, streaming.Constants] = {}
    self._stacked: Any = None

  @property
  def stacked(self) -> Any:
    """The denoiser's parameters with all layers in one, as its sampler takes them; stacked once."""
    if self._stacked is None or self._stacked[0] is not self.params:
      rows = self.dit.stack_layers(jax.tree.map(np.asarray, self.params))
      self._stacked, self._constants = (self.params, jax.device_put(rows)), {}
    return self._stacked[1]

  def constants_of(self, plan: streaming.Plan) -> streaming.Constants:
    """What a plan's times decide, computed once; tables of 64, 128, ... rows, so that numbers of steps share
    programs."""
    params, rows = self.stacked, 64
    while rows <= plan.num_steps:
      rows *= 2
    steps = plan._replace(lag=1, width=1, context=plan.block, memory=None)
    if steps not in self._constants:
      self._constants[steps] = streaming.Constants(*self.compiled.constants(steps, rows, params))
    return self._constants[steps]

  def reconstruct(self, features: Num[Array, "t f"]) -> Float[np.ndarray, "_ f"]:
    """Features (T, F) through the tokenizer and back, T cut to whole latents."""
    whole = len(features) // self.frames_per_latent * self.frames_per_latent
    x = self.stats.normalize(np.asarray(features))[None, :whole]
    return self.stats.denormalize(np.asarray(self.codec.reconstruct(jnp.asarray(x))))[0]

  def encode_words(self, prompts: Sequence[str], contrast: "Contrast | None" = None
                   ) -> tuple[Float[np.ndarray, "b s e"], Bool[np.ndarray, "b s"]]:
    """(text_emb, text_mask) of prompts, padded to the width of everyday ones so that these share compiled code.

    Longer ones are padded to twice that, four times, ...: each width is compiled once. contrast: see `text.contrast`.
    Of a `Clause` the words of the whole sentence are encoded, and those of the clause are real.
    """
    everyday = -(-self.config.data.max_words // 8) * 8
    clauses, prompts = prompts, [prompt.sentence if isinstance(prompt, Clause) else prompt for prompt in prompts]
    emb, mask = self.encoder(prompts, at_least=everyday)
    if contrast is not None and contrast.scale:
      from motion_jax.text.contrast import contrasted
      emb = contrasted(self.encoder, prompts, emb, mask, contrast)
    if emb.shape[1] > 1:
      for row, clause in zip(mask, clauses):
        if isinstance(clause, Clause):
          row &= self.encoder.shows(clause.sentence, clause.spans, len(row))
    missing = max(everyday - emb.shape[1], 0)  # of a sentence vector, which is one row
    return np.pad(emb, ((0, 0), (0, missing), (0, 0))), np.pad(mask, ((0, 0), (0, missing)))

  def usual_sampling(self) -> dict[str, Any]:
    return dict(context=self.context)

  def plan_of(self, negative_prompts: Callable[[str], str] | Mapping[str, str] | None = None, **sampling: Any
              ) -> tuple[streaming.Plan, CmdmSampling, "Contrast | None", dict[str, Any]]:
    """(plan for motions of any length, all choices of sampling, contrast guidance, record of them) of `CmdmSampling`
    choices."""
    chosen = self.sampling(**sampling)
    # A scale of 1 is the network without guidance: where others are usual it shares their program.
    guided = 1.0 != chosen.guidance_scale or 1.0 != self.sampling().guidance_scale
    plan = streaming.make_plan(chosen.num_steps, chosen.steps_apart or 1, self.dit.block, chosen.context, guided=guided,
                               solver=chosen.solver, memory=chosen.memory)
    plan, about = plan._replace(lag=chosen.steps_apart), chosen.about() | dict(model=self.id)
    if negative_prompts is None or not chosen.contrast_scale:
      return plan, chosen, None, about | dict(contrast_scale=0.0)
    from motion_jax.text.contrast import Contrast
    negative = negative_prompts if callable(negative_prompts) else lambda prompt: negative_prompts.get(prompt, prompt)
    return plan, chosen, Contrast(negative, chosen.contrast_scale), about
