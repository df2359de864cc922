"""Line charts with labelled axes and intervals as bands, as SVG text or as a picture.

`svg` leaves colours to a page's style sheet, by the classes s0, s1, .. and real, which follow its light and dark mode.

Why not matplotlib: the default install, which is without it, draws loss.png and the reports; their SVG follows the
page's colours by classes. As an extra it would be a second way to draw the same chart, and no line here would go.
"""
import html
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from PIL import Image, ImageDraw, ImageFont

from motion_jax import look

WIDTH, HEIGHT = 460, 290
_LEFT, _RIGHT, _TOP, _BOTTOM = 66, 16, 14, 46
_DOTS = 16  # a line of more points than this is drawn without dots
COLORS = look.LIGHT | {"axis": look.LIGHT["soft"], "border": look.LIGHT["soft"], "grid": look.LIGHT["line"],
                       "tick": look.LIGHT["soft"], "label": look.LIGHT["ink"]}  # of a mark's kind
_SCALE, _FINE = 2, 2  # a picture has this many pixels for each of a chart's, and is drawn finer, then made smaller


class Series(NamedTuple):
  """One line: x and y (N,), half widths of its band or None, and whether it is the real motions' (grey, dashed)."""
  name: str
  x: Sequence[float | None]
  y: Sequence[float | None]
  interval: Sequence[float | None] | None = None
  real: bool = False


class _Mark(NamedTuple):
  """A shape ("rule", "text", "line", "band" or "dot") at points of the chart, in pixels; anchor: of a text."""
  shape: str
  kind: str
  points: list[tuple[float, float]]
  text: str = ""
  anchor: str = "middle"


def svg(series: Sequence[Series], x_label: str, y_label: str, title: str = "", logarithmic: bool = False) -> str:
  """An <svg> of lines over shared axes. Points without a number are left out; a lone point is a dot."""
  shapes = {"rule": _svg_rule, "text": _svg_text, "line": _svg_line, "band": _svg_band, "dot": _svg_dot}
  head = (f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" xmlns="http://www.w3.org/2000/svg" '
          f'aria-label="{html.escape(title or y_label, quote=True)}">')
  marks = _layout(series, x_label, y_label, title, logarithmic)
  return "\n".join([head, *(shapes[mark.shape](mark) for mark in marks), "</svg>"])


def picture(series: Sequence[Series], x_label: str, y_label: str, title: str = "",
            logarithmic: bool = False) -> Image.Image:
  """The same chart as a picture of 2 * WIDTH x 2 * HEIGHT pixels, on white."""
  zoom = _SCALE * _FINE
  image = Image.new("RGB", (zoom * WIDTH, zoom * HEIGHT), "white")
  shapes = {"rule": _draw_rule, "text": _draw_text, "line": _draw_line, "band": _draw_band, "dot": _draw_dot}
  for mark in _layout(series, x_label, y_label, title, logarithmic):
    points = [(zoom * x, zoom * y) for x, y in mark.points]
    shapes[mark.shape](image, mark._replace(points=points), COLORS[mark.kind], zoom)
  return image.resize((_SCALE * WIDTH, _SCALE * HEIGHT), Image.Resampling.LANCZOS)


def legend(series: Sequence[Series]) -> Image.Image:
  """The names of lines in their colours, one below the other, as wide as `picture`."""
  image = Image.new("RGB", (_SCALE * WIDTH, _SCALE * 18 * len(series)), "white")
  font, draw = ImageFont.load_default(_SCALE * 12), ImageDraw.Draw(image)
  for row, (line, kind) in enumerate(zip(series, kinds(series))):
    draw.text((_SCALE * _LEFT, _SCALE * 18 * row), line.name, fill=COLORS[kind], font=font)
  return image


def kinds(series: Sequence[Series]) -> list[str]:
  """The colour's name of each line: "real", or "s0" to "s4" in turn."""
  found: list[str] = []
  for line in series:
    found.append("real" if line.real else f"s{(len(found) - found.count('real')) % 5}")
  return found


