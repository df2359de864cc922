"""Training states of a run, saved in the background: each appears whole, with checksums, or not at all.

  checkpoints/STEP/state/        a state as orbax writes it
  checkpoints/STEP/record.json   sizes and digests of its files, where it was computed, the memory of the loop

Both are written to a temporary folder, which becomes checkpoints/STEP by one renaming.

Orbax writes and reads the arrays. Its CheckpointManager is not used because it does not keep what the tests promise
(orbax-checkpoint 0.12.8, measured 2026-11-26): one flipped bit in the data file of a state is restored as other numbers
without an error (6 of 6 tries), so damaged states are not passed over; which states stay depends on the memory of the
loop (`sound`), which changes after a save (`remember`); and a process that cannot write keeps the others waiting.
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

STATE, RECORD = "state", "record.json"
ASIDE, DAMAGED = ".saving-", ".damaged"


class Saver:
  """Keeps the newest `keep_last` training states of a run, the best one and the newest sound one.

  best: the step of the best one, or None.
  """

  def __init__(self, workdir, keep_last=2, save_every=1):
    import orbax.checkpoint as ocp  # here: using a model does not need it
    self._ocp = ocp
    self._folder = pathlib.Path(workdir).absolute() / "checkpoints"
    self._folder.mkdir(parents=True, exist_ok=True)
    self._keep_last, self._save_every = keep_last, save_every
    self._thread = self._error = None
    self.best = None

  @property
  def steps(self) -> list[int]:
    """Steps of the saved states, in order."""
    return sorted(int(path.name) for path in self._folder.glob("*") if path.name.isdigit())

  @property
  def latest(self) -> int | None:
    return max(self.steps, default=None)

  def save(self, step, copy, memory=None):
    """Starts to save the copy of a state (`copy_of`); `wait` returns how it ended, the same in all processes.

    memory: a dict for JSON, what the loop needs besides the state to resume exactly.
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
      # With orbax's own barrier the others would wait for a process that cannot write.
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
        write_record(aside, record | {"files": file_digests(aside / STATE)})
        target = self._folder / str(step)
        if target.exists():
          shutil.rmtree(target)
        aside.replace(target)
        self.prune(best)
      meeting.wait()  # `sound` and `latest` are those of all
    except Exception as error:
      self._failed(error, aside, meeting)

  def failure(self) -> Exception | None:
    """The error that kept the last state from being saved, returned once; None, also while it is being saved."""
    if self._thread is not None and self._thread.is_alive():
      return None
    error, self._error = self._error, None
    return error

  def wait(self) -> Exception | None:
    """Waits for the save that was started; returns its error, or None."""
    if self._thread is not None:
      self._thread.join()
      self._thread = None
    return self.failure()

  def close(self):
    """Waits for the save that was started, and drops its error."""
    self.wait()

  @property
  def sound(self) -> int | None:
    """The newest state not preceded by a skipped step, of those on the grid of save_every: pauses change nothing."""
    return max((step for step in self.steps if step % self._save_every == 0
                and not memory_of(self._folder / str(step)).get("streak")), default=None)

  def prune(self, best=None):
    """Removes states, except the newest ones, the best and the newest sound one."""
    if jax.process_index() == 0:
      steps = self.steps
      newest = [step for step in steps if step % self._save_every == 0][-self._keep_last:] + steps[-1:]
      for step in set(steps) - {*newest, self.sound, self.best if best is None else best}:
        shutil.rmtree(self._folder / str(step), ignore_errors=True)

  def restore(self, like, report=print):
    """(the newest whole state, in the shapes and types of `like`; its record). An average that `like` has no place for
    is left out.

    report(line): called for each damaged state that is passed over.
    """
    faults = {}
    step = self.newest_whole(faults)
    if step is None:
      raise InputError(f"no state in {self._folder} is whole ("
                       + "; ".join(f"{step}: {reason(fault)}" for step, fault in faults.items())
                       + "); start a new run in another folder")
    folder, fields = self._folder / str(step), fields_of(like)
    with reading(folder, "it is of another network: give the config that the run began with, or start a new run"), \
         self._ocp.StandardCheckpointer() as reader:
      saved = reader.metadata(folder / STATE).item_metadata.tree
      # --allow-changes may turn an average off, or a guard against spikes on or off.
      spare = {"ema_params": like.params, "norms": np.zeros(64, np.float32)}
      target = {name: value for name, value in fields.items() if name in saved or name != "norms"}
      unused = {name: value for name, value in spare.items() if name in saved and name not in fields}
      restored = reader.restore(folder / STATE, jax.tree.map(self._ocp.utils.to_shape_dtype_struct, target | unused))
      restored = like.replace(**{name: restored[name] for name in target})
    if jax.process_index() == 0:
      for bad, fault in faults.items():
        report(f"note: checkpoints/{bad} is damaged ({reason(fault)}): kept as checkpoints/{bad}{DAMAGED}, continuing "
               f"from step {step}")
        shutil.rmtree(self._folder / f"{bad}{DAMAGED}", ignore_errors=True)
        (self._folder / str(bad)).replace(self._folder / f"{bad}{DAMAGED}")
    return restored, _read_record(folder)

  def newest_whole(self, faults):
    """The newest step whose files are as they were written, or None; `faults` gains {step: error} of newer ones."""
    step = -1
    if jax.process_index() == 0:
      for step in [*reversed(self.steps), -1]:
        if step < 0 or (fault := _fault(self._folder / str(step))) is None:
          break
        faults[step] = fault
    if jax.process_count() > 1:
      step = int(multihost_utils.broadcast_one_to_all(np.int32(step)))
    return None if step < 0 else step

  def discard_after(self, step):
    """Removes the states after a step."""
    if jax.process_index() == 0:
      for later in [saved for saved in reversed(self.steps) if saved > step]:
        shutil.rmtree(self._folder / str(later))
    if jax.process_count() > 1:
      multihost_utils.sync_global_devices("states are discarded")

  def remember(self, step, memory):
    """Replaces the memory saved with the state of a step, at once or not at all."""
    folder = self._folder / str(step)
    if jax.process_index() == 0:
      write_record(folder, _read_record(folder) | {"memory": memory})

  def clean(self):
    """Removes what a killed program left half-written."""
    for path in [*self._folder.glob(f"{ASIDE}*"), *self._folder.glob("*.orbax-checkpoint-tmp*")]:
      shutil.rmtree(path, ignore_errors=True)


