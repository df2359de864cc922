"""Shared parts of all commands that generate motion: check files, load the model, print, write."""
import pathlib
import time
import warnings

from motion_jax.utils import progress, timing
from motion_jax.utils.errors import InputError
from motion_jax_studio.cli import generation_flags as flags
from motion_jax_studio.cli.writing import Output

_PRINTED = 20  # prompts of which a command prints the plan


def counted(number, noun):
  return f"{number:,} {noun}{'s' * (number != 1)}"


class Session:
  """The run of one command: its output files (checked before the slow part), the pipeline of --model.

  ability: an ability that the command needs. Raises InputError for a model without it.
  """

  def __init__(self, args, ability=None):
    self.output, self.start = Output(args), time.time()
    self.seeds = range(args.seed, args.seed + args.num_samples)
    self._explains, self._times = args.explain, args.timings
    if args.timings:
      timing.start()
    self.pipeline = _load(args.model, ability)
    self.model = self.pipeline.model
    self.without, self.sampling = flags.choices_of(args, self.model)

  def each_seed(self, sample, frames):
    """[sample(seed=seed)] for --num-samples seeds. frames: length of a motion. Raises InputError for too many
    motions."""
    from motion_jax_studio.batches import batches
    batches([frames] * len(self.seeds), self.model.fps)
    return [sample(seed=seed) for seed in progress.each(self.seeds, "generating motions", unit="motion")]

  def print_model(self, what):
    import jax
    print(f"{self.model.id}: {self.model.num_params / 1e6:.1f} M parameters on {jax.default_backend()}; {what}, "
          f"guidance {self.model.sampling(**self.sampling).guidance_scale:g}, seed {self.seeds.start}")

  def print_plans(self, planned):
    """Prints the plans of prompts, the model, and the lengths of the motions; notes are warnings."""
    for note in planned.notes:
      warnings.warn(note, stacklevel=2)
    plans = [plan for plan in planned.plans if plan is not None and not plan.is_plain]
    for text in list(dict.fromkeys(" | ".join(part.words for part in plan.segments) for plan in plans))[:_PRINTED]:
      print(f"understood as: {text}")  # the length of each segment is printed once it is sampled
    lengths = dict.fromkeys(f"{count / self.model.fps:.1f}" for count in (min(planned.frames), max(planned.frames)))
    self.print_model(f"{counted(len(planned.frames), 'motion')} of {' to '.join(lengths)} s")

  def write(self, motions, colors=None, constraints=()):
    """Write the motions to the files; with --explain, print their step records. See `Output.write`."""
    from motion_jax.motion.step_records import lines
    print(f"generated in {time.time() - self.start:.1f} s")
    for number, motion in enumerate(motions[:_PRINTED] if self._explains else (), 1):
      print(*(f"motion {number}: " * (len(motions) > 1) + line for line in lines(motion.meta)), sep="\n")
    stem = pathlib.Path(self.output.paths[0]).stem
    self.output.write([motion.replace(id=f"{stem}_{i}") for i, motion in enumerate(motions)], colors, constraints)
    for text in filter(None, (self.model.limits, self.model.license)):
      print(text)
    if self._times:
      print(timing.report())


def print_sampled(motions):
  """Print the plans of motions as they were sampled, and the root speed of motions with --in-place."""
  for text in list(dict.fromkeys(motion.meta["understood"] for motion in motions if "understood" in motion.meta)
                   )[:_PRINTED]:
    print(f"generated as: {text}")
  for motion in motions[:_PRINTED]:
    if "velocity" in motion.meta:
      left, _, ahead = (round(part, 2) + 0.0 for part in motion.meta["velocity"])
      print(f"in place: move the character at {(left ** 2 + ahead ** 2) ** 0.5:.2f} m/s ({ahead:.2f} ahead, {left:.2f} "
            "to its left)")


def _load(name, ability):
  """The pipeline of a model. Raises InputError for a model without the ability."""
  with timing.part("imports"), progress.part("starting JAX"):
    from motion_jax.loading import load
    from motion_jax.models.abilities import cannot
    from motion_jax.utils import cache
    from motion_jax_studio.pipeline import Pipeline
    cache.keep_in_user_cache()
  with timing.part("model"), progress.part(f"reading the model {name}"):
    model = load(name)
  if ability and not model.can(ability):
    raise InputError(cannot(model.id, ability))
  return Pipeline(model)
