"""Training states of a run, saved while training goes on: each appears whole, with checksums, or not at all.

  checkpoints/STEP/state/        a state as orbax writes it
  checkpoints/STEP/record.json   sizes and digests of its files, where it was computed, what the loop remembers

Both are written to a folder aside, which becomes checkpoints/STEP by one renaming. States of versions that kept no
record (checkpoints/STEP/default) are read too.
"""
import dataclasses
import hashlib
import json
import os
import pathlib
import shutil
import threading

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils

from motion_jax.training.distributed import Meeting
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError, reading, reason

STATE, OLD_STATE, RECORD = "state", "default", "record.json"
ASIDE, DAMAGED = ".saving-", ".damaged"


class Saver:
  """Keeps the newest `keep_last` training states of a run, the best one and the newest sound one besides.

  best: the step of the best one, or None.
  """

  def __init__(self, workdir, keep_last=2, save_every=1):
    import orbax.checkpoint as ocp  # here: who only uses a model need not wait for it
    self._ocp = ocp
    self._folder = pathlib.Path(workdir).absolute() / "checkpoints"
    self._folder.mkdir(parents=True, exist_ok=True)
    self._keep_last, self._save_every = keep_last, save_every
    self._thread = self._error = None
    self.best = None

  @property
  def steps(self) -> list[int]:
    """Steps of the states that lie there, rising."""
    return sorted(int(path.name) for path in self._folder.glob("*") if path.name.isdigit())

  @property
  def latest(self) -> int | None:
    return max(self.steps, default=None)

  def save(self, step, copy, memory=None):
    """Begins to save what `copy_of` copied of a state; `wait` tells how it ended, which is the same in all processes.

    memory: a dict for JSON, what the loop needs besides the state to go on exactly.
    """
    self.wait()  # one at a time
    aside = self._folder / f"{ASIDE}{step}"
    record = {"step": step, "environment": environment(), "memory": memory or {}}
    meeting = Meeting()
    try:
      if jax.process_index() == 0:
        if aside.exists():
          shutil.rmtree(aside)
        aside.mkdir()
      meeting.wait()
      # Where orbax's processes wait for one another, one that cannot write would be waited for.
      options = self._ocp.AsyncOptions(barrier_sync_fn=lambda key, timeout_ms: meeting.wait(timeout_ms / 1000))
      checkpointer = self._ocp.StandardCheckpointer(async_options=options)
      checkpointer.save(aside / STATE, copy)
    except Exception as error:
      self._failed(error, aside, meeting)
      return
    self._thread = threading.Thread(target=self._finish, args=(checkpointer, step, aside, record, self.best, meeting),
                                    name="saver")
    self._thread.start()

  def _failed(self, error, aside, meeting):
    self._error = error
    meeting.fail(error)
    if jax.process_index() == 0:
      shutil.rmtree(aside, ignore_errors=True)

  def _finish(self, checkpointer, step, aside, record, best, meeting):
    try:
      checkpointer.close()  # waits until it has written
      if jax.process_index() == 0:  # when orbax is done, all processes have written
        _write_record(aside, record | {"files": _digests(aside / STATE)})
        target = self._folder / str(step)
        if target.exists():
          shutil.rmtree(target)
        aside.replace(target)
        self.prune(best)
      meeting.wait()  # `sound` and `latest` are those of all
    except Exception as error:
      self._failed(error, aside, meeting)

  def failure(self) -> Exception | None:
    """The error by which the last state was not saved, told once; None while it is being saved, too."""
    if self._thread is not None and self._thread.is_alive():
      return None
    error, self._error = self._error, None
    return error

  def wait(self) -> Exception | None:
    """Waits until what was begun is saved; the error by which it is not, or None."""
    if self._thread is not None:
      self._thread.join()
      self._thread = None
    return self.failure()

  def close(self):
    """Ends what was begun, whatever comes of it."""
    self.wait()

  @property
  def sound(self) -> int | None:
    """The newest step that no guard left out, of the regular ones, so that a stop between two makes no difference."""
    return max((step for step in self.steps if step % self._save_every == 0 and not self._memory(step).get("streak")),
               default=None)

  def prune(self, best=None):
    """Removes older states, less the newest regular ones, the best and the newest sound one."""
    if jax.process_index() == 0:
      steps = self.steps
      newest = [step for step in steps if step % self._save_every == 0][-self._keep_last:] + steps[-1:]
      for step in set(steps) - {*newest, self.sound, self.best if best is None else best}:
        shutil.rmtree(self._folder / str(step), ignore_errors=True)

  def _memory(self, step):
    try:
      return json.loads((self._folder / str(step) / RECORD).read_text())["memory"]
    except (OSError, ValueError, KeyError):
      return {}

  def restore(self, like, tell=print):
    """(the newest whole state, in the shapes and types of `like`; its record, {} of one that has none). An average
    that `like` does without is left out.

    tell: is given a line for each one that is passed over because it is damaged.
    """
    fields = fields_of(like)
    faults, upto = {}, np.inf
    while (step := self._newest_whole(upto, faults)) is not None:
      folder = self._folder / str(step)
      recorded = (folder / RECORD).is_file()
      try:
        with reading(folder, "it is of another network, or damaged: give the config that the run began with, or start "
                     "a new run"), self._ocp.StandardCheckpointer() as reader:
          place = folder / (STATE if recorded else OLD_STATE)
          saved = reader.metadata(place).item_metadata.tree
          # Runs of older versions hold an average also where the config asks for none; norms come and go with a guard.
          spare = {"ema_params": like.params, "norms": np.zeros(64, np.float32)}
          target = {name: value for name, value in fields.items() if name in saved or name != "norms"}
          unused = {name: value for name, value in spare.items() if name in saved and name not in fields}
          found = reader.restore(place, jax.tree.map(self._ocp.utils.to_shape_dtype_struct, target | unused))
          found = like.replace(**{name: found[name] for name in target})
      except InputError as error:
        if recorded or jax.process_count() > 1:  # its files are whole: then another network is asked for
          raise
        faults[step], upto = error, step
        continue
      if jax.process_index() == 0:
        for bad, fault in faults.items():
          tell(f"note: checkpoints/{bad} is damaged ({reason(fault)}): kept as checkpoints/{bad}{DAMAGED}, going on "
               f"from step {step}")
          shutil.rmtree(self._folder / f"{bad}{DAMAGED}", ignore_errors=True)
          (self._folder / str(bad)).replace(self._folder / f"{bad}{DAMAGED}")
      return found, _read_record(folder) if recorded else {}
    told = next((fault for fault in faults.values() if isinstance(fault, InputError)), None)
    raise told or InputError(f"no state in {self._folder} is whole ("
                             + "; ".join(f"{step}: {reason(fault)}" for step, fault in faults.items())
                             + "); start a new run in another folder")

  def _newest_whole(self, upto, faults):
    """The newest step below `upto` whose files are as they were written; `faults` gains {step: what is wrong}."""
    step = -1
    if jax.process_index() == 0:
      for step in [one for one in reversed(self.steps) if one < upto] + [-1]:
        if step < 0 or (fault := _fault(self._folder / str(step))) is None:
          break
        faults[step] = fault
    if jax.process_count() > 1:
      step = int(multihost_utils.broadcast_one_to_all(np.int32(step)))
    return None if step < 0 else step

  def discard_after(self, step):
    """Removes the states after a step."""
    if jax.process_index() == 0:
      for later in [one for one in reversed(self.steps) if one > step]:
        shutil.rmtree(self._folder / str(later))
    if jax.process_count() > 1:
      multihost_utils.sync_global_devices("states are discarded")

  def remember(self, step, state, memory):
    """Gives the state of a step another memory, at once or not at all."""
    folder = self._folder / str(step)
    if not (folder / RECORD).is_file():  # of an older version
      self.save(step, copy_of(state), memory)
    elif jax.process_index() == 0:
      _write_record(folder, _read_record(folder) | {"memory": memory})

  def clean(self):
    """Removes what a program that was killed has left half-written."""
    for path in [*self._folder.glob(f"{ASIDE}*"), *self._folder.glob("*.orbax-checkpoint-tmp*")]:
      shutil.rmtree(path, ignore_errors=True)