def progress(workdir) -> tuple[int, float]:
  """(step, processor seconds) of the newest state of a run folder; zeros where there is none."""
  saved = [path for path in pathlib.Path(workdir).glob("checkpoints/*") if path.name.isdigit()]
  newest = max(saved, key=lambda path: int(path.name), default=None)
  return (0, 0.0) if newest is None else (int(newest.name), float(memory_of(newest).get("cpu_seconds", 0.0)))


def memory_of(folder):
  """The memory of the loop that was saved in a folder checkpoints/STEP; {} where it cannot be read."""
  try:
    return json.loads((folder / RECORD).read_text())["memory"]
  except (OSError, ValueError, KeyError):
    return {}


def fields_of(state):
  """The fields of a training state that are not None, by name."""
  return {field.name: getattr(state, field.name) for field in dataclasses.fields(state)
          if getattr(state, field.name) is not None}


def copy_of(state):
  """A dict of copies of a state's arrays: the next step overwrites the originals before they are saved.

  Copies lie in the memory of the host; arrays spread over several processes stay on their devices.
  """
  whole = lambda leaf: not isinstance(leaf, jax.Array) or leaf.is_fully_addressable or leaf.is_fully_replicated
  return jax.tree.map(lambda leaf: np.array(leaf) if whole(leaf) else jnp.copy(leaf), fields_of(state))


def environment() -> dict:
  """Hardware and versions that decide the last bits of a computation: in equal environments states are bitwise equal.
  """
  cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
  return {"jax": jax.__version__, "jaxlib": jax.lib.__version__, "device": jax.devices()[0].device_kind,
          "devices": jax.device_count(), "processes": jax.process_count(), "cores": cores,
          "XLA_FLAGS": os.environ.get("XLA_FLAGS", "")}


def describe_differences(record) -> str:
  """A note on how the environment differs from that in the record of a state, or ""."""
  before, now = record["environment"], environment()
  changed = [f"{key} {before.get(key)} -> {now[key]}" for key in now if before.get(key) != now[key]]
  return changed and (f"note: saved in another environment ({', '.join(changed)}): the run continues up to rounding, "
                      "not to the last bit") or ""


# --- records -----------------------------------------------------------------------------------------------------


def file_digests(folder):
  digests = {}
  for path in sorted(path for path in folder.rglob("*") if path.is_file()):
    with open(path, "rb") as file:
      digest = hashlib.file_digest(file, "sha256").hexdigest()
    digests[path.relative_to(folder).as_posix()] = [path.stat().st_size, digest]
  return digests


def _seal(record):
  return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def write_record(folder, record):
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
  """An exception that says what is wrong with the files of a state, or None."""
  try:
    if not (folder / RECORD).is_file():
      raise ValueError(f"it has no {RECORD}")
    there, wanted = file_digests(folder / STATE), _read_record(folder)["files"]
    wrong = sorted(name for name in there.keys() | wanted.keys() if there.get(name) != wanted.get(name))
    if wrong:
      raise ValueError(f"{wrong[0]} is " + ("missing" if wrong[0] not in there else "not as it was written"))
  except (OSError, ValueError) as error:
    return error
  return None
