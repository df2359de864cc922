"""CMDM ready to use: motion from words, several prompts in a row, a motion that goes on, and live streams."""
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import jax

from motion_jax.control.signal import ControlSignal
from motion_jax.data.clip import Clip
from motion_jax.models import arguments
from motion_jax.models.base import Frames, Prompts, keys_of
from motion_jax.models.cmdm import multi_prompt as multi
from motion_jax.models.cmdm import streaming
from motion_jax.models.cmdm.guiding import Guide
from motion_jax.models.cmdm.live import LiveStream
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.known_motion import KnownMotion, at_rate, clip_of
from motion_jax.models.options import TRIES
from motion_jax.models.results import Motion, Motions, captions_in_a_row, gathered, go_on, make_motions
from motion_jax.shapes import Array
from motion_jax.utils import timing
from motion_jax.utils.numerals import checked
from motion_studio import controlled
from motion_studio.controlled import Control
from motion_studio.planning import sequencing as composed
from motion_studio.planning.independent import made_apart
from motion_studio.planning.segments import prompts_in_a_row

# Where constraints pull: conjugate gradient steps each time, and Gauss-Newton steps when all is finished.
CONTROL_STEPS, SETTLES = 2, 3
_LEAST = 12  # frames that one of several actions of a prompt gets: a block
Segments = Sequence[tuple[str, float | None]]  # prompts and their seconds


