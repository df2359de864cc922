"""The user's cache folder, for results that take long and are always the same: programs, vectors, shapes.

Nothing is cached until `keep_in_user_cache` is called, as the command line does. The key of a file covers everything it
depends on: the code of this package, versions of jax, sizes and contents. A file is written atomically and begins with
its digest, so a damaged one is replaced. Caching changes no numbers: arrays are read back bit for bit, and a program is
the same that would have been traced.
"""
import contextlib
import functools
import hashlib
import io
import json
import os
import pathlib
import threading
import time

import numpy as np

from motion_jax.utils import executables, progress, timing
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.home import home_folder
from motion_jax.utils.lazy import jax

MOST_FILES = 200  # of each kind; the oldest are removed
MOST_BYTES = 1 << 29  # likewise
MOST_ANSWERS = 2000  # in each file of answers
SLOW = 0.02  # seconds from which an answer is worth writing
_MAGIC = b"motion_jax 1\n"
_folder: pathlib.Path | None = None
# What else decides how a function is traced.
_OPTIONS = ("jax_enable_x64", "jax_default_matmul_precision", "jax_default_prng_impl", "jax_threefry_partitionable",
            "jax_numpy_dtype_promotion", "jax_numpy_rank_promotion", "jax_debug_nans", "jax_disable_jit")


def user_folder() -> pathlib.Path:
  """The user's cache folder: motion_jax in XDG_CACHE_HOME or ~/.cache. Raises OSError for a user without a home."""
  return home_folder("XDG_CACHE_HOME", ".cache") / "motion_jax"


def keep_in_user_cache():
  """Turns on caching on disk, also of compiled code (in JAX_COMPILATION_CACHE_DIR or the cache folder of the user)."""
  global _folder
  try:
    folder = user_folder()
    compiled = os.environ.get("JAX_COMPILATION_CACHE_DIR") or os.fspath(folder / "jax")
    os.makedirs(compiled, exist_ok=True)
  except OSError:
    return  # a home that is read-only, or none, costs time, not the motion
  jax.config.update("jax_compilation_cache_dir", compiled)
  jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
  jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
  _folder = folder


@functools.cache
def code_version() -> str:
  """A digest of this package's code and of the versions of what it runs on."""
  digest = hashlib.sha256(f"{jax.__version__} {jax.lib.__version__} {np.__version__}".encode())
  for path in sorted(pathlib.Path(__file__).parents[1].rglob("*.py")):
    digest.update(path.name.encode() + path.read_bytes())
  return digest.hexdigest()


def key_of(*about) -> str:
  """The key of a result that depends on these strings and bytes and on the code."""
  digest = hashlib.sha256(code_version().encode())
  for part in about:
    part = part if isinstance(part, bytes) else str(part).encode()
    digest.update(str(len(part)).encode() + b" " + part)
  return digest.hexdigest()[:40]


def read(kind, key, folder=None) -> bytes | None:
  """The bytes under this key, None if there are none or they are damaged; folder: default the process's own."""
  folder = folder or _folder
  if folder is None:
    return None
  try:
    content = (folder / kind / key).read_bytes()
  except OSError:
    return None
  magic, digest, payload = content[:len(_MAGIC)], content[len(_MAGIC):][:32], content[len(_MAGIC) + 32:]
  return payload if magic == _MAGIC and hashlib.sha256(payload).digest() == digest else None


def write(kind, key, payload: bytes, folder=None):
  """Caches bytes under a key, at most MOST_FILES and MOST_BYTES of a kind; not in a folder that cannot be written."""
  folder = folder or _folder
  if folder is None:
    return
  try:
    with atomic_path(folder / kind / key) as temporary:
      temporary.write_bytes(_MAGIC + hashlib.sha256(payload).digest() + payload)
    known = sorted(((path.stat(), path) for path in (folder / kind).glob("[0-9a-f]*")),
                   key=lambda entry: entry[0].st_mtime, reverse=True)
    total = 0
    for number, (stat, path) in enumerate(known):
      total += stat.st_size
      if number >= MOST_FILES or number and total > MOST_BYTES:
        path.unlink(missing_ok=True)
  except OSError:
    pass


def kept_array(kind, key, make) -> np.ndarray:
  """The array that make() returns, read from the cache if possible."""
  payload = read(kind, key)
  if payload is not None:
    try:
      return np.load(io.BytesIO(payload), allow_pickle=False)
    except ValueError:
      pass
  array = np.asarray(make())
  if _folder is not None:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    write(kind, key, stream.getvalue())
  return array


