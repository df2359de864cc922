"""What several tests share: a tiny trained run, made once."""
import collections
import contextlib
import gc
import importlib.metadata
import importlib.util
import math
import os
import pathlib
import signal

import pytest

from tests import compiled_programs, processor_time

# Compiling is most of what these tests do. Without the compiler's late optimizations and each program in one piece it
# takes far less time, less still with the older way to write fused loops and the compiler's own choice of fewer passes
# where this jaxlib has them (an unknown flag ends the process); numbers differ by rounding only. Has to be said before
# jax is imported.
os.environ["XLA_FLAGS"] = " ".join([
    os.environ.get("XLA_FLAGS", ""), "--xla_backend_optimization_level=0", "--xla_llvm_disable_expensive_passes=true",
    "--xla_cpu_parallel_codegen_split_count=1",
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_opt_preset=CPU_OPT_PRESET_FAST_COMPILE"
    if importlib.metadata.version("jaxlib").startswith("0.10.") else ""]).strip()

# Small systems of equations are solved many times faster by one thread than by several that wait for a busy core.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What one test has compiled no other compiles again, nor another worker of xdist, nor the next run of the tests.
compiled_programs.choose_folder()

import jax  # noqa: E402
import jaxtyping  # noqa: E402

import tests.typechecker  # noqa: E402

ROOT = pathlib.Path(__file__).parents[1]
# The shapes that annotations state are checked wherever a test calls these rooms, or compiles a call of them. Has to be
# said before they are imported.
CHECKED = [f"motion_jax.{room}" for room in (
    "nets", "quant", "diffusion", "motion", "rigs", "metrics",
    *(f"models.cmdm.{name}" for name in ("streaming", "losses", "ddpm_forcing")),
    *(f"models.cdamd.{name}" for name in ("sampling", "losses", "unmasking", "draws")))]
jaxtyping.install_import_hook(CHECKED, f"{tests.typechecker.__name__}.check")

from motion_jax import fit as training  # noqa: E402
from motion_jax.data import sources  # noqa: E402
from motion_jax.training.setup import untrained  # noqa: E402
from motion_jax.training.stage import DEVICES  # noqa: E402
from motion_jax.utils import (  # noqa: E402
  cache,
  config_files,  # noqa: E402
  progress,
)


def pytest_addoption(parser):
  parser.addoption("--torch", action="store_true",
                   help="run the tests that need torch and transformers, and no others; without this option they are "
                   "skipped where these are not installed")
  processor_time.add_options(parser)


def pytest_configure(config):
  progress.FIRST = math.inf  # a slow machine adds no lines to what commands of the tests say
  processor_time.configure(config)
  if not hasattr(config, "workerinput"):
    compiled_programs.prune()


def pytest_terminal_summary(terminalreporter):
  terminalreporter.write_line(compiled_programs.summary())


def pytest_collection_finish(session):
  """What has been imported stays; the collector need not look through it again and again while programs are traced."""
  gc.collect()
  gc.freeze()
  gc.set_threshold(50_000, 20, 50)
  processor_time.collected(session)


def pytest_collection_modifyitems(config, items):
  """The files with most slow tests come first, so that no worker is left with one at the end. Tests marked `torch` need
  the extra `convert`: skipped without it, and alone in the run that is about them."""
  slow = collections.Counter(item.path for item in items if item.get_closest_marker("slow"))
  items.sort(key=lambda item: -slow[item.path])
  absent = [name for name in ("torch", "transformers") if importlib.util.find_spec(name) is None]
  wanted = config.getoption("--torch")
  if wanted and absent:
    raise pytest.UsageError(f"--torch, but {' and '.join(absent)} not installed: pip install -q '.[convert]'")
  if wanted:
    config.hook.pytest_deselected(items=[item for item in items if not item.get_closest_marker("torch")])
    items[:] = [item for item in items if item.get_closest_marker("torch")]
  elif absent:
    for item in items:
      if item.get_closest_marker("torch"):
        item.add_marker(pytest.mark.skip(reason="needs torch and transformers; .ci/run runs it where they are"))


def some_of(params, quick=(), slow=()):
  """Parameters of a test for `pytest.mark.parametrize`; a tuple is several arguments.

  The quick ones run always and the slow ones among the slow tests; these two cover every kind. The others are
  exhaustive: the test repeats for them what it shows for those.
  """
  if missing := {*quick, *slow} - set(params):
    raise ValueError(f"{sorted(missing)} are no parameters of this test: {sorted(params)}")
  marks = lambda one: () if one in quick else pytest.mark.slow if one in slow else pytest.mark.exhaustive
  return [pytest.param(*(one if isinstance(one, tuple) else [one]), marks=marks(one)) for one in params]


def load_config(name, size):
  """configs/NAME.py's config of a size, as `motion-jax train` reads it."""
  return config_files.load(f"{name}:{size}")


def traced_loss_shape(config):
  """The shape of the loss of a config on one device, by `jax.eval_shape`: sizes, fields and frozen parts fit together.

  Nothing is compiled.
  """
  config, _ = training.resolve(config)
  setup = training.setups()[config.stage](config)
  batch, rng = setup.next_batch(0), jax.random.key(0)
  init, init_extra = setup.stage.init, setup.stage.init_extra
  state = [jax.eval_shape(made, batch, rng) for made in (init, init_extra) if made is not None]
  loss = lambda params, *extra: setup.stage.loss(params, setup.frozen or {}, batch, 0, rng, *extra)[0]["loss"]
  return jax.eval_shape(jax.vmap(loss, None, axis_size=1, axis_name=DEVICES), *state).shape[1:]