def ticks(low: float, high: float, count: int = 5) -> list[float]:
  """Round numbers (1, 2 or 5 times a power of ten apart) from low to high, about `count` of them."""
  if not high > low:
    high = low + (abs(low) or 1)
  raw = (high - low) / count
  power = 10.0 ** math.floor(math.log10(raw))
  step = power * next(factor for factor in (1, 2, 5, 10) if factor * power >= 0.75 * raw)
  first = math.ceil(low / step - 1e-9)
  return [round(k * step, 12) for k in range(first, math.floor(high / step + 1e-9) + 1)]


def logarithmic_ticks(low: float, high: float) -> list[float]:
  """Powers of ten from low to high, with twice and five times them where few fit; of a narrow range `ticks`."""
  powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
  for factors in ((1,), (1, 2, 5)):
    marks = [value for k in powers for value in (factor * 10.0 ** k for factor in factors) if low <= value <= high]
    if len(marks) > 2:
      step = math.ceil(len(marks) / 8) if factors == (1,) else 1
      return marks[::step]
  return ticks(low, high)


def number(value: float) -> str:
  """A tick's number as short as it goes: 1500, 0.05, 2e−4."""
  if 0 < abs(value) < 1e-3:
    digits, power = f"{value:.5e}".split("e")
    return f"{float(digits):g}e{int(power)}".replace("-", "−")
  return f"{value:.6g}".replace("-", "−")


def _layout(series, x_label, y_label, title, logarithmic) -> list[_Mark]:
  """The marks of a chart, from back to front."""
  lines = [(curve, kind, points) for curve, kind in zip(series, kinds(series)) if (points := _points(curve))]
  if not lines:
    raise ValueError(f"got no numbers to draw for {title or y_label!r}; every point is missing")
  ends = [y + side * half for *_, points in lines for _, y, half in points for side in (-1, 1)]
  if logarithmic and min(ends) <= 0:
    raise ValueError(f"got {min(ends):.6g} to draw for {title or y_label!r}; a logarithmic axis shows positive numbers "
                     "only")
  x_low, x_high = _range([x for *_, points in lines for x, _, _ in points])
  bent: Callable[[float], float] = math.log10 if logarithmic else float
  y_low, y_high = _range([bent(end) for end in ends])
  zero = not logarithmic and 0 <= y_low < 0.4 * y_high  # near enough to zero to show it
  pad = 0.06 * (y_high - (0.0 if zero else y_low))
  y_low, y_high = (0.0 if zero else y_low - pad), y_high + pad
  across = lambda x: _LEFT + (x - x_low) / (x_high - x_low) * (WIDTH - _LEFT - _RIGHT)
  down = lambda y: HEIGHT - _BOTTOM - (bent(y) - y_low) / (y_high - y_low) * (HEIGHT - _TOP - _BOTTOM)
  y_ticks = logarithmic_ticks(10 ** y_low, 10 ** y_high) if logarithmic else ticks(y_low, y_high)
  marks = _axes(across, down, ticks(x_low, x_high, 6), y_ticks, x_label, y_label)
  if x_low < 0 < x_high:
    marks.append(_Mark("rule", "border", [(across(0), _TOP), (across(0), HEIGHT - _BOTTOM)]))
  for curve, kind, points in lines:
    marks += _line([(across(x), down(y), down(y - half), down(y + half)) for x, y, half in points], kind, curve.name)
  return marks


def _points(curve):
  halves = curve.interval or [0.0] * len(curve.x)
  if not len(curve.x) == len(curve.y) == len(halves):
    raise ValueError(f"the curve {curve.name!r} has {len(curve.x)} places, {len(curve.y)} values and {len(halves)} "
                     "intervals, expected as many of each")
  return sorted((float(x), float(y), float(half or 0.0)) for x, y, half in zip(curve.x, curve.y, halves)
                if x is not None and y is not None and math.isfinite(x) and math.isfinite(y))


def _range(values):
  low, high = min(values), max(values)
  if high > low:
    return low, high
  return low - (abs(low) or 1) * 0.5, high + (abs(high) or 1) * 0.5


