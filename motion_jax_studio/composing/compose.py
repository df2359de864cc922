"""A data set made by the application: sampled motions that meet all requirements of their prompts, as an archive.

Prompts come from a grammar and, optionally, from people's sentences. Each is sampled by the whole pipeline; a motion is
kept if the plan of its prompt has requirements, it violates none of them, and bones and feet are sound. The archive
(`motion_jax.data.datasets.archive`) has the whole caption of each clip, the captions of its segments as spans, the
seed, and how far the correction step moved a joint. Prompt, seed and motion are functions of (seed, number), so that an
interrupted run continues where it stopped and gives the same archive.

With `group`, each prompt is sampled that often in one pass of the network, without plan and corrections, and all of its
motions are kept with their rewards, for training on scored samples (`diffusion.negative_aware`).
"""
import hashlib
import json
import pathlib
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from motion_jax.data.batches import step_rng
from motion_jax.data.datasets.archive import ABOUT
from motion_jax.diffusion import negative_aware
from motion_jax.metrics import physics
from motion_jax.models.results import Motion
from motion_jax.motion import plausibility
from motion_jax.utils import progress
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.format_versions import KEY
from motion_jax.utils.input_files import load_npz, read_json, read_json_lines
from motion_jax_studio.checks.violations import violation_score
from motion_jax_studio.composing import grammar
from motion_jax_studio.composing.apart import Apart, read_sentences
from motion_jax_studio.language import Plan
from motion_jax_studio.pipeline import Pipeline
from motion_jax_studio.planning.segments import prompts_in_sequence

CHUNK = 96            # prompts of one call, which is written as a file
LONGEST = 196         # frames
_SQUEEZED = 1.35      # longest usual length, as a factor on LONGEST, that is sampled in LONGEST frames
_PEOPLE = 0.35        # share of prompts from people's sentences, if there are any
# Limits of sound motion: 99 of 100 clips of bandai and CMU that are decoded and cleaned up lie inside.
_MET = 0.05  # largest violation score of a requirement that counts as met
_ONE_PASS = ("plan", "warn", "cleanup", "pose", "correct", "check")
_MOST = {"bone_drift": 0.02, "floating": 0.08, "planted_speed": 0.25}
_ROWS, _JOINTS = "rows.jsonl", "joints.npz"


class Prompt(NamedTuple):
  """A prompt, where it is from ("grammar" or "people"), and the seed of its motion."""
  text: str
  origin: str
  seed: int


def compose(out: str | pathlib.Path, model: Any = "cmdm-small", number: int = 8000, seed: int = 0,
            sentences: str | pathlib.Path = "", apart: Iterable[str | pathlib.Path] = (), attempts: int = 3,
            group: int = 0) -> str:
  """Writes an archive of motions that the application made from `number` prompts; returns a summary.

  sentences: a file of people's sentences (`apart.read_sentences`); of a .jsonl its split "train". apart: files of
  evaluation sentences; prompts within `apart.MARGIN` words of one are skipped. attempts: samples per prompt at most.
  group: samples in one pass per prompt, all kept and scored; 0: the best of the application, if it passes.
  An existing folder of the same choices is continued, with more prompts too. Raises InputError for a folder of other
  choices, or of another model, and if nothing is kept, or no rewards differ.
  """
  out, lists = pathlib.Path(out), [pathlib.Path(path) for path in apart]
  people = read_sentences(sentences, "train" if pathlib.Path(sentences).suffix == ".jsonl" else "") if sentences else []
  far = Apart(text for path in lists for text in read_sentences(path))
  pipeline = Pipeline(model)
  pipeline.warns = False
  about = dict(composed_by=pipeline.model.id, license=_license_of(pipeline.model), seed=seed, attempts=attempts,
               group=group, sentences=_digest(people), apart=[path.name for path in lists])
  _check(out, about)
  (out / "parts").mkdir(parents=True, exist_ok=True)
  if not (out / ABOUT).exists():
    with atomic_path(out / ABOUT) as path:
      path.write_text(json.dumps({KEY: 1} | about, indent=1) + "\n")
  chunks = [range(first, min(first + CHUNK, number)) for first in range(0, number, CHUNK)]
  for chunk in progress.each(chunks, "composing", unit="chunk"):
    folder = out / "parts" / f"{chunk.start:06d}"
    if _size_of(folder) != len(chunk):
      prompts = [prompt_of(seed, place, people) for place in chunk]
      _write_part(folder, len(chunk), *_chunk(pipeline, chunk.start, prompts, far, attempts, group))
  return _assemble(out, [out / "parts" / f"{chunk.start:06d}" for chunk in chunks], number)


