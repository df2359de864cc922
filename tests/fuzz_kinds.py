"""What the fuzzer tries: healthy inputs of every kind, damaged, and the command or function that then reads them.

A kind is a function (rng, folder) -> Case: it writes damaged input into the folder and says what to run there. Networks
are tiny and sample nothing: what is tried is all that happens before and after.
"""
import contextlib
import functools
import io
import json
import pathlib

import numpy as np

from motion_jax.data import timelines
from motion_jax.data.datasets import babel, humanml3d, snapmogen
from motion_jax.data.datasets.archive import read_archive
from motion_jax.evaluators import evaluator as evaluator_lib
from motion_jax.models import cmdm, results
from motion_jax.models.cmdm import networks
from motion_jax.motion.cleanup import clean_up
from motion_jax.text.encoder import load_text_encoder
from motion_jax_studio.cli import main
from tests.fuzz_cases import Case, command, damaged
from tests.fuzz_damage import NUMBERS, WORDS, damage, damage_text, deflated_bomb, encode, pick
from tests.fuzz_formats import FORMATS
from tests.fuzz_healthy import healthy, put

# --- files that hold a motion --------------------------------------------------------------------------------------


def _render(ending):
  def kind(rng, folder):
    name = "features.npy" if ending == ".npy" and rng.random() < 0.4 else f"a{ending}"
    data = healthy("motion")[name]
    if ending == ".npz" and rng.random() < 0.01:
      data = deflated_bomb(["joints.npy"])
    else:
      data = damage(rng, name, data)
    put(folder, {f"in{ending}": data})
    rate = ("--fps", pick(rng, (20, 30, 12.5, "nan", 1e9))) if rng.random() < 0.1 else ()
    return command("render", f"in{ending}", "--out", "out/made" + pick(rng, (".npz", ".npy", ".bvh", ".glb")), *rate)
  return kind


def _build_from(name, endings):
  def kind(rng, folder):
    files = damaged(rng, healthy(name), endings)
    put(folder / "in", files)
    mapping = ("--mapping", "in/map.json") if "map.json" in files and rng.random() < 0.4 else ()
    return command("data", "build", "in", "out/set", *mapping, *(["--no-mirror"] if rng.random() < 0.5 else []))
  return kind


def captions(rng, folder):
  """Tables of captions beside healthy files, in all their formats."""
  files = dict(healthy("captures"))
  table, suffix = files.pop("captions.csv").decode(), pick(rng, (".csv", ".csv", ".tsv", ".jsonl"))
  if suffix == ".tsv":
    table = table.replace(",", "\t")
  if suffix == ".jsonl":
    table = "".join(f'{{"file": "c{i}.bvh", "caption": "walks", "start": 0, "end": {i}}}\n' for i in range(2))
  if rng.random() < 0.2:
    table = table.replace(",", ";")
  files["captions" + suffix] = damage(rng, "captions" + suffix, table.encode())
  put(folder / "in", files)
  return command("data", "build", "in", "out/set", "--no-mirror")


# --- words ---------------------------------------------------------------------------------------------------------

_PROMPTS = "prompt,length\n\"a person walks, then runs\",24\na person waves,\nsomeone jumps,40\n"
_SEQUENCE = "a person walks:4 | a person waves:2s | someone sits"
_TIMELINES = ("walking in a circle # 0.0 # 6.0 # legs\nraising both hands # 2.0 # 5.0 # right arm # left arm\n\n"
              "a person sits # 1.0 # 3.0 # spine\n")


def _argument(text):
  """As a shell would pass it: no null character, bytes that are no UTF-8 as surrogates."""
  return encode(text).replace(b"\0", b"").decode("utf-8", "surrogateescape")


def _lengths(rng):
  if rng.random() < 0.5:
    return ("--num-frames", "24")
  return (pick(rng, ("--num-frames", "--seconds")), pick(rng, (*map(str, NUMBERS), "3", "x", "", "2s", "1e3")))


def prompts(rng, folder):
  put(folder / "run", healthy("run"))
  if rng.random() < 0.4:
    text = damage_text(rng, b"a person walks and then turns left").decode("utf-8", "replace")
    given = _argument(text if not text.startswith("-") else " " + text)
  else:
    given = "in" + pick(rng, (".csv", ".txt"))
    text = _PROMPTS if given.endswith(".csv") else _PROMPTS.replace(",", " ").replace('"', "")
    put(folder, {given: damage(rng, given, text.encode())})
  lengths = _lengths(rng)
  once = ("--max-attempts", "1") if len(lengths[1]) > 3 else ()  # an hour's motion is made a dozen times for minutes
  return command("generate", given, *lengths, *once, "--model", "run", "--out", "out/a.npy")


