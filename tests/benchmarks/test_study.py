"""The study of the papers' ablations: what it plans, how it judges claims, that it goes on where it was stopped."""
import dataclasses
import importlib
import itertools
import json
import sys
import types

import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.tasks.base import Found
from tests.conftest import ROOT
from tests.evaluation.test_run import write_archive

sys.path.insert(0, str(ROOT / "benchmarks"))
study, study_plan, study_report = (importlib.import_module(name) for name in ("study", "study_plan", "study_report"))
SETTINGS = study_plan.Settings(("cmu", "bandai"))


# --- plan --------------------------------------------------------------------------------------------------------


def test_the_plan_holds_every_row_of_the_papers_tables_for_each_seed():
  rows = study_plan.plan(SETTINGS)
  names = {paper: [row.name for row in rows if (row.paper, row.seed) == (paper, 2)] for paper in study_plan.PAPERS}
  assert set(names["cmdm"]) == {"default", "vae", "c-vae", "one-level", "no-adaln", "no-rope", "no-adaln-no-rope", "ar",
                                "fss-50-1", "fss-50-5", "fss-50-10", "fss-20-1", "fss-20-5", "fss-20-10"}
  assert set(names["cdamd"]) == {"default", "one-vq", "all-vq", "cm", "bcm", "no-prior", "263", "263-no-prior",
                                 "263-no-dcca", "mardm"}
  assert len(rows) == 3 * (14 + 10) and rows == study_plan.plan(SETTINGS)
  for (paper, table), mapped in study_plan.TABLES.items():
    printed = tables.paper_table(paper, table)
    assert set(printed.own) <= set(mapped) <= set(printed.rows)
    rows = study_plan.ABLATIONS[paper]["ROWS"]
    assert {name: rows[row][0].get(table) for name, row in mapped.items()} == {name: name for name in mapped}


@pytest.mark.parametrize("count", (1, 2, 3, 5))
def test_parts_cover_the_plan_and_share_no_run(count):
  parts = [study_plan.plan(SETTINGS, (index, count)) for index in range(count)]
  assert sorted(row[:3] for part in parts for row in part) == sorted(row[:3] for row in study_plan.plan(SETTINGS))
  runs = [{run for row in part for run in row.runs} for part in parts]
  assert sum(map(len, runs)) == len(set().union(*runs))
  work = [sum(SETTINGS.steps[run.stage] for run in some) for some in runs]
  assert max(work) < 1.5 * min(work)


def test_rows_of_sampling_and_of_a_seed_share_runs():
  default, fss, one, vae = (study_plan.row_of("cmdm", name, 1) for name in ("default", "fss-20-5", "one-level", "vae"))
  assert fss.runs == default.runs and fss.sampling == {"num_steps": 20, "lag": 5} and default.sampling == {}
  assert one.runs[0] == default.runs[0] != vae.runs[0] and one.sampling == {"schedule": "full"}
  assert default.runs[0].folder == "cmdm/seed1/default/tokenizer" and default.scores != fss.scores
  stages = lambda name: [(run.row, run.stage) for run in study_plan.row_of("cdamd", name, 0).runs]
  assert stages("263-no-dcca") == [("263", "autoencoder"), ("263", "rvq"), ("263-no-dcca", "generator")]
  assert stages("no-prior") == [("default", "autoencoder"), ("no-prior", "generator")]


def test_configs_of_all_runs_have_the_same_budget():
  """Steps, batches and data are equal in a stage; frozen parts are the study's own."""
  for size in ("small", "mini", "tiny"):
    settings = study_plan.Settings(("cmu", "bandai"), size=size)
    budgets = {}
    for row in study_plan.plan(settings):
      parts = {}
      for run in row.runs:
        config = study_plan.config_of(run, settings, "out", parts)
        parts[run.stage] = run.folder
        assert config.seed == row.seed and tuple(config.data.folders) == ("cmu", "bandai")
        if run.stage in ("denoiser", "generator"):
          assert config.frozen.tokenizer == f"out/{row.runs[0].folder}"
          assert config.frozen.get("prior", "") == (f"out/{parts['rvq']}" if "rvq" in parts else "")
        optimizer = config.optimizer.to_dict()
        falls = [optimizer.pop(name) for name in ("schedule", "boundaries")]
        if (run.row, run.stage) != ("mardm", "generator"):
          budgets.setdefault(f"falls of {run.stage}", set()).add(json.dumps(falls))
        else:  # the rate falls at 50,000 of 180,000 steps
          assert falls[0] == "step" and (falls[1] == (139,) or size == "tiny")
        budgets.setdefault(run.stage, set()).add(json.dumps(
            [config.train.to_dict(), config.data.batch_size, optimizer]))
    assert set(budgets) == {name for stage in study_plan.STEPS for name in (stage, f"falls of {stage}")}
    assert {len(found) for found in budgets.values()} == {1}
  config = study_plan.config_of(study_plan.row_of("cmdm", "default", 0).runs[0], SETTINGS, "out", {})
  assert (config.optimizer.warmup_steps, config.optimizer.cooldown_steps, config.loss.kl_ramp) == (100, 500, 166)
  assert config.optimizer.ema_decay == pytest.approx(0.9934, abs=1e-4) and config.train.num_steps == 1500


