"""MoMask's decoding in rounds and levels, editing and pipeline are the reference's: its recorded runs."""

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.convert.state import select
from motion_jax.models import mask_schedule as masking
from motion_jax.models.momask import sampling
from motion_jax.motion.representations import to_joints
from motion_jax.nets.masks import padding_mask
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.models.momask.recorded import (
  CODES,
  EXACT,
  codec_of,
  given,
  gumbel_of,
  real_rows,
  recorded,
  transformer_of,
)


def recorded_choice(draws, prefix, threshold, temperature, gumbel=True):
  """choose(i, logits) by recorded uniforms u0, u1, ... below a prefix, in order; levels count from 1."""
  names = sorted((name for name in draws if name.startswith(prefix) and name[len(prefix):].isdigit()),
                 key=lambda name: int(name[len(prefix):]))
  first, u = int(names[0][len(prefix):]), jnp.stack([draws[name] for name in names])

  def by_sum(i, logits):
    shares = jax.nn.softmax(sampling.keep_likeliest(logits, threshold) / temperature, -1)
    return jnp.minimum((jnp.cumsum(shares, axis=-1) <= u[i - first][..., None]).sum(-1), logits.shape[-1] - 1)

  if not gumbel:
    return by_sum
  return sampling.chooser(lambda i: gumbel_of(u[i - first]), temperature, threshold)


def decoded_rounds(fixture, dtype, net, params, codes, editable, real, text, draws, prefix, num_rounds, scale,
                   counts=None, threshold=0.9, temperature=1.0, gumbel=True, rescore=False):
  """The recorded loop -> ({"masked", "input", "drawn", "ids", "logits"}, last codes)."""
  counts = masking.masked_counts(num_rounds, np.asarray(editable).sum(-1)) if counts is None else counts
  choose = recorded_choice(draws, prefix, threshold, temperature, gumbel)
  scale = None if scale == 1 else scale
  run = jax.jit(lambda codes, text: sampling.decode_masked(net, params, codes, editable, real, counts, text, scale,
                                                           choose, rescore))
  rounds = run(codes, text)
  ids = jnp.where(real, rounds.codes[-1], -1)
  return {"masked": rounds.masked, "input": rounds.given, "drawn": rounds.drawn, "ids": ids,
          "logits": jnp.moveaxis(rounds.logits, -1, -2)}, ids


def kept(fixture, dtype, prefix, out, real):
  """Outputs that the file has, ours at real places."""
  made = {}
  for name, array in out.items():
    if f"out/{prefix}{name}" in fixture.arrays:
      here = np.asarray(real)
      shown = np.broadcast_to(here[:, None] if name == "logits" else here, array.shape)
      made[prefix + name] = np.where(shown, array, recorded(fixture, dtype, prefix + name))
  return made


RUNS = {f"{run}/{name}": EXACT for run in ("gumbel", "categorical", "warm", "plain", "no_text")
        for name in ("ids", "masked", "input", "drawn")}


@golden("momask/mask_generate", bounds=RUNS | {"": (1e-4, 1e-10)})
def run_mask_generate(fixture, dtype):
  net, params, _ = transformer_of("masked", fixture.meta["arguments"], fixture.params, dtype)
  x, made = given(fixture, dtype), {}
  length = fixture["out/" + next(iter(fixture.meta["runs"])) + "/ids"].shape[1]
  real = padding_mask(x["lengths"], length)
  for run, fields in fixture.meta["runs"].items():
    text, scale = x["text"], fields["cond_scale"]
    if fields.get("force_mask"):
      text, scale = 0 * text, 1
    out, _ = decoded_rounds(fixture, dtype, net, params, jnp.zeros(real.shape, int), real, real, text,
                            given(fixture, dtype, f"in/{run}/"), "u", fields["timesteps"], scale,
                            threshold=fields.get("topk_filter_thres", 0.9), temperature=fields.get("temperature", 1),
                            gumbel=fields["gsample"])
    made |= kept(fixture, dtype, f"{run}/", out, real)
  return made


def levels_of(net, params, ids, real, text, draws, prefix, scale, num_levels=None, threshold=0.9, temperature=1.0):
  choose = recorded_choice(draws, prefix, threshold, temperature)
  scale = None if scale == 1 else scale
  run = jax.jit(lambda ids, text: sampling.add_levels(net, params, ids, real, text, scale, choose, num_levels,
                                                      padding_class=True))
  return run(ids, text)


@golden("momask/residual_generate", bounds={f"{run}/codes": EXACT for run in ("scale5", "scale2", "two_levels")} | {
    "": (1e-4, 1e-10)})
