"""Pictures during training: motions of training captions, or clips before and after a tokenizer."""
import pathlib
from collections.abc import Callable

import jax
import numpy as np

from motion_jax import export, loading
from motion_jax.data.clip import Caption, Clip
from motion_jax.models import registry
from motion_jax.motion.representations import to_joints
from motion_jax.training import checkpoint
from motion_jax.utils.errors import InputError

NUM, MOMENTS, HEIGHT = 4, 7, 180  # motions of a picture, moments of each, pixels of a row


def drawer(config, workdir, setup) -> Callable | None:
  """draw(params, path): the picture of a run's parameters, for the loop; None where train.sample_every is 0.

  setup: its `TrainingSetup`. Captions, clips and noise are the same in all pictures of a run. Models are made from the
  run folder, which must hold weights by then. Raises InputError for a stage that makes no motion.
  """
  if not config.train.sample_every:
    return None
  if registry.model_of(config.stage) is not None:
    clips = _generated(pathlib.Path(workdir), config.data.get("max_frames", 196))
  elif config.stage.partition(".")[0] in registry.METHODS and "window" in config.data:  # a tokenizer learns on windows
    clips = _there_and_back(setup)
  else:
    raise InputError(f"got train.sample_every {config.train.sample_every}, but {config.stage} makes no motion that "
                     "could be drawn; set it to 0")
  return lambda params, path: export.save(clips(params), path, num=MOMENTS, height=HEIGHT)


def _generated(workdir, longest):
  """clips(params) of a few training captions, each as long as its clips are."""
  loaded = []

  def clips(params):
    if not loaded:
      loaded.append(loading.load(workdir))
    model, (captions, frames) = loaded[0], checkpoint.load_lengths(workdir)
    model.params = jax.tree.map(np.asarray, params)
    chosen = np.linspace(0, len(captions) - 1, min(NUM, len(captions))).astype(int)
    return list(model.generate([captions[i] for i in chosen], [min(frames[i], longest) for i in chosen],
                               seeds=range(len(chosen)), cleanup=True))

  return clips


def _there_and_back(setup):
  """clips(params): windows of the first batch, each above what the tokenizer makes of it."""
  features = setup.next_batch(0)["features"]
  features = features[np.linspace(0, len(features) - 1, min(NUM, len(features))).astype(int)]
  layout = setup.stats.layout
  reconstruct = jax.jit(lambda params: setup.stage.predict(
      params, {}, {"features": features, "index": np.arange(len(features))}, jax.random.key(0))["features"])

  def clip(x, said):
    return Clip(to_joints(setup.stats.denormalize(np.asarray(x)), layout), layout.skeleton.fps, (Caption(said),),
                skeleton=layout.skeleton)

  def clips(params):
    decoded = reconstruct(params)
    return [clip(x, said) for source, back in zip(features, decoded)
            for x, said in ((source, "source"), (back, "there and back"))]

  return clips
