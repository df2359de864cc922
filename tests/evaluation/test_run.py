"""Evaluation by a protocol: the same numbers every time, after a kill, on several devices; bad input is refused."""
import json
import re
import shutil

import numpy as np
import pytest

from motion_jax.evaluation import aggregates, protocols, request, run
from motion_jax.evaluation import test_set as test_set_lib
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.request import Request
from motion_jax.evaluation.result import HALVES, Result
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax_studio import cli
from tests import processes
from tests.conftest import devices_env
from tests.evaluation.small import SMALL, make_clips, write_archive  # noqa: F401  other rooms take them from here


@pytest.fixture(scope="module")
def judged(tiny_run, archive, evaluators, tmp_path_factory):
  """(result, its folder) of a whole evaluation with controls."""
  home = tmp_path_factory.mktemp("judged")
  made = run.evaluate(Request([tiny_run], [archive], SMALL, out=home / "out", force=True, controls=True, verbose=False,
      sampling=dict(num_steps=2), samples=home / "samples", **evaluators))
  return made, home / "out"


def again(judged, tiny_run, archive, evaluators, out, **options):
  """The same once more, from the same samples."""
  return run.evaluate(Request([tiny_run], [archive], SMALL, out=out, force=True, verbose=False,
      sampling=dict(num_steps=2), **{"samples": judged[1].parent / "samples", "controls": True} | evaluators |
      options))


@pytest.mark.slow
def test_a_result_has_rows_intervals_and_its_provenance(judged, tiny_run):
  result, out = judged
  row = result.rows[tiny_run.name]
  assert result.row_order == ["real", tiny_run.name] and {"shuffled", HALVES} <= set(result.rows)
  assert f"| {HALVES} |" in tables.markdown(result)
  assert len(row["fid"]["values"]) == 2 and len(row["multimodality"]["values"]) == 1
  assert row["fid"]["mean"] == pytest.approx(np.mean(row["fid"]["values"]))
  assert row["fid"]["interval"] == pytest.approx(12.7062 * np.std(row["fid"]["values"], ddof=1) / np.sqrt(2), rel=1e-5)
  assert row["multimodality"]["interval"] is None
  assert set(result.metrics) <= set(row) and row["jerk"]["mean"] > 0
  data, (model,) = result.provenance["data"], result.provenance["models"]
  assert data["items"] == 9 and data["samples"] == 8 and data["excluded"] == 0
  assert model["sampling"] == {"num_steps": 2} and len(model["hash"]) == 64
  assert json.loads((out / "results.json").read_text()) == result.as_json()
  assert Result.read(out) == result and Result.read(out).folder == out
  for name in ("tables.md", "tables.tex", "tables.csv", "timings.json", *(entry["made"] for entry in result.gallery)):
    assert (out / name).is_file()


@pytest.mark.slow
def test_choices_of_sampling_are_rows(judged, tiny_run, archive, evaluators, tmp_path):
  """One choice alone and among others: the same numbers, from the same samples."""
  shared = shutil.copytree(judged[1].parent / "samples", tmp_path / "samples")
  before = set(shared.iterdir())
  made = run.evaluate(Request([tiny_run], [archive], SMALL, out=tmp_path, force=True, verbose=False,
      sampling=dict(num_steps=2), vary=[dict(schedule="fss"), dict(schedule="ar")], guidance_scales=(1.0, 3.0),
      multimodality=False, samples=shared, **evaluators))
  name = tiny_run.name
  assert made.row_order == ["real", *(f"{name}{part}, guidance {scale}" for scale in (1, 3)
                                         for part in (", schedule fss", ", schedule ar"))]
  rows = [made.rows[row]["fid"]["values"] for row in made.row_order[1:]]
  assert len(set(shared.iterdir()) - before) == 3  # what is said anyway is not made again
  own = judged[0].provenance["models"][0]["guidance_scale"]
  assert own == 3.0 and rows[2] == judged[0].rows[name]["fid"]["values"]
  assert [made.curves[f"FID against guidance, {name}{part}"]["x"]
          for part in (", schedule fss", ", schedule ar")] == [[1, 3]] * 2


def content(folder):
  """results.json and the tables as text, less whether somebody is at work on the checkout."""
  return re.sub(r'"changed": \w+', "", "".join((folder / name).read_text() for name in (
      "results.json", "tables.md", "tables.tex")))


