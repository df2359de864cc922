"""Train the two parts of CMDM from Python at toy size, change a config, and sample from the run that results.

For a network of your own see train_a_new_method.py; a whole method is one folder of five files (docs/adding.md).
"""
import pathlib
import sys
import tempfile

import motion_jax as mj
from motion_jax import fit
from motion_jax.utils import config_files

folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
tokenizer = config_files.load("cmdm_tokenizer:tiny")  # procedural motions: nothing to download
tokenizer.train.num_steps = 4
fit.run(tokenizer, folder / "tokenizer")

denoiser = config_files.load("cmdm_denoiser:tiny")
denoiser.frozen.tokenizer = str(folder / "tokenizer")
fit.run(denoiser, folder / "denoiser")

motions = mj.load(folder / "denoiser").generate(["a person walks"], num_frames=40, seeds=[0])
print(motions.joints.shape)  # (1, 40, 22, 3); two steps of training do not make a walk
