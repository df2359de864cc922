"""The report page is whole, loads nothing, and shows what the results hold."""
import html.parser
import json
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.evaluation.report import page as report
from motion_jax.evaluation.result import Result
from motion_jax_studio import cli

EVIL = "</p><script>alert(1)</script> \"it's\" a & b"


def number(mean, interval=0.01):
  return {"mean": mean, "interval": interval, "values": [mean] * 20}


def a_result(**changes) -> Result:
  """A made-up result with every part that a result may have, but no gallery."""
  names = ("x", "y", "x_label", "y_label", "interval")
  curve = lambda *values: dict(zip(names, (*values, None)))
  return Result.from_json({
      "protocol": "cmdm-259", "title": "HumanML3D, 259 columns", "metrics": ["top1", "fid", "diversity", "skating"],
      "row_order": ["real", "ours", "ours, guidance 1"],
      "rows": {"real": {"top1": number(0.511), "fid": number(0.002), "diversity": number(9.5), "skating": number(0.04)},
               "ours": {"top1": number(0.587), "fid": number(0.123), "diversity": number(9.6), "skating": number(0.05)},
               "ours, guidance 1": {"top1": number(0.481), "fid": number(0.3), "diversity": number(9.7)}},
      "paper": {"system": "cmdm", "table": "1", "row": "CMDM w/ FSS"},
      "sanity": {"real": {"top1": 0.511, "fid": 0.002}, "shuffled": {"top1": 0.03, "fid": 0.002}, "fid_noise": 51.5,
                 "failures": []},
      "controls": {"rows": {"real": {"top1": 0.511}}, "failures": ["top1 of frozen does not go down"], "expected": [
          dict(control="noise", metric="top1", direction="down", real=0.511, values=[0.4, 0.2, 0.1], ok=True),
          dict(control="frozen", metric="top1", direction="down", real=0.511, values=[0.6], ok=False)]},
      "curves": {
          "FID against guidance, CMDM": curve([1, 2, 4], [0.3, 0.1, 0.2], "guidance scale", "FID", [0.1, 0.02, 0.03]),
          "FID against guidance, MARDM": curve([1, 2, 4], [0.4, None, 0.3], "guidance scale", "FID"),
          "R@3 against noise": curve([0, 1, 3], [0.8, 0.6, 0.2], "noise on real joints, cm", "R@3")},
      "provenance": {"replications": 20, "seed": 3467,
                     "data": {"split": "test", "samples": 4384, "split_hash": "ab" * 32},
                     "evaluators": [{"name": "t2m-259", "kind": "t2m", "hash": "cd" * 32}],
                     "models": [{"row": "ours", "hash": "ef" * 32, "sampler": {"steps": 50}}]},
      "gallery": []} | changes)


def a_gallery(folder, caption="a person walks", kinds=("grid", "failure")):
  (folder / "gallery").mkdir(parents=True)
  entries = []
  for kind in kinds:
    entry = {"caption": caption, "kind": kind, "score": 3.25}
    for side in ("real", "made"):
      joints = synthetic_joints("walk", 8, np.random.default_rng(0)).astype(np.float32)
      entry[side] = f"gallery/{kind}_{side}.npz"
      export.save(Clip(joints, captions=(Caption(caption),)), folder / entry[side])
    entries.append(entry)
  return entries


class Tags(html.parser.HTMLParser):
  """Complains about tags that are not closed in the order in which they were opened."""
  VOID = {"meta", "img", "br", "line", "circle", "polygon"}

  def __init__(self, text):
    super().__init__()
    self.open, self.seen = [], []
    self.feed(text)
    assert not self.open, self.open

  def handle_starttag(self, tag, attributes):
    self.seen.append((tag, dict(attributes)))
    self.open += [tag] if tag not in self.VOID else []

  def handle_endtag(self, tag):
    assert tag in self.VOID or self.open.pop() == tag, (tag, self.getpos())


@pytest.mark.slow
def test_page_is_whole_and_offline(tmp_path):
  gallery = a_gallery(tmp_path, EVIL)
  page = report.write([Result.from_json(json.loads(json.dumps(a_result(gallery=gallery).as_json())))], tmp_path)
  text = page.read_text(encoding="utf-8")
  seen = Tags(text).seen
  assert "alert(1)</script>" not in text and not any(tag in ("script", "link", "iframe") for tag, _ in seen)
  links = [attributes["href"] for tag, attributes in seen if tag == "a"]
  assert links == ["motions/r0_grid_00.html", "motions/r0_failure_00.html"]
  assert all((tmp_path / link).is_file() for link in links)
  images = [attributes["src"] for tag, attributes in seen if tag == "img"]
  assert len(images) == 2 and all(image.startswith("data:image/jpeg;base64,") for image in images)
  assert not re.search(r"@import|url\(|https?://(?!www\.w3\.org/2000/svg)", text)
  assert "HumanML3D, 259 columns" in text and "4,384 samples of test" in text and "distance 3.25" in text


