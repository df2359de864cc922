"""mj.load: a run folder, or the name of a model that ships, becomes a Model that generates and streams."""
import dataclasses
import hashlib
import pathlib
import warnings
from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import checkpoint, cmdm, export
from motion_jax.data.clip import Caption, Clip
from motion_jax.diffusion import streaming
from motion_jax.motion import rotations as rot
from motion_jax.motion.features import root_path, to_joints
from motion_jax.motion.polish import polish as planted
from motion_jax.motion.stats import Stats, load_stats
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.text.encoder import TextEncoder, load_text_encoder

PRETRAINED = pathlib.Path(__file__).parent / "pretrained"
MAX_SECONDS = 3600.0
SCHEDULES = ("fss", "ar", "full")


class Motion(Clip):
  """A clip that knows how to write itself: `motion.save("wave.mp4")`, by extension."""

  def save(self, path, **options):
    """Writes npz, npy, bvh, glb, mp4, gif, html or png; returns the paths written."""
    return export.save(self, path, **options)


@dataclasses.dataclass(frozen=True, eq=False)
class Motions:
  """Generated motions: joints (B, T, J, 3), frame_mask (B, T) true where a motion is real; `motions[i]` is a Motion."""
  joints: np.ndarray
  frame_mask: np.ndarray
  features: np.ndarray  # (B, T, F), not normalized
  motions: tuple[Motion, ...]

  def __len__(self):
    return len(self.motions)

  def __getitem__(self, index) -> Motion:
    return self.motions[index]

  def __iter__(self):
    return iter(self.motions)


def pretrained_names():
  return sorted(path.parent.name for path in PRETRAINED.glob("*/config.json") if (path.parent / "Mean.npy").is_file())


def load(name="cmdm-small", text=None) -> "Model":
  """A run folder of a denoiser, or the name of a model that ships. text names another folder of the text encoder."""
  folder = pathlib.Path(name)
  if not folder.is_dir() and (PRETRAINED / str(name)).is_dir():
    folder = PRETRAINED / str(name)
  if not folder.is_dir():
    raise FileNotFoundError(f"found neither a run folder {str(name)!r} nor a model of that name; models that ship: "
                            f"{', '.join(pretrained_names()) or 'none'}")
  config = checkpoint.load_config(folder)
  if config.get("stage") != "cmdm.denoiser":
    raise ValueError(f"{folder} holds a {config.get('stage')!r} run; generating needs the run of a cmdm.denoiser")
  level = config.frozen.get("text_level", "words")  # older runs do not say
  return Model(folder, config, load_text_encoder(text or config.frozen.text, level=level))


