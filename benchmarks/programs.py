"""The programs that matter for speed, built without running them: samplers, stream steps, decoders, training steps.

`all_programs` gives {name: Program}. A name is kind/what/type/batch, such as "fss/M/bfloat16/batch1":

  fss, ar    clips of 6 s by CMDM, frame-wise or block after block, from noise to features
  stream     one step of a stream in its steady state, which gives a block of 3 latents, 12 frames
  cdamd      clips of 6 s by CDAMD's generator of 290 M parameters with its decoder
  decode     latents to features
  train      a training step with its optimizer, of a config on a batch of its shapes

benchmarks/accelerator.py runs them on the device at hand; benchmarks/roofline.py and tests/benchmarks/test_lowering.py
lower them for devices that are not. Weights and inputs are random: that changes no time.
"""
import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.latents import AutoencoderCodec, VaeCodec
from motion_jax.models import cdamd, cmdm
from motion_jax.models.cdamd import draws, losses, unmasking
from motion_jax.models.cmdm import streaming
from motion_jax.models.shared import mask_schedule
from motion_jax.nets import causal_dit
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.training import mesh, optimizers, train_step
from motion_jax.utils import config_files

SECONDS = 6  # of motion that a clip has, at 20 frames a second
WORDS, STEPS, LAG, CONTEXT, GUIDANCE = 24, 50, 2, 48, 3.0
SIZES = ("M", "XL", "L", "S")  # the paper's M first
TYPES = ("bfloat16", "float32")
TRAINED = ("cdamd_generator", "cmdm_tokenizer", "cdamd_autoencoder", "cdamd_rvq")


class Program(NamedTuple):
  """function(*arguments()) is what is measured, and arguments can be traced, so that shapes need no memory.

  frames, batch: of motion that one call makes. carried: the first result takes the place of the first argument, which
  is donated. steps: calls until a stream's first block. loops: how often a loop runs at most whose end depends on data.
  """
  function: Callable
  arguments: Callable[[], tuple]
  batch: int
  frames: int = 0
  carried: bool = False
  steps: int = 1
  loops: int | None = None

  def shapes(self) -> tuple:
    """The arguments as jax.ShapeDtypeStruct."""
    return jax.eval_shape(self.arguments)


def all_programs(tiny=False, sizes=SIZES, types=TYPES, batches=(1, 256), train_batches=(64, 256), attention="xla"
                 ) -> dict[str, Callable[[], Program]]:
  """{name: function that builds the Program}, of the first size first. attention: "xla" or "cudnn", in networks."""
  if tiny:
    sizes, types, batches, train_batches = ("M",), ("float32",), (1,), (4,)
  found, later = {}, {}

  def add(name, build, *args, **fields):
    others = set(sizes[1:]) & set(name.replace("-", "/").split("/"))
    (later if others else found)[name] = functools.partial(build, *args, tiny=tiny, **fields)

  for size in sizes:
    for dtype in types:
      for batch in batches:
        add(f"fss/{size}/{dtype}/batch{batch}", sample_cmdm, size, dtype, batch, LAG, attention=attention)
      add(f"stream/{size}/{dtype}", stream_step, size, dtype, attention=attention)
  for dtype in types:
    for batch in batches:
      add(f"cdamd/full/{dtype}/batch{batch}", sample_cdamd, dtype, batch, attention=attention)
    for size in sizes:
      for batch in train_batches:
        add(f"train/denoiser-{size}/{dtype}/batch{batch}", train_denoiser, size, dtype, batch, attention=attention)
    for name in TRAINED:
      add(f"train/{name}/{dtype}", train_config, name, dtype, attention=attention)
  for batch in batches:
    for method in ("cmdm", "cdamd"):
      add(f"decode/{method}/batch{batch}", decode, method, batch)
  for size in sizes:
    add(f"ar/{size}/{types[0]}/batch1", sample_cmdm, size, types[0], 1, STEPS, attention=attention)
  return found | later


# --- programs ---------------------------------------------------------------------------------------------------------


