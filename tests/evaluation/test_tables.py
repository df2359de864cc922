"""The papers' numbers are those of the papers, and ours stand beside them rightly marked."""
import csv
import io

import pytest

from motion_jax.evaluation.report import tables
from motion_jax.evaluation.result import Result
from motion_jax_studio import cli


def _result(**changes) -> Result:
  number = lambda mean, interval: {"mean": mean, "interval": interval, "values": [mean - 0.001, mean + 0.001]}
  return Result(**{
      "protocol": "cmdm-259", "title": "HumanML3D, 259 columns", "metrics": ["top1", "fid", "clip_score"],
      "row_order": ["real", "ours", "worse"],
      "rows": {"real": {"top1": number(0.511, 0.003), "fid": number(0.0, 0.0), "clip_score": None},
               "ours": {"top1": number(0.590, 0.002), "fid": number(0.080, 0.002)},
               "worse": {"top1": number(0.550, 0.050), "fid": number(0.069, 0.0)}},
      "paper": {"system": "cmdm", "table": "1", "row": "CMDM w/ FSS"}} | changes)


@pytest.mark.parametrize("key", tables.paper_tables(), ids="-".join)
def test_every_table_is_whole(key):
  table = tables.paper_table(*key)
  assert set(table.metrics) <= set(tables.METRICS)
  assert set(table.own) <= set(table.rows) and table.caption and "lines" in table.source
  assert {name for names in table.groups.values() for name in names} <= set(table.rows)
  for row in table.rows.values():
    assert list(row) == list(table.metrics)
    assert all(value is None or value["mean"] >= 0 and (value["interval"] or 0) >= 0 for value in row.values())
    tops = [row[metric]["mean"] for metric in ("top1", "top2", "top3") if row.get(metric)]
    assert tops == sorted(tops)
  assert tables.markdown(tables.printed_table(*key)).count("\n| ") == len(table.rows) + 2


# Typed by hand from the papers: with and without intervals, in per cent, in parts, of the authors.
SPOTS = [
    ("authors", "humanml3d", "DiP", {"top1": (0.458, None), "fid": (0.228, None), "multimodality": (1.04, None)}),
    ("cmdm", "1", "CMDM w/ FSS", {"top1": (0.588, 0.004), "top2": (0.778, 0.002), "top3": (0.860, 0.003),
                                  "fid": (0.068, 0.003), "matching": (2.620, 0.010), "multimodality": (1.785, 0.074),
                                  "clip_score": (0.685, 0.001)}),
    ("cmdm", "8", "MAC-VAE 16, 1/8", {"reconstruction_fid": (0.024, None), "released_mpjpe": (0.101, None),
                                      "top1": (0.561, None), "fid": (0.054, None), "matching": (2.709, None)}),
    ("cmdm", "speed", "CMDM w/ FSS", {"frames_per_second": (125, None), "next_token_ms": (30, None)}),
    ("cdamd", "3", "suffix: CDAMD", {"fid": (0.090, None), "top1": (0.541, None), "clip_score": (0.679, None)}),
]


@pytest.mark.parametrize("system,table,row,expected", SPOTS, ids=lambda value: value if isinstance(value, str) else "")
def test_numbers_are_the_papers(system, table, row, expected):
  found = tables.paper_row(system, table, row)
  assert {name: (found[name]["mean"], found[name]["interval"]) for name in expected} == expected


def test_a_number_outside_both_intervals_is_marked():
  lines = {line.name: line for line in tables.compare(_result()).lines}
  assert list(lines) == ["real", "ours", "worse", "paper: CMDM w/ FSS", "paper: real"]
  marks = {name: [cell.marked for cell in line.cells] for name, line in lines.items()}
  # 0.590 and 0.588 are 0.002 apart, the paper's interval is 0.004; 0.080 and 0.068 are further than 0.003.
  assert marks["ours"] == [False, True, False]
  # 0.550 has an interval of its own that holds the paper's number; 0.069 has none, the paper's 0.003 holds it.
  assert marks["worse"] == [False, False, False]
  assert marks["real"] == [False, True, False]  # real against real is printed as 0.002
  assert lines["paper: real"].cells[0] == tables.Cell("0.511", "0.003")


def test_a_printed_number_without_interval_counts_to_its_last_digit():
  paper = {"mean": 0.588, "interval": None, "digits": 3}
  assert not tables.differs({"mean": 0.58849, "interval": None}, paper)
  assert tables.differs({"mean": 0.5886, "interval": 0.0}, paper)


def test_latex_and_csv():
  """Markdown is that of the published results, in test_result.py."""
  rows = list(csv.DictReader(io.StringIO(tables.csv(_result()))))
  assert rows[1] == {"row": "ours", "kind": "ours", "top1": "0.590", "top1_interval": "0.002", "fid": "0.080",
                     "fid_interval": "0.002", "clip_score": "", "clip_score_interval": ""}
  text = tables.latex(_result(title="50 % of a_b & {c}"))
  assert r"ours & $0.590^{\pm 0.002}$ & $0.080^{\pm 0.002}$* & -- \\" in text
  assert r"50 \% of a\_b \& \{c\}" in text and text.count(r"\midrule") == 2


def test_rows_of_ours_may_have_rows_of_the_paper_each():
  paper = {"system": "cmdm", "table": "1", "row": {"ours": "CMDM w/ FSS", "worse": "CMDM w/ AR"}, "also": ["MARDM"]}
  lines = {line.name: line for line in tables.compare(_result(paper=paper)).lines}
  assert [name for name in lines if name.startswith("paper")] == [
      "paper: CMDM w/ FSS", "paper: CMDM w/ AR", "paper: MARDM", "paper: real"]
  assert lines["worse"].cells[1].marked  # 0.069 is not AR's 0.079


def test_parts_go_with_the_papers_parts():
  value = {"top1": {"mean": 0.5, "interval": 0.0}}
  result = _result(protocol="editing", metrics=["top1"], paper={"system": "cdamd", "table": "3", "row": "CDAMD"},
                   rows={"suffix: small": value, "prefix: small": value}, row_order=["suffix: small", "prefix: small"])
  lines = {line.name: line.cells[0].mean for line in tables.compare(result).lines}
  assert lines == {"suffix: small": "0.500", "prefix: small": "0.500", "paper: suffix: CDAMD": "0.541",
                   "paper: prefix: CDAMD": "0.490"}


def test_every_printed_table_can_be_read_at_the_command_line(capsys):
  """By its number, which prints all parts of it, or all of them."""
  every = 6 + 13 + 4 + 2  # of CDAMD, CMDM, control and of authors
  for name, words, count in ((["CDAMD", "6"], ["| CDAMD  | 0.398"], 1), ([], ["XL"], every),
                             (["cmdm", "3"], ["Table 3-humanml3d", "Table 3-snapmogen"], 2)):
    assert cli.main(["evaluate", "--paper-tables", *name]) == 0
    out = capsys.readouterr().out
    assert all(word in out for word in words) and out.count("### ") == count
  assert cli.main(["evaluate", "--paper-tables", "cmdm", "33"]) == 1
  assert "got table '33' of 'cmdm', expected one of" in capsys.readouterr().err
  with pytest.raises(ValueError, match="got row 'Ours' of cdamd's table 2, expected one of MDM, MotionDiffuse"):
    tables.paper_row("cdamd", 2, "Ours")
