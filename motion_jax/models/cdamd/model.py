"""CDAMD ready to use: motion from words, and new parts for a motion that exists."""
import dataclasses
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from motion_jax.control.signal import ControlSignal
from motion_jax.data.clip import Caption, Clip
from motion_jax.latents import AutoencoderCodec
from motion_jax.models import arguments, cdamd
from motion_jax.models.base import Frames, Prompts, TextToMotionModel, keys_of
from motion_jax.models.cdamd import draws
from motion_jax.models.cdamd import length as lengths
from motion_jax.models.cdamd import mask_schedule as masking
from motion_jax.models.cdamd.guiding import Settling
from motion_jax.models.cdamd.options import CdamdSampling
from motion_jax.models.cdamd.unmasking import most_unmasked
from motion_jax.models.known_motion import clip_of, on_our_body
from motion_jax.models.options import TRIES
from motion_jax.models.results import Motion, Motions, captions_in_a_row, features_of, gathered, make_motions
from motion_jax.motion.blending import join, laid_over
from motion_jax.motion.cleanup import clean_up
from motion_jax.motion.filling import runs_of
from motion_jax.motion.representations import get_layout
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.nets.masks import padding_mask
from motion_jax.runs import Run
from motion_jax.shapes import Array
from motion_jax.text.captions import of_a_person
from motion_jax.text.encoder import TextEncoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.numerals import checked
from motion_studio import controlled, editing
from motion_studio.checks.path_shapes import least_seconds
from motion_studio.controlled import Control
from motion_studio.language.actions import going_forward, sides_of, with_one_hand
from motion_studio.language.sentences import Action, Sentence

CONTROL_STEPS = 4  # of Gauss-Newton, where constraints pull
_PAST = 8  # frames of a motion behind which it goes on; behind more of them a second squat is left out: one is seen

Editable = Clip | Array  # a clip of any source, joints (T, J, 3), or features (T, F), not normalized
Spans = Sequence[Sequence[int]]  # [(first frame, the one behind the last), ...]


def _as_captions_say(action: Action) -> Action:
  """The action in the words of captions by kinematics."""
  prompt = with_one_hand(going_forward(action.prompt))
  if prompt == action.prompt or action.times > 1:
    return action
  who = action.prompt.removesuffix(action.words)
  return action._replace(prompt=prompt, words=prompt.removeprefix(who), sides=sides_of(prompt.split()),
                         reworded=True)


