"""The authors' PyTorch weights become run folders: `motion-jax convert` (names in facts: cmdm 9).

Sizes are read off the tensors. What tensors do not tell (heads, block, statistics, text encoder) is a flag or the
released code's value. A folder appears whole or not at all.
"""
import contextlib
import hashlib
import os
import pathlib
import re
import shutil
import tempfile
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import ml_collections
import numpy as np

from motion_jax import checkpoint, cmdm, convert
from motion_jax.metrics.evaluators import ClipEvaluator, T2MEvaluator
from motion_jax.motion.features import layout_for
from motion_jax.motion.stats import Stats, load_stats, save_stats
from motion_jax.nets.causal_dit import SIZES, CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.recipes.cmdm import bert_fields_of, text_identity
from motion_jax.teacher import make_teacher
from motion_jax.text.encoder import load_text_encoder

# (width, depth) -> heads: the paper's sizes, and the code's dit_large.
HEADS = {(size["width"], size["depth"]): size["num_heads"] for size in SIZES.values()} | {(512, 20): 4}
WEIGHTS = {"ema": "ema_model", "model": "model"}
T2M = ("movement_encoder", "motion_encoder", "text_encoder")
TEXT = "distilbert-base-uncased"
# What a checkpoint holds for going on with its training only, as the field's training scripts name it.
TRAINING_ONLY = re.compile(r"(opt|optim|optimizer|scheduler|lr_scheduler|scaler)(_.*)?$")


class Part(NamedTuple):
  """Tensors of one network out of a checkpoint, {reference's name: array}."""
  state: dict
  source: dict           # file, part, sha256
  left: tuple[str, ...]  # entries that were left aside on purpose

  def shape(self, name, what, dims):
    """Shape of a tensor that every `what` has; an error says what the file holds instead."""
    if name not in self.state or self.state[name].ndim != dims:
      got = f"of shape {self.state[name].shape}" if name in self.state else "missing"
      raise ValueError(f"{self.source['file']} is no {what}: {name} is {got}; it holds "
                       f"{', '.join(sorted(self.state)[:4])}, ...")
    return self.state[name].shape

  def count(self, pattern):
    """How many different numbers stand at the group of a pattern of names."""
    return len({match[1] for name in self.state if (match := re.match(pattern, name))})


class Network(NamedTuple):
  """A converted network: its module, the module's fields, and its parameters as the run folder keeps them."""
  what: str
  module: Any
  fields: dict
  params: Any
  part: Part

  @property
  def num_params(self):
    return sum(np.size(a) for a in jax.tree.leaves(self.params))

  def __str__(self):
    fields = ", ".join(f"{name} {value}" for name, value in self.fields.items())
    source = self.part.source["file"] + (f" ({self.part.source['part']})" if self.part.source["part"] else "")
    left = f"\n  left aside: {', '.join(self.part.left)}" if self.part.left else ""
    return f"{self.what}: {self.num_params:,} parameters from {source}\n  {fields}{left}"


# --- reading -----------------------------------------------------------------------------------------------------