class CmdmModel(CmdmNetworks):
  """CMDM ready to use: prompts in, motion out. Made by `load`."""
  abilities = ("generate", "understand", "stream", "multi_prompt", "extend", "reconstruct")
  options = CmdmSampling
  control_choices = ("control_steps", "settles")

  @arguments.checked
  def generate(self, prompts: Prompts, num_frames: Frames = None, *, seconds: Frames = None,
               rng: jax.Array | None = None, seeds: Iterable[int] | None = None, seed: int | None = None,
               cleanup: bool = True, literal: bool = False, control: Control = None, project: bool = True,
               tries: int = TRIES, **sampling: Any) -> Motions:
    """Motions for one prompt or several, of the given length each (one number or one per prompt).

    A prompt of several actions ("walks, then waves", "waves while walking") is done action by action, as
    `understand(prompt)` says it is understood; literal: its words go to the network as they are, as those of a single
    action always do. A length is shared among the actions. Where kicks, jumps, waves, turns and
    the like that it asks for are not to be seen, or not as many, a motion is made anew, up to `tries` in all
    (`models.looking`; 1: what comes first).
    rng: a key, of which prompt i gets fold_in(rng, i), so that a motion does not depend on its batch-mates; or seeds,
    one integer per prompt. sampling: guidance_scale, schedule, num_steps, lag, ... of `CmdmSampling`; by default the
    model's own. Without a length it is that of the nearest training captions. cleanup: standing feet are
    planted and tremor is taken away (`motion.cleanup`); features stay as they were made. Raises ValueError for an empty
    prompt or a length that is not positive or over an hour.
    """
    prompts = self.prompts_of(prompts, literal)
    keys, seeds = keys_of(rng, seeds, len(prompts), seed)
    return controlled.generate(self, prompts, num_frames, seconds, keys, seeds, cleanup, literal, sampling, control,
                               project, checked(tries, 1, 100, "tries"))

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: ControlSignal | None = None) -> Motions:
    """Motions of prompts that are said to the network as they are, a key each; see `sample_controlled`."""
    sampling = dict(sampling)
    control_steps, settles = (checked(sampling.pop(name, usual), 0, 100, name) for name, usual in (
        ("control_steps", CONTROL_STEPS), ("settles", SETTLES)))
    plan, chosen, about = self.plan_of(**sampling)
    # Whole blocks are independent of what follows them; a few more of them spare a compilation for every new length.
    blocks = -(-max(frames) // (plan.block * self.vae.frames_per_latent * 4)) * 4
    plan = plan._replace(context=min(plan.context, max(self.context, blocks * plan.block)))  # no more than there is
    run = self.compiled.generate if plan.lag else self.compiled.generate_whole
    if not plan.lag:
      plan = plan._replace(context=max(plan.context, blocks * plan.block))
    with timing.part("text"):
      text_emb, text_mask = self.encode_words(prompts, chosen.side_guidance)
    held: dict[str, Any] = {}
    if signal is not None:
      signal = signal.slice_frames(0, blocks * plan.block * self.frames_per_latent)
      held = dict(control=signal) if self.dit.control else {}
      held |= dict(guide=Guide.of(self.codec, self.stats, signal, control_steps, settles)) if control_steps else {}
      about |= dict(control_steps=control_steps, settles=settles)
    made = run(plan.fitted(blocks), blocks, self.params, self.codec, text_emb=text_emb, text_mask=text_mask,
               scale=chosen.guidance_scale, keys=keys, **held)
    captions = [captions_in_a_row([prompt], [count], self.fps) for prompt, count in zip(prompts, frames)]
    return make_motions(self, made, frames, captions, seeds, about, cleanup)

  def sample_controlled(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array,
                        seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], signal: ControlSignal
                        ) -> Motions:
    """As `sample`, led towards what signal (B, longest) asks: a network that was trained for it is told it, and latents
    are pulled to it while they are denoised (`models.cmdm.guiding`), by as many conjugate gradient steps in every
    second iteration as sampling["control_steps"] says (0: not pulled), and sampling["settles"] times more when all are
    finished, which no stream can."""
    return self.sample(prompts, frames, keys, seeds, cleanup, sampling, signal)

  @arguments.checked
  def multi_prompt(self, segments: Segments, *, rng: jax.Array | None = None, seed: int | None = None,
                   seeds: Iterable[int] | None = None, way: str = "stream", cleanup: bool = True, rest: bool = False,
                   hold_until_done: bool = False, ease: bool = False, literal: bool = False, **sampling: Any) -> Motion:
    """One motion from several prompts in a row: [("a person walks", 4.0), ("he sits down", None), ...], in seconds.

    None is the length of similar training clips. See `multi_prompts`; sampling: choices of `CmdmSampling`.
    """
    return self.multi_prompts([segments], rng=rng, seeds=seeds, seed=seed, way=way, cleanup=cleanup, rest=rest,
                              hold_until_done=hold_until_done, ease=ease, literal=literal, **sampling)[0]

  @arguments.checked
  def multi_prompts(self, lists: Iterable[Segments], *, rng: jax.Array | None = None,
                    seeds: Iterable[int] | None = None, seed: int | None = None, way: str = "stream",
                    cleanup: bool = True, rest: bool = False, hold_until_done: bool = False, ease: bool = False,
                    literal: bool = False, **sampling: Any) -> Motions:
    """A motion as of `multi_prompt` for each of several lists of segments, in one batch, of which none of them knows.
    The captions of a motion say when each prompt plays. A prompt of several actions is as many prompts, which share its
    seconds (`models.segments`); literal: every prompt is said to the network as it is.

    way: "stream" changes the words from block to block of one run, in which the old prompt's last blocks and the new
    one's first are denoised together; prompts then change on a grid of whole blocks (12 frames), to which lengths are
    rounded, and the end is cut to the sum that was asked. "chain" is the released code's: one run per prompt behind the
    last latent of the one before, lengths floored to whole latents (4 frames). "joined" makes each prompt by itself and
    joins them where poses meet, up to 14 frames from where it is asked, which no stream could do.
    rest: an action that is over before its seconds are, such as a bow, ends in standing still. hold_until_done: an
    action that is done once has at least the time that clips of it in training have, and the next words wait. ease:
    what hastens where the words change is spread over 0.4 s (`motion.blending.eased`); features stay as they were made.
    """
    told = [self.segments_of(one, literal) for one in lists]
    if not told:
      raise ValueError("got no prompts, expected a list of (prompt, seconds or None) for each motion")
    if way not in multi.WHOLE_WAYS:
      raise ValueError(f"got way {way!r}, expected one of {', '.join(multi.WHOLE_WAYS)}")
    keys, seeds = keys_of(rng, seeds, len(told), seed)
    if hold_until_done:
      told = [[(prompt, max(count, composed.took_of(self, prompt))) for prompt, count in row] for row in told]
    if rest:
      return composed.rested(self, told, keys, seeds, cleanup, sampling, way=way, ease=ease)
    return self.in_a_row(told, keys, seeds, cleanup, sampling, way, ease)

  def in_a_row(self, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array, seeds: Sequence[int | None],
               cleanup: bool, sampling: dict[str, Any], way: str = "stream", ease: bool | None = None) -> Motions:
    """A motion of each list of (prompt, frames), a key each; see `multi_prompts`. ease None: what is cleaned up is."""
    ease = cleanup if ease is None else ease
    if way == multi.JOINED:  # what hastens at borders is spread by the joining already
      return gathered(made_apart(self, lists, keys, seeds, cleanup, sampling))
    plan, chosen, about = self.plan_of(**sampling)
    prompts, counts = ([list(part) for part in parts] for parts in zip(*(zip(*segments) for segments in lists)))
    make = multi.stream if way == "stream" else multi.chain
    made, totals, ends = make(self, plan, chosen, prompts, counts, keys)
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
             num_past: int | None = None, cleanup: bool = True, literal: bool = False, **sampling: Any) -> Motion:
    """Continues a motion that exists: a Clip of any source (`motion_jax.export.load` reads files), joints (T, J, 3), or
    features (T, F) as this model knows them, not normalized.

    prompt: a sentence, or segments as for `multi_prompt`. The clip's own frames come back as they were, resampled if
    its rate is another; the new ones begin where it ends, on the clip's own bones. past_prompt: what the clip shows
    (its own caption, else the new prompt). way: "stream" keeps the clip's last num_past latents (as many as the context
    holds) clean in the cache; "chain" is the released code's, 1 latent that is noised anew in every step.
    """
    if way not in multi.WAYS:
      raise ValueError(f"got way {way!r}, expected one of {', '.join(multi.WAYS)}")
    if num_past is not None and num_past < 1:
      raise ValueError(f"got num_past {num_past}, expected 1 latent or more to go on from")
    if isinstance(prompt, str):
      if num_frames is not None or seconds is not None:
        seconds = self.frames_of([prompt], num_frames, seconds)[0] / self.fps
      prompt = [(prompt, seconds)]
    rows = self.segments_of(prompt, literal)
    clip = clip_of(clip, self.stats.layout)
    keys, seeds = keys_of(rng, seeds, 1, seed)
    plan, chosen, about = self.plan_of(**sampling)
    prompts, counts = ([*part] for part in zip(*rows))
    known = KnownMotion.of(at_rate(clip, self.fps, self.stats.layout.skeleton), self.stats.layout.skeleton)
    said = [caption.text for caption in clip.captions if caption.text.strip()]
    past_prompt = past_prompt or (said[-1] if said else prompts[0])
    made, ends = multi.extend(self, plan, chosen, known.on_model, past_prompt, prompts, counts, keys, way, num_past,
                              cleanup)
    about |= dict(prompt=" | ".join(prompts), seed=seeds[0], way=way, cleanup=bool(cleanup), past_prompt=past_prompt)
    new = known.continued(made, ends[-1], self.fps, cleanup)
    return go_on(self, clip, known.joints, new, captions_in_a_row(prompts, ends, self.fps), about)

  @arguments.checked
  def stream(self, prompt: str, *, rng: jax.Array | None = None, seed: int | None = None,
             seeds: Iterable[int] | None = None, num_frames: int | None = None, cleanup: bool = True,
             hold_until_done: bool = False, literal: bool = False, **sampling: Any) -> LiveStream:
    """Yields joints (n, J, 3) block after block, without end unless num_frames says so; memory stays flat.

    A prompt of several actions is said action by action, the last without end; literal: every prompt as it is.
    `say` changes the words while it runs, see `LiveStream`. Driven by the very step that `generate` and `multi_prompts`
    run: the same key gives the same motion, cleaned or not. hold_until_done: new words wait until an action that is
    done once, such as a kick, has had the time that clips of it in training have.
    """
    self.check_words([prompt], literal)
    keys, _ = keys_of(rng, seeds, 1, seed)
    plan, chosen, _ = self.plan_of(**sampling)
    if not plan.lag:
      raise ValueError("got schedule 'full': a stream runs by schedule 'fss' or 'ar'")
    if num_frames is not None:
      self.frames_of([prompt], num_frames, None)
    return LiveStream(self, plan, chosen, keys, prompt, num_frames, cleanup,
                      partial(composed.took_of, self) if hold_until_done else None,
                      None if literal else partial(prompts_in_a_row, self, least=_LEAST))

  def usual_sampling(self) -> dict[str, Any]:
    return dict(context=self.context)

  def plan_of(self, **sampling: Any) -> tuple[streaming.Plan, CmdmSampling, dict[str, Any]]:
    """(plan for motions of any length, all choices of sampling, what a file says of them) of some `CmdmSampling`."""
    chosen = self.sampling(**sampling)
    guided = chosen.guidance_scale != 1.0
    plan = streaming.make_plan(chosen.num_steps, chosen.steps_apart or 1, self.dit.block, chosen.context, guided=guided,
                               solver=chosen.solver, memory=chosen.memory)
    plan = plan._replace(lag=chosen.steps_apart)
    return plan, chosen, chosen.about() | dict(model=self.id)

  def segments_of(self, given: Segments, literal: bool = False) -> list[tuple[str, int]]:
    """[(prompt, frames)] of the [(prompt, seconds or None)] of one motion, a row for each action that a prompt names;
    literal: one for each prompt."""
    if isinstance(given, str) or not len(given) or any(isinstance(part, str) or len(part) != 2 for part in given):
      raise ValueError(f"got the prompts {given!r}, expected a list of (prompt, seconds or None)")
    self.check_words([prompt for prompt, _ in given], literal)
    found = []
    for prompt, seconds in given:
      frames = None if seconds is None else self.frames_of([prompt], None, seconds)[0]
      rows = [(prompt, frames)] if literal else prompts_in_a_row(self, prompt, frames, _LEAST)
      found += [(said, self.frames_of([said], count, None)[0]) for said, count in rows]
    total = sum(count for _, count in found)
    if total > self.max_seconds * self.fps:
      raise ValueError(f"got prompts for {total / self.fps:.0f} s, expected at most {self.max_seconds:.0f}; a stream "
                       "has no end")
    return found


MODELS = {"cmdm.denoiser": CmdmModel}
