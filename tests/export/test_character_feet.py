"""A character's feet, whatever its shoes and hips: soles on the floor, a stance as broad as the hips."""
import dataclasses

import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.export.character import check_character
from motion_jax.export.character.posing import pose_figure
from motion_jax.motion import rotations as rot
from tests.export.characters import write_character
from tests.export.test_bvh import walk

CLIP = walk(40)


@pytest.fixture(scope="module")
def figure(tmp_path_factory):
  path = tmp_path_factory.mktemp("figure") / "body.glb"
  write_character(path, CLIP, size=1.7)
  return check_character(path)


def lowest(figure, posed):
  """Height (T,) of the lowest point of the soles, in a motion's metres."""
  return np.min([(posed.places[:, bone, None] + rot.rotate(posed.turned[:, bone, None], points[None]))[..., 1].min(1)
                 for bone, points in figure.soles.items()], axis=0)


@pytest.mark.parametrize("tip", [0.0, 0.1, 0.3])
def test_soles_stand_on_the_floor_whatever_the_length_of_the_shoes(tip, figure):
  """The tip of a long shoe dips at push-off; once this lifted the whole clip by 5 to 12 cm."""
  soles = {}
  for side in ("left", "right"):  # a stiff shoe on the ankle's bone, from the heel to the tip
    bone = figure.parts[f"{side}_ankle"]
    x, y, z = figure.places[bone]
    sole = np.array([[x, 0.0, z], [x, 0.0, z + 0.2 + tip]])
    soles[bone] = rot.rotate(rot.conjugate(figure.turned[bone])[None], sole - figure.places[bone])
  shod = dataclasses.replace(figure, soles=soles)
  joints = synthetic_joints("stand", 40, np.random.default_rng(0))
  rises = [joint for joint in range(22) if joint not in (10, 11)]  # all but the toes, for a third of the time
  joints[12:26, rises] += [0, 0.08, 0]
  low = lowest(shod, pose_figure(shod, CLIP.replace(joints=joints.astype(np.float32))))
  assert low.min() > -0.01 and low.max() < 0.02


@pytest.mark.parametrize("wide", [0.8, 1.0, 3.0])
def test_the_stance_is_as_broad_as_the_hips(wide, figure):
  hips = [figure.parts["left_hip"], figure.parts["right_hip"]]
  more = (wide - 1) * abs(figure.offsets[hips[0], 0])  # of each side
  offsets, places, legs = figure.offsets.copy(), figure.places.copy(), set(hips)
  for bone, parent in enumerate(figure.parents):
    legs |= {bone} if parent in legs else set()
  for bone in legs:
    side = np.sign(figure.places[bone, 0])
    places[bone, 0] += more * side
    offsets[bone, 0] += more * side * (bone in hips)
  broad = dataclasses.replace(figure, offsets=offsets, places=places)

  def stance(figure):
    posed = pose_figure(figure, CLIP)
    left, right = (posed.places[:, figure.parts[f"{side}_ankle"]][:, [0, 2]] for side in ("left", "right"))
    return np.median(np.abs(left - right)[:, 0])  # it walks along z

  assert abs(stance(broad) - stance(figure) - 2 * more) < 0.1 * abs(2 * more) + 0.01