def read_part(path, wanted=(), others=()):
  """One network's tensors out of a checkpoint -> Part.

  wanted: the entries that hold it ("ae"; three for an evaluator, whose names then keep theirs, "text_encoder/..."),
  none for a bare state dict; a file whose names are not nested is a bare one. others: entries of its kind to leave
  aside. Entries that only training needs are left aside too; any other is an error.
  """
  state, plain = convert.load_checkpoint(path)
  if not state:
    raise ValueError(f"{path} holds no tensor" + (f", only {', '.join(sorted(plain))}" if plain else ""))
  nested = any("/" in name for name in state)
  left = set(plain)
  if nested and wanted:
    tops = {name.split("/")[0] for name in state}
    left |= {top for top in tops if top in others or TRAINING_ONLY.match(top)} - set(wanted)
    absent, unknown = set(wanted) - tops, sorted(tops - left - set(wanted))
    if absent or unknown:
      raise ValueError(f"{path} holds {', '.join(sorted(tops | plain))}; expected {', '.join(wanted)} and nothing else "
                       "but what training needs; this is another kind of checkpoint")
    state = {name: array for name, array in state.items() if name.split("/")[0] in wanted}
    if len(wanted) == 1:
      state = convert.select(state, f"{wanted[0]}/")
  # Data-parallel and compiled modules prefix every name alike.
  for prefix in ("module.", "_orig_mod."):
    if state and all(name.startswith(prefix) for name in state):
      state = {name.removeprefix(prefix): array for name, array in state.items()}
  broken = [name for name, array in state.items() if not np.isfinite(array).all()]
  if broken:
    raise ValueError(f"{path}: {broken[0]} holds NaN or infinity; fetch the file again")
  with open(path, "rb") as file:
    digest = hashlib.file_digest(file, "sha256").hexdigest()
  part = ", ".join(wanted) if nested else ""
  return Part(state, dict(file=pathlib.Path(path).name, part=part, sha256=digest), tuple(sorted(left)))


def _network(what, part, module, fields, shapes, table, ignore=()):
  params = convert.from_torch(part.state, table, ignore)
  checkpoint.check_fits(params, shapes, f"{part.source['file']} does not fit a {what}")
  return Network(what, module, fields, params, part)


def _heads(given, width, known, flag="--heads"):
  """The number of heads, which no tensor tells: as given, or the known one."""
  heads = known if given is None else given
  if heads is None:
    raise ValueError(f"the tensors do not tell the number of attention heads, and width {width} is none of the known "
                     f"sizes; give it with {flag}")
  if heads < 1 or width % heads:
    raise ValueError(f"got {heads} heads for width {width}, expected a number that divides it")
  return heads


def tokenizer(path) -> Network:
  """A released MAC-VAE, "ae" of net_best_fid.tar."""
  what, part = "tokenizer", read_part(path, ("ae",))
  width, features, _ = part.shape("encoder.model.0.conv.weight", what, 3)
  _, latent_dim = part.shape("decode_proj.weight", what, 2)
  halvings = part.count(r"encoder\.model\.(\d+)\.0\.conv\.weight")
  depth = part.count(r"encoder\.model\.2\.1\.model\.(\d+)\.conv1\.weight")
  fields = dict(features=features, latent_dim=latent_dim, width=width, num_halvings=halvings,
                dilations=tuple(3 ** b for b in reversed(range(depth))))
  reversed_too = "linear_proj_aux.weight" in part.state
  if reversed_too:
    fields |= dict(teacher_dim=part.shape("linear_proj_aux.weight", what, 2)[1], teacher_to_latent=True)
  elif "linear_proj_z.weight" in part.state:
    fields |= dict(teacher_dim=part.shape("linear_proj_z.weight", what, 2)[0])
  vae = CausalVAE(**fields)
  table = convert.causal_vae_names(halvings, depth, bool(vae.teacher_dim), reversed_too)
  return _network(what, part, vae, fields, cmdm.frozen_shapes(vae)["tokenizer"], table)


def denoiser(path, weights="ema", num_heads=None, block=3) -> Network:
  """A released Causal-DiT, "ema_model" (the one that is evaluated) or "model" of latest.tar.

  num_heads: without it, that of the paper's size with this width and depth.
  """
  if weights not in WEIGHTS:
    raise ValueError(f"got weights {weights!r}, expected one of {', '.join(WEIGHTS)}")
  if block < 1:
    raise ValueError(f"got --block {block}, expected a number of latents such as 3")
  what, part = "denoiser", read_part(path, (WEIGHTS[weights],), others=WEIGHTS.values())
  width, latent_dim = part.shape("x_embedder.weight", what, 2)
  ff_width, _ = part.shape("blocks.0.ffn.0.weight", what, 2)
  depth = part.count(r"blocks\.(\d+)\.")
  heads = _heads(num_heads, width, HEADS.get((width, depth)))
  fields = dict(latent_dim=latent_dim, width=width, depth=depth, num_heads=heads, ff_width=ff_width, block=block,
                text_dim=part.shape("y_embedder.weight", what, 2)[1])
  dit = CausalDiT(**fields)
  return _network(what, part, dit, fields, cmdm.denoiser_shapes(dit), convert.causal_dit_names(depth))


