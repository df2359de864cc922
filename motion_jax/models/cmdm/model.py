"""CMDM ready to use: motion from prompts, prompts in sequence, continued motions, and live streams."""
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.models import arguments
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.options import WAYS, CmdmSampling
from motion_jax.models.keys import keys_of
from motion_jax.models.shared import round_trips
from motion_jax.models.shared.blocks import BlockModel, Continued, Frames, Sampled, Segments
from motion_jax.models.shared.script import segment_ends
from motion_jax.shapes import Array, Float
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import checked

if TYPE_CHECKING:
  from motion_jax.data.clip import Clip
  from motion_jax.export.graphs import Graph
  from motion_jax.models.cmdm.live import LiveStream
  from motion_jax.models.results import Motion
  from motion_jax.runs import Run
  from motion_jax.text.encoder import TextEncoder

# Guidance by constraints: conjugate gradient steps per pull, and Gauss-Newton steps on the finished latents.
CONTROL_STEPS, REFINEMENTS = 2, 3


class CmdmModel(BlockModel, CmdmNetworks):
  """CMDM ready to use: prompts in, motion out. Made by `load`.

  In addition to the choices of `CmdmSampling`, sampling takes negative_prompts, a function or a dict from prompts to
  those that contrast guidance moves them away from, by contrast_scale (`text.contrast`); and for motions guided by
  constraints control_steps, the conjugate gradient steps of every second iteration (0: not pulled), and refinements,
  the Gauss-Newton steps on the finished latents, which a stream cannot have.
  """
  abilities: tuple[str, ...] = (*BlockModel.abilities, "reconstruct", "graphs")
  options = CmdmSampling
  more_choices = ("negative_prompts", "control_steps", "refinements")
  takes_control = True
  ways = WAYS

  def __init__(self, run: "Run", encoder: "TextEncoder") -> None:
    super().__init__(run, encoder)
    self.block_frames = self.dit.block * self.frames_per_latent
    if not self.vae.causal:  # the paper's VAE decodes whole motions, and constraints pull latents block after block
      self.takes_control = False
      self.abilities = tuple(ability for ability in self.abilities if ability not in ("stream", "graphs"))

  def graphs(self, **sampling: Any) -> tuple[list["Graph"], dict[str, Any]]:
    """Its functions for `export.graphs.write`, and what a host needs to run them (`models.cmdm.graphs`)."""
    from motion_jax.models.cmdm.graphs import graphs_of  # jax2onnx is an extra
    return graphs_of(self, **sampling)

  def run_segments(self, lists: Sequence[Frames], keys: jax.Array, sampling: dict[str, Any],
                   signal: ControlSignal | None = None, way: str = "stream") -> Sampled:
    """A motion of each list of (prompt, frames), a key each, in one batch.

    signal (B, T): a network that was trained on constraints gets them as a condition, and latents are pulled towards
    them while they are denoised (`models.cmdm.guiding`).
    """
    from motion_jax.models.cmdm import multi_prompt
    sampling = dict(sampling)
    control_steps, refinements = (checked(sampling.pop(name, usual), 0, 100, name) for name, usual in (
        ("control_steps", CONTROL_STEPS), ("refinements", REFINEMENTS)))
    plan, chosen, contrast, about = self.plan_of(**sampling)
    control: dict[str, Any] = {}
    if signal is not None:
      about |= dict(control_steps=control_steps, refinements=refinements)
      control = dict(signal=signal, control_steps=control_steps, refinements=refinements)
    steered = lists
    if chosen.clauses and way == "stream":
      steered = multi_prompt.by_clauses(lists, self.block_frames, self.captions.knows)
    prompts, frames = ([list(part) for part in parts] for parts in zip(*(zip(*segments) for segments in steered)))
    make = multi_prompt.stream if way == "stream" else multi_prompt.chain
    sampled = Sampled(*make(self, plan, chosen, prompts, frames, keys, contrast, **control), about)
    return sampled if steered is lists else sampled._replace(
        ends=[segment_ends([count for _, count in segments], self.block_frames) for segments in lists])

  def segment_frames(self, frames: Sequence[int], way: str = "stream") -> list[int]:
    """The frames that each segment of `multi_prompt` gets where `frames` were requested, which are rounded by `way`."""
    from motion_jax.models.cmdm import multi_prompt
    return multi_prompt.segment_frames(frames, way, self.block_frames, self.frames_per_latent)

  @arguments.checked
  def extend(self, clip: "Clip | Array", prompt: str | Segments, num_frames: int | None = None, *,
             seconds: float | None = None, past_prompt: str | None = None, rng: jax.Array | None = None,
             seed: int | None = None, seeds: Iterable[int] | None = None, way: str = "stream",
             num_past: int | None = None, cleanup: bool = False, **sampling: Any) -> "Motion":
    """Continues an existing motion, see `BlockModel.extend`.

    past_prompt: describes the clip (its own caption, else the new prompt). way: "stream" keeps the clip's last num_past
    latents (as many as the context holds) clean in the cache; "chain" is the released code's, 1 latent that gets fresh
    noise in every step.
    """
    self._check_way(way)
    if num_past is not None and num_past < 1:
      raise InputError(f"got num_past {num_past}, expected 1 latent or more to continue from")
    return self._extended(clip, prompt, num_frames, seconds, keys_of(rng, seeds, 1, seed), cleanup, sampling,
                          past_prompt=past_prompt, way=way, num_past=num_past)

  def continue_motion(self, clip: "Clip", joints: Float[np.ndarray, "t j 3"], segments: Frames, keys: jax.Array,
                      cleanup: bool, sampling: dict[str, Any], past_prompt: str | None = None, way: str = "stream",
                      num_past: int | None = None) -> Continued:
    """The continuation of joints (T, J, 3), decoded together with their end; see `extend`."""
    from motion_jax.models.cmdm.extending import extend
    plan, chosen, contrast, about = self.plan_of(**sampling)
    prompts, frames = ([*part] for part in zip(*segments))
    captions = [caption.text for caption in clip.captions if caption.text.strip()]
    past_prompt = past_prompt or (captions[-1] if captions else prompts[0])
    added, ends, steps = extend(self, plan, chosen, joints, past_prompt, prompts, frames, keys, contrast, way, num_past,
                                cleanup)
    return Continued(added, ends, about | dict(way=way, past_prompt=past_prompt), steps)

  def make_stream(self, segments: Sequence[tuple[str, int | None]], keys: jax.Array, num_frames: int | None,
                  cleanup: bool, sampling: dict[str, Any]) -> "LiveStream":
    """A stream of segments [(prompt, frames)], the last without end."""
    from motion_jax.models.cmdm.live import LiveStream
    if not self.can("stream"):
      raise InputError(f"{self.folder.name} has a tokenizer that looks ahead (tokenizer.causal=False), so it cannot be "
                       "streamed block after block; generate and multi_prompt make whole motions")
    plan, chosen, contrast, _ = self.plan_of(**sampling)
    if not plan.lag:
      raise InputError("got schedule 'full': a stream runs by schedule 'fss' or 'ar'")
    return LiveStream(self, plan, chosen, keys, segments, num_frames, cleanup, contrast)


MODELS = {"cmdm.denoiser": CmdmModel}
TOKENIZERS = dict.fromkeys(("cmdm.tokenizer", "cmdm.denoiser"), round_trips.causal_vae)
