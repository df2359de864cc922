"""The length of a training run in epochs: how many steps they are is known once the data are read."""
from motion_jax.inputs.errors import InputError


def resolved(config, num_items):
  """The config with its numbers of steps, for training data of num_items windows or captioned clips.

  Where train.num_steps is 0, it becomes train.num_epochs times the batches of an epoch, whose last partial batch is
  dropped, and train.save_every one in train.num_saves of that. A given num_steps stays as it is.
  """
  train = config.train
  if train.num_steps:
    return config
  epochs = train.get("num_epochs", 0)
  if epochs <= 0 or not num_items:
    raise InputError(f"got train.num_steps 0 and train.num_epochs {epochs}, expected one of them above 0")
  found = config.copy_and_resolve_references().unlock()
  found.train.num_steps = epochs * max(num_items // config.data.batch_size, 1)
  found.train.save_every = max(found.train.num_steps // max(train.num_saves, 1), 1)
  found.train.sample_every = min(train.sample_every, found.train.num_steps)
  return found.lock()


def as_before(config, before):
  """The config of a run that goes on: its numbers of steps are those that its folder records, unless others are given.
  """
  if config.train.num_steps or config.train.get("num_epochs", 0) != before.train.get("num_epochs", 0):
    return config
  found = config.copy_and_resolve_references().unlock()
  found.train.update({name: before.train[name] for name in ("num_steps", "save_every", "sample_every")})
  return found.lock()


def described(config, num_items) -> str:
  """How long a run is, in one line."""
  train, batch = config.train, config.data.batch_size
  epochs = train.num_steps / max(num_items // batch, 1)
  return (f"{train.num_steps:,} steps of {batch} items" + (
      f", {epochs:.3g} epochs of {num_items:,}" if num_items else "") + f"; saves every {train.save_every:,} steps")