def teacher(path, layout, num_heads=None, text_fields=None) -> Network:
  """A released Part-TMR with its text transformer; params are {"motion": ..., "text": ...}.

  text_fields: of its `Bert`; without them, DistilBERT's sizes.
  """
  what, part = "teacher", read_part(path)
  stack = "motion_encoder.seqTransEncoder_Root.layers"
  width, _ = part.shape("motion_encoder.skel_embedding_Root.weight", what, 2)
  depth = part.count(re.escape(stack) + r"\.(\d+)\.")
  fields = dict(kind="part_tmr", width=width, depth=depth, num_heads=_heads(num_heads, width, 4),
                mlp_width=part.shape(f"{stack}.0.linear1.weight", what, 2)[0],
                dim=part.shape("motion_projection.projection.weight", what, 2)[0], dropout=0.1, head_dropout=0.5,
                pool="all")
  text_fields = text_fields or _distilbert_fields(part)
  module = make_teacher(fields, layout)
  shapes = jax.eval_shape(lambda: module.init(jax.random.key(0), jnp.zeros((1, 4, layout.dim)),
                                              jnp.zeros((1, text_fields["width"]))))
  params = convert.part_tmr_from_torch(part.state, text_fields, depth)
  checkpoint.check_fits(params["motion"], shapes["params"], f"{part.source['file']} does not fit a {what}")
  return Network(what, module, fields | {"text": text_fields}, params, part)


def _distilbert_fields(part):
  what, prefix = "Part-TMR with DistilBERT", "text_encoder.text_model."
  vocab_size, width = part.shape(f"{prefix}embeddings.word_embeddings.weight", what, 2)
  if width != 768:
    raise ValueError(f"the teacher's text transformer has width {width}, DistilBERT has 768; the tensors do not tell "
                     "its number of heads, give the folder that it started from with --text")
  return dict(vocab_size=vocab_size, width=width, num_heads=12,
              num_layers=part.count(re.escape(prefix) + r"transformer\.layer\.(\d+)\."),
              mlp_width=part.shape(f"{prefix}transformer.layer.0.ffn.lin1.weight", what, 2)[0],
              max_positions=part.shape(f"{prefix}embeddings.position_embeddings.weight", what, 2)[0])


def evaluator(path, num_heads=None) -> Network:
  """A released evaluator: T2M's (259 or 67 numbers per frame) or MARDM's CLIP-type one, told by what the file holds."""
  names = convert.load_state(path)
  if any(name.startswith("contrast_model/") or name == "token_embedding.weight" for name in names):
    return _clip_evaluator(path, num_heads)
  what, part = "T2M evaluator", read_part(path, T2M, others=("movement_decoder",))
  movement_width, features, _ = part.shape("movement_encoder/main.0.weight", what, 3)
  fields = dict(features=features, columns=features + 4 if features in (259, 247) else features,  # less the contacts
                movement_width=movement_width, movement_dim=part.shape("movement_encoder/main.3.weight", what, 3)[0],
                motion_width=part.shape("motion_encoder/input_emb.weight", what, 2)[0],
                text_width=part.shape("text_encoder/input_emb.weight", what, 2)[0],
                dim=part.shape("motion_encoder/output_net.3.weight", what, 2)[0])
  classes, words = part.shape("text_encoder/pos_emb.weight", what, 2)[::-1]
  module = T2MEvaluator(**fields)
  one = jnp.ones(1, jnp.int32)
  shapes = jax.eval_shape(lambda: module.init(jax.random.key(0), jnp.zeros((1, 4, words)), jnp.zeros((1, 4, classes)),
                                              one, jnp.zeros((1, 8, module.columns)), 8 * one))
  return _network(what, part, module, fields, shapes, convert.t2m_evaluator_names())