def _axes(across, down, x_ticks, y_ticks, x_label, y_label):
  bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT
  marks = []
  for y in y_ticks:
    marks.append(_Mark("rule", "grid", [(_LEFT, down(y)), (right, down(y))]))
    marks.append(_Mark("text", "tick", [(_LEFT - 8, down(y) + 4)], number(y), "end"))
  marks.append(_Mark("rule", "axis", [(_LEFT, bottom), (right, bottom)]))
  for x in x_ticks:
    marks.append(_Mark("rule", "axis", [(across(x), bottom), (across(x), bottom + 4)]))
    marks.append(_Mark("text", "tick", [(across(x), bottom + 18)], number(x)))
  marks.append(_Mark("text", "label", [((_LEFT + right) / 2, HEIGHT - 8)], x_label))
  marks.append(_Mark("text", "label", [(14, (_TOP + bottom) / 2)], y_label, "turned"))
  return marks


def _line(points, kind, name):
  """A band, the line over it, and dots where there are few points; points: (x, y, lower edge, upper edge) in pixels."""
  marks = []
  if len(points) > 1 and any(abs(low - high) > 0.5 for _, _, low, high in points):
    edge = [(x, high) for x, _, _, high in points] + [(x, low) for x, _, low, _ in points[::-1]]
    marks.append(_Mark("band", kind, edge))
  marks.append(_Mark("line", kind, [(x, y) for x, y, _, _ in points], name))
  if len(points) <= _DOTS:
    marks += [_Mark("dot", kind, [(x, y)]) for x, y, _, _ in points]
  return marks


# --- as SVG ------------------------------------------------------------------------------------------------------


def _svg_rule(mark):
  (x1, y1), (x2, y2) = mark.points
  return f'<line class="{mark.kind}" x1="{x1:.1f}" x2="{x2:.1f}" y1="{y1:.1f}" y2="{y2:.1f}"/>'


def _svg_text(mark):
  (x, y), = mark.points
  turned = mark.anchor == "turned"
  place = f'text-anchor="{"middle" if turned else mark.anchor}"' + f' transform="rotate(-90 {x:g} {y:g})"' * turned
  return f'<text class="{mark.kind}" x="{x:.1f}" y="{y:.1f}" {place}>{html.escape(mark.text)}</text>'


def _svg_line(mark):
  path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in mark.points)
  return f'<path class="line {mark.kind}" d="{path}"><title>{html.escape(mark.text)}</title></path>'


def _svg_band(mark):
  return f'<polygon class="band {mark.kind}" points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in mark.points)}"/>'


def _svg_dot(mark):
  (x, y), = mark.points
  return f'<circle class="dot {mark.kind}" cx="{x:.1f}" cy="{y:.1f}" r="3.2"/>'


# --- as a picture ------------------------------------------------------------------------------------------------


def _draw_rule(image, mark, color, zoom):
  ImageDraw.Draw(image).line(mark.points, color, zoom)


def _draw_text(image, mark, color, zoom):
  font = ImageFont.load_default(12 * zoom)
  mark = mark._replace(text=mark.text.replace("\u2212", "-"))  # a minus, which Pillow's own font lacks
  if mark.anchor != "turned":
    anchor = {"middle": "ms", "end": "rs"}[mark.anchor]
    ImageDraw.Draw(image).text(mark.points[0], mark.text, color, font, anchor=anchor)
    return
  left, top, right, bottom = (math.floor(edge) for edge in font.getbbox(mark.text, anchor="ms"))
  text = Image.new("L", (right - left + 1, bottom - top + 1))
  ImageDraw.Draw(text).text((-left, -top), mark.text, 255, font, anchor="ms")
  text = text.transpose(Image.Transpose.ROTATE_90)
  x, y = mark.points[0]
  image.paste(color, (round(x) + top, round(y) - text.height // 2), text)


def _draw_line(image, mark, color, zoom):
  ImageDraw.Draw(image).line(mark.points, color, round(2.2 * zoom), joint="curve")


def _draw_band(image, mark, color, zoom):
  ImageDraw.Draw(image, "RGBA").polygon(mark.points, color + "2b")


def _draw_dot(image, mark, color, zoom):
  ImageDraw.Draw(image).circle(mark.points[0], 3.2 * zoom, color)
