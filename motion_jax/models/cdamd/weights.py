"""CDAMD's and MARDM's released weights (docs/papers/cdamd.md)."""
import pathlib
import re
from typing import Any

import ml_collections
from ml_collections import ConfigDict

from motion_jax import paper_tables, runs
from motion_jax.convert.parts import (
  Network,
  check_free,
  check_sinusoids,
  heads_of,
  network,
  read_part,
  stats_of,
  text_files,
  without_clip,
  write,
)
from motion_jax.latents import AutoencoderCodec
from motion_jax.models import cdamd
from motion_jax.models.cdamd.weight_names import (
  mardm_names,
  masked_transformer_names,
)
from motion_jax.models.shared.autoencoder_weights import autoencoder, length_estimator, rvq, write_tokenizer
from motion_jax.nets.masked_transformer import SIZES, GatedTransformer
from motion_jax.training import checkpoint

# (width, depth) -> heads. Not of the paper's own size, which has none that divide it.
HEADS = {(size["width"], size["depth"]): size["num_heads"] for name, size in SIZES.items() if name != "large"} | {
    (GatedTransformer.width, GatedTransformer.depth): GatedTransformer.num_heads}
# Entries of a generator's file, the one to take first; CDAMD's files know no average.
WEIGHTS = {"ema": ("ema_mardm", "t2m_transformer", "trans"), "model": ("mardm", "t2m_transformer", "trans")}
TEXT = "clip-vit-base-patch32"
POSITIONS = "position_enc.pe"
DIFFUSIONS = ("flow", "ddpm")


def generator(path: str | pathlib.Path, weights: str = "ema", num_heads: int | None = None) -> Network:
  """A released masked transformer with its diffusion MLP, CDAMD's or MARDM's, detected from the content of the file.

  CDAMD: "t2m_transformer" (or "trans") of latest.tar. MARDM: "ema_mardm" (what is evaluated) or "mardm" of latest.tar.
  Fields are a model section: transformer, head. num_heads: without it, that of the known size of this width and depth.
  """
  if weights not in WEIGHTS:
    raise ValueError(f"got weights {weights!r}, expected one of {', '.join(WEIGHTS)}")
  part = without_clip(read_part(path, choices=WEIGHTS[weights], others=sum(WEIGHTS.values(), ())))
  kind = "mardm" if any(name.startswith("MARTransformer.") for name in part.state) else "cdamd"
  what = {"mardm": "MARDM generator", "cdamd": "CDAMD generator"}[kind]
  stack, widening = {"mardm": ("MARTransformer.", "mlp.fc1"), "cdamd": ("seqTransEncoder.layers.", "ff.0")}[kind]
  width, latent_dim = part.shape("input_process.poseEmbedding.weight", what, 2)
  depth = part.count(re.escape(stack) + r"(\d+)\.")
  transformer = dict(kind=kind, latent_dim=latent_dim, width=width, depth=depth,
                     num_heads=heads_of(num_heads, width, HEADS.get((width, depth))),
                     ff_width=part.shape(f"{stack}0.{widening}.weight", what, 2)[0],
                     text_dim=part.shape("cond_emb.weight", what, 2)[1], dropout=0.2)
  if kind == "cdamd":
    transformer |= dict(num_codes=part.shape("token_emb.weight", what, 2)[0],
                        num_levels=part.shape("codebook_type_emb.weight", what, 2)[0],
                        max_length=part.shape("seqTransEncoder.pos_emb", what, 3)[1])
  head = dict(width=part.shape("DiffMLPs.net.input_proj.weight", what, 2)[0],
              depth=part.count(r"DiffMLPs\.net\.res_blocks\.(\d+)\."))
  fields = dict(transformer=transformer, head=head)
  net = cdamd.make_generator(ml_collections.ConfigDict(fields))
  names = mardm_names if kind == "mardm" else masked_transformer_names
  check_sinusoids(part, POSITIONS, width)
  return network(what, part, net, fields, cdamd.generator_shapes(net), names(depth, head["depth"]), (POSITIONS,))


# --- writing -----------------------------------------------------------------------------------------------------


