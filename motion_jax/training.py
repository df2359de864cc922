"""From a config to a trained run folder: joins data, text, stage and loop. What launch.py calls."""
import json
import pathlib

import jax
import numpy as np

from motion_jax import checkpoint, cmdm, train
from motion_jax.data import batches, sources
from motion_jax.data.captions import vary_subject
from motion_jax.motion import stats as stats_lib
from motion_jax.motion.features import to_joints
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.text.encoder import load_text_encoder

STAGES = cmdm.STAGES


def run(config, workdir, resume=False, max_seconds=None):
  """Trains the stage that config.stage names in the folder workdir. Raises ValueError for a config that cannot run."""
  if config.stage not in STAGES:
    raise ValueError(f"got stage {config.stage!r}, expected one of {', '.join(STAGES)}")
  workdir = pathlib.Path(workdir)
  print(f"{config.stage} in {workdir} on {jax.local_device_count()} {jax.default_backend()} device(s)\n{config}")
  if resume and (workdir / checkpoint.CONFIG).is_file():
    _check_same_run(config, checkpoint.load_config(workdir))
  make = _tokenizer_run if config.stage == "cmdm.tokenizer" else _denoiser_run
  next_batch, frozen, evaluate, stats, files = make(config)
  workdir.mkdir(parents=True, exist_ok=True)
  if not resume and not checkpoint.is_fresh(workdir):
    raise ValueError(f"{workdir} holds a run already; --resume continues it, or choose another folder")
  if resume and not checkpoint.is_fresh(workdir):
    frozen = _as_before(workdir, stats, frozen, files)
  checkpoint.save_config(workdir, config)
  stats_lib.save_stats(stats, workdir)
  if frozen:  # a run folder is all that loading needs
    checkpoint.save_params(workdir, frozen, name=checkpoint.FROZEN)
  for name, text in files.items():
    (workdir / name).write_text(text)
  state = train.train(config, workdir, STAGES[config.stage](config), next_batch, frozen, resume, evaluate, max_seconds)
  print(f"wrote {workdir}/params.safetensors, metrics.jsonl, loss.png at step {int(state.step)}")
  return state


def _check_same_run(config, before):
  for part in ("stage", "seed", "model", "loss", "data"):
    now, then = config[part], before[part]
    now, then = (c.to_dict() if hasattr(c, "to_dict") else c for c in (now, then))
    if _plain(now) != _plain(then):
      raise ValueError(f"--resume with another {part}: the run has {then}, got {now}; start a new folder instead")


def _plain(value):
  if isinstance(value, dict):
    return {k: _plain(v) for k, v in value.items() if k not in ("folder", "folders")}
  return [_plain(v) for v in value] if isinstance(value, list | tuple) else value


def _as_before(workdir, stats, frozen, files):
  """What a resumed run stands on, from its own folder; raises ValueError if data, tokenizer or words are others now."""
  before = stats_lib.load_stats(workdir, stats.layout)
  if (np.abs(before.mean - stats.mean) > 0.01 * before.std).any() or not np.allclose(before.std, stats.std, rtol=0.01):
    raise ValueError(f"--resume with other data: the statistics in {workdir} are not those of the data or the "
                     "tokenizer given now; give those that the run began with, or start a new folder")
  if (workdir / checkpoint.TEXT).is_file() and (json.loads((workdir / checkpoint.TEXT).read_text())["fingerprint"] !=
                                                json.loads(files[checkpoint.TEXT])["fingerprint"]):
    raise ValueError(f"--resume with another text encoder than {workdir} began with; start a new folder instead")
  if not frozen:
    return frozen
  own = checkpoint.load_params(workdir, frozen, name=checkpoint.FROZEN)
  same = jax.tree.map(lambda a, b: np.allclose(a, b, rtol=1e-5, atol=1e-6), own["tokenizer"], frozen["tokenizer"])
  if not all(jax.tree.leaves(same)):
    raise ValueError(f"--resume with another tokenizer than {workdir} began with; its latents mean something else, "
                     "start a new folder instead")
  return own


def _tokenizer_run(config):
  data = sources.load_features(config.data, captioned=False)
  windows = batches.Windows(data.features, config.data.window, config.data.stride)
  held_out = _held_out(config, data.stats)
  vae = CausalVAE(**config.model)
  reconstruct = jax.jit(lambda params, x: vae.apply(params, vae.apply(params, x, method="encode")[0], method="decode"))

  def evaluate(params):
    return {"held_out_mm": round(reconstruction_error(lambda x: reconstruct(params, x), held_out, data.stats), 2)}

  def next_batch(step):
    return windows.batch(config.data.batch_size, config.seed, step)

  return next_batch, {}, evaluate, data.stats, {}


def _held_out(config, stats):
  """Features of the validation split, or of the training clips where there is none (synthetic data)."""
  try:
    return sources.load_features(config.data, "val", stats, captioned=False).features
  except ValueError:
    return sources.load_features(config.data, "train", stats, captioned=False).features[:8]


