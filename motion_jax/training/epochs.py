"""The length of a training run in epochs: how many steps they are is known once the data are read."""
from motion_jax.utils.errors import InputError


def resolved(config, num_items):
  """The config with its numbers of steps, for training data of num_items windows or captioned clips.

  Where train.num_steps is 0, it becomes train.num_epochs times the batches of an epoch, whose last partial batch is
  dropped, and a train.save_every of 0 one in train.num_saves of that. What is given above 0 stays as it is.
  """
  train = config.train
  if train.num_steps:
    return config
  epochs = train.get("num_epochs", 0)
  if epochs <= 0 or not num_items:
    raise InputError(f"got train.num_steps 0 and train.num_epochs {epochs}, expected one of them above 0")
  found = config.copy_and_resolve_references().unlock()
  found.train.num_steps = epochs * max(num_items // config.data.batch_size, 1)
  found.train.save_every = train.save_every or max(found.train.num_steps // max(train.num_saves, 1), 1)
  found.train.sample_every = min(train.sample_every, found.train.num_steps)
  return found.lock()


def as_before(config, before):
  """The config of a run that goes on: what it leaves open, the run's folder records.

  With another number of epochs the run is longer or shorter; it is saved as often as before.
  """
  if config.train.num_steps:
    return config
  found = config.copy_and_resolve_references().unlock()
  found.train.save_every = config.train.save_every or before.train.save_every
  if config.train.get("num_epochs", 0) == before.train.get("num_epochs", 0):
    found.train.update(num_steps=before.train.num_steps, sample_every=before.train.sample_every)
  return found.lock()


def described(config, num_items) -> str:
  """How long a run is, in one line."""
  train, batch = config.train, config.data.batch_size
  epochs = train.num_steps / max(num_items // batch, 1)
  return (f"{train.num_steps:,} steps of {batch} items" + (
      f", {epochs:.3g} epochs of {num_items:,}" if num_items else "") + f"; saves every {train.save_every:,} steps")