@pytest.mark.slow
def test_a_repeat_is_byte_identical_and_so_is_one_that_was_killed(judged, tiny_run, archive, evaluators, tmp_path):
  """With all samples there, and with some of them gone or cut short: the same file."""
  _, out = judged
  before = content(out)
  made = sorted((judged[1].parent / "samples").rglob("*.npz"))
  assert len(made) == 3  # two replications, one multimodality
  times = [path.stat().st_mtime_ns for path in made]
  again(judged, tiny_run, archive, evaluators, tmp_path / "a", recompute=True)
  assert times == [path.stat().st_mtime_ns for path in made]
  made[0].unlink()
  made[1].write_bytes(made[1].read_bytes()[:100])
  with pytest.raises(ValueError, match="does not exist"):
    again(judged, tiny_run, archive, evaluators, tmp_path / "b", recompute=True)
  again(judged, tiny_run, archive, evaluators, tmp_path / "b")
  for folder in "ab":
    assert content(tmp_path / folder) == before


@pytest.mark.slow
def test_a_control_that_fails_is_said_at_the_end_and_by_the_status(judged, archive, monkeypatch, capsys):
  """Random evaluators notice little."""
  monkeypatch.setattr(run, "evaluate", lambda *given, **more: judged[0])
  assert cli.main(["--data", str(archive)], "evaluate", "eval.py") == 1
  assert re.search("eval.py: control: .* does not go", capsys.readouterr().err)


@pytest.mark.slow
@pytest.mark.parametrize("arguments, words", [
    (["--sampling", "nm_steps=2"], "got the choice of sampling 'nm_steps', .* knows schedule, num_steps, lag"),
    (["--sampling", "guidance_scale=3"], "--guidance-scale takes scales"),
    (["--vary", "lag"], "got the choice of sampling 'lag', expected KEY=VALUE"),
    (["--motions", "real=somewhere"], "expected NAME=DIR with unique names other than real"),
    (["--protocol", "reconstruction", "--guidance-scale", "2"], "is not sampled, so guidance"),
    (["--protocol", "mtt", "--evaluator", "some"], "of kind 't2m', protocol 'mtt' is about the space of kind tmr"),
    (["--clip-evaluator", "other"], "got --clip-evaluator 'fresh-t2m' of kind 't2m'"),
])
def test_what_cannot_be_computed_is_refused_before_anything_is_done(tiny_run, archive, evaluators, monkeypatch, capsys,
                                                                    arguments, words):
  """At the command line, with a small protocol and random evaluators in the place of those that ship."""
  monkeypatch.setitem(protocols.PROTOCOLS, "archives-66", SMALL)
  monkeypatch.setattr(request, "load_evaluator", lambda name: evaluators[f"{'clip_' * ('clip' in name)}evaluator"])
  monkeypatch.setattr(run.sanity_lib, "check", lambda harness: pytest.fail("began"))
  arguments = ["--model", str(tiny_run), "--data", str(archive), "--out", "nowhere", *arguments]
  assert cli.main(arguments, "evaluate", "eval.py") == 1
  assert re.search(f"eval.py: (.|\n)*{words}", capsys.readouterr().err)


@pytest.mark.slow
def test_a_result_is_not_lost_to_another_question(judged, tiny_run, archive, evaluators, tmp_path, monkeypatch):
  monkeypatch.setattr(run, "default_out", lambda runs, protocol: judged[1])
  with pytest.raises(ValueError, match="holds a result of another models, which would be lost; name a folder by --out"):
    run.evaluate(Request([tiny_run], [archive], SMALL, force=True, verbose=False, sampling=dict(num_steps=3),
        **evaluators))


def test_intervals_of_a_papers_protocol_are_the_papers():
  values = [1.0, 2.0, 4.0]
  assert aggregates.interval(values)["interval"] == pytest.approx(1.96 * np.std(values) / 3**0.5)
  assert aggregates.interval(values, False)["interval"] == pytest.approx(4.30265 * np.std(values, ddof=1) / 3**0.5)


