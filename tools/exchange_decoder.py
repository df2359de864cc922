"""A generator's run with a tokenizer that went on with its encoder held still (config.train.freeze).

  python tools/exchange_decoder.py motion_jax/pretrained/cmdm-small runs/decoder runs/cmdm-new

Everything but the decoder's parameters is the generator's own. An encoder that has changed is refused: its latents are
not those that the generator learned.
"""
import argparse
import pathlib
import shutil

import jax
import numpy as np

from motion_jax import runs
from motion_jax.latents import TOKENIZER
from motion_jax.training import checkpoint
from motion_jax.utils.errors import InputError

STAGES = {"cmdm.denoiser": "cmdm.tokenizer", "cdamd.generator": "cdamd.autoencoder"}


def exchange(generator: str | pathlib.Path, tokenizer: str | pathlib.Path, out: pathlib.Path) -> None:
  """Writes the folder out; raises InputError where the two do not belong together or out is there already."""
  run = runs.load_run(generator, tuple(STAGES))
  given = runs.load_run(tokenizer, STAGES[run.stage]).params()["params"]
  frozen = run.frozen()
  own = frozen[TOKENIZER]["params"]
  checkpoint.check_fits(given["decoder"], own["decoder"], f"the decoder in {tokenizer} does not fit {generator}")
  if not all(map(np.array_equal, *map(jax.tree.leaves, (given["encoder"], own["encoder"])))):
    raise InputError(f"the encoder in {tokenizer} is another than that of {generator}, whose latents are not its own; "
                     "train with config.train.freeze = (\"encoder\",), or train the generator on it")
  if out.exists():
    raise InputError(f"{out} is there already; choose another folder")
  shutil.copytree(run.folder, out)
  own["decoder"] = given["decoder"]
  checkpoint.save_params(out, frozen, name=checkpoint.FROZEN)


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  for name in ("generator", "tokenizer", "out"):
    parser.add_argument(name, type=pathlib.Path)
  args = parser.parse_args()
  exchange(args.generator, args.tokenizer, args.out)
  print(f"wrote {args.out}; try: motion-jax generate \"a person walks\" --model {args.out}")


if __name__ == "__main__":
  main()