def test_bad_arguments_are_told():
  common = ["--archives", "a", "--out", "b"]
  with pytest.raises(ValueError, match="expected some of default"):
    study_plan.plan(SETTINGS, only=["bcn"])
  with pytest.raises(ValueError, match="expected 0/2 to 1/2"):
    study_plan.plan(SETTINGS, (2, 2))
  for wrong, told in ((["--steps", "tokeniser=3"], "a stage of tokenizer, denoiser"), (["--part", "1"], "such as 0/2")):
    with pytest.raises(ValueError, match=told):
      study.parse(common + wrong)
  settings, _, part = study.parse([*common, "--steps", "rvq=7", "--part", "1/3", "--papers", "cdamd"])
  assert settings.steps["rvq"] == 7 and settings.steps["generator"] == 500 and part == (1, 3)
  assert settings.papers == ("cdamd",) and settings.archives == ("a",)


# --- claims ------------------------------------------------------------------------------------------------------


def test_claims_are_those_of_the_papers_own_numbers():
  for claim in study_report.CLAIMS:
    printed = study_report.in_print(claim)
    a, b = printed["a"]["mean"], printed["b"]["mean"]
    assert (a < b if claim.way == "lower" else a > b), claim


def rows_of(**numbers):
  return {row: {seed: {"fid": value} for seed, value in enumerate(values)} for row, values in numbers.items()}


def test_verdicts_follow_the_interval_of_the_differences():
  claim = study_report.Claim("a is better", ("cmdm", "4"), "fid", "a", "lower", "b")
  verdict = lambda **numbers: study_report.judged(claim, rows_of(**numbers))["verdict"]
  assert verdict(a=(1.0, 2.0, 3.0), b=(1.5, 2.6, 3.4)) == "shows"  # seeds differ more than rows do
  assert verdict(a=(1.5, 2.6, 3.4), b=(1.0, 2.0, 3.0)) == "the opposite shows"
  assert verdict(a=(1.0, 2.0, 3.0), b=(1.5, 1.6, 3.4)) == "does not show"
  assert verdict(a=(1.0, 1.0), b=(1.0, 1.0)) == "does not show"
  assert verdict(a=(1.0,), b=(1.5, 1.6)) == "no verdict: one seed"
  assert verdict(a=(1.0,)) == "no verdict: not run"
  higher = claim._replace(way="higher")
  assert study_report.judged(higher, rows_of(a=(1.5, 2.6, 3.4), b=(1.0, 2.0, 3.0)))["verdict"] == "shows"


def test_what_has_to_be_said_of_a_row_stands_above_the_tables():
  study = study_report.summarize(dict(dataclasses.asdict(SETTINGS)), [], {})
  plain = study_report.markdown(study)
  told = study_report.markdown(study | dict(notes=["the row is of another machine"]))
  assert told.replace("\n**the row is of another machine**\n", "") == plain
  assert told.index("**the row is") < told.index("## The papers' claims")


def test_intervals_are_students():
  found = study_report.over_seeds([1.0, 2.0, 3.0])
  assert found["mean"] == 2 and found["interval"] == pytest.approx(4.30265 / 3**0.5, rel=1e-5)
  assert study_report.over_seeds([1.0])["interval"] is None


# --- the whole ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
  """Some procedural motion as an archive, and the least that can be trained and judged on it."""
  # Of other lengths, for a procedural walk may be the same in train and test.
  clips = [clip.replace(split=split, id=f"{split}_{clip.id}") for split, num, frames in (
      ("train", 6, 68), ("val", 2, 72), ("test", 34, 74)) for clip in synthetic_clips(3, num, frames)]
  folder = write_archive(tmp_path_factory.mktemp("data") / "synthetic", clips)
  return study_plan.Settings((str(folder),), papers=("cmdm",), seeds=1, steps=dict.fromkeys(study_plan.STEPS, 3),
                             size="tiny", stories=1, segments=3, clip_evaluator="none")