def sample_cmdm(size, dtype, batch, lag, tiny=False, attention="xla") -> Program:
  """Clips of 6 s, from noise to features: frame-wise sampling, or block after block where lag is all steps."""
  dit, (vae, parts) = denoiser(size, dtype, tiny, attention), cmdm_tokenizer(tiny)
  steps = 4 if tiny else STEPS
  blocks = frames_of(tiny) // vae.frames_per_latent // dit.block
  plan = streaming.make_plan(steps, min(lag, steps), dit.block, CONTEXT, blocks)

  def sample(params, parts, text_emb, text_mask, keys):
    return cmdm.generate(dit, plan, blocks, params, VaeCodec.of(vae, parts), text_emb=text_emb, text_mask=text_mask,
                         scale=jnp.float32(GUIDANCE), keys=keys)

  arguments = lambda: (filled(cmdm.denoiser_shapes(dit)), filled(parts), *words(dit.text_dim, batch),
                       keys_of(batch))
  return Program(jax.jit(sample), arguments, batch, blocks * dit.block * vae.frames_per_latent)


def stream_step(size, dtype, tiny=False, attention="xla") -> Program:
  """One step of a stream whose window and cache are full."""
  dit = denoiser(size, dtype, tiny, attention)
  plan = streaming.make_plan(4 if tiny else STEPS, LAG, dit.block, CONTEXT)

  def arguments():
    text_emb, text_mask = words(dit.text_dim, 1)
    sampler = streaming.bind(dit, plan, filled(cmdm.denoiser_shapes(dit)), text_emb=text_emb,
                             text_mask=text_mask, scale=jnp.float32(GUIDANCE), keys=keys_of(1))
    return sampler.init(), sampler

  step = lambda state, sampler: sampler.step(state)
  return Program(jax.jit(step), arguments, 1, 4 * dit.block, carried=True, steps=plan.age)


def sample_cdamd(dtype, batch, tiny=False, attention="xla") -> Program:
  """Clips by CDAMD's generator with its decoder, 10 decoding iterations of 10 midpoint steps."""
  _, net, autoencoder, parts = generator(dtype, tiny, attention)
  length = frames_of(tiny) // autoencoder.frames_per_latent
  real = np.ones((batch, length), bool)
  order = draws.draw_order(keys_of(batch), np.full(batch, length), length, "random")
  counts = mask_schedule.masked_counts(2 if tiny else 10, real.sum(-1))
  schedule = unmasking.schedule(np.asarray(mask_schedule.masked_table(np.asarray(order), counts)))
  plan = cdamd.make_plan(num_steps=2 if tiny else 10, num_rows=unmasking.most_unmasked(counts))

  def make(params, parts, text_emb, keys):
    draw = draws.make_draw(keys, net.transformer.latent_dim)
    return cdamd.generate(net, plan, params, AutoencoderCodec.of(autoencoder, parts), real_mask=jnp.asarray(real),
                          text_emb=text_emb, schedule=schedule, scale=jnp.float32(4.0), draw=draw)

  arguments = lambda: (filled(cdamd.generator_shapes(net)), filled(parts),
                       jax.random.normal(jax.random.key(2), (batch, 1, net.transformer.text_dim)),
                       keys_of(batch))
  return Program(jax.jit(make), arguments, batch, length * autoencoder.frames_per_latent)


def decode(method, batch, tiny=False) -> Program:
  if method == "cmdm":
    net, parts = cmdm_tokenizer(tiny)
    codec_of = VaeCodec.of
  else:
    net, parts = generator("float32", tiny)[2:]
    codec_of = AutoencoderCodec.of
  frames = frames_of(tiny)
  shape = batch, frames // net.frames_per_latent, net.latent_dim
  masks = () if method == "cmdm" else (np.ones(shape[:2], bool),)
  return Program(jax.jit(lambda parts, z: codec_of(net, parts).decode(z, *masks)),
                 lambda: (filled(parts), jax.random.normal(jax.random.key(0), shape)), batch, frames)


def train_denoiser(size, dtype, batch, tiny=False, attention="xla") -> Program:
  config = config_of("cmdm_denoiser", tiny)
  if not tiny:
    config.model.update(causal_dit.size(size))
  return train(config, cmdm.denoiser_stage, dtype, batch, attention)


def train_config(name, dtype, tiny=False, attention="xla") -> Program:
  config = config_of(name, tiny)
  if name == "cmdm_tokenizer":
    config.frozen.teacher = ""  # alone: the teacher is a constant that others choose
    config.model.teacher_dim = 0
  stage = {"cdamd_generator": cdamd.generator_stage, "cmdm_tokenizer": cmdm.tokenizer_stage,
           "cdamd_autoencoder": cdamd.autoencoder_stage, "cdamd_rvq": cdamd.rvq_stage}[name]
  program = train(config, stage, dtype, config.data.batch_size, attention)
  # The head computes masked latents alone, in parts: all of them where each latent is masked.
  return program._replace(loops=losses.MOST_PARTS) if name == "cdamd_generator" else program