class Model:
  """CMDM ready to use: prompts in, motion out. Made by `load`."""

  def __init__(self, folder, config, encoder: TextEncoder):
    self.folder, self.config, self.encoder = pathlib.Path(folder), config, encoder
    self.vae = CausalVAE(**_plain(config.tokenizer))
    self.dit = CausalDiT(**_plain(config.model))
    if encoder.dim != self.dit.text_dim:
      raise ValueError(f"the text encoder gives {encoder.dim} numbers a word, the denoiser in {folder} was trained on "
                       f"{self.dit.text_dim}; pass the encoder named {config.frozen.text!r} as text")
    if checkpoint.load_fingerprint(folder) not in (None, encoder.fingerprint):
      raise ValueError(f"{folder} was trained on another version of the text encoder {config.frozen.text!r}; pass the "
                       "folder with the old one as text, or train the denoiser again")
    self.stats: Stats = load_stats(folder, config.data.layout)
    load_params = lambda like, name: jax.tree.map(jnp.asarray, checkpoint.load_params(folder, like, name))
    self.frozen = load_params(cmdm.frozen_shapes(self.vae), checkpoint.FROZEN)
    self.params = load_params(cmdm.denoiser_shapes(self.dit), checkpoint.PARAMS)
    self.context = config.data.max_frames // self.vae.frames_per_latent // self.dit.block * self.dit.block
    self._generate = jax.jit(partial(cmdm.generate, self.dit, self.vae), static_argnums=(0, 1))
    self._generate_whole = jax.jit(partial(cmdm.generate_whole, self.dit, self.vae), static_argnums=(0, 1))
    self._stream_step = jax.jit(partial(cmdm.stream_step, self.dit, self.vae), static_argnums=(0, 1, 2))
    self._lengths = None

  # --- what it is ------------------------------------------------------------------------------------------------

  @property
  def fps(self) -> float:
    return self.stats.layout.skeleton.fps

  @property
  def num_params(self) -> int:
    return sum(x.size for x in jax.tree.leaves((self.params, self.frozen["tokenizer"])))

  @property
  def id(self) -> str:
    """Folder name and a hash of the weights: what a file says about where its motion is from."""
    digest = hashlib.sha256((self.folder / checkpoint.PARAMS).read_bytes()).hexdigest()[:12]
    return f"{self.folder.name}@{digest}"

  @property
  def license(self) -> str:
    path = self.folder / "LICENSE.txt"
    return path.read_text().strip() if path.is_file() else ""

  # --- lengths ---------------------------------------------------------------------------------------------------

  def natural_frames(self, prompt) -> int:
    """How long the clips of the nearest training captions are: an action generated much longer goes on by itself."""
    if self._lengths is None:
      table = checkpoint.load_lengths(self.folder)
      if table is None:
        return 120
      self._lengths = self.encoder.sentence(table[0]), table[1]
    known, frames = self._lengths
    nearness = known @ self.encoder.sentence([prompt])[0]
    nearest = np.argsort(-nearness, kind="stable")[:5]
    return int(np.clip(np.median(frames[nearest]), 60, 196))

  def _frames(self, prompts, num_frames, seconds):
    if num_frames is not None and seconds is not None:
      raise ValueError("got both num_frames and seconds; give one of them")
    if num_frames is None:
      num_frames = self.natural_frames if seconds is None else [float(s) * self.fps for s in _each(seconds, prompts)]
    counts = [num_frames(p) for p in prompts] if callable(num_frames) else _each(num_frames, prompts)
    for count in counts:
      if not np.isfinite(count) or not self.vae.frames_per_latent <= count <= MAX_SECONDS * self.fps:
        raise ValueError(f"got a length of {count:g} frames, expected {self.vae.frames_per_latent} to "
                         f"{MAX_SECONDS * self.fps:.0f} ({MAX_SECONDS:.0f} s at {self.fps:g} frames a second)")
    return [int(round(count)) for count in counts]

  # --- motion ----------------------------------------------------------------------------------------------------

  def generate(self, prompts, num_frames=None, *, seconds=None, rng=None, seeds=None, guidance_scale=None,
               schedule="fss", num_steps=None, lag=None, polish=True) -> Motions:
    """Motions for one prompt or several, of the given length each (one number or one per prompt).

    rng: a key, of which prompt i gets fold_in(rng, i), so that a motion does not depend on its batch-mates; or seeds,
    one integer per prompt. schedule: "fss" (frame-wise, `lag` steps between blocks), "ar" (block after block), "full"
    (all at once). Without a length it is that of the nearest training captions. polish plants standing feet and takes
    tremor away (`motion.polish`); features stay as they were made. Raises ValueError for an empty prompt
    or a length that is not positive or over an hour.
    """
    prompts = [prompts] if isinstance(prompts, str) else list(prompts)
    if not prompts:
      raise ValueError("got no prompt")
    self.check_words(prompts)
    frames = self._frames(prompts, num_frames, seconds)
    keys, seeds = _keys(rng, seeds, len(prompts))
    defaults = self.config.sampler
    scale = self._scale(guidance_scale)
    if schedule not in SCHEDULES:
      raise ValueError(f"got schedule {schedule!r}, expected one of {', '.join(SCHEDULES)}")
    num_steps = int(defaults.num_steps if num_steps is None else num_steps)
    lag = {"fss": int(defaults.lag if lag is None else lag), "ar": num_steps, "full": 0}[schedule]
    made = self._features(self._encode(prompts), keys, max(frames), scale, schedule, num_steps, lag)
    features = self.stats.denormalize(np.asarray(made))
    length = max(frames)
    features = features[:, :length]
    joints = to_joints(features, self.stats.layout)
    if polish and self.stats.layout.kind == "full":
      contacts = self.stats.layout["contacts"]
      for i, count in enumerate(frames):
        joints[i, :count] = planted(joints[i, :count], features[i, :count, contacts], self.stats.layout.skeleton)
    mask = np.arange(length) < np.array(frames)[:, None]
    made = tuple(
        Motion(joints[i, :count], self.fps, (Caption(prompts[i]),), id=f"motion_{i}", source=self.id,
               license=self.license, skeleton=self.stats.layout.skeleton, features=features[i, :count],
               meta=dict(prompt=prompts[i], seed=seeds[i], guidance_scale=scale, model=self.id, schedule=schedule,
                         num_steps=num_steps, lag=lag, polished=bool(polish)))
        for i, count in enumerate(frames))
    return Motions(joints * mask[..., None, None], mask, features * mask[..., None], made)

  def _features(self, text, keys, num_frames, scale, schedule, num_steps, lag):
    block = self.dit.block
    blocks = -(-num_frames // (block * self.vae.frames_per_latent))
    # Whole blocks are independent of what follows them; a few more of them spare a compilation for every new length.
    blocks = -(-blocks // 4) * 4
    guided = scale != 1.0
    if schedule == "full":
      plan = streaming.make_plan(num_steps, 1, block, max(self.context, blocks * block), blocks)._replace(lag=0)
      return self._generate_whole(plan, blocks, self.params, self.frozen, *text, scale, keys)
    plan = streaming.make_plan(num_steps, lag, block, self.context, blocks, guided)
    return self._generate(plan, blocks, self.params, self.frozen, *text, scale, keys)

  def stream(self, prompt, *, rng=None, seed=None, guidance_scale=None, num_frames=None) -> Iterator[np.ndarray]:
    """Yields joints (n, J, 3) block after block, without end unless num_frames says so; memory stays flat.

    Driven by the very step that `generate` runs: the same key gives the same motion, before polishing, which looks at
    whole clips.
    """
    self.check_words([prompt])
    keys, _ = _keys(rng, None if seed is None else [seed], 1)
    defaults, scale = self.config.sampler, self._scale(guidance_scale)
    if num_frames is not None:
      self._frames([prompt], num_frames, None)
    plan = streaming.make_plan(defaults.num_steps, defaults.lag, self.dit.block, self.context, guided=scale != 1.0)
    constants = streaming.make_constants(self.dit, self.params, plan)
    text = streaming.encode_text(self.dit, self.params, *self._encode([prompt]), plan.guided)
    state = cmdm.init_stream(self.dit, self.vae, plan, self.frozen, keys)
    given, past, at = 0, None, 0
    while num_frames is None or given < num_frames:
      unit = -(-plan.width // 2)  # two compiled widths: the start and the rest
      active = min(-(-min(at + 1, plan.width) // unit) * unit, plan.width)
      state, features, _ = self._stream_step(plan, active, at > plan.age, self.params, self.frozen, constants, text,
                                             scale, keys, state)
      at += 1
      if at < plan.age:
        continue
      joints, past = _continue_path(self.stats.denormalize(np.asarray(features))[0], past, self.stats.layout)
      joints = joints if num_frames is None else joints[:num_frames - given]
      given += len(joints)
      yield joints

  def reconstruct(self, features):
    """Features (T, F) there and back through the tokenizer, T cut to whole latents."""
    unit = self.vae.frames_per_latent
    x = self.stats.normalize(np.asarray(features))[None, :len(features) // unit * unit]
    mean, _ = self.vae.apply(self.frozen["tokenizer"], jnp.asarray(x), method="encode")
    return self.stats.denormalize(np.asarray(self.vae.apply(self.frozen["tokenizer"], mean, method="decode")))[0]

  def _encode(self, prompts):
    """(text_emb, text_mask) padded to the width of everyday prompts, so that none of those waits for a compiler."""
    emb, mask = self.encoder(prompts)
    width = -(-max(emb.shape[1], self.config.data.max_words) // 8) * 8
    missing = width - emb.shape[1]
    return jnp.pad(emb, ((0, 0), (0, missing), (0, 0))), jnp.pad(mask, ((0, 0), (0, missing)))

  def _scale(self, guidance_scale):
    scale = self.config.sampler.guidance_scale if guidance_scale is None else float(guidance_scale)
    if not np.isfinite(scale):
      raise ValueError(f"got guidance_scale {scale}, expected a finite number such as 3")
    return scale

  def check_words(self, prompts):
    """Raises ValueError for an empty prompt; warns of words that the model does not know."""
    for prompt in prompts:
      if not isinstance(prompt, str) or not prompt.strip():
        raise ValueError(f"got the prompt {prompt!r}; say what the person does, as in \"a person waves\"")
      strange = self.encoder.unfamiliar(prompt)
      if strange:
        warnings.warn(f"the model does not know {', '.join(repr(w) for w in strange)} in {prompt!r}; it may be ignored "
                      "or misunderstood", stacklevel=3)


class _Path(NamedTuple):
  """Where a stream has got to: the last row of features, its heading (4,) and its place (3,)."""
  row: np.ndarray
  heading: np.ndarray
  place: np.ndarray


def _continue_path(features, past, layout):
  """Joints (n, J, 3) of the next rows of a stream (n, F), going on from where the last ones ended -> (joints, past)."""
  rows = features if past is None else np.concatenate([past.row, features])
  joints = to_joints(rows, layout).astype(np.float64)
  heading, path = root_path(rows)
  if past is not None:
    joints = rot.rotate(rot.conjugate(past.heading), joints)[1:] + past.place
    path = rot.rotate(rot.conjugate(past.heading), path) + past.place
    heading = rot.multiply(heading, past.heading)
  return joints.astype(np.float32), _Path(rows[-1:], heading[-1], path[-1] * [1, 0, 1])


def _plain(config):
  return {k: tuple(v) if isinstance(v, list | tuple) else v for k, v in config.to_dict().items()}


def _each(value, prompts):
  values = list(value) if isinstance(value, Sequence | np.ndarray) else [value] * len(prompts)
  if len(values) != len(prompts):
    raise ValueError(f"got {len(values)} lengths for {len(prompts)} prompts; give one number or one per prompt")
  return values


def _keys(rng, seeds, count):
  if seeds is not None:
    if len(seeds) != count:
      raise ValueError(f"got {len(seeds)} seeds for {count} motions")
    return jnp.stack([jax.random.key(int(seed)) for seed in seeds]), [int(seed) for seed in seeds]
  rng = jax.random.key(0) if rng is None else rng
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(jnp.arange(count)), [None] * count