def stories(rng, folder):
  put(folder / "run", healthy("run"))
  given = pick(rng, ("", "in.csv", "in.txt", "in.txt"))
  if given:
    text = _PROMPTS if given.endswith(".csv") else pick(rng, (_TIMELINES, "a person walks:4\na person sits\n"))
    put(folder, {given: damage(rng, given, text.encode())})
  else:
    given = " " + _argument(damage_text(rng, _SEQUENCE.encode()).decode("utf-8", "replace"))
  way = pick(rng, ("stream", "chain", "joined"))
  return command("multi-prompt", given, "--way", way, "--model", "run", "--out", "out/a.npy")


def timeline_files(rng, folder):
  """Timelines and sequences of prompts as evaluation reads them."""
  if rng.random() < 0.5:
    put(folder, {"in.txt": damage(rng, "in.txt", _TIMELINES.encode())})
    return Case("read_timelines", lambda: [timelines.single_track(one) for one in timelines.read_timelines("in.txt")])
  sequences = [{"id": str(i), "lengths": [40, 60], "text": ["walks", "sits"]} for i in range(3)]
  put(folder, {"in.json": damage(rng, "in.json", json.dumps(sequences).encode())})
  return Case("read_sequences", lambda: timelines.read_sequences("in.json"))


# --- folders -------------------------------------------------------------------------------------------------------


def runs(rng, folder):
  put(folder / "run", damaged(rng, healthy("run")))
  return command("generate", "a person walks", "--num-frames", "24", "--model", "run", "--out", "out/a.npy")


def evaluators(rng, folder):
  put(folder / "run", damaged(rng, healthy("evaluator")))
  return Case("load_evaluator", lambda: evaluator_lib.load_evaluator("run"))


def words(rng, folder):
  names = pick(rng, (None, "config.json", "tokenizer.json", ".safetensors"))
  put(folder / "words", damaged(rng, healthy("words"), names))
  level = pick(rng, ("words", "sentence"))
  return Case("load_text_encoder", lambda: load_text_encoder(pathlib.Path("words").absolute(), level=level))


def _data(name):
  def kind(rng, folder):
    put(folder, damaged(rng, healthy(name)))
    if name == "archive" and rng.random() < 0.01:
      put(folder / "set", {"motions.npz": deflated_bomb(["names.npy", "root.npy", "local.npy", "start.npy"])})
    return command("data", "doctor", "set") if rng.random() < 0.6 else pick(rng, _READS[name])
  return kind


_READS = {
    "archive": (Case("read_archive", lambda: read_archive("set")), command("data", "build", "set", "out/made"),
                Case("read_archive(train, faults)", lambda: read_archive("set", "train", []))),
    "humanml3d": (Case("read_folder", lambda: humanml3d.read_folder("set", "all")),
                  Case("text_items", lambda: humanml3d.text_items("set", "train", min_frames=4)),
                  Case("folder_stats", lambda: humanml3d.folder_stats("set"))),
    "snapmogen": (Case("read_folder", lambda: snapmogen.read_folder("set")),
                  Case("folder_stats", lambda: snapmogen.folder_stats("set"))),
    "babel": (Case("pieces", lambda: babel.pieces("set", "train", "both")),
              Case("folder_stats", lambda: babel.folder_stats("set")))}


# --- command lines -------------------------------------------------------------------------------------------------

_FLAGS = """num-samples seed guidance-scale num-steps solver schedule lag context num-frames seconds num-iterations
order mask no-cleanup fps unit up way prompt past-prompt out model split mode mapping captions overwrite no-mirror data
teacher change keep task help version what""".split()
_GIVEN = (*"""euler heun fss ar full stream chain joined run in.npz in.npy in.bvh set out/a.npz out/b.bvh,out/c.npy out
out/x/y/z.npy / a.docx train 1:2 0.5s:1s 50%:""".split(), "a person walks", "walks:2 | sits:1",
          *"cmdm-small m cm y z".split(), *map(str, NUMBERS), *(word for word in WORDS if "\0" not in word))
_MAKING = "generate", "multi-prompt", "extend", "edit"