def devices_env(count):
  """Environment of a process that sees `count` CPU devices, and imports from this checkout."""
  flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count={count}"
  return os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}


@pytest.fixture
def traced_cudnn(monkeypatch):
  """Lets programs with cuDNN's attention be traced and lowered, which JAX refuses where no cuDNN is installed."""
  from jax._src.cudnn import fused_attention_stablehlo
  monkeypatch.setattr(fused_attention_stablehlo, "check_cudnn_version", lambda: 91_000)


@pytest.fixture
def as_users_run(monkeypatch):
  """The annotations of a call are checked in tests alone; with this a test sees what a user is told."""
  monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.fixture(autouse=True)
def no_cache_folder(monkeypatch):
  """What a test of the command line keeps on disk ends with it."""
  monkeypatch.setattr(cache, "_folder", None)


@pytest.fixture(autouse=True, scope="session")
def signals_are_heard():
  """A shell's background job ignores Ctrl-C, one of nohup hangups, and so would the programs that tests start."""
  ignored = {number for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
             if signal.getsignal(number) == signal.SIG_IGN}
  for number in ignored:
    signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
  yield
  for number in ignored:
    signal.signal(number, signal.SIG_IGN)


@pytest.fixture(autouse=True, scope="module")
def few_maps():
  """Compiled functions stay in memory, each with pieces of its own, of which Linux allows a process 65,530: a worker
  that ran all tests would die of it, and hold 8 GB before."""
  yield
  maps = pathlib.Path("/proc/self/maps")
  if maps.is_file() and maps.read_bytes().count(b"\n") > 8_000:
    jax.clear_caches()
    gc.collect()


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory):
  """The run folder of configs/cmdm_denoiser.py:tiny after its two steps."""
  folder = tmp_path_factory.mktemp("runs") / "denoiser"
  training.run(load_config("cmdm_denoiser", "tiny"), folder)
  return folder


@pytest.fixture(scope="session")
def tiny_generator(tmp_path_factory):
  """The run folder of configs/cdamd_generator.py:tiny after its two steps; sampling takes few."""
  folder = tmp_path_factory.mktemp("runs") / "generator"
  config = load_config("cdamd_generator", "tiny").unlock()
  config.sampler.update(num_iterations=3, num_steps=1, solver="euler")
  training.run(config, folder)
  return folder


# The further methods and their tokenizers: {name: (config, size)}.
METHODS = {"mdm": ("mdm_denoiser", "tiny"), "dip": ("mdm_denoiser", "dip_tiny"),
           "dip goals": ("mdm_denoiser", "goals_tiny"), "mld": ("mld_denoiser", "tiny"),
           "momask": ("momask_masked", "tiny"), "momask residual": ("momask_residual", "tiny"),
           "t2m_gpt": ("t2m_gpt_gpt", "tiny"), "motionstreamer": ("motionstreamer_generator", "tiny"),
           "mld frames": ("mld_frames", "tiny"), "mld vae": ("mld_vae", "tiny"),
           "momask rvq": ("momask_rvq", "tiny"), "t2m_gpt vq": ("t2m_gpt_vq", "tiny"),
           "motionstreamer tae": ("motionstreamer_tokenizer", "tiny")}


@pytest.fixture(scope="session")
def random_run(tmp_path_factory):
  """random_run(name of `METHODS`) -> a run folder of its tiny config with random parameters, made when first needed."""
  from tests.configs.test_tiny_sizes import traced_training  # a test module: not before pytest has rewritten it
  made = {}

  def folder(name):
    if name not in made:
      made[name] = tmp_path_factory.mktemp("random") / name.replace(" ", "_")
      with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training.loop, "train", traced_training)
        config = load_config(*METHODS[name]).unlock()
        if name == "momask":
          config.frozen.residual = str(folder("momask residual"))
        training.run(config.lock(), made[name])
    return made[name]

  return folder


@pytest.fixture(scope="module")
def kept_features():
  """Where many tests of a module train on the same procedural motion, its features are made once."""
  with sources.keep_features():
    yield


def _compiled_less(found, judged):
  """A training set-up that begins with weights that numpy drew, and evaluates nothing unless it is to be judged."""
  drawn = lambda *inputs: untrained(jax.eval_shape(found.stage.init, *inputs))
  return found._replace(stage=found.stage._replace(init=drawn), evaluate=found.evaluate if judged else None)


def light_setups(judged=False):
  """`training.setups()` for a test that proves that a config trains: what is compiled is its training step, not its
  initializers and, unless judged, its evaluation, which take as long again; the slow tests of test_smoke.py have these
  of every base config."""
  return {stage: lambda config, setup=setup: _compiled_less(setup(config), judged)
          for stage, setup in training.setups().items()}


@contextlib.contextmanager
def light_training(judged=False):
  """While it lasts, training compiles its step alone; see `light_setups`."""
  known = light_setups(judged)
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(training, "setups", lambda: known)
    yield


@pytest.fixture
def unjudged():
  with light_training():
    yield


def brief_run(name, folder, num_steps=2, **model):
  """A run folder of a tiny config, for tests of what is done with it; model: fields of its section `model`. Two steps
  of a config as it is are one program with test_smoke.py."""
  config = load_config(name, "tiny").unlock()
  config.train.num_steps = num_steps
  config.model.update(model)
  with light_training():
    training.run(config, folder)
  return folder
