"""Train a network of your own with the library's loop: a Stage is three pure functions. A few seconds on a laptop.

Here a mask is filled in: the network sees motion features without some frames and predicts these. For loading, sampling
and evaluating it by name, see docs/adding.md.
"""
import pathlib
import sys
import tempfile

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion import to_features
from motion_jax.training import loop, stage
from motion_jax.utils import config_files

data = np.stack([to_features(clip.joints)[:39] for clip in synthetic_clips(num=16, num_frames=40)])
data = (data - data.mean((0, 1))) / (data.std((0, 1)) + 1e-3)  # (N, T, 263)
net = nn.Sequential([nn.Conv(64, (9,)), nn.silu, nn.Conv(64, (9,)), nn.silu, nn.Dense(data.shape[-1])])


def next_batch(step):  # a pure function of the step, so that a run resumes exactly
  index = np.random.default_rng(step).integers(len(data), size=8)
  return {"index": index, "features": data[index]}


def loss(params, frozen, batch, step, rng):  # (sums, weight): devices with unequal numbers of frames add up correctly
  hidden = jax.random.bernoulli(rng, 0.3, batch["features"].shape[:2])
  made = net.apply(params, jnp.where(hidden[..., None], 0.0, batch["features"]))
  return {"loss": jnp.where(hidden, jnp.square(made - batch["features"]).mean(-1), 0.0).sum()}, hidden.sum()


config = config_files.load("cmdm_tokenizer:tiny")  # for its optimizer, mesh and train sections
config.train.update(num_steps=200, log_every=50, save_every=200)
method = stage.Stage(lambda batch, rng: net.init(rng, batch["features"]), loss, predict=None)
loop.train(config, pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp()), method, next_batch)
