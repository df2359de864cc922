"""Record motions of the shipped models, or compare them with a recording: a refactoring must not change a bit of them.

  python tools/pin_motions.py record motions.npz
  python tools/pin_motions.py compare motions.npz          largest difference of each motion, in metres
  python tools/pin_motions.py reduce motions.npz           every tenth frame of some of them, as a test's fixture
  ... --only cmdm-small/generate                                 motions whose name begins so

Equal to the bit on one machine; other processors round elsewhere (tests/test_pinned.py allows for that).
"""
import argparse
import pathlib
import sys
import warnings

import numpy as np

import motion_jax as mj
from motion_jax.data.mirror import mirror_legs
from motion_jax_studio import Pipeline

PROMPTS = (
    "a person walks forward", "a person waves the right hand", "a person kicks twice with the right leg",
    "a person walks in a circle", "a person walks forward, then sits down", "a person walks while waving",
    "a man jumps three times", "someone turns left and runs",
    "a person sits down, stays seated for 2 seconds and gets up",
    "a person squats", "a person punches", "After bowing, a person walks backward.",
)
FIXTURE = pathlib.Path(__file__).parents[1] / "tests" / "fixtures" / "pinned_motions.npz"
REDUCED = (  # motions of the fixture, of which every tenth frame is kept
    "cmdm-small/one_pass/a person walks forward", "cmdm-small/one_pass/a person kicks twice with the right leg",
    "cmdm-small/generate/a person walks forward", "cmdm-small/generate/a person walks while waving",
    "cmdm-small/generate/a man jumps three times", "cmdm-small/generate/a person walks forward, then sits down",
    "cmdm-small/generate/a person sits down, stays seated for 2 seconds and gets up", "cmdm-small/control",
    "cmdm-small/stream", "cmdm-small/multi_prompt", "cmdm-small/extend",
    "cmdm-small-fast/one_pass/a person walks forward",
    "cmdm-small-fast/generate/a person squats", "cmdm-open/one_pass/a person walks forward",
    "cmdm-open/generate/someone turns left and runs", "cdamd-small/one_pass/a person squats",
    "cdamd-small/generate/a person punches", "cdamd-small/generate/a person walks while waving", "cdamd-small/edit",
    "cdamd-small/control",
)
MODELS = ("cmdm-small", "cmdm-small-fast", "cmdm-open", "cdamd-small")
WALK = "a person walks forward"


def one_pass(model, prompt):
  """The network's own motion; sentences that name a leg are contrasted with the other leg, as cmdm-small needs it."""
  contrast = {"negative_prompts": mirror_legs} if "negative_prompts" in model.more_choices else {}
  return model.generate(prompt, seconds=3.0, seed=0, cleanup=True, **contrast)[0].joints


def planned(model, prompt):
  return Pipeline(model)(prompt, seed=0).joints


def controlled(model):
  path = mj.control.RootPath(((0, 0), (0, 1.5), (1.0, 2.5)))
  return Pipeline(model)(WALK, seconds=4.0, seed=0, control=[path]).joints


def streamed(model):
  return np.concatenate(list(Pipeline(model).stream("a person walks forward, then waves", seed=1, num_frames=120)))


def in_sequence(model):
  segments = [("a person walks", 2.0), ("a person waves", 2.0), ("a person sits down", None)]
  return Pipeline(model).multi_prompt(segments, seed=0).joints


def extended(model, clip):
  return Pipeline(model).extend(clip, "a person turns left, then walks", seed=0).joints


def edited(model, clip):
  return Pipeline(model).edit(clip, "a person waves the left hand", task="outpainting", seed=0).joints


def motions(only=""):
  """Yields (name, model, function that makes joints of the model)."""
  for name in MODELS:
    if only and not (name.startswith(only.split("/")[0]) or only.startswith(name)):
      continue
    model = mj.load(name)
    jobs = {f"one_pass/{prompt}": lambda model, prompt=prompt: one_pass(model, prompt) for prompt in PROMPTS}
    jobs |= {f"generate/{prompt}": lambda model, prompt=prompt: planned(model, prompt) for prompt in PROMPTS}
    jobs["control"] = controlled
    if model.can("stream"):
      jobs |= {"stream": streamed, "multi_prompt": in_sequence,
               "extend": lambda model: extended(model, one_pass(model, WALK))}
    if model.can("edit"):
      jobs["edit"] = lambda model: edited(model, one_pass(model, WALK))
    for job, make in jobs.items():
      if f"{name}/{job}".startswith(only):
        yield f"{name}/{job}", model, make


def main():
  parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
  parser.add_argument("command", choices=("record", "compare", "reduce"))
  parser.add_argument("file")
  parser.add_argument("--only", default="", help="motions whose name begins so")
  args = parser.parse_args()
  if args.command == "reduce":
    recorded = np.load(args.file)
    np.savez_compressed(FIXTURE, **{name: recorded[name][::10] for name in REDUCED})
    return
  warnings.simplefilter("ignore")
  known = dict(np.load(args.file)) if args.command == "compare" else {}
  worst, found = 0.0, {}
  for name, model, make in motions(args.only):
    found[name] = np.asarray(make(model), np.float32)
    if args.command == "record":
      np.savez_compressed(args.file, **found)  # after each, so that an interrupted recording is of use
    if known:
      same = found[name].shape == known[name].shape
      off = np.abs(found[name] - known[name]).max() if same else np.inf
      worst = max(worst, off)
      print(f"{off:9.2e}  {name}" + ("" if same else f"  {known[name].shape} -> {found[name].shape}"), flush=True)
  if args.command == "record":
    print(f"wrote {args.file}: {len(found)} motions")
    return
  print(f"largest difference of {len(found)} motions: {worst:.2e} m")
  sys.exit(worst > 0)


if __name__ == "__main__":
  main()
