"""Copies what loading needs of a run folder, in float16, to where models ship from.

  python tools/export_model.py runs/denoiser motion_jax/pretrained/cmdm-small
  python tools/export_model.py runs/student motion_jax/pretrained/cmdm-small-fast --shares cmdm-small
"""
import argparse
import json
import pathlib
import shutil

import jax
import numpy as np

from motion_jax import runs
from motion_jax.evaluators import stages as matching
from motion_jax.evaluators.networks import ClipEvaluator, T2MEvaluator
from motion_jax.evaluators.words import WordFeatures
from motion_jax.latents import TOKENIZER
from motion_jax.models import cdamd, cmdm, tmr
from motion_jax.models.shared import length as lengths
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.text.encoder import load_text_encoder, shipped_encoders
from motion_jax.training import checkpoint
from motion_jax.training.setup import text_identity
from motion_jax.utils.config_files import module_fields


def shapes_of(config):
  """{file: shapes of its parameters} of a run: a denoiser with its tokenizer, a tokenizer alone, or a teacher."""
  if config.stage == "cmdm.tokenizer":
    return {checkpoint.PARAMS: cmdm.frozen_shapes(CausalVAE(**config.model))[TOKENIZER]}
  if config.stage == "tmr.teacher":
    module = tmr.make_teacher(config.model, config.data.layout)
    return {checkpoint.PARAMS: tmr.teacher_shapes(module, config.text, config.data.layout)}
  if config.stage == "cmdm.denoiser":
    return {checkpoint.PARAMS: cmdm.denoiser_shapes(CausalDiT(**config.model)),
            checkpoint.FROZEN: cmdm.frozen_shapes(CausalVAE(**config.tokenizer))}
  if config.stage == "cdamd.generator":
    net = cdamd.make_generator(config.model)
    frozen = cdamd.frozen_shapes(Autoencoder(**module_fields(config.tokenizer)))
    if config.length:
      frozen["length"] = lengths.length_shapes(LengthEstimator(**config.length), net.transformer.text_dim)
    return {checkpoint.PARAMS: cdamd.generator_shapes(net), checkpoint.FROZEN: frozen}
  if config.stage == "evaluator.matching":  # a vocabulary of others is not ours to ship
    words = WordFeatures(load_text_encoder(config.frozen.text))
    return {checkpoint.PARAMS: matching.t2m_shapes(T2MEvaluator(**config.model), words.dim)}
  if config.stage == "evaluator.clip":
    return {checkpoint.PARAMS: matching.clip_shapes(ClipEvaluator(**config.model))}
  raise ValueError(f"got a run of stage {config.stage!r}, expected a cmdm.denoiser, a cmdm.tokenizer, a tmr.teacher, "
                   "a cdamd.generator, an evaluator.matching or an evaluator.clip")


def _check_same(own, theirs):
  """Raises ValueError unless two trees of weights are the same in float16."""
  same = jax.tree.map(lambda a, b: bool((np.float16(a) == np.float16(b)).all()), own, theirs)
  if not all(jax.tree.leaves(same)):
    raise ValueError("got --shares of a model whose tokenizer is another; leave it out")


def _with_words(run, out):
  """What the config says of the text encoder, whose fingerprint is written; and that, unless it ships already."""
  level = run.config.frozen.get("text_level", "words")
  encoder = load_text_encoder(run.text, level=level)
  (out / checkpoint.TEXT).write_text(text_identity(encoder))
  if not encoder.folder:
    return {}
  # Of the machine that trained it: the same one that ships, or a copy.
  carry = [path.parent.name for path in sorted(runs.PRETRAINED.glob(f"*/{checkpoint.ENCODER}"))]
  ours = [name for name in (*shipped_encoders(), *carry) if name != out.name
          and load_text_encoder(name, level=level).fingerprint == encoder.fingerprint]
  if ours:
    return {"text": ours[0]}
  for path in encoder.files():
    (out / checkpoint.ENCODER).mkdir(exist_ok=True)
    shutil.copyfile(path, out / checkpoint.ENCODER / path.name)
  return {"text": checkpoint.ENCODER}


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("run", type=pathlib.Path)
  parser.add_argument("out", type=pathlib.Path)
  parser.add_argument("--shares", metavar="NAME", help="a model that ships whose tokenizer the run has, too; it is not "
                      "written again")
  args = parser.parse_args()
  run = runs.load_run(args.run)
  config = run.config
  args.out.mkdir(parents=True, exist_ok=True)
  sizes = {}
  for name, shapes in shapes_of(config).items():
    if args.shares and name == checkpoint.FROZEN:
      _check_same(run.frozen(shapes), runs.load_run(args.shares, config.stage).frozen(shapes))
      continue
    params = checkpoint.load_params(args.run, name=name)
    params = {part: params[part] for part in shapes if part in params}  # less what only training needs
    checkpoint.check_fits(params, shapes, f"{args.run / name} does not fit its config")
    largest = max(float(np.abs(x).max()) for x in jax.tree.leaves(params))
    if not largest < 60_000:  # float16 ends at 65,504
      raise ValueError(f"{name} holds {largest}, too large for float16")
    checkpoint.save_params(args.out, params, np.float16, name)
    sizes[name] = sum(x.size for x in jax.tree.leaves(params))
  for name in ("Mean.npy", "Std.npy", checkpoint.LENGTHS):
    if (args.run / name).is_file():
      shutil.copyfile(args.run / name, args.out / name)
  fields = config.to_dict()
  if "text" in config.frozen:
    fields["frozen"].update(_with_words(run, args.out))
  fields["data"].update(folder="", folders=[])  # paths of the machine that trained it
  if "tokenizer" in fields["frozen"]:
    fields["frozen"].update(tokenizer=args.shares or checkpoint.FROZEN)
  fields["frozen"].update({part: "" for part in ("prior", "length", "movement") if part in fields["frozen"]})
  fields["train"].update(start="")
  if fields.get("distill", {}).get("teacher"):
    fields["distill"].update(teacher=pathlib.Path(fields["distill"]["teacher"]).name)
  (args.out / checkpoint.CONFIG).write_text(json.dumps(fields, indent=1) + "\n")
  megabytes = sum(path.stat().st_size for path in args.out.rglob("*")) / 1e6
  print(f"{args.out}: {sizes}, {megabytes:.1f} MB")


if __name__ == "__main__":
  main()