def fields_of(state):
  """The fields of a training state that are there: a run older than a field that it has no use for goes on."""
  return {field.name: getattr(state, field.name) for field in dataclasses.fields(state)
          if getattr(state, field.name) is not None}


def copy_of(state):
  """A dict of copies of a state's arrays: its own are given to the next step, and written to, before they are saved.

  In the memory of the host; what is spread over several processes stays on their devices.
  """
  whole = lambda leaf: not isinstance(leaf, jax.Array) or leaf.is_fully_addressable or leaf.is_fully_replicated
  return jax.tree.map(lambda leaf: np.array(leaf) if whole(leaf) else jnp.copy(leaf), fields_of(state))


def environment() -> dict:
  """What a computation's last bits depend on, besides the code: states are equal to the bit where these are equal."""
  cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
  return {"jax": jax.__version__, "jaxlib": jax.lib.__version__, "device": jax.devices()[0].device_kind,
          "devices": jax.device_count(), "processes": jax.process_count(), "cores": cores,
          "XLA_FLAGS": os.environ.get("XLA_FLAGS", "")}


def told_differences(record) -> str:
  """A line about what is another environment now than the record of a state names, or ""."""
  if not record:
    return "note: this state was saved without checksums and without a word about where"
  before, now = record["environment"], environment()
  changed = [f"{key} {before.get(key)} -> {now[key]}" for key in now if before.get(key) != now[key]]
  return changed and (f"note: saved in another environment ({', '.join(changed)}): the run goes on up to rounding, not "
                      "to the last bit") or ""


# --- records -----------------------------------------------------------------------------------------------------


def _digests(folder):
  found = {}
  for path in sorted(path for path in folder.rglob("*") if path.is_file()):
    with open(path, "rb") as file:
      digest = hashlib.file_digest(file, "sha256").hexdigest()
    found[path.relative_to(folder).as_posix()] = [path.stat().st_size, digest]
  return found


def _seal(record):
  return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def _write_record(folder, record):
  record = {key: value for key, value in record.items() if key != "seal"}
  with atomic_path(folder / RECORD) as path:
    path.write_text(json.dumps(record | {"seal": _seal(record)}, indent=1) + "\n")


def _read_record(folder):
  """A record; raises ValueError for one that is damaged."""
  record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
  if not isinstance(record, dict) or record.pop("seal", None) != _seal(record):
    raise ValueError(f"{RECORD} is not as it was written")
  return record


def _fault(folder):
  """What is wrong with the files of a state: an exception, or None."""
  try:
    if (folder / OLD_STATE).is_dir() and not (folder / RECORD).exists():
      return None  # nobody can know
    if not (folder / RECORD).is_file():
      raise ValueError(f"it has no {RECORD}")
    there, wanted = _digests(folder / STATE), _read_record(folder)["files"]
    wrong = sorted(name for name in there.keys() | wanted.keys() if there.get(name) != wanted.get(name))
    if wrong:
      raise ValueError(f"{wrong[0]} is " + ("missing" if wrong[0] not in there else "not as it was written"))
  except (OSError, ValueError) as error:
    return error
  return None