def _clip_evaluator(path, num_heads):
  what, part = "CLIP-type evaluator", read_part(path, ("contrast_model",))
  width, features = part.shape("motion_encoder.embed_motion.weight", what, 2)
  vocab_size, _ = part.shape("token_embedding.weight", what, 2)
  depth = part.count(r"motion_encoder\.transformer\.layers\.(\d+)\.")
  mlp_width, _ = part.shape("motion_encoder.transformer.layers.0.linear1.weight", what, 2)
  fields = dict(features=features, columns=features, width=width, depth=depth, num_heads=_heads(num_heads, width, 8),
                mlp_width=mlp_width, dim=part.shape("out.weight", what, 2)[0], vocab_size=vocab_size,
                max_words=part.shape("positional_embedding", what, 2)[0])
  module = ClipEvaluator(**fields)
  shapes = jax.eval_shape(lambda: module.init(jax.random.key(0), jnp.zeros((1, 4), jnp.int32),
                                              jnp.zeros((1, 4, features)), jnp.ones(1, jnp.int32)))
  return _network(what, part, module, fields, shapes, convert.clip_evaluator_names(depth),
                  convert.CLIP_EVALUATOR_IGNORED)


# --- writing -----------------------------------------------------------------------------------------------------


def write_cmdm(out, tokenizer_file, stats, denoiser_file=None, text=None, weights="ema", num_heads=None, block=3):
  """The run folder of a released CMDM; without a denoiser, that of its tokenizer -> the Networks.

  stats: a folder with the Mean.npy and Std.npy of the training data, which the checkpoints do not hold. text: folder
  of the text encoder; without one the run names DistilBERT, and loading says where to put it.
  """
  _check_free(out)
  vae = tokenizer(tokenizer_file)
  layout = layout_for(vae.fields["features"])
  stats = load_stats(stats, layout)
  if denoiser_file is None:
    config = dict(stage="cmdm.tokenizer", model=vae.fields, frozen={}, data=dict(layout=layout.name))
    _write(out, config, [vae], vae.params, stats)
    return [vae]
  dit = denoiser(denoiser_file, weights, num_heads, block)
  if dit.fields["latent_dim"] != vae.fields["latent_dim"]:
    raise ValueError(f"the denoiser makes latents of {dit.fields['latent_dim']} numbers, those of the tokenizer have "
                     f"{vae.fields['latent_dim']}; they are of different trainings")
  files = {}
  if text is not None:
    encoder = load_text_encoder(text)
    if encoder.dim != dit.fields["text_dim"]:
      raise ValueError(f"the text encoder {text} gives {encoder.dim} numbers a word, the denoiser was trained on "
                       f"{dit.fields['text_dim']}; give --text the encoder that it was trained on ({TEXT} has 768)")
    files[checkpoint.TEXT] = text_identity(encoder)
  config = dict(stage="cmdm.denoiser", tokenizer=vae.fields, model=dit.fields,
                frozen=dict(text=str(text or TEXT), tokenizer=checkpoint.FROZEN),
                data=dict(layout=layout.name, max_frames=192, max_words=64),
                sampler=dict(num_steps=50, lag=2, guidance_scale=3.0))  # facts: cmdm 8, inference
  zeros = np.zeros(vae.fields["latent_dim"], np.float32)  # Parity: released latents are not scaled
  frozen = {"tokenizer": vae.params, "latent_mean": zeros, "latent_std": zeros + 1}
  _write(out, config, [vae, dit], dit.params, stats, frozen, files)
  return [vae, dit]