def train(config, make_stage, dtype, batch_size, attention="xla") -> Program:
  """A training step of a config, with its optimizer, on a batch of its shapes."""
  with config.unlocked():
    (config.train if "dtype" in config.train else config.model).dtype = dtype
    if "attention" in config.train:
      config.train.attention = attention
    config.mesh.map = "shard_map"
  stage, tx = make_stage(config), optimizers.make_optimizer(config.optimizer, config.train.num_steps)
  average = config.optimizer.ema_decay > 0
  step = train_step.make_train_step(stage, tx, config.optimizer.ema_decay, config.optimizer.skip_loss)

  def arguments():
    batch = batch_of(config, batch_size)
    state = train_step.init_state(stage, tx, batch, jax.random.key(0), average)
    return state, filled(frozen_of(config)), batch, jax.random.key(1)

  return Program(mesh.make_mesh(config.mesh).compiled(step), arguments, batch_size, carried=True)


# --- networks and inputs ----------------------------------------------------------------------------------------------


def config_of(name, tiny):
  return config_files.load(f"{name}:tiny" if tiny else name)


def frames_of(tiny):
  return 24 if tiny else SECONDS * 20


def filled(shapes):
  """Arrays of these shapes whose products keep about their size: cosines, which compile in no time."""
  def fill(path, leaf):
    if len(leaf.shape) < 2:
      return jnp.full(leaf.shape, float(getattr(path[-1], "key", "") in ("scale", "latent_std")), leaf.dtype)
    fan_in = max(int(np.prod(leaf.shape[:-1])), 1)
    waves = jnp.cos(jnp.arange(int(np.prod(leaf.shape)), dtype=jnp.float32)) * np.sqrt(2 / fan_in)
    return waves.reshape(leaf.shape).astype(leaf.dtype)

  return jax.tree_util.tree_map_with_path(fill, shapes)


def keys_of(count):
  return jax.vmap(jax.random.key)(jnp.arange(count))


def denoiser(size, dtype, tiny, attention):
  fields = config_of("cmdm_denoiser", tiny).model.to_dict() | ({} if tiny else causal_dit.size(size))
  return CausalDiT(**fields | dict(dtype=jnp.dtype(dtype), attention=attention))


def cmdm_tokenizer(tiny):
  """(network, shapes of its parts)."""
  vae = CausalVAE(**config_of("cmdm_denoiser", tiny).tokenizer)
  return vae, cmdm.frozen_shapes(vae)


def generator(dtype, tiny, attention="xla"):
  """(config, network, autoencoder, shapes of its parts)."""
  config = config_of("cdamd_generator", tiny)
  autoencoder = Autoencoder(**config.tokenizer)
  return (config, cdamd.make_generator(config.model, jnp.dtype(dtype), attention=attention), autoencoder,
          cdamd.frozen_shapes(autoencoder))


def words(dim, batch):
  return jax.random.normal(jax.random.key(3), (batch, WORDS, dim)), jnp.ones((batch, WORDS), bool)


def batch_of(config, size):
  """Random numbers in the shapes of a config's batches."""
  frames = config.data.get("window") or config.data.max_frames
  features = config.get("tokenizer", config.model).features
  normal = lambda seed, *shape: jax.random.normal(jax.random.key(seed), shape)
  batch = dict(features=normal(0, size, frames, features), index=jnp.arange(size))
  if "tokenizer" in config:
    sentence = "transformer" in config.model  # a vector a caption, where CMDM has one a word
    dim = config.model.transformer.text_dim if sentence else config.model.text_dim
    count = 1 if sentence else config.data.max_words
    batch |= dict(num_frames=jnp.full(size, frames, jnp.int32), text_emb=normal(1, size, count, dim))
    batch |= {} if sentence else dict(text_mask=jnp.ones((size, count), bool))
  return batch


def frozen_of(config):
  """Shapes of the frozen parts that the stage of a config learns on."""
  if "tokenizer" not in config:
    return {}
  if config.stage == "cmdm.denoiser":
    return cmdm.frozen_shapes(CausalVAE(**config.tokenizer))
  frozen = cdamd.frozen_shapes(Autoencoder(**config.tokenizer))
  if config.loss.prior_levels:
    frozen["prior"] = cdamd.autoencoder_shapes(Autoencoder(**config.prior), config.quantizer)
  return frozen
