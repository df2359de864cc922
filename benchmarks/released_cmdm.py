"""CMDM's Tables 1 and 6 from the authors' weights, by this library and by their PyTorch code on the same noise.

  python benchmarks/released_cmdm.py --code CMDM --files CMDM --text-encoder DISTILBERT --torch-python PYTHON --out OUT

docs/papers/released-cmdm.md says where the files come from. What it does, each step once (a second call continues):
converts tokenizer, denoiser and evaluators; exports the prompts of the protocol's draws and the noise that this
library's sampler begins with; has PYTHON run the authors' `generate` on them; judges both by `cmdm-259` (Table 1) and
`cmdm-67` (Table 6); writes OUT/README.md with both tables and how far the motions are apart.
"""
import argparse
import json
import pathlib
import subprocess
import sys

import jax
import numpy as np
from released_names import DENOISER, EVALUATORS, TOKENIZER

import motion_jax as mj
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.request import Request
from motion_jax.evaluation.result import Result
from motion_jax.evaluation.run import evaluate, export_prompts
from motion_jax.models.cmdm.streaming import block_noise
from motion_jax.models.keys import keys_of
from motion_jax_studio import cli

HERE = pathlib.Path(__file__).resolve().parent
PROTOCOLS = {"cmdm-259": 259, "cmdm-67": 67}
COMPARED = 32  # motions whose numbers are held against PyTorch's


def main():
  args = _parser().parse_args()
  out, files = pathlib.Path(args.out), pathlib.Path(args.files)
  data = files / "datasets" / "HumanML3D"
  model = _convert(out / "model", "cmdm", "--tokenizer", files / TOKENIZER, "--denoiser", files / DENOISER, "--stats",
                   data, "--text-encoder", args.text_encoder)
  stats = pathlib.Path(args.code) / "utils" / "eval_mean_std" / "t2m"
  evaluators = {columns: _convert(out / f"evaluator-{columns}", "evaluator", files / place, "--stats", stats, "--glove",
                                  files / "glove") for columns, place in EVALUATORS.items()}
  clip = "none"
  if args.clip_evaluator:
    clip = _convert(out / "evaluator-clip", "evaluator", args.clip_evaluator, "--stats", stats, "--text-encoder",
                    args.clip_text_encoder)
  made = out / "pytorch"
  request = lambda name, **fields: Request(
      folders=[data], protocol=name, evaluator=evaluators[PROTOCOLS[name]], replications=args.replications,
      limit=args.limit, multimodality=False, **fields)
  prompts = [json.loads(line) for line in _prompts(request, made).splitlines()]
  loaded = mj.load(model)
  _write_noise(loaded, prompts, made / "noise")
  subprocess.run([args.torch_python, HERE / "released_cmdm_torch.py", "sample", "--code", args.code, "--files", files,
                  "--text-encoder", args.text_encoder, "--prompts", made, "--num-steps", str(args.num_steps)],
                 check=True)
  found = {}
  for name in PROTOCOLS:
    clip_evaluator = clip if name == "cmdm-67" else "none"
    found[name] = evaluate(request(
        name, runs=[model], motions=[("PyTorch", made)], clip_evaluator=clip_evaluator, out=out / name,
        samples=out / "samples", sampling=dict(num_steps=args.num_steps), force=args.force))
  (out / "README.md").write_text(page(found, _apart(loaded, prompts[:COMPARED], made, args.num_steps)))
  print(f"wrote {out / 'README.md'}")


def page(found: dict[str, Result], apart: dict) -> str:
  """The page: both tables, and the differences of motions."""
  lines = ["# CMDM's released weights, in JAX and in PyTorch", "",
           f"Features of {apart['motions']} motions from the same noise: largest difference {apart['largest']:.1e}, in "
           f"units of the training data's deviation; mean {apart['mean']:.1e}.", ""]
  for name, result in found.items():
    lines += [f"## Table {1 if name == 'cmdm-259' else 6}: {name}", "", tables.markdown(result), ""]
  return "\n".join(lines)


def _convert(out, *command):
  if not out.exists():
    if cli.main(["convert", *map(str, command), "--out", str(out)]):
      sys.exit(1)
  return out


def _prompts(request, out):
  """prompts.jsonl, which is the same for both protocols."""
  texts = {}
  for name in PROTOCOLS:
    export_prompts(request(name), out)
    texts[name] = (out / "prompts.jsonl").read_text()
  assert len(set(texts.values())) == 1, "the protocols' draws differ"
  return texts["cmdm-259"]


def _write_noise(model, prompts, folder):
  """What each motion's latents begin with, a file for each seed."""
  folder.mkdir(parents=True, exist_ok=True)
  plan, channels = model.plan_of()[0], model.dit.latent_dim
  blocks = -(-max(line["frames"] for line in prompts) // (plan.block * model.frames_per_latent))
  draw = jax.jit(lambda keys: jax.vmap(lambda i: block_noise(keys, i, plan, channels))(jax.numpy.arange(blocks)))
  for line in prompts:
    path = folder / f"{line['seed']}.npy"
    if not path.exists():
      np.save(path, np.asarray(draw(keys_of(None, [line["seed"]], 1)[0])).reshape(-1, channels))


def _apart(model, prompts, folder, num_steps):
  """How far the motions of both are apart, normalized."""
  made = model.generate([line["caption"] for line in prompts], num_frames=[line["frames"] for line in prompts],
                        seeds=[line["seed"] for line in prompts], num_steps=num_steps, cleanup=False)
  apart = [np.abs(model.stats.normalize(motion.features[:line["frames"]]) -
                  model.stats.normalize(np.load(folder / line["file"]))) for motion, line in zip(made, prompts)]
  return dict(motions=len(apart), largest=max(one.max() for one in apart), mean=np.mean([one.mean() for one in apart]))


def _parser():
  parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
  parser.add_argument("--code", required=True, help="checkout of github.com/YU1ut/CMDM")
  parser.add_argument("--files", required=True, help="folder with checkpoints/, glove/ and datasets/HumanML3D")
  parser.add_argument("--text-encoder", required=True, help="folder of distilbert-base-uncased")
  parser.add_argument("--torch-python", required=True, help="a Python with torch, einops and transformers")
  parser.add_argument("--clip-evaluator", help="text_mot_match_clip/model/finest.tar, for the CLIP score of Table 6")
  parser.add_argument("--clip-text-encoder", help="folder of clip-vit-base-patch16, for --clip-evaluator")
  parser.add_argument("--replications", type=int, default=10)
  parser.add_argument("--limit", type=int, help="motions of a trial")
  parser.add_argument("--num-steps", type=int, default=50)
  parser.add_argument("--force", action="store_true", help="go on where the evaluators do not know the data")
  parser.add_argument("--out", required=True)
  return parser


if __name__ == "__main__":
  main()