def run_residual_generate(fixture, dtype):
  net, params, _ = transformer_of("residual", fixture.meta["arguments"], fixture.params, dtype)
  x, made = given(fixture, dtype), {}
  real = padding_mask(x["lengths"], x["ids"].shape[1])
  for run, fields in fixture.meta["runs"].items():
    codes, logits = levels_of(net, params, x["ids"], real, x["text"], given(fixture, dtype, f"in/{run}/"), "u",
                              fields["cond_scale"], fields.get("num_res_layers"), fields.get("topk_filter_thres", 0.9),
                              fields["temperature"])
    made[f"{run}/codes"] = codes
    for level, array in enumerate(logits, 1):
      if f"out/{run}/logits{level}" in fixture.arrays:
        made[f"{run}/logits{level}"] = real_rows(fixture, dtype, f"{run}/logits{level}", array.swapaxes(1, 2), real, -1)
  return made


def parts_of(fixture, dtype):
  sizes, state = fixture.meta["arguments"], fixture.params
  codec, _ = codec_of(sizes["rvq"], select(state, "vq."), dtype)
  return codec, transformer_of("masked", sizes, select(state, "mask."), dtype)[:2], transformer_of(
      "residual", sizes, select(state, "res."), dtype)[:2]


CASES = {f"{case}/{name}": EXACT for case in ("middle", "frames", "free") for name in (*CODES, "edit_mask")}


@golden("momask/edit", bounds=CASES | CODES | {"": (2e-4, 1e-10)})
def run_edit(fixture, dtype):
  codec, (net, params), (res_net, res_params) = parts_of(fixture, dtype)
  x = given(fixture, dtype)
  tokens = jax.jit(lambda x: codec.encode(x)[0])(x["motion"])
  length, unit = tokens.shape[1], codec.frames_per_latent
  real = padding_mask(x["frames"] // unit, length)
  made = {"tokens": tokens}
  for case, fields in fixture.meta["cases"].items():
    counts, editable = None, np.zeros((1, length), bool)
    for first, past in fields.get("sections", []):
      # Parity: a share counts on the padded tokens, in the reference.
      place = (lambda a: int(a * length)) if isinstance(first, float) else (lambda a: a // unit)
      editable[:, place(first):place(past)] = True
    if "sections" in fields:
      made[f"{case}/edit_mask"] = editable
      editable = editable & np.asarray(real)
    else:
      editable = np.asarray(real)
      share = np.float32(0.16) * editable.sum(-1).astype(np.float32)
      counts = np.tile(np.maximum(1, np.round(share)).astype(int), (fields["rounds"], 1))
    draws = given(fixture, dtype, f"in/{case}/")
    out, ids = decoded_rounds(fixture, dtype, net, params, tokens[..., 0], jnp.asarray(editable), real, x["text"],
                              draws, "u", fields["rounds"], fields["scale"], counts, rescore=counts is not None)
    # Parity: the reference draws the residual levels of the whole clip again, and feeds the padding class on.
    codes, _ = levels_of(res_net, res_params, ids, real, x["text"], draws, "res_u", fields.get("res_scale", 2))
    made |= kept(fixture, dtype, f"{case}/", out, real)
    made |= {f"{case}/res_codes": codes, f"{case}/motion": jax.jit(codec.decode)(codes)}
  return made


@golden("momask/pipeline", bounds=CODES | {"": (2e-4, 1e-10)})
def run_pipeline(fixture, dtype):
  codec, (net, params), (res_net, res_params) = parts_of(fixture, dtype)
  x = given(fixture, dtype)
  lengths = fixture["in/frames"] // codec.frames_per_latent
  real = padding_mask(jnp.asarray(lengths), int(lengths.max()))
  rounds = len([name for name in fixture.under("in/u") if name.isdigit()])
  empty = jnp.zeros(real.shape, int)
  out, ids = decoded_rounds(fixture, dtype, net, params, empty, real, real, x["text"], x, "u", rounds, 4)
  codes, _ = levels_of(res_net, res_params, ids, real, x["text"], x, "res_u", 5)
  # Parity: the reference decodes padding as zero vectors, so the end of a clip depends on its batch; ours ends there.
  motion = jax.jit(codec.decode)(codes)
  features = motion * x["std"] + x["mean"]
  made = kept(fixture, dtype, "", out, real) | {"res_codes": codes, "motion": motion}
  for i, length in enumerate(lengths):
    made[f"joints{i}"] = to_joints(features[i, :length * codec.frames_per_latent])
  return made


@recordings("mask_generate", "residual_generate", "pipeline", single=("edit",), further=True)
def test_golden(name, precision):
  assert not check(fixtures.path(f"momask/{name}.npz"), [precision]).failures