def prompt_of(seed: int, number: int, people: Sequence[str] = ()) -> Prompt:
  """Prompt `number` of a seed."""
  rng = step_rng(seed, 22, number)
  if people and rng.random() < _PEOPLE:
    return Prompt(people[rng.integers(len(people))], "people", int(rng.integers(2**31)))
  return Prompt(grammar.prompt(seed, number), "grammar", int(rng.integers(2**31)))


def _chunk(pipeline, first, prompts, far, attempts, group):
  """(rows, joints of each) of the motions that are kept, and why the others are not: {reason: number}."""
  chosen, left = _chosen(pipeline, first, prompts, far)
  rows, joints = [], []
  if group:
    for number, prompt, plan, frames in chosen:
      motions = pipeline([prompt.text] * group, frames, seeds=range(prompt.seed, prompt.seed + group),
                         without=_ONE_PASS)
      rows += [_scored_row(number, place, prompt, plan, motion) for place, motion in enumerate(motions)]
      joints += [np.asarray(motion.joints, np.float32) for motion in motions]
    return rows, joints, left
  motions = pipeline([plan for *_, plan, _ in chosen], [frames for *_, frames in chosen],
                     seeds=[prompt.seed for _, prompt, *_ in chosen], max_attempts=attempts) if chosen else []
  for (number, prompt, plan, _), motion in zip(chosen, motions):
    reason = ("requirements not met" if motion.meta.get("unmet") else
              "" if is_sound(motion) else "bones or feet not sound")
    if reason:
      left[reason] = left.get(reason, 0) + 1
    else:
      rows.append(_row(pipeline.planner, number, prompt, plan, motion))
      joints.append(np.asarray(motion.joints, np.float32))
  return rows, joints, left


def _chosen(pipeline, first, prompts, far):
  """(number, prompt, plan, frames) of the prompts to sample, and {reason: number} of the others."""
  chosen, left = [], dict[str, int]()

  def leave(reason):
    left[reason] = left.get(reason, 0) + 1

  for number, prompt in enumerate(prompts, first):
    if far.nearest(prompt.text):
      leave("near an evaluation sentence")
      continue
    plan = pipeline.plan(prompt.text)
    if not plan.requirements:
      leave("nothing to check")
      continue
    if _unknown(pipeline, plan):
      leave("words that the model does not know")
      continue
    _, counts = pipeline.schedule(plan)
    if sum(counts) > _SQUEEZED * LONGEST:
      leave("too long")
      continue
    chosen.append((number, prompt, plan, min(sum(counts), LONGEST)))
  return chosen, left


def _unknown(pipeline, plan):
  """Whether a note says that the model does not know a word or an action of a plan."""
  return bool(pipeline.notes([plan], plan=False))


def is_sound(motion: Motion) -> bool:
  """Whether bones keep their lengths, feet stand on the floor and do not slide while they stand."""
  joints = np.asarray(motion.joints)
  if plausibility.fault(joints, fps=motion.fps):
    return False
  values = dict(bone_drift=physics.bone_drift(joints), floating=physics.floating(joints),
                planted_speed=physics.planted_speed(joints, motion.fps))
  return all(float(value) <= _MOST[name] for name, value in values.items())


def reward_of(motion: Motion, plan: Plan) -> float:
  """The share of a plan's requirements that a motion meets; 0 with unsound bones or feet."""
  if not plan.requirements or not is_sound(motion):
    return 0.0
  return float(np.mean([violation_score(motion.joints, [requirement], motion.fps) <= _MET
                        for requirement in plan.requirements]))


def _scored_row(number, place, prompt, plan, motion):
  name = f"scored_{number:06d}_{place:02d}"
  return dict(id=name, clip=name, start=0, end=len(motion.joints), text=[prompt.text], split="train", made="scored",
              group=number, seed=prompt.seed + place, origin=prompt.origin, reward=round(reward_of(motion, plan), 4))