def write_cdamd(out: str | pathlib.Path, tokenizer_file: str | pathlib.Path | None, stats: Any,
                generator_file: str | pathlib.Path | None = None, rvq_file: str | pathlib.Path | None = None,
                length_file: str | pathlib.Path | None = None, text: str | None = None, weights: str = "ema",
                num_heads: int | None = None, diffusion: str = "flow") -> list[Network]:
  """The run folder of a released CDAMD or MARDM -> the Networks.

  Without a generator it is that of the autoencoder or, of an RVQ-VAE's file alone (tokenizer_file None), of that.
  stats: a folder with the statistics of the training data, which checkpoints do not hold. diffusion: "ddpm" for MARDM's
  other variant, whose tensors look the same. text: folder of the text encoder; without one the run names CLIP ViT-B/32,
  and loading says where to put it.
  """
  check_free(out)
  if diffusion not in DIFFUSIONS:
    raise ValueError(f"got diffusion {diffusion!r}, expected one of {', '.join(DIFFUSIONS)}")
  if generator_file is None and (length_file is not None or (tokenizer_file is None) == (rvq_file is None)):
    raise ValueError("give a tokenizer and a generator, with an RVQ-VAE and a length estimator if there are; or a "
                     "tokenizer alone, or an RVQ-VAE alone")
  if generator_file is None:
    read, file = (autoencoder, tokenizer_file) if rvq_file is None else (rvq, rvq_file)
    ae = read(file)  # type: ignore[arg-type]  # one of the two is given
    stage = "cdamd.autoencoder" if rvq_file is None else "cdamd.rvq"
    return write_tokenizer(out, ae, stats_of(stats, ae.fields["features"]), stage)
  if tokenizer_file is None:
    raise ValueError("a generator makes latents; give the file of the tokenizer that makes motion of them, too")

  ae = autoencoder(tokenizer_file)
  stats = stats_of(stats, ae.fields["features"])
  gen = generator(generator_file, weights, num_heads)
  transformer = gen.fields["transformer"]
  if transformer["latent_dim"] != ae.fields["latent_dim"]:
    raise ValueError(f"the generator makes latents of {transformer['latent_dim']} numbers, those of the tokenizer have "
                     f"{ae.fields['latent_dim']}; they are of different trainings")
  frozen = AutoencoderCodec(ae.module, ae.params).unscaled().parts  # Parity: released latents are not scaled
  networks = [ae, gen]
  config = _generator_config(ae, gen, stats.layout, diffusion)
  if rvq_file is not None:
    prior = rvq(rvq_file)
    _check_prior(prior, ae, transformer)
    frozen["prior"] = prior.params
    quantizer = {name: prior.fields.pop(name) for name in ("num_levels", "num_codes")}
    config |= dict(prior=prior.fields, quantizer=quantizer)
    networks.append(prior._replace(fields=prior.fields | quantizer))
    if quantizer["num_codes"] < transformer["num_codes"]:  # Parity: the reference's table is longer than its codebook
      networks[1] = gen._replace(note=f"token_emb: rows {quantizer['num_codes']} to {transformer['num_codes'] - 1} are "
                                      "kept and belong to no code")
  if length_file is not None:
    estimator = length_estimator(length_file)
    _, text_dim = estimator.part.shape("output.0.weight", estimator.what, 2)
    if text_dim != transformer["text_dim"]:
      raise ValueError(f"the length estimator reads {text_dim} numbers a sentence, the generator "
                       f"{transformer['text_dim']}; they are of different trainings")
    frozen["length"], config["length"] = estimator.params, estimator.fields
    networks.append(estimator)
  files = text_files(text, transformer["text_dim"], "generator", f"{TEXT} has 512", level="sentence")
  config["frozen"] = dict(text=str(text or TEXT), tokenizer=checkpoint.FROZEN)
  write(out, config, networks, gen.params, stats, frozen, files)
  return networks


def _check_prior(prior, tokenizer, transformer):
  if transformer["kind"] == "mardm":
    raise ValueError("MARDM's generator has no prior; leave the RVQ-VAE out")
  if prior.fields["features"] != tokenizer.fields["features"]:
    raise ValueError(f"the RVQ-VAE takes {prior.fields['features']} numbers a frame, the tokenizer "
                     f"{tokenizer.fields['features']}; they are of different trainings")
  if prior.fields["num_codes"] > transformer["num_codes"]:
    raise ValueError(f"the RVQ-VAE has {prior.fields['num_codes']} codes, the generator's table "
                     f"{transformer['num_codes']} rows; they are of different trainings")


def _generator_config(tokenizer, gen, layout, diffusion):
  """Config of generation, apart from the sizes: the choices of the released evaluations.

  Source: docs/papers/cdamd.md#generation.
  """
  kit, ddpm = layout.skeleton.name == "kit", diffusion == "ddpm"
  sampler = dict(num_iterations=10, guidance_scale=2.0 if kit else 4.0, order="random", mask="causal")
  mask = "dccm"
  if gen.fields["transformer"]["kind"] == "mardm":
    mask = "bidirectional"
    sampler |= dict(num_iterations=18, guidance_scale=2.5 if kit else 4.5, mask=mask)
  sampler |= dict(solver="ddpm", num_steps=50) if ddpm else dict(solver="midpoint", num_steps=10)
  data = dict(layout=layout.name, mode="benchmark", min_frames=24 if kit else 40, max_frames=196)
  config = dict(stage="cdamd.generator", tokenizer=tokenizer.fields, model=gen.fields, data=data,
                loss=dict(mask=mask, diffusion=diffusion, ddpm_steps=50), sampler=sampler | dict(unmasked_only=True))
  # With how many levels of the prior a CDAMD was trained its tensors do not tell, so not its row either.
  transformer, rows = gen.fields["transformer"], {}
  if transformer["kind"] == "mardm" and (transformer["width"], transformer["depth"]) == (1024, 1):
    rows = {"essential": {"cmdm 6": "MARDM-DDPM" if ddpm else "MARDM-SiT"},
            "coordinates": {} if ddpm else {"cdamd 1": "MARDM-SiT-XL", "cdamd 3": "MARDM"}}.get(layout.name, {})
  return config | dict(paper_row=paper_tables.claim(runs.with_defaults(ConfigDict(config)), rows))