def reconstruction_error(reconstruct, features, stats, length=192):
  """Mean distance in millimetres of joints before and after reconstruct(x (1, length, F)), both root-aligned.

  Heading and path are those that the features sum up to (facts: cmdm 6.3, "with heading"). Clips are padded to one
  length, so that one compiled function serves all.
  """
  total = count = 0
  for clip in features:
    clip = clip[:min(len(clip), length) // 4 * 4]
    padded = np.zeros((1, length, clip.shape[-1]), np.float32)
    padded[0, :len(clip)] = clip
    joints = [to_joints(stats.denormalize(np.asarray(x)), stats.layout)
              for x in (clip, reconstruct(padded)[0, :len(clip)])]
    real, made = (j - j[:, :1] for j in joints)
    total += np.linalg.norm(real - made, axis=-1).mean(-1).sum() * stats.layout.skeleton.unit * 1000
    count += len(clip)
  return float(total / count)


def _denoiser_run(config):
  folder = config.frozen.tokenizer
  vae, params, stats = load_tokenizer(folder, config)
  data = sources.load_features(config.data, stats=stats)
  weights = None
  if config.data.balance:
    weights = batches.balance_weights(data.groups, config.data.balance)
  items = batches.TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames,
                            tuple(config.data.lengths), weights=weights)
  encoder = load_text_encoder(config.frozen.text)
  words = config.data.max_words

  def next_batch(step):
    batch = items.batch(config.data.batch_size, config.seed, step)
    rng = batches.step_rng(config.seed, 2, step)
    said = [vary_subject(caption, rng, config.data.vary_subject) for caption in batch.pop("caption")]
    batch["text_emb"], batch["text_mask"] = encoder(said, pad_to=words)
    return batch

  if config.loss.unit_latents:
    mean, std = latent_moments(vae, params, data.features)
  else:
    mean, std = np.zeros(vae.latent_dim, np.float32), np.ones(vae.latent_dim, np.float32)
  frozen = {"tokenizer": params, "latent_mean": mean, "latent_std": std}
  files = {checkpoint.LENGTHS: caption_lengths(data), checkpoint.TEXT: text_identity(encoder)}
  return next_batch, frozen, None, data.stats, files


def text_identity(encoder):
  """JSON by which loading knows that captions are encoded as they were in training."""
  return json.dumps({"name": encoder.name, "fingerprint": encoder.fingerprint}) + "\n"


def caption_lengths(data):
  """JSON rows [caption, median frames], by which a prompt without a length gets that of its like."""
  frames = {}
  for x, captions in zip(data.features, data.captions):
    for caption in captions:
      frames.setdefault(caption, []).append(len(x))
  return json.dumps([[caption, int(np.median(counts))] for caption, counts in sorted(frames.items())], indent=0)


def load_tokenizer(folder, config):
  """(module, params, stats) of a trained tokenizer; "fresh" makes an untrained one for trying things out."""
  if folder == "fresh":
    vae = CausalVAE(**config.tokenizer)
    x = np.zeros((1, 16, vae.features), np.float32)
    params = vae.init(jax.random.key(0), x, np.zeros((1, 16 // vae.frames_per_latent, vae.latent_dim), np.float32))
    return vae, params, sources.load_features(config.data).stats
  fields = checkpoint.load_config(folder).model.to_dict()
  if _plain(fields) != _plain(config.tokenizer.to_dict()):
    raise ValueError(f"the tokenizer in {folder} is {_plain(fields)}, config.tokenizer says "
                     f"{_plain(config.tokenizer.to_dict())}; make them agree")
  vae = CausalVAE(**config.tokenizer)
  shapes = cmdm.frozen_shapes(vae)["tokenizer"]
  return vae, checkpoint.load_params(folder, shapes), stats_lib.load_stats(folder, config.data.layout)


def latent_moments(vae, params, features, num_clips=512, length=192):
  """Mean and std of sampled latents, per channel (C,), over some training clips."""
  encode = jax.jit(lambda x: vae.apply(params, x, method="encode"))
  means, variances = [], []
  for i in np.linspace(0, len(features) - 1, min(num_clips, len(features))).astype(int):
    clip = features[i][:length]
    padded = np.zeros((1, length, clip.shape[-1]), np.float32)
    padded[0, :len(clip)] = clip
    mean, logvar = encode(padded)
    rows = len(clip) // vae.frames_per_latent
    means.append(np.asarray(mean)[0, :rows])
    variances.append(np.exp(np.asarray(logvar)[0, :rows]))
  z, variance = np.concatenate(means), np.concatenate(variances)
  # Of the samples, not of the means: a channel that the encoder leaves to the prior is then not blown up to size 1.
  return z.mean(0), np.sqrt(z.var(0) + variance.mean(0)).astype(np.float32)
