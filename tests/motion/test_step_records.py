"""Records of steps: what a comparison of joints measures, in words, and in the files that carry meta."""
import json

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.export.glb import facts
from motion_jax.motion.leaning import lean
from motion_jax.motion.skeleton import HUMANML3D, SKELETONS
from motion_jax.motion.step_records import added, change_between, largest, lines, record

WALK = synthetic_joints("walk", 40, np.random.default_rng(0)).astype(np.float32)


def test_a_change_is_measured_in_frames_centimetres_and_degrees():
  moved = WALK.copy()
  moved[5:9, 20] += [0, 0.123, 0]
  moved[30:32] += [0.01, 0, 0]
  assert change_between(WALK, moved) == {"frames": [[5, 9], [30, 32]], "cm": 12.3, "degrees": 0.0}
  assert change_between(WALK, WALK + 1e-5) == {} and change_between(WALK, WALK[:30]) == {"num_frames": [40, 30]}
  assert change_between(WALK[10:], moved[10:], start=10)["frames"] == [[30, 32]]
  turned = WALK @ np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
  assert change_between(WALK, turned)["degrees"] == pytest.approx(90, abs=0.1)
  assert 15 < change_between(WALK, lean(WALK, 0, 1, np.full(40, 20.0)))["degrees"] < 25
  for skeleton in SKELETONS.values():  # each in its own unit
    joints = np.zeros((3, skeleton.num_joints, 3))
    assert change_between(joints, joints + [0, 0.1 / skeleton.unit, 0], skeleton)["cm"] == 10.0


def test_a_record_is_one_line_and_a_file_of_anyone_cannot_break_it():
  row = record("pose", "hands brought to their places", WALK, WALK + [0, 0.05, 0], HUMANML3D, (1.25, 0))
  meta = added(added({"seed": 3}, record("sample", "one pass of the network")), row)
  assert json.loads(json.dumps(meta)) == meta and meta["seed"] == 3
  assert lines(meta) == ["sample: one pass of the network",
                         "pose: hands brought to their places, frames 0 to 39, up to 5 cm, score 1.25 to 0"]
  assert largest([row, row | {"cm": 7.0}]) == {"step": "pose", "did": row["did"], "cm": 7.0, "degrees": 0.0}
  for steps in (3, "text", [3], [{"step": 1, "did": ""}], None):
    assert lines({"steps": steps}) == []
  for wrong in ({"cm": "far"}, {"frames": 3}, {"frames": [[1]]}, {"score": [1]}, {"num_frames": ["a", 2]}):
    assert lines({"steps": [{"step": "pose", "did": "x"} | wrong]}) == ["pose: x"], wrong


def test_files_that_carry_meta_carry_the_steps(tmp_path):
  steps = [record("sample", "one pass of the network"), record("pose", "a <hand> moved", WALK, WALK + 0.1)]
  clip = Clip(WALK[:8], 20.0, meta={"steps": steps})
  for ending in (".npz", ".glb", ".html"):
    export.save(clip, tmp_path / f"walk{ending}")
  assert export.load(tmp_path / "walk.npz").meta["steps"] == steps
  data = (tmp_path / "walk.glb").read_bytes()
  document = json.loads(data[20:20 + int.from_bytes(data[12:16], "little")])
  assert document["animations"][0]["extras"]["steps"] == steps and "steps" not in facts(Clip(WALK, 20.0))
  page = (tmp_path / "walk.html").read_text()
  assert "pose: a &lt;hand&gt; moved, frames 0 to 39, up to 17.3 cm\n" in page.replace("</div>", "\n")
  assert "motion 2: sample" in export.page([clip, clip.replace(meta={"steps": steps[:1]})])
