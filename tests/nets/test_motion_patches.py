"""MotionPatches is the reference's: the image of a motion, its vision transformer, heads and contrast."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.models import tmr
from motion_jax.models.tmr.weight_names import motion_patches_from_torch
from motion_jax.motion.body_parts import chain_columns
from motion_jax.nets.motion_patches import MotionPatches
from motion_jax.nets.vit import resize_positions
from motion_jax.text.bert import Bert, bert_fields
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.golden import check, golden, recordings


def network(fixture, dtype):
  sizes = fixture.config
  fields = bert_fields({"model_type": "distilbert", **sizes["text"]})
  width = sizes["width"]
  net = MotionPatches(width, sizes["layers"], sizes["heads"], 4 * width, sizes["projection"], num_rows=sizes["image"],
                      chains=chain_columns("coordinates"), dtype=dtype)
  params = motion_patches_from_torch(fixture.params, fields, sizes["layers"])
  return net, Bert(**fields, dtype=dtype), jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


def clips_of(fixture, dtype):
  """The recorded joints, normalized, cut from frame 0 and padded: (B, T, 66) and frames (B,)."""
  frames = fixture.config["frames"]
  joints = (fixture["in/joints"].astype(np.float64) - fixture["in/mean"]) / fixture["in/std"]
  longest = min(max(frames), fixture.config["image"])
  x = np.zeros((len(frames), longest, 66))
  for row, clip in zip(x, np.split(joints.reshape(len(joints), -1), np.cumsum(frames)[:-1])):
    row[:len(clip)] = clip[:longest]
  return jnp.asarray(x, dtype), jnp.minimum(jnp.asarray(frames), longest)


@golden("motion_patches", leave_out=("grad/",), bounds={"": (1e-5, 1e-10)})  # nothing changes a gradient on its way
def run_motion_patches(fixture, dtype):
  net, bert, params = network(fixture, dtype)
  x, frames = clips_of(fixture, dtype)
  mask = jnp.arange(x.shape[1]) < frames[:, None]
  ids, text_mask = jnp.asarray(fixture["in/input_ids"]), jnp.asarray(fixture["in/attention_mask"], bool)
  apply = lambda motion, method, *inputs: net.apply({"params": motion}, *inputs, method=method)

  @jax.jit
  def run(params):
    motion = params["motion"]
    made = {"motion_unit": tmr.embed_motion(net, params, x, mask),
            "text_unit": tmr.embed_text(net, bert, params, ids, text_mask)}
    made["loss"], made["logits"] = tmr.info_nce(made["text_unit"], made["motion_unit"], apply(motion, "scale"))
    made["text_hidden"] = bert.apply({"params": params["text"]}, ids, text_mask)
    made |= {"tokens": apply(motion, "tokens", x, mask), "motion_features": apply(motion, "features", x, mask),
             "motion_embedding": apply(motion, "motion_vector", x, mask),
             "text_embedding": apply(motion, "text_head", made["text_hidden"][:, 0])}
    image = apply(motion, "image", x, mask)
    return made | {f"image/{i}": image[i] for i in fixture.config["shown"]}

  made = run(params)
  kit = (fixture["in/kit/joints"].astype(np.float64) - fixture["in/kit/mean"]) / fixture["in/kit/std"]
  rows = fixture["out/kit/image"].shape[1]
  wide = MotionPatches(chains=chain_columns("coordinates_kit"), upsample=True, dtype=dtype)
  image = wide.apply({"params": {"logit_scale": jnp.zeros(())}}, jnp.asarray(kit.reshape(1, len(kit), -1), dtype),
                     method="image")[0]
  assert not image[:, rows:].any()  # padding begins where the recorded image, which has none, ends
  table = jnp.asarray(fixture["in/pos_square"][0], dtype)
  made |= {"kit/image": image[:, :rows], "pos_resized": resize_positions(table, (14, 14), (14, 5))[None]}
  return made


@pytest.mark.slow
@recordings("motion_patches")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


@pytest.fixture(scope="module")
def small():
  net = MotionPatches(8, 1, 2, 8, 4, chains=chain_columns("coordinates"), num_rows=32, patch=8, num_points=8)
  x = jnp.asarray(np.random.default_rng(0).normal(size=(2, 32, 66)), jnp.float32)
  return net, _params(net, x), x


def _params(net, x):
  return untrained(jax.eval_shape(net.init, jax.random.key(1), x, jnp.zeros((len(x), 6))))


def test_padding_is_invisible(small):
  """A short clip is an image with zeros below it, whatever its array holds there and however long that is."""
  net, params, x = small
  clip = jax.jit(lambda x, count: net.apply(params, x, jnp.arange(x.shape[1]) < count[:, None], method="motion_vector"))
  short = clip(x[1:, :13], jnp.array([13]))[0]
  assert np.allclose(clip(x, jnp.array([32, 13]))[1], short, atol=1e-5)
  assert not np.allclose(clip(x, jnp.array([32, 20]))[1], short, atol=1e-4)


def test_a_frame_has_the_feature_of_its_row_of_patches(small):
  """The head of the normalized mean over a row's chains; all frames of a row share it, and the teacher looks both ways.
  """
  net, params, x = small
  frames = jax.jit(lambda x: net.apply(params, x, method="frames"))
  made = frames(x[:, :24])
  assert made.shape == (2, 24, net.dim)
  assert (made.reshape(2, 3, 8, -1) == made.reshape(2, 3, 8, -1)[:, :, :1]).all()
  padded = frames(jnp.pad(x[:, :24], ((0, 0), (0, 8), (0, 0))))
  assert np.allclose(padded[:, :24], made, atol=1e-6)  # the rest of the image is zeros, as in training
  changed = np.abs(frames(x.at[:, -1].add(5.0)) - frames(x)).max((0, 2))
  assert (changed > 0).all()
  with pytest.raises(ValueError, match="40 frames, the image shows 32"):
    frames(jnp.zeros((1, 40, 66)))


def test_a_wrong_image_is_refused():
  with pytest.raises(ValueError, match="37 positions for a grid of 5 x 5"):
    resize_positions(np.zeros((37, 2)), (5, 5), (6, 2))
  with pytest.raises(ValueError, match="multiples of the patch's 16"):
    MotionPatches(num_rows=60, chains=chain_columns("coordinates")).init(jax.random.key(0), jnp.zeros((1, 8, 66)),
                                                                         jnp.zeros((1, 6)))
