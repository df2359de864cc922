"""Charts lie where their axes say, as SVG and as a picture, and refuse what they cannot show."""
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from motion_jax import charts, look


@pytest.mark.parametrize("low,high,count,expected", [
    (0, 1, 5, [0, 0.2, 0.4, 0.6, 0.8, 1]), (1, 6, 6, [1, 2, 3, 4, 5, 6]), (-28, 28, 6, [-20, -10, 0, 10, 20]),
    (0, 0.104, 5, [0, 0.02, 0.04, 0.06, 0.08, 0.1]), (3, 3, 5, [3, 3.5, 4, 4.5, 5, 5.5, 6])])
def test_ticks_are_round(low, high, count, expected):
  assert charts.ticks(low, high, count) == pytest.approx(expected)


def test_lines_lie_where_the_axes_say():
  """A line from the first to the last tick; its ends lie on the grid lines of 0 and 10."""
  svg = charts.svg([charts.Series("a", [0, 10], [0, 10])], "x", "y")
  tree = ElementTree.fromstring(svg)
  find = lambda kind: [e for e in tree if e.get("class") == kind]
  ticks = {(e.get("text-anchor"), e.text): e for e in find("tick")}
  (x0, y0), (x1, y1) = [tuple(map(float, pair.split())) for pair in find("line s0")[0].get("d")[1:].split("L")]
  assert x0 == pytest.approx(float(ticks["middle", "0"].get("x")), abs=0.1)
  assert x1 == pytest.approx(float(ticks["middle", "10"].get("x")), abs=0.1)
  assert y0 == pytest.approx(float(ticks["end", "0"].get("y")) - 4, abs=0.1)
  assert y1 == pytest.approx(float(ticks["end", "10"].get("y")) - 4, abs=0.1)


def test_a_band_is_as_wide_as_its_interval():
  tree = ElementTree.fromstring(charts.svg([charts.Series("", [0, 1], [5, 5], [1, 2])], "x", "y"))
  band = next(e for e in tree if e.get("class") == "band s0").get("points")
  ys = [float(pair.split(",")[1]) for pair in band.split()]
  assert (ys[2] - ys[1]) == pytest.approx(2 * (ys[3] - ys[0]), abs=0.3)


def test_a_tick_fits_beside_its_axis():
  values = {1500: "1500", 0.05: "0.05", 2e-4: "2e−4", -1.5e-6: "−1.5e−6", 0: "0", -28: "−28", 1e-3: "0.001"}
  assert {value: charts.number(value) for value in values} == values


def test_bad_curves():
  with pytest.raises(ValueError, match="2 places, 1 values"):
    charts.svg([charts.Series("a", [0, 1], [0])], "x", "y")
  with pytest.raises(ValueError, match="every point is missing"):
    charts.svg([charts.Series("a", [0, 1], [None, float("nan")])], "x", "y")
  dot = charts.svg([charts.Series("a", [2], [7])], "x", "y")
  assert dot.count("<circle") == 1


@pytest.mark.parametrize("low,high,expected", [
    (0.5, 2000, [1, 10, 100, 1000]), (0.3, 4, [0.5, 1, 2]), (1.2, 1.9, [1.2, 1.4, 1.6, 1.8])])
def test_logarithmic_ticks_are_round(low, high, expected):
  assert charts.logarithmic_ticks(low, high) == pytest.approx(expected)


def test_a_power_is_a_straight_line_on_a_logarithmic_axis():
  tree = ElementTree.fromstring(charts.svg([charts.Series("a", [0, 1, 2], [1, 10, 100])], "x", "y", logarithmic=True))
  line = next(e for e in tree if e.get("class") == "line s0").get("d")
  (_, y0), (_, y1), (_, y2) = [tuple(map(float, pair.split())) for pair in line[1:].split("L")]
  assert y0 - y1 == pytest.approx(y1 - y2, abs=0.2) and y1 - y2 > 50
  with pytest.raises(ValueError, match="got 0 .*positive"):
    charts.svg([charts.Series("a", [0, 1], [0, 1])], "x", "y", logarithmic=True)


def test_a_picture_shows_what_the_svg_does():
  """The line's colour lies along the SVG's line, and neither above nor below it; the labels are written."""
  series = [charts.Series("a", list(range(40)), [7.0] * 40)]
  tree = ElementTree.fromstring(charts.svg(series, "step", "loss"))
  (x0, y), *_, (x1, _) = [tuple(map(float, pair.split())) for pair in
                          next(e for e in tree if e.get("class") == "line s0").get("d")[1:].split("L")]
  picture = np.asarray(charts.picture(series, "step", "loss").convert("RGB"), int)
  assert picture.shape == (2 * charts.HEIGHT, 2 * charts.WIDTH, 3)
  blue = np.abs(picture - (0x2a, 0x6f, 0xb8)).sum(-1) < 30
  rows, columns = np.nonzero(blue)
  assert abs(rows.mean() - 2 * y) < 2 and np.ptp(rows) < 8
  assert abs(columns.min() - 2 * x0) < 4 and abs(columns.max() - 2 * x1) < 4
  dark = picture.sum(-1) < 300
  assert dark[-30:, 400:600].any() and dark[150:350, :40].any(), "the names of the axes"


def test_a_picture_has_a_minus_that_its_font_can_draw():
  draw = lambda label: charts.picture([charts.Series("", [0, 1], [0, 1])], label, "y").tobytes()
  assert draw("−1") == draw("-1") != draw("1")


def test_reports_and_charts_share_their_colours():
  """Every variable that the reports' style sheet names is a colour of `look` in light and in dark."""
  used = set(re.findall(r"var\(--(\w+)\)", look.page_style())) - {"font", "mono"}
  assert used == set(look.LIGHT) == set(look.DARK)
  series = [charts.Series("", [0], [0], real=number == 1) for number in range(7)]
  assert charts.kinds(series) == ["s0", "real", "s1", "s2", "s3", "s4", "s0"]
  assert {charts.COLORS[kind] for kind in charts.kinds(series)} <= set(look.LIGHT.values())