@pytest.mark.slow
def test_devices_take_batches_in_turn_and_give_the_same_motions(forks, tmp_path):
  """Seven motions in batches of three, on two simulated devices and on one of them."""
  script = f"""
import jax
import numpy as np
from motion_jax.evaluation import samples
used = []
def make(jobs):
  used.append(jax.numpy.zeros(1).devices().pop())  # the default device of this thread
  return [np.full((count + 2, 3), seed) for count, seed in zip(jobs.frames, jobs.seeds)]
frames = [8, 4, 12, 4, 20, 16, 8]
jobs = samples.Jobs(list("abcdefg"), frames, list(range(7)), list(range(7)))
devices = jax.local_devices()
for name, some in (("two", devices), ("one", devices[:1])):
  made = samples.sample(make, samples.Store({str(tmp_path)!r}, dict(a=name)), "r000", jobs, batch=3, devices=some)
  assert [(len(x), int(x[0, 0])) for x in made] == [(m + 2, i) for i, m in enumerate(frames)]
assert len(devices) == 2 and sorted(map(str, used[:3])) == sorted(map(str, [devices[0], devices[0], devices[1]]))
assert used[3:] == 3 * devices[:1]
"""
  done = processes.run(["-c", script], devices_env(2))
  assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_motions_of_a_model_are_judged_the_same_from_files(judged, tiny_run, archive, evaluators, tmp_path):
  """Prompts are those that a model of ours gets; its motions, given back, have its numbers."""
  result, _ = judged
  wanted = Request((), [archive], SMALL, evaluator=evaluators["evaluator"], replications=2)
  run.export_prompts(wanted, tmp_path / "made")
  lines = [json.loads(line) for line in (tmp_path / "made" / "prompts.jsonl").read_text().splitlines()]
  assert len(lines) == 2 * 8 + 4 * 2 and lines[0].keys() == {"file", "caption", "frames", "fps", "seed", "id"}
  stored = {}
  for path in (judged[1].parent / "samples").rglob("*.npz"):
    with np.load(path) as file:
      for seed, start, end in zip(file["seeds"].tolist(), file["start"], file["start"][1:]):
        stored[seed] = file["features"][start:end]
  for line in lines:
    path = tmp_path / "made" / line["file"]
    path.parent.mkdir(exist_ok=True)
    assert len(stored[line["seed"]]) >= line["frames"]
    np.save(path, stored[line["seed"]][:line["frames"]])  # other programs write nothing after the end
  made = run.evaluate(Request([], [archive], SMALL, out=tmp_path / "out", force=True, verbose=False, **evaluators,
      motions=[("theirs", tmp_path / "made")]))
  assert made.row_order == ["real", "theirs"] and made.provenance["models"][0]["layout"] == "full"
  for metric, one in result.rows[tiny_run.name].items():
    assert made.rows["theirs"][metric]["values"] == one["values"], metric
  (tmp_path / "made" / lines[3]["file"]).unlink()
  with pytest.raises(FileNotFoundError, match="1 of 8 motions of 'theirs' are not in .*r000/00003.npy"):
    run.evaluate(Request([], [archive], SMALL, out=tmp_path / "out", force=True, verbose=False, **evaluators,
        motions=[("theirs", tmp_path / "made")]))


@pytest.mark.slow
def test_physics_of_the_controls_moves_as_it_should(judged):
  """What random evaluators cannot know is left to trained ones; jerk, skating and the like need none."""
  checked = judged[0].controls
  own = ("jerk", "acceleration", "bone_drift", "penetration", "skating", "foot_height", "multimodality")
  assert {one["metric"] for one in checked["expected"]} >= set(own)
  assert all(one["ok"] for one in checked["expected"] if one["metric"] in own)
  assert judged[0].curves["FID against noise"]["x"] == [0.0, 1.0, 3.0, 10.0]


def test_real_data_that_does_not_look_right_stops_it(archive, evaluators, tmp_path):
  with pytest.raises(ValueError, match="does not look right on real data, so nothing was sampled(.|\n)*check "):
    run.evaluate(Request([], [archive], SMALL, out=tmp_path, verbose=False, **evaluators))
  assert not (tmp_path / "results.json").exists()


@pytest.mark.parametrize("protocol, changes, words", [
    ("archives-66", {}, "got 9 test items, .* compares 32 at a time; give more data"),
    (SMALL, dict(limit=3), "got --limit 3, .* compares 4 .* --limit 4 is enough, the test set has 9")])
def test_what_does_not_fit_the_data_is_refused(archive, evaluators, tmp_path, protocol, changes, words):
  with pytest.raises(ValueError, match=words):
    run.evaluate(Request([], [archive], protocol, out=tmp_path, verbose=False, **evaluators | changes))


def test_folders_that_are_no_data(tmp_path, archive, evaluator):
  with pytest.raises(FileNotFoundError, match="is no data folder"):
    run.evaluate(Request([], [tmp_path], "archives-66"))
  with pytest.raises(ValueError, match="takes data of humanml3d, .* is 'archive'"):
    test_set_lib.read_test_set([archive], protocols.get_protocol("cdamd-66"), [evaluator])
  with pytest.raises(ValueError, match=r"judged on coordinates features \(66 numbers a frame\), evaluator .* \(67\)"):
    test_set_lib.read_test_set([archive], SMALL, [fresh_evaluator("t2m", "essential")])
