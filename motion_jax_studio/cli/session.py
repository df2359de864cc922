"""Shared parts of all commands that generate motion: check files, load the model, print, write."""
import functools
import pathlib
import time

from motion_jax.utils import progress, timing
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import MOTIONS
from motion_jax_studio.cli import control, shared
from motion_jax_studio.cli import generation_flags as flags

_PRINTED = 20  # prompts of which a command prints the plan


def counted(number, noun):
  return f"{number:,} {noun}{'s' * (number != 1)}"


class Session:
  """The run of one command: its arguments, its output files (checked before the slow part), the pipeline of --model.

  ability: an ability that the command needs. Raises InputError for a model without it.
  """

  def __init__(self, args, ability=None):
    self.args, self.outputs, self.start = args, shared.outputs_of(args), time.time()
    self.pipeline = _load(args, ability)
    self.model = self.pipeline.model

  @functools.cached_property
  def sampling(self):
    """The sampling choices on the command line."""
    return flags.sampling_of(self.args, self.model)

  @property
  def without(self):
    """The steps that are left out."""
    return flags.without_of(self.args)

  def each_seed(self, sample, frames):
    """[sample(seed)] for --num-samples seeds. frames: length of a motion. Raises InputError for too many motions."""
    from motion_jax_studio.batches import batches
    batches([frames] * self.args.num_samples, self.model.fps)
    seeds = range(self.args.seed, self.args.seed + self.args.num_samples)
    return [sample(seed) for seed in progress.each(seeds, "generating motions", unit="motion")]

  def print_model(self, what):
    import jax
    print(f"{self.model.id}: {self.model.num_params / 1e6:.1f} M parameters on {jax.default_backend()}; {what}, "
          f"guidance {self.model.sampling(**self.sampling).guidance_scale:g}, seed {self.args.seed}")

  def print_plans(self, planned):
    """Prints the notes and plans of prompts, the model, and the lengths of the motions."""
    shared.print_notes(planned.notes)
    plans = [plan for plan in planned.plans if plan is not None and not plan.is_plain]
    for text in list(dict.fromkeys(" | ".join(part.words for part in plan.segments) for plan in plans))[:_PRINTED]:
      print(f"understood as: {text}")  # the length of each segment is printed once it is sampled
    lengths = dict.fromkeys(f"{count / self.model.fps:.1f}" for count in (min(planned.frames), max(planned.frames)))
    self.print_model(f"{counted(len(planned.frames), 'motion')} of {' to '.join(lengths)} s")

  def write(self, motions, colors=None, constraints=()):
    """Write the motions to the files; with --explain, print their step records.

    For pictures: colors (T, 3) of the body, and the constraints to draw.
    """
    from motion_jax.motion.step_records import lines
    print(f"generated in {time.time() - self.start:.1f} s")
    for number, motion in enumerate(motions[:_PRINTED] if self.args.explain else (), 1):
      print(*(f"motion {number}: " * (len(motions) > 1) + line for line in lines(motion.meta)), sep="\n")
    signals = control.drawn(constraints, motions) if constraints else None
    clips = [motion.replace(id=f"{pathlib.Path(self.outputs[0]).stem}_{i}") for i, motion in enumerate(motions)]
    with timing.part("files"), progress.part("writing files"):
      written = [path for out in self.outputs for path in self._write_one(clips, out, colors, signals, constraints)]
    shared.print_rig_error(self.args, clips, self.outputs)
    shared.print_files(written)
    for text in filter(None, (self.model.limits, self.model.license)):
      print(text)
    if self.args.timings:
      print(timing.report())

  def _write_one(self, clips, out, colors, signals, constraints):
    from motion_jax import export
    options = shared.file_options(self.args, out)
    if pathlib.Path(out).suffix.lower() in shared.PICTURES:
      spans = [shared.span_of(self.args, clip) for clip in clips]
      if colors is not None:
        options["colors"] = colors[spans[0]]
      if signals is not None:
        shown = [signal.slice_frames(span.start, span.stop) for signal, span in zip(signals, spans)]
        options |= control.drawn_options(out, shown, constraints)
      clips = [shared.trimmed(self.args, clip) for clip in clips]
    return export.save(clips, out, **options)


def print_made(motions):
  """Print the plans of motions as they were sampled, and the root speed of motions with --in-place."""
  for text in list(dict.fromkeys(motion.meta["understood"] for motion in motions if "understood" in motion.meta)
                   )[:_PRINTED]:
    print(f"generated as: {text}")
  for motion in motions[:_PRINTED]:
    if "velocity" in motion.meta:
      left, _, ahead = (round(part, 2) + 0.0 for part in motion.meta["velocity"])
      print(f"in place: move the character at {(left ** 2 + ahead ** 2) ** 0.5:.2f} m/s ({ahead:.2f} ahead, {left:.2f} "
            "to its left)")


def check_count(prompts, args):
  """Raises InputError for more motions than one run may generate, before the model is loaded."""
  if prompts * args.num_samples > MOTIONS[1]:
    raise InputError(f"got {prompts:,} prompts with --num-samples {args.num_samples:,}, "
                     f"{prompts * args.num_samples:,} motions; expected at most {MOTIONS[1]:,} in one run")


def _load(args, ability):
  """The pipeline of --model. Raises InputError for a model without the ability."""
  if args.timings:
    timing.start()
  with timing.part("imports"), progress.part("starting JAX"):
    shared.cache_compiled_code()
    from motion_jax.loading import load
    from motion_jax.models.abilities import cannot
    from motion_jax_studio.pipeline import Pipeline
  with timing.part("model"), progress.part(f"reading the model {args.model}"):
    model = load(args.model)
  if ability and not model.can(ability):
    raise InputError(cannot(model.id, ability))
  return Pipeline(model)