def _row(planner, number, prompt, plan: Plan, motion):
  """The row of captions.jsonl of a motion."""
  steps, frames = motion.meta.get("steps", ()), len(motion.joints)
  parts, spans, first = prompts_in_sequence(planner, plan, frames), [], 0
  for text, count in parts if len(parts) > 1 else ():
    spans.append([text, first, min(first + count, frames)])
    first += count
  attempts = motion.meta.get("attempts", ())
  kept = next((attempt["number"] for attempt in attempts if attempt["kept"]), 1)
  name = f"composed_{number:06d}"
  return dict(id=name, clip=name, start=0, end=frames, text=[prompt.text], split="train", made="composed",
              content=f"composed: {len(plan.requirements)} requirements", spans=spans, origin=prompt.origin,
              seed=prompt.seed, attempt=kept,
              corrected_cm=max((step.get("cm", 0.0) for step in steps if step["step"] == "correct"), default=0.0))


# --- files -----------------------------------------------------------------------------------------------------------


def _size_of(folder):
  """The number of prompts of a part that was written; 0 if there is none."""
  return read_json_lines(folder / _ROWS)[0][1].get("prompts", CHUNK) if (folder / _ROWS).exists() else 0


def _write_part(folder, number, rows, joints, left):
  folder.mkdir(parents=True, exist_ok=True)
  with atomic_path(folder / _JOINTS) as path:
    np.savez(path, **{row["clip"]: clip for row, clip in zip(rows, joints)})
  with atomic_path(folder / _ROWS) as path:  # last: a part with rows is whole
    path.write_text("".join(json.dumps(row) + "\n" for row in [dict(prompts=number, left_out=left), *rows]))


def _assemble(out, parts, number):
  """Writes motions.npz and captions.jsonl from the parts; returns the summary."""
  rows, clips, left = [], [], dict[str, int]()
  for part in parts:
    (_, first), *some = read_json_lines(part / _ROWS)
    for reason, count in first["left_out"].items():
      left[reason] = left.get(reason, 0) + count
    names = [row["clip"] for _, row in some]
    arrays = load_npz(part / _JOINTS, names, required=names)
    rows += [row for _, row in some]
    clips += [arrays[name] for name in names]
  if not rows:
    raise InputError(f"{out}: none of {number} prompts gave a motion that meets its requirements ({_counts(left)}); "
                     "compose more of them, or with another model")
  if "reward" in rows[0]:
    values = negative_aware.optimality(*(np.array([row[name] for row in rows]) for name in ("reward", "group")))
    learned = [place for place, value in enumerate(values) if np.isfinite(value)]
    rows = [rows[place] | dict(optimality=round(float(values[place]), 6)) for place in learned]
    clips = [clips[place] for place in learned]
  root = np.concatenate([clip[:, 0] for clip in clips])
  local = np.concatenate([clip - clip[:, :1] for clip in clips])
  starts = np.cumsum([0, *map(len, clips)])
  with atomic_path(out / "motions.npz") as path:
    np.savez_compressed(path, names=np.array([row["clip"] for row in rows]), start=starts,
                        root=root.astype(np.float32), local=local.astype(np.float16))
  with atomic_path(out / "captions.jsonl") as path:
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
  return (f"{out}: {len(rows):,} clips of {number:,} prompts, {len(root) / 20 / 3600:.2f} hours; left out: "
          f"{_counts(left) or 'none'}")


def _counts(left):
  return ", ".join(f"{count:,} {reason}" for reason, count in sorted(left.items(), key=lambda row: -row[1]))


def _check(out, about):
  """Raises InputError for a folder that other choices made."""
  if not (out / ABOUT).exists():
    if out.exists() and any(out.iterdir()):
      raise InputError(f"{out} is not a folder of composed data; name another --out")
    return
  before = read_json(out / ABOUT)
  for name, value in about.items():
    if before.get(name) != value:
      raise InputError(f"{out} was composed with {name} {str(before.get(name))[:80]!r}, this run has "
                       f"{str(value)[:80]!r}; name another --out")


def _digest(sentences):
  return hashlib.sha256("\n".join(sentences).encode()).hexdigest()[:16] if sentences else ""


def _license_of(model):
  path = pathlib.Path(model.folder) / "about.json"
  return str(read_json(path).get("licence", "")) if path.is_file() else ""