def commands(rng, folder):
  """Sub-commands with flags and values that fit, or do not."""
  motion = healthy("motion")
  put(folder, {f"in{ending}": motion[f"a{ending}"] for ending in (".npz", ".npy", ".bvh")} | healthy("archive"))
  put(folder / "run", healthy("run"))
  start = pick(rng, (["generate", "a person walks", "--num-frames", "24"], ["multi-prompt", _SEQUENCE],
                     ["render", "in.npz"], ["extend", "in.npz", "--prompt", "sits"],
                     ["extend", "in.bvh", "--prompt", "walks:2 | sits"],
                     ["data", "build", "set", "out/made"], ["data", "doctor", "set"], ["models"],
                     ["edit", "in.npz", "--prompt", "waves", "--task", "prefix"], ["data"], ["convert", "cmdm"], []))
  if start and start[0] in (*_MAKING, "render"):
    start = [*start, "--out", "out/a" + pick(rng, (".npz", ".npy", ".bvh"))]
    start += ["--model", "run"] if start[0] in _MAKING else []
  for _ in range(int(rng.integers(0, 4))):
    chance = rng.random()
    if chance < 0.75:
      start.append("--" + pick(rng, _FLAGS))
    if chance < 0.9:
      start.append(_argument(pick(rng, _GIVEN)))
    elif start:
      del start[int(rng.integers(len(start)))]
  # What ships takes seconds to load, and a page, a film or the copy of one minutes to write: not here.
  heavy = {"cmdm-small", "cdamd-small", "/", "retrieve"}
  start = [word for word in start if word not in heavy]
  if start and start[0] in _MAKING:
    start += ([] if "--out" in start else ["--out", "out/a.npy"]) + ([] if "run" in start else ["--model", "run"])
  return command(*start)


# name: (share of the cases, kind)
KINDS = {
    "bvh": (14, _render(".bvh")), "asf": (6, _build_from("acclaim", ".asf")),
    "amc": (6, _build_from("acclaim", ".amc")), "npz": (14, _render(".npz")),
    "npy": (14, _render(".npy")), "captions": (6, captions),
    "captures": (3, _build_from("captures", None)), "prompts": (6, prompts), "stories": (5, stories),
    "timelines": (4, timeline_files), "runs": (4, runs), "evaluators": (1, evaluators), "words": (1, words),
    "archives": (6, _data("archive")), "humanml3d": (4, _data("humanml3d")), "snapmogen": (2, _data("snapmogen")),
    "babel": (2, _data("babel")), "commands": (8, commands)} | {name: (2, kind) for name, kind in FORMATS.items()}


# --- networks that sample nothing ----------------------------------------------------------------------------------


def check_stubs(folder):
  """Raises RuntimeError unless a healthy run, prompt and story are made with the stubs: they are the models' whole API,
  and where they lag behind it every case of a run is refused for a reason of the fuzzer's own."""
  put(folder / "run", healthy("run"))
  model, length = ("--model", str(folder / "run")), ("--num-frames", "24")
  said = io.StringIO()
  for arguments in (("generate", "a person walks", *length), ("multi-prompt", _SEQUENCE)):
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
      status = main([*arguments, *model, "--out", str(folder / "made.npy")])
    if status:
      raise RuntimeError(f"a healthy {arguments[0]} of the fuzzer fails: {said.getvalue().strip()[-500:]}")


def stub_networks():
  """From here on, in this process, models make zeros (a body that stands) where they would sample."""
  def compiled(dit):
    def motion(plan, num_blocks, params, codec, *, keys, **given):
      return still(codec, len(keys), num_blocks * plan.block)

    def latents(plan, length, params, *, past, keys, **given):
      return np.zeros((len(keys), length - past.shape[1], dit.latent_dim), np.float32)

    def advance(layout, conditions, state, *given):
      return state

    def decode(codec, z, state):
      return still(codec, *z.shape[:2]), state

    return networks.Compiled(
        advance=advance, constants=lambda *given: (None, None, None), words=lambda *given: (None, None, None),
        control=None, pull=None, generate_whole=motion, chain_segment=latents,
        encode=lambda codec, x: np.zeros((len(x), x.shape[1] // codec.frames_per_latent, dit.latent_dim), np.float32),
        decode=decode, decode_whole=lambda codec, z, *given: still(codec, *z.shape[:2]))

  def still(codec, count, length):
    return np.zeros((count, length * codec.frames_per_latent, codec.net.features), np.float32)

  def short_clean_up(joints, *args, **kwargs):  # an hour's motion is cleaned for minutes, which is no fault
    return clean_up(joints, *args, **kwargs) if len(joints) <= 1_200 else joints

  networks._compile, results.clean_up = compiled, short_clean_up
  for name in ("denoiser_shapes", "frozen_shapes"):  # of the same few networks, again and again
    setattr(cmdm, name, functools.lru_cache(50)(getattr(cmdm, name)))