def test_page_shows_the_numbers(tmp_path):
  text = report.write(a_result(), tmp_path).read_text(encoding="utf-8")
  # The tile, marked, for 0.123 is not the paper's 0.068, and named, for there is another row.
  assert '<b>0.123<span class="mark">*</span></b><span>ours<br>real 0.002<br>paper 0.068</span>' in text
  assert "<td><b>0.587</b><small>±0.010</small></td>" in text, "the best of two rows of ours, outside the interval"
  assert '<tr class="paper"><th>paper: CMDM w/ FSS</th><td>0.588<small>±0.004</small></td>' in text
  feet = text[text.index("Bodies and feet"):text.index("Sanity")]
  assert "skating" in feet and "paper" not in feet and "FID" not in feet
  assert "✗ top1 of frozen does not go down" in text and "tell real motions from shuffled captions" in text
  assert '0.400 → 0.200 → 0.100 <span class="ok">↓✓</span>' in text and '0.600 <span class="bad">↓✗</span>' in text
  charts = [ElementTree.fromstring(svg) for svg in re.findall(r'<svg class="chart".*?</svg>', text, re.S)]
  assert [chart.get("aria-label") for chart in charts] == ["FID against guidance", "R@3 against noise"]
  assert text.count('<ul class="legend">') == 1 and "abababababab" in text and "ab" * 8 not in text.split("<pre>")[0]


def test_folders_of_results_share_a_page(tmp_path, capsys):
  folders = [tmp_path / name / "eval" for name in ("fss", "ar")]
  for folder in folders:
    folder.mkdir(parents=True)
    (folder / "results.json").write_text(json.dumps(a_result().as_json()))
  assert cli.main(["evaluate", "--compare-with", *map(str, folders), "--report", str(tmp_path / "page")]) == 0
  text = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
  Tags(text)
  assert text.count("<h1>") == 1 and text.count("<h2>") == 2
  assert str(tmp_path / "page" / "index.html") in capsys.readouterr().out
  assert '<a href="#r0">fss/eval: ' in text and '<a href="#r1">ar/eval: ' in text  # as much as tells them apart
  assert cli.main(["evaluate", "--compare-with", str(tmp_path / "nowhere"), "--report", str(tmp_path / "page")]) == 1
  assert re.search("nowhere.*no results.json", capsys.readouterr().err)


def test_a_page_needs_neither_motions_nor_more_than_rows(tmp_path):
  """Results are passed on without their gallery; those of rows alone have no further parts."""
  result = a_result(gallery=[dict(caption="", kind="grid", score=1.0, real="gallery/a.npz", made="gallery/b.npz")])
  text = report.write(result, tmp_path / "page", folders=[tmp_path / "elsewhere"]).read_text(encoding="utf-8")
  Tags(text)
  assert "came without its gallery" in text and "<h3>Motions" not in text
  whole = a_result(paper=None).as_json()
  bare = {name: whole[name] for name in ("protocol", "rows", "row_order", "metrics")}
  text = report.write(Result.from_json(bare), tmp_path).read_text(encoding="utf-8")
  Tags(text)
  assert not any(part in text for part in ("came without", "<h3>Curves", "<h3>Record", "<h3>Motions"))
  assert not (tmp_path / "motions").exists()


@pytest.mark.slow
def test_a_broken_motion_is_a_note_beside_the_real_one(tmp_path):
  """A model after two steps of training samples bodies that nothing can draw; the report shows what it can."""
  gallery = a_gallery(tmp_path)
  jump, lost = (synthetic_joints("walk", 8, np.random.default_rng(0)).astype(np.float32) for _ in range(2))
  jump[4:] += 500.0
  lost[:, 15] += 5.0
  export.save(Clip(jump), tmp_path / gallery[0]["made"])
  export.save(Clip(lost), tmp_path / gallery[1]["made"])
  text = report.write(a_result(gallery=gallery), tmp_path).read_text(encoding="utf-8")
  Tags(text)
  jumps, alone = (re.sub(r"<[^>]*>", " ", part) for part in text.split('<div class="card pair">')[1:])
  assert "generated: frame 4: pelvis has moved 866 m since the frame before" in jumps and "side by side" in jumps
  assert "generated: not drawn: the bone to head is 8.74 m long" in alone and "▶ play" in alone
  assert "side by side" not in alone and str(tmp_path) not in text
  assert sorted(path.name for path in (tmp_path / "motions").iterdir()) == ["r0_failure_00.html", "r0_grid_00.html"]


def test_a_motion_that_is_missing_is_named(tmp_path):
  lost = a_result(gallery=a_gallery(tmp_path / "run", kinds=("failure",)))
  (tmp_path / "run" / "gallery" / "failure_made.npz").unlink()
  with pytest.raises(FileNotFoundError, match="names gallery/failure_made.npz"):
    report.write(lost, tmp_path, folders=[tmp_path / "run"])
  assert not (tmp_path / "index.html").exists()