def write_teacher(out, file, stats, text=None, num_heads=None):
  """The run folder of a released Part-TMR -> the Networks. text: folder of the text encoder that it started from,
  whose word pieces it reads; its own weights are those of the file."""
  _check_free(out)
  stats = load_stats(stats)
  encoder = None if text is None else load_text_encoder(text)
  made = teacher(file, stats.layout, num_heads, encoder and bert_fields_of(encoder.model))
  fields = dict(made.fields)
  config = dict(stage="cmdm.teacher", text=fields.pop("text"), model=fields, frozen=dict(text=str(text or TEXT)),
                loss=dict(text_pool="first"), data=dict(layout=stats.layout.name, max_frames=196, max_words=77))
  files = {checkpoint.TEXT: text_identity(encoder)} if encoder else {}
  _write(out, config, [made], made.params, stats, files=files)
  return [made]


def write_evaluator(out, file, stats, num_heads=None):
  """The folder of a released evaluator -> the Networks. stats: its own statistics, not those of the training data."""
  _check_free(out)
  made = evaluator(file, num_heads)
  stage = "evaluator.clip" if isinstance(made.module, ClipEvaluator) else "evaluator.t2m"
  stats = _evaluator_stats(stats, made.fields["columns"])
  config = dict(stage=stage, model=made.fields, data=dict(layout=stats.layout.name))
  _write(out, config, [made], made.params, stats)
  return [made]


def load_evaluator(folder):
  """(module, params, stats) of a folder that write_evaluator wrote."""
  config = checkpoint.load_config(folder)
  kinds = {"evaluator.t2m": T2MEvaluator, "evaluator.clip": ClipEvaluator}
  if config.get("stage") not in kinds:
    raise ValueError(f"{folder} holds a {config.get('stage')!r} run, expected an evaluator's; motion-jax convert "
                     "evaluator makes one")
  params = jax.tree.map(jnp.asarray, checkpoint.load_params(folder))
  return kinds[config.stage](**config.model), params, load_stats(folder, config.data.layout)


def _evaluator_stats(folder, columns):
  """Mean and std of a folder by length: Mean.npy and Std.npy, or the authors' eval_mean.npy, eval_mean_67.npy, ..."""
  folder, layout = pathlib.Path(folder), layout_for(columns)
  for mean in ("Mean.npy", "eval_mean.npy", f"eval_mean_{columns}.npy"):
    paths = folder / mean, folder / mean.replace("Mean", "Std").replace("mean", "std")
    if all(path.is_file() for path in paths):
      try:
        values = [np.load(path, allow_pickle=False).astype(np.float32) for path in paths]
      except (ValueError, EOFError) as error:
        raise ValueError(f"{paths[0]} or {paths[1].name} is no whole array of numbers ({error})") from error
      if values[0].shape == (columns,):
        return Stats(*values, layout)
  raise FileNotFoundError(f"{folder} has no statistics of {columns} numbers; expected the evaluator's own as Mean.npy "
                          f"and Std.npy, or as eval_mean_{columns}.npy and eval_std_{columns}.npy")


def _write(out, config, networks, params, stats, frozen=None, files=None):
  config |= dict(seed=0, converted={network.what: network.part.source for network in networks})
  with _new_folder(out) as folder:
    checkpoint.save_config(folder, ml_collections.ConfigDict(config))
    save_stats(stats, folder)
    checkpoint.save_params(folder, params)
    if frozen:
      checkpoint.save_params(folder, frozen, name=checkpoint.FROZEN)
    for name, content in (files or {}).items():
      checkpoint.save_text(folder, name, content)


def _check_free(out):
  out = pathlib.Path(out)
  if out.is_file() or out.is_dir() and any(out.iterdir()):
    raise ValueError(f"{out} exists already; choose another --out, or remove it first")


@contextlib.contextmanager
def _new_folder(out):
  """A folder under a temporary name that becomes `out` when the block ends well, and vanishes otherwise."""
  out = pathlib.Path(out).absolute()
  try:
    out.parent.mkdir(parents=True, exist_ok=True)
    made = pathlib.Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
  except OSError as error:
    raise OSError(f"cannot write {out}: {error.strerror or error}; choose a folder that you may write to") from error
  try:
    yield made
    os.chmod(made, 0o755)
    os.replace(made, out)
  finally:
    shutil.rmtree(made, ignore_errors=True)
