"""Studies of the papers' claims: verdicts against closed forms, registrations that may not change, reports."""
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from motion_jax import loading
from motion_jax.evaluation.candidates import Reader
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.tasks.editing import Editing
from motion_jax.evaluation.tasks.generation import Generation
from motion_jax.evaluation.tasks.long_horizon import LongHorizon
from motion_jax.evaluation.test_set import read_test_set
from motion_jax.evaluators.evaluator import fresh_evaluator
from tests.conftest import ROOT
from tests.evaluation import small

sys.path.insert(0, str(ROOT / "benchmarks"))
import study  # noqa: E402
import study_plan  # noqa: E402
import study_registration  # noqa: E402
import study_report  # noqa: E402
import study_sampling  # noqa: E402
import study_verdicts as verdicts  # noqa: E402
from study_verdicts import EXCLUDED, SHOWN, UNDECIDED, Effect  # noqa: E402

PAGES, STUDIES = ROOT / "docs" / "benchmark", ROOT / "benchmarks" / "data" / "studies"
REGISTERED = PAGES / "registered"


def test_holm_is_that_of_the_textbook():
  np.testing.assert_allclose(verdicts.holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
  np.testing.assert_allclose(verdicts.holm([0.5, 0.6]), [1, 1])  # never above 1, never below one before it


def test_effects_over_seeds_are_those_of_a_paired_t_test():
  a, b = np.array([3.0, 4.2, 5.1, 3.9]), np.array([3.5, 4.4, 5.0, 4.6])
  test = stats.ttest_rel(a, b)
  low, high = test.confidence_interval()
  np.testing.assert_allclose(verdicts.over_seeds(a, b), [np.mean(a - b) / b.mean(), low / b.mean(), high / b.mean(),
                                                         test.pvalue])
  assert verdicts.over_seeds([1.0], [2.0]) is None


def test_effects_over_clusters():
  """A tenth less in every cluster is a tenth less in every draw; of noise the interval is the normal one."""
  rng = np.random.default_rng(0)
  b = rng.uniform(1, 2, 50)
  np.testing.assert_allclose(verdicts.over_clusters(0.9 * b, b, draws=99), [-0.1, -0.1, -0.1, 2 / 100])
  noise = rng.normal(size=400)
  effect = verdicts.over_clusters(10 + noise, np.full(400, 10.0), draws=4000)
  half = 1.96 * noise.std() / np.sqrt(400) / 10
  np.testing.assert_allclose([effect.high - effect.value, effect.value - effect.low], half, rtol=0.08)
  z = abs(noise.mean()) / (noise.std() / np.sqrt(400))
  assert effect.p == pytest.approx(2 * stats.norm.sf(z), abs=0.05)
  curves = np.stack([b, 2 * b], axis=1)  # a statistic of whole rows
  assert verdicts.over_clusters(2 * curves, curves, lambda x: x.mean(0).max(), draws=9).value == pytest.approx(1)
  with pytest.raises(ValueError, match="the same ones of both rows"):
    verdicts.over_clusters(b, b[:-1])


@pytest.mark.parametrize("effect, p, way, verdict, remark", [
    ((-0.30, -0.40, -0.20), 0.001, "lower", SHOWN, "larger than the paper's"),
    ((-0.05, -0.08, -0.02), 0.001, "lower", SHOWN, "smaller than the paper's"),
    ((-0.12, -0.20, -0.04), 0.01, "lower", SHOWN, ""),
    ((-0.12, -0.20, -0.04), 0.06, "lower", UNDECIDED, ""),  # its own interval leaves 0 out, Holm's p does not
    ((0.00, -0.05, 0.05), 1.0, "lower", EXCLUDED, "no effect of that size either way"),
    ((0.10, -0.05, 0.25), 0.2, "lower", EXCLUDED, ""),
    ((0.10, 0.05, 0.15), 0.001, "lower", EXCLUDED, verdicts.OPPOSITE),
    ((0.00, -0.20, 0.20), 1.0, "lower", UNDECIDED, ""),
    ((0.00, -0.20, 0.09), 1.0, "higher", EXCLUDED, ""),
    ((0.00, -0.20, 0.20), 1.0, "higher", UNDECIDED, "")])
def test_three_verdicts(effect, p, way, verdict, remark):
  """The paper's effect is a tenth."""
  assert verdicts.judge(Effect(*effect, p), way, 0.1, p) == (verdict, remark)


def test_the_first_study_by_the_three_verdicts():
  """19 of 38 intervals exclude the paper's relative effect, as an audit found by hand; none is shown after Holm."""
  registration, counts = study_registration.load(REGISTERED / "mini-first.toml"), []
  for paper in study_plan.PAPERS:
    kept = json.loads((STUDIES / f"{paper}.json").read_text())
    again = study_report.judge_again(kept, registration)
    assert [claim["verdict"] for claim in again["claims"]] == [claim["verdict"] for claim in kept["claims"]]
    assert (PAGES / f"study_{paper}.md").read_text() == study_report.markdown(kept)
    counts.append([sum(claim["verdict"] == name for claim in kept["claims"]) for name in (SHOWN, EXCLUDED, UNDECIDED)])
  assert counts == [[0, 10, 12], [0, 9, 7]]
  dccm = next(claim for claim in kept["claims"] if (claim["a"], claim["b"], claim["metric"]) == ("one-vq", "cm", "fid"))
  np.testing.assert_allclose([dccm["effect"]["value"], dccm["margin"]], [-0.043, 0.645], atol=6e-4)


@pytest.mark.parametrize("name", ["schedules", "edits"])
def test_pages_of_sampling_are_those_of_their_json(name):
  """And of the registration as it is in the repository."""
  kept = json.loads((STUDIES / f"{name}.json").read_text())
  assert (PAGES / f"study_{name}.md").read_text() == study_sampling.markdown(kept)
  registration = study_registration.load(REGISTERED / f"{name}.toml")
  assert kept["registration"]["sha256"] == registration.sha256 or kept["registration"]["amendments"]
  assert [claim["text"] for claim in kept["claims"]] == [claim.text for claim in registration.claims]


# --- registrations ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", sorted(REGISTERED.glob("*.toml")), ids=lambda path: path.stem)
def test_registrations_say_the_papers_effects(path):
  """`load` compares every margin with the printed numbers; rows are those that a tool knows."""
  registration = study_registration.load(path)
  assert 0 < registration.settings["alpha"] < 1 and registration.claims
  for claim in registration.claims:
    known = registration.rows or study_plan.names_of(claim.source[0])
    assert {claim.a, claim.b} <= set(known)


@pytest.mark.parametrize("old, new, message", [
    ("margin = 0.010", "margin = 0.1", "got margin 0.1, the printed numbers are 0.0102 apart"),
    ('"lower", "ar"', '"lower", "arr"', "got the rows fss-50-2 and arr, expected some of fss-50-2, "),
    ('"lower", "ar"', '"better", "ar"', "got 'better', expected lower or higher"),
    ('"matching", "CMDM w/ FSS"', '"auj", "CMDM w/ FSS"', "cmdm's table 1 prints no 'auj'"),
    ('metric = "matching"', 'metric = "matches"', "got the metric 'matches', expected one of top1"),
    ("alpha = ", "beta = ", "has no 'alpha'"), ("name = ", "name == ", "is no registration")])
def test_registrations_that_cannot_be(tmp_path, old, new, message):
  (tmp_path / "own.toml").write_text((REGISTERED / "schedules.toml").read_text().replace(old, new))
  with pytest.raises(ValueError, match=message):
    study_registration.load(tmp_path / "own.toml")


def test_a_registration_that_changed_after_results_is_refused(tmp_path):
  """Before there are results it may change; then only with a reason, which is kept and printed."""
  path, out = tmp_path / "own.toml", tmp_path / "out"
  text = (REGISTERED / "schedules.toml").read_text()

  def keep(change, has_results, amend=None):
    path.write_text(text.replace("draws = 10000", f"draws = {change}"))
    return study_registration.keep(study_registration.load(path), out, has_results, amend)

  assert keep(100, False)["commit"] is None and not keep(200, False)["amendments"]
  first = keep(300, False)
  assert keep(300, True) == first
  for nothing in (None, " "):
    with pytest.raises(ValueError, match='changed since there are results.*or say why with --amend "why"'):
      keep(400, True, nothing)
  kept = keep(400, True, "too few draws")
  assert keep(400, True) == kept and [amendment["why"] for amendment in kept["amendments"]] == ["too few draws"]
  lines = "\n".join(study_registration.lines(kept))
  assert "**Amended on " in lines and "too few draws" in lines and "**not in a commit**" in lines
  with pytest.raises(ValueError, match="changed since there are results"):
    keep(300, True)


def test_a_changed_registration_ends_the_commands(tmp_path, capsys):
  """Of studies with results: before anything is trained or sampled."""
  text, out = (REGISTERED / "schedules.toml").read_text(), tmp_path / "out"
  study_registration.keep(study_registration.load(REGISTERED / "schedules.toml"), out, False)
  (tmp_path / "own.toml").write_text(text.replace("draws = 10000", "draws = 10"))
  (out / "samples" / "key").mkdir(parents=True)
  (out / "samples" / "key" / "ar_clips00.npz").touch()
  with pytest.raises(SystemExit, match="study_sampling.py: .*own.toml has changed since there are results"):
    study_sampling.main(["--registration", str(tmp_path / "own.toml"), "--archives", "a", "--out", str(out)])


@pytest.mark.parametrize("name, message", [
    ("edits", "is no study.json of benchmarks/study.py"), ("none", "cannot read .*none.json")])
def test_what_is_no_study_is_not_judged(name, message):
  with pytest.raises(SystemExit, match=message):
    study_report.main([str(STUDIES / f"{name}.json"), "--registration", str(REGISTERED / "mini-first.toml")])


def test_a_study_takes_its_settings_from_the_registration():
  registration, settings, _, _ = study.parse(["--archives", "a", "--out", "b", "--seeds", "2"])
  assert registration.path.name == "mini.toml" and settings.seeds == 2 and settings.size == "mini"
  assert settings.steps == registration.settings["study"]["steps"]


def test_rows_that_differ_in_sampling_alone_are_trained_once():
  row, other = (study_plan.row_of("cdamd", name, 0) for name in ("dccm-inference", "one-vq"))
  assert row.runs == other.runs and (row.sampling, other.sampling) == ({"mask": "dccm"}, {})
  assert study_plan.row_of("cmdm", "fss-20-5", 1).runs == study_plan.row_of("cmdm", "default", 1).runs
  assert study_plan.row_of("cmdm", "one-level", 0).runs[-1].row == "one-level"


def test_a_row_that_cannot_be_sampled_says_so_before_training(tmp_path, monkeypatch, capsys):
  run = study_plan.row_of("cmdm", "vae", 0).runs[-1]
  (tmp_path / run.folder).mkdir(parents=True)
  monkeypatch.setattr(study.training, "run", lambda *args, **options: pytest.fail(capsys.readouterr().out))
  with pytest.raises(pytest.fail.Exception, match="note: the tokenizer looks both ways.*whole motions alone"):
    study.train_run(run, study_plan.Settings(("a",)), tmp_path, {"tokenizer": "t"}, study.Clock(), set())


# --- sampling --------------------------------------------------------------------------------------------------------

SMALL = '''
name = "small"
title = "Small"
model = "{model}"
seed = 0
clips = 8
stories = 4
segments = 2
draws = 50
alpha = 0.05
fewest = {{clips = 4, stories = 3}}
rules = "none"
[rows]
a = {{num_steps = 2, lag = 1}}
b = {{schedule = "full", num_steps = 2}}
[[claims]]
text = "a matches better"
table = "4"
metric = "matching"
rows = ["a", "lower", "b"]
printed = ["top1", "CMDM", "w/o FSS"]
margin = 0.021
[[claims]]
text = "b has a higher AUJ"
table = "4"
metric = "auj"
rows = ["b", "higher", "a"]
printed = ["auj", "w/ Full-Seq. Diff.", "CMDM"]
margin = 0.714
'''


def test_a_row_that_the_model_cannot_sample_is_refused_before_sampling(tmp_path):
  text = (REGISTERED / "schedules.toml").read_text().replace('"ar", num_steps = 50', '"arr", num_steps = 50')
  (tmp_path / "own.toml").write_text(text)
  with pytest.raises(ValueError, match="got schedule 'arr'"):
    study_sampling.Sampling(study_registration.load(tmp_path / "own.toml"), ["a"], tmp_path, bench=SimpleNamespace())


@pytest.mark.slow
def test_a_study_of_sampling_continues_and_reports(tmp_path, monkeypatch, capsys):
  """Stopped after its first row: the same command goes through, in pools, and repeats no sample."""
  monkeypatch.setattr(study_sampling, "POOL", {"clips": 4, "stories": 2})
  run = small.random_run(tmp_path / "run", "cmdm_denoiser")
  archive = small.write_archive(tmp_path / "data", small.make_clips())
  (tmp_path / "small.toml").write_text(SMALL.format(model=run))
  registration = study_registration.load(tmp_path / "small.toml")
  evaluator, tasks = fresh_evaluator("t2m"), {}
  for name, task, protocol in (("texts", Generation, small.SMALL), ("stories", LongHorizon, small.small(
      "long-horizon", sequences=4, segments=2, transition_frames=16, real_jerk=None, way="stream"))):
    protocol = protocol.without_multimodality().on("archive")
    tasks[name] = task(Harness(protocol, evaluator, None, read_test_set([archive], protocol, [evaluator]), 0))
  bench = SimpleNamespace(task=lambda name, seed: tasks[name])
  sampling = study_sampling.Sampling(registration, [archive], tmp_path / "out", bench)
  assert sampling.pools() == [("clips", 0), ("stories", 0), ("stories", 1), ("clips", 1)]  # 4 and 3 have a verdict
  sampling.run(seconds=0)
  assert "time is over" in capsys.readouterr().out and sampling.complete("clips") == 0
  sampling.run()
  assert capsys.readouterr().out.count(" motions, ") == 8 and sampling.complete("stories") == 2
  sampling.run()
  assert not capsys.readouterr().out
  kept = study_registration.keep(registration, tmp_path / "out", False)
  summary = sampling.summary(registration, kept)
  assert summary["samples"] == {"clips": 8, "stories": 4}
  matching, auj = summary["claims"]
  rows = summary["table"]["clips"]
  assert matching["effect"]["value"] == pytest.approx(rows["a"]["matching"]["mean"] / rows["b"]["matching"]["mean"] - 1)
  stories = summary["table"]["stories"]
  assert auj["effect"]["value"] == pytest.approx(stories["b"]["auj"]["mean"] / stories["a"]["auj"]["mean"] - 1)
  page = study_sampling.markdown(summary)
  assert "**8 of 8 clips, 4 of 4 stories of 2 prompts**" in page and "| `b` |" in page


EDITS = '''
name = "small-edits"
title = "Small edits"
paper = "cdamd"
model = "{model}"
seed = 0
edits = 8
draws = 50
alpha = 0.05
fewest = {{edits = 4}}
rules = "none"
[rows]
prefix = {{task = "prefix", mask = "causal"}}
suffix = {{task = "suffix", mask = "causal"}}
[[claims]]
text = "what keeps the second half matches better"
table = "3"
metric = "matching"
rows = ["suffix", "lower", "prefix"]
printed = ["matching", "suffix: CDAMD", "prefix: CDAMD"]
margin = 0.077
'''


@pytest.mark.slow
def test_a_study_of_edits(tmp_path, monkeypatch):
  """Rows differ in what they keep: the clips are those of the draw, and only what is not kept is new."""
  monkeypatch.setattr(study_sampling, "POOL", {"edits": 4, "stories": 2})
  run = small.random_run(tmp_path / "run", "cdamd_generator", num_iterations=2, num_steps=1, solver="euler")
  archive = small.write_archive(tmp_path / "data", small.make_clips())
  (tmp_path / "edits.toml").write_text(EDITS.format(model=run))
  registration = study_registration.load(tmp_path / "edits.toml")
  model, evaluator, protocol = loading.load(run), fresh_evaluator("t2m"), small.small("editing").on("archive")
  reader = Reader("", model.stats.layout, model.config.data.mode)
  task = Editing(Harness(protocol, evaluator, None, read_test_set([archive], protocol, [evaluator, reader]), 0))
  sampling = study_sampling.Sampling(registration, [archive], tmp_path / "out",
                                     SimpleNamespace(task=lambda name, seed: task))
  sampling.run()
  summary = sampling.summary(registration, study_registration.keep(registration, tmp_path / "out", False))
  assert summary["samples"] == {"edits": 8} and set(summary["table"]) == {"edits", "stories"}
  assert summary["claims"][0]["count"] == 8
  assert "**8 of 8 edits**; one seed" in study_sampling.markdown(summary)
  frames = sampling.jobs("prefix", "edits")[0].frames[0]
  prefix, suffix = (sampling.sample(row, "edits", 0)[0][:frames] for row in ("prefix", "suffix"))
  assert not np.allclose(prefix[-4:], suffix[-4:])
