"""Small evaluations: protocols of few motions, and procedural motion as an archive."""
import dataclasses
import json

import numpy as np
import pytest

from motion_jax import fit
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluation import protocols, run
from motion_jax.evaluation.request import Request
from tests.conftest import load_config

SMALL = dataclasses.replace(
    protocols.get_protocol("archives-66"), pool=4, diversity_draws=6, few_draws=4, multimodality_batches=1,
    multimodality_motions=3, multimodality_pairs=2, multimodality_replications=1, replications=2, seed=5)


def small(name, **changes):
  """A protocol with one replication of few motions."""
  few = dict(pool=4, diversity_draws=6, few_draws=4, replications=1, min_frames=24)
  return dataclasses.replace(protocols.get_protocol(name), **(few | changes))


def write_archive(folder, clips):
  """Clips as an archive folder."""
  folder.mkdir(parents=True)
  start = np.cumsum([0] + [clip.num_frames for clip in clips])
  joints = np.concatenate([clip.joints for clip in clips])
  np.savez(folder / "motions.npz", names=np.array([clip.id for clip in clips]), start=start, root=joints[:, 0],
           local=joints - joints[:, :1])
  rows = [dict(id=clip.id, clip=clip.id, start=0, end=clip.num_frames, split=clip.split,
               text=[caption.text for caption in clip.captions]) for clip in clips]
  (folder / "captions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
  return folder


def make_clips(num=11, num_frames=49):
  """Synthetic clips, all but two of them for test."""
  return [clip.replace(split="train" if i < 2 else "test")
          for i, clip in enumerate(synthetic_clips(seed=3, num=num, num_frames=num_frames))]


def random_run(folder, name, **sampler):
  """A run folder of a tiny config with random weights, which takes no training."""
  from tests.configs.test_tiny_sizes import traced_training  # a test module: not before pytest has rewritten it
  config = load_config(name, "tiny").unlock()
  config.sampler.update(sampler)
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(fit.loop, "train", traced_training)
    fit.run(config, folder)
  return folder


def two_captions():
  """The captions of the first two test clips, for prompts in a row."""
  return [clip.captions[0].text for clip in make_clips() if clip.split == "test"][:2]


def judged(runs, data, protocol, evaluator, out, **options):
  """The result of an evaluation by one evaluator, whatever the real data look like."""
  return run.evaluate(Request(runs, data, protocol, evaluator=evaluator, clip_evaluator="none", out=out, force=True,
                              verbose=False, **options))