class CdamdModel(TextToMotionModel):
  """CDAMD or MARDM ready to use: prompts in, motion out; a motion in, the same one with new parts out."""
  abilities = ("generate", "understand", "edit")
  options = CdamdSampling
  control_choices = ("control_steps", "settles")

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), sampler__guidance_scale=(-1e3, 1e3))
    self.autoencoder = Autoencoder(**module_fields(config.tokenizer))
    self.net = cdamd.make_generator(config.model)
    self.max_seconds = config.data.max_frames / get_layout(config.data.layout).skeleton.fps
    shapes = cache.kept_shapes("cdamd.frozen", self.autoencoder, lambda: cdamd.frozen_shapes(self.autoencoder))
    text_dim = self.net.transformer.text_dim
    self.length = LengthEstimator(**module_fields(config.length)) if config.length else None
    if self.length:
      shapes["length"] = lengths.length_shapes(self.length, text_dim)
    super().__init__(run, encoder, text_dim, self.autoencoder.frames_per_latent, shapes,
                     cache.kept_shapes("cdamd.generator", self.net, lambda: cdamd.generator_shapes(self.net)))
    # All motions are padded to the training length, whose positions are known, and compiled once.
    self.max_latents = config.data.max_frames // self.frames_per_latent
    self.codec = AutoencoderCodec.of(self.autoencoder, self.frozen)
    self._generate = cache.Program("cdamd.generate", partial(_generate, self.net), 1, (self.net,))
    self._edit = cache.Program("cdamd.edit", partial(_edit, self.net), 1, (self.net,))

  def natural_frames(self, prompt: str) -> int:
    """How long such motions are: what the length estimator says or, without one, the nearest training captions."""
    if self.length is None:
      return super().natural_frames(prompt)
    logits: Any = self.length.apply(self.frozen["length"], self.encoder([of_a_person(prompt)])[0][:, 0])
    usual = lengths.middle_frames(logits, self.frames_per_latent)[0]
    return int(min(max(usual, least_seconds(prompt) * self.fps), self.config.data.max_frames))

  def understand(self, prompt: str) -> Sentence:
    """As of any model; of one that learned captions by kinematics "walks" is understood as "walks forward", and
    "punches" as "punches with the left hand"."""
    sentence = super().understand(prompt)
    if not self.config.data.get("kinematic_captions", False):
      return sentence
    return sentence.with_segments(tuple(part._replace(
        action=_as_captions_say(part.action), simultaneous=tuple(map(_as_captions_say, part.simultaneous)))
        for part in sentence.segments))

  @arguments.checked
  def generate(self, prompts: Prompts, num_frames: Frames = None, *, seconds: Frames = None,
               rng: jax.Array | None = None, seeds: Iterable[int] | None = None, seed: int | None = None,
               cleanup: bool = True, literal: bool = False, control: Control = None, project: bool = True,
               tries: int = TRIES, **sampling: Any) -> Motions:
    """Motions for one prompt or several, of the given length each (one number or one per prompt).

    A prompt of several actions ("walks, then waves", "waves while walking") is done action by action, as
    `understand(prompt)` says it is understood, each action an edit behind the last 0.4 s of the one before;
    literal: its words go to the network as they are, as those of a single action always do. A length is shared among
    the actions. Where kicks, jumps, waves, turns and the like that it asks for are not to be seen, or not as many,
    a motion is made anew, up to `tries` in all (`models.looking`; 1: what comes first).
    rng: a key, of which prompt i gets fold_in(rng, i); or seeds, one integer per prompt. With a solver of fixed steps a
    motion does not depend on its batch-mates. Lengths are cut to whole latents (4 frames); without one it is
    `natural_frames`. sampling: choices of `CdamdSampling`. Raises ValueError for what cannot be made.
    """
    prompts = self.prompts_of(prompts, literal)
    keys, seeds = keys_of(rng, seeds, len(prompts), seed)
    return controlled.generate(self, prompts, num_frames, seconds, keys, seeds, cleanup, literal, sampling, control,
                               project, checked(tries, 1, 100, "tries"))

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: ControlSignal | None = None) -> Motions:
    """Motions of prompts that are said to the network as they are, a key each; see `sample_controlled`."""
    sampling = dict(sampling)
    steps = sum(checked(sampling.pop(name, usual), 0, 100, name) for name, usual in (
        ("control_steps", CONTROL_STEPS), ("settles", 0)))
    frames = [count // self.frames_per_latent * self.frames_per_latent for count in frames]
    every = np.arange(self.max_latents) < np.array(frames)[:, None] // self.frames_per_latent
    plan, masked, scale, about = self._tables(keys, every, **sampling)
    text_emb, text_mask = self.encode_words(prompts)
    held: dict[str, Any] = {}
    if signal is not None and steps:
      signal = signal.slice_frames(0, self.max_latents * self.frames_per_latent)
      held, about = dict(settling=Settling.of(self.stats, signal, steps)), about | dict(control_steps=steps)
    made = self._generate(plan, self.params, self.codec, text_emb=text_emb, text_mask=text_mask, masked=masked,
                          real_mask=jnp.asarray(every), scale=scale, keys=keys, **held)
    captions = [captions_in_a_row([prompt], [count], self.fps) for prompt, count in zip(prompts, frames)]
    return make_motions(self, made, frames, captions, seeds, about, cleanup)

  def sample_controlled(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array,
                        seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], signal: ControlSignal
                        ) -> Motions:
    """As `sample`, led towards what signal (B, longest) asks: finished latents are pulled to it through the decoder
    (`models.cdamd.guiding`), in as many Gauss-Newton steps as sampling["control_steps"] says; 0: not pulled.
    sampling["settles"] is more of them."""
    return self.sample(prompts, frames, keys, seeds, cleanup, sampling, signal)

  def in_a_row(self, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array, seeds: Sequence[int | None],
               cleanup: bool, sampling: dict[str, Any]) -> Motions:
    """A motion of each list of (prompt, frames), a key each: the first is made of words alone, and each further one
    behind the end of what there is, as an edit that keeps that end."""
    first = self.sample([row[0][0] for row in lists], [row[0][1] for row in lists], keys, seeds, False, sampling)
    return gathered([self._gone_on(motion, row[1:], key, cleanup, sampling)
                     for motion, row, key in zip(first, lists, keys)])

  def _gone_on(self, motion, segments, key, cleanup, sampling):
    """The motion with each of segments [(prompt, frames)] behind it."""
    joints, layout = motion.joints, self.stats.layout
    prompts, ends = [motion.captions[0].text], [motion.num_frames]
    for i, (prompt, frames) in enumerate(segments):
      end = ends[-1] + max(frames // self.frames_per_latent, 1) * self.frames_per_latent
      while len(joints) < end:
        past = joints[-_PAST:]
        past = past[len(past) % self.frames_per_latent:]
        count = min(end - len(joints), self.max_latents * self.frames_per_latent - len(past))
        given = features_of(self, np.concatenate([past, np.repeat(past[-1:], count, axis=0)]))
        new = np.arange(len(given)) >= len(past)
        rng = jax.random.fold_in(jax.random.fold_in(key, i + 1), len(joints))
        sampling = sampling | dict(mask=sampling.get("mask") or self.config.sampler.edit_mask)
        made, _ = self.remake([given], [new], [prompt], keys_of(rng, None, 1)[0], sampling)
        known, shown = (np.array(layout.to_joints(x)) for x in (given, made[0]))
        new_joints = join(shown, known, ~new)
        joints = np.concatenate([joints, laid_over(new_joints.astype(np.float64), past, len(past))]).astype(np.float32)
      prompts.append(prompt)
      ends.append(len(joints))
    if cleanup and layout.has_fixed_bones:
      joints = clean_up(joints, skeleton=layout.skeleton)
    return motion.replace(joints=joints, features=features_of(self, joints), meta=motion.meta | dict(
        cleanup=bool(cleanup)), captions=captions_in_a_row(prompts, ends, self.fps))

  def edit(self, clip: Editable, prompt: str, task: str | None = None, *, rng: jax.Array | None = None,
           seed: int | None = None, seeds: Iterable[int] | None = None, **choices: Any) -> Motion:
    """A motion that exists with parts of it made as the words say, the others kept; see `edits`."""
    return self.edits([clip], [prompt], task, rng=rng, seeds=seeds, seed=seed, **choices)[0]

  @arguments.checked
  def edits(self, clips: Sequence[Editable], prompts: Sequence[str], task: str | None = None, *,
            keep: Spans | None = None, change: Spans | None = None, rng: jax.Array | None = None,
            seeds: Iterable[int] | None = None, seed: int | None = None, paste: bool = True, cleanup: bool = True,
            tries: int = TRIES, mask: str | None = None, **sampling: Any) -> Motions:
    """Clips with parts of them made, each as its prompt says, in one batch.

    clips: of any source, or arrays: joints (T, J, 3), or features (T, F) as this model knows them, not normalized.
    Which parts: a task of `inputs.spans.TASKS`, or spans to keep or to change, [(0, 30), ...] in frames of this model
    (`inputs.spans.spans_of` reads "0:1.5s"), the same in every clip. meta["made"] lists the frames that are new.
    All other frames come back as and where they were, resampled if the clip's rate is another; new ones continue them
    on the clip's own body (`models.editing`), with feet pinned unless cleanup is False. Of a motion longer than the
    model knows the seconds around the new frames are remade. tries: how often at most new frames are made that do not
    show what the prompt requires (`models.looking`). mask: what new latents may attend to, `nets.masks`; without it
    config.sampler.edit_mask. paste False: the network's own motion, with whole latents made, nothing put back and
    nothing finished, where the model begins: the body at the origin, facing +z.
    """
    # Parity: the released code pastes nothing back; paste=False is the benchmark's.
    self.check_words(list(dict.fromkeys(prompts)))
    if len(prompts) != len(clips) or not clips:
      raise ValueError(f"got {len(prompts)} prompts for {len(clips)} clips; give one for each")
    if sum(choice is not None for choice in (task, keep, change)) != 1:
      raise ValueError("say what to make by one of task, keep and change")
    keys, seeds = keys_of(rng, seeds, len(clips), seed)
    sampling["mask"] = mask or self.config.sampler.edit_mask
    if not paste:
      return self._as_decoded(clips, prompts, task, keep, change, keys, seeds, cleanup, sampling)
    new = partial(_requested, task, keep, change)
    return editing.edits(self, clips, prompts, new, keys, seeds, cleanup, checked(tries, 1, 100, "tries"), sampling,
                         task or "spans")

  def _as_decoded(self, clips, prompts, task, keep, change, keys, seeds, cleanup, sampling):
    """Edits as the paper makes them: whole latents, decoded with all others."""
    given, clips, unit = clips, [clip_of(clip, self.stats.layout) for clip in clips], self.frames_per_latent
    features = [clip.features if clip is not one and clip.features is not None else
                features_of(self, on_our_body(clip, self.fps, self.stats.layout.skeleton))
                for one, clip in zip(given, clips)]
    frames = [len(x) // unit * unit for x in features]
    for count, x in zip(frames, features):
      if not unit <= count <= self.config.data.max_frames:
        raise ValueError(f"got a motion of {len(x)} frames at {self.fps:g} frames a second, expected {unit} to "
                         f"{self.config.data.max_frames}; cut a part out of it")
    edited = np.concatenate([self._edited(task, keep, change, count) for count in frames])
    made, about = self._remade([x[:count] for x, count in zip(features, frames)], edited, prompts, keys, sampling)
    motions = make_motions(self, made, frames, [(Caption(prompt),) for prompt in prompts], seeds,
                           about | dict(task=task or "spans", pasted=False), cleanup)
    new = [[list(run) for run in runs_of(np.repeat(row, unit)[:count])] for row, count in zip(edited, frames)]
    return dataclasses.replace(motions, motions=tuple(
        motion.replace(id=clip.id, license=clip.license or self.license,
                       meta=motion.meta | dict(edited=clip.source or clip.id, made=runs))
        for motion, clip, runs in zip(motions, clips, new)))

  def remake(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
             prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
             ) -> tuple[list[Float[np.ndarray, "_ f"]], dict[str, Any]]:
    """(features (T, F) of each motion as the network has them, not normalized, what a file says of the sampling):
    latents with any new frame, of new (T,), are made, all are decoded. A motion may end within a latent."""
    edited = np.zeros((len(features), self.max_latents), bool)
    for row, flags in zip(edited, new):
      row[np.flatnonzero(flags) // self.frames_per_latent] = True
    made, about = self._remade(features, edited, prompts, keys, sampling)
    return [self.stats.denormalize(x[:len(given)]) for x, given in zip(made, features)], about

  def _remade(self, features, edited, prompts, keys, sampling):
    """(normalized features (B, T, F), what a file says of the sampling) of features [(T, F)], not normalized, whose
    latents edited (B, L) are made."""
    plan, masked, scale, about = self._tables(keys, edited, **sampling)
    unit, length = self.frames_per_latent, self.max_latents * self.frames_per_latent
    padded = np.zeros((len(features), length, self.stats.layout.dim), np.float32)
    for row, x in zip(padded, features):  # the last frame fills its latent
      row[:len(x) + -len(x) % unit] = self.stats.normalize(np.pad(x, ((0, -len(x) % unit), (0, 0)), mode="edge"))
    real = padding_mask(jnp.array([-(-len(x) // unit) for x in features]), self.max_latents)
    text_emb, text_mask = self.encode_words(prompts)
    made = self._edit(plan, self.params, self.codec, padded, text_emb=text_emb, text_mask=text_mask, masked=masked,
                      real_mask=real, scale=scale, keys=keys)
    return np.asarray(made), about

  def encode_words(self, prompts: Sequence[str]) -> tuple[Array, Array | None]:
    """(text_emb, text_mask or None) as the model was trained: sentence vectors, or these and their words."""
    if self.encoder.level == "sentence":
      return self.encoder(prompts)[0], None
    return self.encoder.sentence_and_words(prompts, at_least=min(self.config.data.max_words, self.encoder.max_words))

  def _tables(self, keys, editable, **sampling):
    """(Plan, masked (N, B, L), guidance scale, what a file says of them) for latents editable (B, L)."""
    chosen = self.sampling(**sampling)
    order_of = draws.draw_order(keys, np.full(len(keys), self.max_latents), self.max_latents, chosen.order)
    counts = masking.masked_counts(chosen.num_iterations, editable.sum(-1))
    masked = masking.masked_table(np.where(editable, order_of, np.inf), counts)
    # Rounded up to even numbers, so that few lengths are compiled anew.
    most = 2 * -(-most_unmasked(counts) // 2)
    plan = cdamd.make_plan(solver=chosen.solver, num_steps=chosen.num_steps, mask=chosen.mask,
                           guided=chosen.guidance_scale != 1.0, num_rows=most if chosen.unmasked_only else None,
                           ddpm_steps=self.config.loss.ddpm_steps, temperature=chosen.temperature,
                           shared_noise=chosen.shared_noise)
    return plan, masked, chosen.guidance_scale, chosen.about() | dict(model=self.id)

  def _edited(self, task, keep, change, count):
    """(1, L): the latents of a clip of count frames that are made, where kept ones are kept whole or not at all."""
    if task is not None:
      edited = masking.task_mask(task, [count], self.max_latents, self.frames_per_latent)
    else:
      kept = masking.in_spans(keep, count) if keep is not None else ~masking.in_spans(change, count)
      edited = masking.kept_mask(list(runs_of(kept)), count, self.max_latents, self.frames_per_latent)[None]
    if not edited.any():
      raise ValueError("everything is kept, so there is nothing to make")
    return edited


MODELS = {"cdamd.generator": CdamdModel}


def _requested(task, keep, change, num_frames):
  """(num_frames,): the frames that one of task, keep and change requests."""
  if task is not None:
    return editing.task_frames(task, num_frames)
  return masking.in_spans(change, num_frames) if keep is None else ~masking.in_spans(keep, num_frames)


def _draw(net, plan, keys, real):
  return draws.make_draw(keys, real.shape[1], net.transformer.latent_dim, plan.shared_noise)


def _generate(net, plan, params, codec, *, keys, real_mask, **given):
  return cdamd.generate(net, plan, params, codec, real_mask=real_mask, draw=_draw(net, plan, keys, real_mask), **given)


def _edit(net, plan, params, codec, features, *, keys, real_mask, **given):
  return cdamd.edit(net, plan, params, codec, features, real_mask=real_mask, draw=_draw(net, plan, keys, real_mask),
                    **given)