@pytest.mark.slow
def test_a_study_goes_on_where_it_stopped(settings, tmp_path, monkeypatch, capsys):
  """With training and judging put in place by stand-ins: what is asked of them, and what is not asked again."""
  steps, trained, scored = {}, [], []

  def train(config, folder, resume, max_seconds):
    assert resume
    count = steps[str(folder)] = min(steps.get(str(folder), 0) + 2, config.train.num_steps)  # two steps a slice
    trained.append((folder.relative_to(tmp_path).as_posix(), count))
    (folder / "checkpoints").mkdir(exist_ok=True)
    with open(folder / "metrics.jsonl", "a") as file:
      file.write(json.dumps(dict(step=count, loss=1.0)) + "\n")
    return types.SimpleNamespace(step=count)

  def scores(bench, row, folder, clock):
    scored.append(row.name)
    if scored.count(row.name) == 1 and row.name == "no-adaln":
      raise study.Stopped
    if row.name == "no-rope":
      raise FloatingPointError("the loss is nan")
    return {"fid": dict(mean=0.1 * len(scored), interval=0.0, values=[])}, {"code": judging[0]}

  judging = [study.provenance.commit()]
  monkeypatch.setattr(study.time, "monotonic", itertools.count().__next__)  # every look at the clock is a second
  monkeypatch.setattr(study.training, "run", train)
  monkeypatch.setattr(study.Bench, "scores", scores)
  monkeypatch.setattr(study.Bench, "real", lambda bench: {"texts": {"fid": dict(mean=0.01)}})
  rows = ["default", "no-adaln", "no-rope", "fss-20-5"]
  go_on = lambda: study.run_study(settings, tmp_path, only=rows)
  for _ in range(4):  # three runs take two slices each; then the second row is stopped while it is judged
    assert not go_on()
  home = "cmdm/seed0/default"
  assert trained == [(run, count) for run in (f"{home}/tokenizer", f"{home}/denoiser",
                                                   "cmdm/seed0/no-adaln/denoiser") for count in (2, 3)]
  assert scored == ["default", "no-adaln"]
  told = json.loads((tmp_path / home / "tokenizer" / "trained.json").read_text())
  assert (told["steps"], told["seconds"]) == (3, 2.0) and not (tmp_path / home / "tokenizer" / "checkpoints").exists()
  for _ in range(2):
    assert not go_on()
  capsys.readouterr()
  assert not go_on()  # one row cannot be judged; the others are not done again
  out = capsys.readouterr().out
  assert out.count("done before") == 3 and "the loss is nan" in out
  assert scored == ["default", "no-adaln", "no-adaln", "no-rope", "fss-20-5", "no-rope"]
  assert len(trained) == len(set(trained)) == 8
  assert {path.parent.name for path in tmp_path.glob("cmdm/seed0/*/scores.json")} == {"default", "fss-20-5", "no-adaln"}
  judging[0] = {"commit": "another"}
  study.run_study(settings, tmp_path, only=rows, again=True)
  assert scored[6:] == ["no-rope"]  # nothing was judged by other code
  monkeypatch.setattr(study.provenance, "commit", lambda: judging[0])
  study.run_study(settings, tmp_path, only=rows, again=True)
  assert scored[7:] == ["default", "no-adaln", "no-rope", "fss-20-5"] and len(trained) == 8
  with pytest.raises(ValueError, match="take another --out"):
    study.run_study(dataclasses.replace(settings, size="small"), tmp_path)
  with pytest.raises(ValueError, match="hashes.*take another --out"):
    study.run_study(dataclasses.replace(settings, teacher=str(tmp_path)), tmp_path)
  more = dataclasses.replace(settings, seeds=2, papers=("cdamd",))
  study.keep_settings(more, tmp_path)
  kept = json.loads((tmp_path / "settings.json").read_text())
  assert kept["seeds"] == 2 and kept["papers"] == ["cmdm", "cdamd"]


