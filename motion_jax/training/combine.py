"""Runs made of runs: a generator with another decoder, the mean of two generators; passes of configs/shipped."""
import pathlib
import shutil

import jax
import numpy as np

from motion_jax import runs
from motion_jax.latents import TOKENIZER
from motion_jax.training import checkpoint
from motion_jax.utils.atomic import atomic_folder
from motion_jax.utils.errors import InputError

# {stage of a generator: stage of the tokenizer that it holds}
TOKENIZERS = {"cmdm.denoiser": "cmdm.tokenizer", "cdamd.generator": "cdamd.autoencoder"}


def exchange_decoder(generator: str | pathlib.Path, tokenizer: str | pathlib.Path, out: str | pathlib.Path) -> None:
  """Writes in `out` the run of a generator with the decoder of a tokenizer whose encoder was frozen (train.freeze).

  All other parameters are the generator's. Raises InputError where the encoder has changed, for its latents are not
  those that the generator learned.
  """
  run = runs.load_run(generator, tuple(TOKENIZERS))
  given = runs.load_run(tokenizer, TOKENIZERS[run.stage]).params()["params"]
  frozen = run.frozen()
  own = frozen[TOKENIZER]["params"]
  checkpoint.check_fits(given["decoder"], own["decoder"], f"the decoder in {tokenizer} does not fit {generator}")
  if not all(map(np.array_equal, *map(jax.tree.leaves, (given["encoder"], own["encoder"])))):
    raise InputError(f"the encoder in {tokenizer} differs from that in {generator}, which learned the latents of its "
                     "own; train with config.train.freeze = (\"encoder\",), or train the generator on it")
  own["decoder"] = given["decoder"]
  _write(run, out, {checkpoint.FROZEN: frozen})


def average(first: str | pathlib.Path, second: str | pathlib.Path, out: str | pathlib.Path) -> None:
  """Writes in `out` the first run with the mean of the parameters of both."""
  run = runs.load_run(first)
  params, others = run.params(), runs.load_run(second, run.stage).params()
  checkpoint.check_fits(others, params, f"the parameters in {second} do not fit {first}")
  _write(run, out, {checkpoint.PARAMS: jax.tree.map(lambda a, b: (a + b) / 2, params, others)})


COMBINATIONS = {"exchange_decoder": exchange_decoder, "average": average}


def _write(run, out, changed):
  """Copies the files of a run that loading needs, with changed ones {name: parameters}; all of it or nothing."""
  out = pathlib.Path(out)
  if out.exists():
    raise InputError(f"{out} is there already; choose another folder")
  with atomic_folder(out) as folder:
    left_out = shutil.ignore_patterns("checkpoints", "lock.json", "metrics.jsonl", "samples", "profile", "*.tfevents.*")
    shutil.copytree(run.folder, folder, dirs_exist_ok=True, ignore=left_out)
    for name, params in changed.items():
      checkpoint.save_params(folder, params, name=name)
