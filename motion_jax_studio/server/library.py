"""The models of a studio: loaded and compiled one after the other in a background thread."""
import importlib
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from motion_jax.control.constraints import RootPath
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError, reason
from motion_jax_studio.pipeline import Pipeline
from motion_jax_studio.server import stream_constraints
from motion_jax_studio.server.limits import Limits

_PATIENCE = 600.0  # seconds that a request waits for its model


class ModelSlot:
  """A model and its state: waiting, loading, compiling, ready or failed."""

  def __init__(self, name: str) -> None:
    self.name, self.state, self.doing, self.error = name, "waiting", "", ""
    self.done, self.of = 0, 3
    self.model: Any = None
    self.pipeline: Any = None
    self.began, self.seconds = 0.0, 0.0
    self.ready = threading.Event()  # or failed

  def can(self, ability: str) -> bool:
    """Whether the model is there and has an ability."""
    return self.model is not None and self.model.can(ability)

  def progress(self) -> dict[str, Any]:
    """The loading progress, for the page."""
    now = time.monotonic() - self.began if self.began and not self.ready.is_set() else self.seconds
    return {"name": self.name, "state": self.state, "doing": self.doing, "done": self.done, "of": self.of,
            "seconds": round(now, 2), "error": self.error}

  def about(self) -> dict[str, Any]:
    """The model's entry in `GET /v1/models`."""
    entry, model = self.progress(), self.model
    if model is not None:
      entry |= {"id": model.id, "fps": model.fps, "skeleton": model.stats.layout.skeleton.name,
                "abilities": list(model.abilities), "license": model.license, "limits": model.limits,
                "sampling": {name: {"help": known.help, "allowed": known.allowed,
                                    "usual": getattr(model.sampling(), name)}
                             for name, known in model.options.described().items()}}
    return entry


class Library:
  """The models by name. `start` loads and compiles them in order, in a thread."""

  def __init__(self, names: Sequence[str], load: Callable[[str], Any] | None = None, warm: bool = True) -> None:
    """load(name) -> model; warm: whether streams are compiled in advance."""
    self.slots = {name: ModelSlot(name) for name in names}
    self._load, self._warm = load or _load, warm

  def start(self) -> threading.Thread:
    """Start a thread that loads and compiles the models; returns it. It ends when all of them are done."""
    thread = threading.Thread(target=self._fill, name="models", daemon=True)
    thread.start()
    return thread

  def _fill(self):
    for slot in self.slots.values():
      slot.began = time.monotonic()
      try:
        slot.state, slot.doing = "loading", "reading the weights"
        model = self._load(slot.name)
        slot.model, slot.pipeline = model, Pipeline(model)
        slot.pipeline.warns = False  # the page shows its notes
        slot.done, slot.state, slot.doing = 1, "compiling", "compiling the sampler"
        steps = _steps(slot) if self._warm else iter(())
        next(steps, None)
        slot.done, slot.state, slot.doing = slot.of, "ready", ""
        slot.seconds = time.monotonic() - slot.began
        slot.ready.set()
        for _ in steps:
          pass
        if slot.pipeline.planner.repertoire is not None:
          slot.pipeline.planner.repertoire.nearest("a person walks", 1)  # loaded before a stream needs it
      except Exception as error:  # a model that fails leaves the others
        slot.state, slot.doing, slot.error = "failed", "", reason(error, 400)
      finally:
        slot.seconds = slot.seconds or time.monotonic() - slot.began
        slot.ready.set()

  def slot(self, name: str | None) -> ModelSlot:
    """The slot of a model by name; None: the first slot. Raises InputError for an unknown name."""
    name = name if name is not None else next(iter(self.slots))
    if name not in self.slots:
      raise InputError(f"got the model {str(name)[:60]!r}, this studio has {', '.join(self.slots)}")
    return self.slots[name]

  def model(self, name: str | None, ability: str) -> Any:
    """The model of `pipeline`."""
    return self.pipeline(name, ability).model

  def pipeline(self, name: str | None, ability: str) -> Pipeline:
    """The pipeline of a model with an ability, None: of the first that has it; waits until it is ready. Raises
    InputError if there is none."""
    slot = self.slot(name)
    if name is None:
      slot = next((other for other in self.slots.values() if self._waited(other).can(ability)), slot)
    self._waited(slot)
    if not slot.ready.is_set():
      raise InputError(f"the model {slot.name} is not ready yet ({slot.state}); try again in a minute")
    if slot.model is None or slot.state == "failed":
      raise InputError(f"the model {slot.name} could not be loaded: {slot.error}")
    if not slot.can(ability):
      able = [other.name for other in self.slots.values() if other.can(ability)]
      raise InputError(f"the model {slot.name} has no {ability!r}; "
                       + (f"{', '.join(able)} {'has' if len(able) == 1 else 'have'}" if able else
                          "start the studio with one that has, by --model"))
    return slot.pipeline

  def _waited(self, slot):
    """A slot whose model is ready, or was waited for."""
    if not slot.ready.is_set():
      with progress.part(f"waiting for the model {slot.name}, which is being prepared"):
        slot.ready.wait(_PATIENCE)
    return slot


def _load(name):
  from motion_jax import loading
  from motion_jax.utils import cache
  cache.keep_in_user_cache()
  return loading.load(name)


def _steps(slot):
  """Compiles a stream in stages: its first block, further blocks, blocks with a path. Yields after each stage.

  Other programs of a model are compiled when they are needed.
  """
  model, pipeline = slot.model, slot.pipeline
  for name in ("scipy.ndimage", "scipy.linalg"):
    importlib.import_module(name)
  if model.can("stream"):
    live = pipeline.stream("a person walks", seed=0, **live_sampling(model, {}))
    slot.done = 2
    for _ in range(4):
      next(live)
      yield
    if not model.takes_control or model.stats.layout.skeleton is not HUMANML3D:
      return
    x, z = live.place  # the first path that is drawn does not wait for the compiler
    path = RootPath([[x, z], [x, z + 2.0]])
    live.hold(stream_constraints.signal_of([path], None, live.decided, live.place, None, model.fps, Limits()))
    next(live)
    yield


def live_sampling(model: Any, given: dict[str, Any]) -> dict[str, Any]:
  """The sampling choices of streams and multi-prompt motions in the studio: those given, and a large lag.

  With a lag of half of the steps only one block is in flight, so that a new prompt takes effect soon and an edit of the
  timeline samples little again. Both use the same lag, so that a live motion can be repeated on the timeline.
  """
  if "lag" in given or "lag" not in model.options.described():
    return given
  steps = given.get("num_steps", model.sampling().num_steps)
  return given | {"lag": max(1, int(steps) // 2)}