def kept_shapes(name, module, make):
  """The nested dict of array shapes that make() traces a network for; module: what they depend on, by its repr."""
  if _folder is None:
    return make()
  key = key_of("shapes", name, repr(module))
  payload = read("shapes", key)
  if payload is None:
    shapes = make()
    write("shapes", key, json.dumps(jax.tree.map(lambda leaf: [[*leaf.shape], str(leaf.dtype)], shapes)).encode())
    return shapes
  is_leaf = lambda node: isinstance(node, list)
  return jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(tuple(leaf[0]), leaf[1]), json.loads(payload), is_leaf=is_leaf)


class Answers:
  """Answers to questions that take long, as JSON values: in memory, and on disk under a kind and what they depend on.

  The file is read at the first question and written after each answer that took long, at most MOST_ANSWERS in it.
  """

  def __init__(self, kind="", *about):
    self._kind, self._about, self._known, self._key, self._lock = kind, about, {}, None, threading.Lock()

  def __call__(self, question, compute):
    if self._key is None and self._kind and _folder is not None:
      self._read()
    if question not in self._known:
      start = time.perf_counter()
      answer = compute()
      with self._lock:
        self._known[question] = answer
        if len(self._known) > MOST_ANSWERS:
          del self._known[next(iter(self._known))]
        if self._key and time.perf_counter() - start > SLOW:
          write(self._kind, self._key, json.dumps(self._known).encode())
      return answer
    return self._known[question]

  def _read(self):
    with self._lock:
      if self._key is None:
        self._key = key_of(self._kind, *self._about)
        with contextlib.suppress(ValueError, TypeError):
          self._known = json.loads(read(self._kind, self._key) or b"{}") | self._known


class Program:
  """A jitted function whose compiled program is cached: a second process neither traces nor compiles it again.

  fn(*static, *arrays, **arrays) with `num_static` hashable choices first; about: what else fn depends on, such as
  modules that it closes over, by their repr. light: compiled by `executables.light_options`. Without a cache folder it
  is `jax.jit` and nothing else.
  """

  def __init__(self, name, fn, num_static=0, about=(), light=False):
    self.name, self.num_static, self.about, self.light = name, num_static, tuple(map(repr, about)), light
    self._fn, self._static = fn, tuple(range(num_static))
    self._loaded = {}
    self._lock = threading.Lock()  # of several threads one makes it, and the others wait

  @functools.cached_property
  def jitted(self):
    """The function itself, compiled by jax for each new type of its arguments."""
    return jax.jit(self._fn, static_argnums=self._static, compiler_options=self._options())

  def _options(self):
    return executables.light_options() if self.light else {}

  def __call__(self, *args, **named):
    if _folder is None:
      return self.jitted(*args, **named)
    static, arrays = args[:self.num_static], (args[self.num_static:], named)
    leaves, tree = jax.tree.flatten(arrays)
    options = tuple([str(getattr(jax.config, name, None)) for name in _OPTIONS])
    signature = static, tree, tuple([_type_of(leaf) for leaf in leaves]), options
    run = self._loaded.get(signature)
    if run is None:
      with self._lock:
        if signature not in self._loaded:
          with timing.part("program"), progress.part("compiling, which the first motion of a kind needs"):
            self._loaded[signature] = self._load(static, tree, leaves, options)
        run = self._loaded[signature]
    return run(*leaves)

  def _load(self, static, tree, leaves, options):
    """The program for these types, a function of the leaves alone, compiled and stored if it is not in the cache."""
    def call(fn, *leaves):
      arrays, named = jax.tree.unflatten(tree, leaves)
      return fn(*static, *arrays, **named)

    jitted = functools.partial(call, self.jitted)
    if not executables.can_store(leaves):
      return jitted
    types = [repr(jax.typeof(leaf)) for leaf in leaves]
    key = key_of(executables.machine(), self.name, *self.about, *map(repr, static), tree, *types, options)
    stored = read("programs", key)
    try:
      if stored is not None:
        return executables.load(stored)
    except executables.ERRORS:
      pass  # of another machine or build after all: it is compiled and replaced
    try:
      run, stored = executables.compile_and_store(functools.partial(call, self._fn), leaves, self._options())
    except executables.ERRORS:
      return jitted  # a device whose programs cannot be stored: slower to start, the same motion
    write("programs", key, stored)
    return run


def _type_of(leaf):
  """The part of an argument that decides which program it needs: shape, dtype and weak type."""
  dtype = getattr(leaf, "dtype", None)
  return jax.typeof(leaf) if dtype is None else (leaf.shape, dtype, getattr(leaf, "weak_type", False))