def test_each_seed_draws_the_test_clips_anew(settings, monkeypatch):
  """Its captions, cuts and stories are a seed's own, and those of all its rows."""
  monkeypatch.setattr(study.sanity, "check", lambda harness: dict(failures=[]))
  bench = study.Bench(settings)
  texts, stories = bench.task("texts", 0), bench.task("stories", 0)
  assert bench.task("texts", 0) is texts
  other, others = bench.task("texts", 1), bench.task("stories", 1)
  assert other.test_set is texts.test_set
  assert (other.harness.drawn(0).item != texts.harness.drawn(0).item).any()
  first, second = [[one.captions for one in task.sequences()] for task in (stories, others)]
  assert first != second


def test_a_run_that_cannot_be_trained_is_tried_once(settings, tmp_path, monkeypatch, capsys):
  tried = []

  def train(config, folder, resume, max_seconds):
    tried.append(folder.name)
    raise FloatingPointError("the loss is nan")

  monkeypatch.setattr(study.training, "run", train)
  monkeypatch.setattr(study.Bench, "real", lambda bench: {})
  assert not study.run_study(settings, tmp_path, only=["default", "no-adaln"])
  assert tried == ["tokenizer"] and "default/tokenizer could not be trained" in capsys.readouterr().out


def test_time_that_is_up_stops_before_anything_begins(settings, tmp_path, monkeypatch):
  monkeypatch.setattr(study.Bench, "real", lambda bench: pytest.fail("began"))
  assert not study.run_study(settings, tmp_path, max_seconds=0)


def least(run, settings, out, parts, config_of=study_plan.config_of):
  """The config of a run with the least to compile: no alignment, one layer in a block of the tokenizer."""
  config = config_of(run, settings, out, parts).unlock()
  (config.tokenizer if run.stage == "denoiser" else config.model).update(dilations=(1,), num_halvings=1)
  if "teacher" in config.frozen:
    config.frozen.teacher, config.model.teacher_dim = "", 0
  return config.lock()


@pytest.mark.slow
def test_two_rows_from_data_to_claims(settings, tmp_path, monkeypatch):
  """One row is trained and judged in earnest; stories, and the row that differs in sampling, take another's word."""
  asked, judge = [], study.Generation.found

  def texts(task, candidate, replication):
    asked.append(candidate.options)
    return judge(task, candidate, replication) if not candidate.options else Found({"": {"top1": 0.5, "fid": 1.0}})

  monkeypatch.setattr(study_plan, "config_of", least)
  monkeypatch.setattr(study.Generation, "found", texts)
  monkeypatch.setattr(study.LongHorizon, "found", lambda task, candidate, replication: Found({
      "": dict.fromkeys(study.STORY_METRICS, 2.0)}))
  assert study.run_study(settings, tmp_path, only=["default", "fss-20-5"], force=True)
  assert asked == [{}, {"num_steps": 20, "lag": 5}]
  found = json.loads((tmp_path / "study.json").read_text())
  assert set(found["table"]["cmdm"]) == {"default", "fss-20-5"} and {"texts", "stories"} == set(found["real"])
  assert {"top1", "fid", "matching", "auj", "transition_fid"} <= set(found["table"]["cmdm"]["default"])
  assert 0 < found["real"]["stories"]["auj"]["mean"] < 10
  assert {one["verdict"] for one in found["claims"]} == {"no verdict: not run"}
  assert found["settings"]["archives"] == ["synthetic"] and found["settings"]["teacher"] == "part-tmr-small"
  assert str(study_plan.ROOT) not in (tmp_path / "study.json").read_text()
  told = (tmp_path / "study.md").read_text()
  assert "never a number of ours with one of the paper's" in told and "| FSS K=20, L=5 (`fss-20-5`) | 0.500 " in told
  assert "has the same steps (tokenizer 3, denoiser 3), data" in told  # nothing of what was not trained
  assert "| 0.588 ± 0.004 |" in told and "`cmdm/seed0/default/denoiser` | 3 |" in told


def test_features_are_made_once(settings, monkeypatch):
  config = study_plan.config_of(study_plan.row_of("cdamd", "default", 0).runs[0], settings, "out", {})
  calls, make = [], study.sources.clip_items
  monkeypatch.setattr(study.sources, "clip_items", lambda *args: calls.append(args) or make(*args))
  with study.sources.keep_features():
    data = study.sources.load_features(config.data)
    assert study.sources.load_features(config.data, stats=data.stats) is data
    val = study.sources.load_features(config.data, "val", data.stats)
    assert study.sources.load_features(config.data, "val", data.stats, False) is val and val is not data
  assert len(calls) == 2
  again = study.sources.load_features(config.data)
  assert again is not data and len(calls) == 3, "only while it lasts"
