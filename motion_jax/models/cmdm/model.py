"""CMDM ready to use: motion from prompts, prompts in sequence, continued motions, and live streams."""
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.data.clip import Clip
from motion_jax.models import arguments
from motion_jax.models.cmdm import multi_prompt as multi
from motion_jax.models.cmdm import streaming
from motion_jax.models.cmdm.live import LiveStream
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.keys import keys_of
from motion_jax.models.results import Motion, Motions, captions_in_a_row, go_on, make_motions
from motion_jax.models.shared import round_trips
from motion_jax.models.shared.known_motion import KnownMotion, at_rate, clip_of
from motion_jax.runs import Run
from motion_jax.shapes import Array
from motion_jax.text.contrast import Contrast
from motion_jax.text.encoder import TextEncoder
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import checked

if TYPE_CHECKING:
  from motion_jax.export.graphs import Graph

# Guidance by constraints: conjugate gradient steps per pull, and Gauss-Newton steps on the finished latents.
CONTROL_STEPS, REFINEMENTS = 2, 3
Segments = Sequence[tuple[str, float | None]]  # prompts and their seconds


class CmdmModel(CmdmNetworks):
  """CMDM ready to use: prompts in, motion out. Made by `load`.

  Beside the choices of `CmdmSampling`, sampling takes negative_prompts, a function or a dict from prompts to those that
  contrast guidance moves them away from, by contrast_scale (`text.contrast`); and of motions guided by constraints
  control_steps, the conjugate gradient steps of every second iteration (0: not pulled), and refinements, the
  Gauss-Newton steps on the finished latents, which no stream can have.
  """
  abilities: tuple[str, ...] = ("generate", "sample_segments", "stream", "multi_prompt", "extend", "reconstruct",
                                "graphs")
  options = CmdmSampling
  more_choices = ("negative_prompts", "control_steps", "refinements")
  takes_control = True
  ways = multi.WAYS

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    super().__init__(run, encoder)
    if not self.vae.causal:  # the paper's VAE decodes whole motions, and constraints pull latents block after block
      self.takes_control = False
      self.abilities = tuple(ability for ability in self.abilities if ability not in ("stream", "graphs"))

  def graphs(self, **sampling: Any) -> tuple[list["Graph"], dict[str, Any]]:
    """Its functions for `export.graphs.write`, and what a host needs beside them (`models.cmdm.graphs`)."""
    from motion_jax.models.cmdm.graphs import graphs_of  # jax2onnx is an extra
    return graphs_of(self, **sampling)

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: ControlSignal | None = None) -> Motions:
    """One pass of the network: motions of prompts, a key each.

    signal (B, longest): a network that was trained on constraints gets them as a condition, and latents are pulled
    towards them while they are denoised (`models.cmdm.guiding`).
    """
    sampling = dict(sampling)
    control_steps, refinements = (checked(sampling.pop(name, usual), 0, 100, name) for name, usual in (
        ("control_steps", CONTROL_STEPS), ("refinements", REFINEMENTS)))
    plan, chosen, contrast, about = self.plan_of(**sampling)
    blocks = -(-max(frames) // (plan.block * self.frames_per_latent))
    control: dict[str, Any] = {}
    if signal is not None:
      signal = signal.slice_frames(0, blocks * plan.block * self.frames_per_latent)
      control = dict(signal=signal, control_steps=control_steps, refinements=refinements)
      about |= dict(control_steps=control_steps, refinements=refinements)
    made = multi.run(self, plan, chosen, [[prompt] for prompt in prompts], np.zeros((len(prompts), blocks), np.int32),
                     frames, keys, contrast, **control)
    captions = [captions_in_a_row([prompt], [count], self.fps) for prompt, count in zip(prompts, frames)]
    return make_motions(self, made, frames, captions, seeds, about, cleanup)

  @arguments.checked
  def multi_prompt(self, segments: Segments, *, rng: jax.Array | None = None, seed: int | None = None,
                   seeds: Iterable[int] | None = None, way: str = "stream", cleanup: bool = False, ease: bool = False,
                   **sampling: Any) -> Motion:
    """One motion of several prompts in sequence: [("a person walks", 4.0), ("he sits down", None), ...], in seconds.

    None is the model's default length. See `multi_prompts`; sampling: choices of `CmdmSampling`.
    """
    return self.multi_prompts([segments], rng=rng, seeds=seeds, seed=seed, way=way, cleanup=cleanup, ease=ease,
                              **sampling)[0]

  @arguments.checked
  def multi_prompts(self, lists: Iterable[Segments], *, rng: jax.Array | None = None,
                    seeds: Iterable[int] | None = None, seed: int | None = None, way: str = "stream",
                    cleanup: bool = False, ease: bool = False, **sampling: Any) -> Motions:
    """A motion as of `multi_prompt` for each of several lists of segments, in one batch; each is independent of the
    others. The captions of a motion say when each prompt plays.

    way: "stream" changes the prompt from block to block of one run, in which the old prompt's last blocks and the new
    one's first are denoised together; prompts then change on a grid of whole blocks (12 frames), to which lengths are
    rounded, and the end is cut to the requested sum. "chain" is the released code's: one run per prompt, conditioned on
    the last latent of the one before, lengths floored to whole latents (4 frames). ease: sudden changes of speed where
    prompts change are spread over 0.4 s (`motion.blending.eased`); features stay as sampled.
    """
    rows = [self.segments_of(one) for one in lists]
    if not rows:
      raise ValueError("got no prompts, expected a list of (prompt, seconds or None) for each motion")
    keys, seeds = keys_of(rng, seeds, len(rows), seed)
    return self.sample_segments(rows, keys, seeds, cleanup, sampling, way, ease)

  def sample_segments(self, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array, seeds: Sequence[int | None],
                      cleanup: bool, sampling: dict[str, Any], way: str = "stream", ease: bool | None = None
                      ) -> Motions:
    """A motion of each list of (prompt, frames), a key each; see `multi_prompts`. ease None: as cleanup."""
    if way not in multi.WAYS:
      raise InputError(f"got way {way!r}, expected one of {', '.join(multi.WAYS)}")
    ease = cleanup if ease is None else ease
    plan, chosen, contrast, about = self.plan_of(**sampling)
    prompts, counts = ([list(part) for part in parts] for parts in zip(*(zip(*segments) for segments in lists)))
    make = multi.stream if way == "stream" else multi.chain
    made, totals, ends = make(self, plan, chosen, prompts, counts, keys, contrast)
    captions = [captions_in_a_row(*row, self.fps) for row in zip(prompts, ends)]
    about |= {"way": way} | ({"eased": True} if ease else {})
    return make_motions(self, made, totals, captions, seeds, about, cleanup, ease)

  def segment_frames(self, frames: Sequence[int], way: str = "stream") -> list[int]:
    """The frames that each segment of `multi_prompt` gets where `frames` were requested, which are rounded by `way`."""
    return multi.segment_frames(frames, way, self.dit.block * self.frames_per_latent, self.frames_per_latent)

  @arguments.checked
  def extend(self, clip: Clip | Array, prompt: str | Segments, num_frames: int | None = None, *,
             seconds: float | None = None, past_prompt: str | None = None, rng: jax.Array | None = None,
             seed: int | None = None, seeds: Iterable[int] | None = None, way: str = "stream",
             num_past: int | None = None, cleanup: bool = False, **sampling: Any) -> Motion:
    """Continues an existing motion: a Clip of any source (`motion_jax.export.load` reads files), joints (T, J, 3), or
    features (T, F) as this model knows them, not normalized.

    prompt: a sentence, or segments as for `multi_prompt`. The clip's own frames come back unchanged, resampled if its
    rate is another; the new ones begin where it ends, on the clip's own bones. past_prompt: describes the clip (its own
    caption, else the new prompt). way: "stream" keeps the clip's last num_past latents (as many as the context holds)
    clean in the cache; "chain" is the released code's, 1 latent that gets fresh noise in every step.
    """
    if way not in multi.WAYS:
      raise ValueError(f"got way {way!r}, expected one of {', '.join(multi.WAYS)}")
    if num_past is not None and num_past < 1:
      raise ValueError(f"got num_past {num_past}, expected 1 latent or more to go on from")
    if isinstance(prompt, str):
      if num_frames is not None or seconds is not None:
        seconds = self.frames_of([prompt], num_frames, seconds)[0] / self.fps
      prompt = [(prompt, seconds)]
    rows = self.segments_of(prompt)
    clip = clip_of(clip, self.stats.layout)
    keys, seeds = keys_of(rng, seeds, 1, seed)
    plan, chosen, contrast, about = self.plan_of(**sampling)
    prompts, counts = ([*part] for part in zip(*rows))
    known = KnownMotion.of(at_rate(clip, self.fps, self.stats.layout.skeleton), self.stats.layout.skeleton)
    own = [caption.text for caption in clip.captions if caption.text.strip()]
    past_prompt = past_prompt or (own[-1] if own else prompts[0])
    made, ends, steps = multi.extend(self, plan, chosen, known.on_model, past_prompt, prompts, counts, keys, contrast,
                                     way, num_past, cleanup)
    about |= dict(prompt=" | ".join(prompts), seed=seeds[0], way=way, cleanup=bool(cleanup), past_prompt=past_prompt)
    new = known.continued(made, ends[-1], self.fps, cleanup)
    return go_on(self, clip, known.joints, new, captions_in_a_row(prompts, ends, self.fps), about, *steps)

  @arguments.checked
  def stream(self, prompt: str | Segments, *, rng: jax.Array | None = None, seed: int | None = None,
             seeds: Iterable[int] | None = None, num_frames: int | None = None, cleanup: bool = False,
             **sampling: Any) -> LiveStream:
    """Yields joints (n, J, 3) block after block, without end unless num_frames says so; memory stays flat.

    prompt: a sentence, or segments as for `multi_prompt`, the last of which has no end. `say` changes the prompt while
    it runs, see `LiveStream`. Driven by the same step as `generate` and `multi_prompts`: the same key gives the same
    motion, cleaned up or not.
    """
    if not self.can("stream"):
      raise InputError(f"{self.folder.name} has a tokenizer that looks ahead (tokenizer.causal=False), so it cannot be "
                       "streamed block after block; generate and multi_prompt make whole motions")
    keys, _ = keys_of(rng, seeds, 1, seed)
    plan, chosen, contrast, _ = self.plan_of(**sampling)
    if not plan.lag:
      raise ValueError("got schedule 'full': a stream runs by schedule 'fss' or 'ar'")
    rows = [(one, None) for one in self.prompts_of(prompt)] if isinstance(prompt, str) else self.segments_of(prompt)
    if num_frames is not None:
      self.frames_of([rows[0][0]], num_frames, None)
    return LiveStream(self, plan, chosen, keys, rows, num_frames, cleanup, contrast)

  def usual_sampling(self) -> dict[str, Any]:
    return dict(context=self.context)

  def plan_of(self, negative_prompts: Callable[[str], str] | Mapping[str, str] | None = None, **sampling: Any
              ) -> tuple[streaming.Plan, CmdmSampling, Contrast | None, dict[str, Any]]:
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
    negative = negative_prompts if callable(negative_prompts) else lambda prompt: negative_prompts.get(prompt, prompt)
    return plan, chosen, Contrast(negative, chosen.contrast_scale), about

  def segments_of(self, segments: Segments) -> list[tuple[str, int]]:
    """[(prompt, frames)] of the [(prompt, seconds or None)] of one motion, checked."""
    if isinstance(segments, str) or not len(segments) or any(isinstance(one, str) or len(one) != 2 for one in segments):
      raise ValueError(f"got the prompts {segments!r}, expected a list of (prompt, seconds or None)")
    prompts = self.prompts_of([prompt for prompt, _ in segments])
    found = [(prompt, self.frames_of([prompt], None, seconds)[0]) for prompt, (_, seconds) in zip(prompts, segments)]
    total = sum(count for _, count in found)
    if total > self.max_seconds * self.fps:
      raise ValueError(f"got prompts for {total / self.fps:.0f} s, expected at most {self.max_seconds:.0f}; a stream "
                       "has no end")
    return found


MODELS = {"cmdm.denoiser": CmdmModel}
TOKENIZERS = dict.fromkeys(("cmdm.tokenizer", "cmdm.denoiser"), round_trips.causal_vae)
