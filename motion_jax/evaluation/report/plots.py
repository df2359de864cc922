"""Line charts as SVG text: labelled axes, intervals as bands, colours from the page's style sheet (light and dark)."""
import html
import math
from typing import NamedTuple

WIDTH, HEIGHT = 460, 290
_LEFT, _RIGHT, _TOP, _BOTTOM = 66, 16, 14, 46
_DOTS = 16  # a line of more points than this is drawn without dots


class Series(NamedTuple):
  """One line: x and y (N,), half widths of its band or None, and whether it is the real motions' (grey, dashed)."""
  name: str
  x: list
  y: list
  interval: list | None = None
  real: bool = False


def ticks(low, high, count=5) -> list[float]:
  """Round numbers (1, 2 or 5 times a power of ten apart) from low to high, about `count` of them."""
  if not high > low:
    high = low + (abs(low) or 1)
  raw = (high - low) / count
  power = 10.0 ** math.floor(math.log10(raw))
  step = power * next(factor for factor in (1, 2, 5, 10) if factor * power >= 0.75 * raw)
  first = math.ceil(low / step - 1e-9)
  return [round(k * step, 12) for k in range(first, math.floor(high / step + 1e-9) + 1)]


def chart(series, x_label, y_label, title="") -> str:
  """An <svg> of lines over shared axes. Points without a number are left out; a lone point is a dot.

  Colours are the classes s0, s1, .. and real of the page's style sheet, so the picture follows its light and dark.
  """
  lines = [(one, _points(one)) for one in series]
  lines = [(one, points) for one, points in lines if points]
  if not lines:
    raise ValueError(f"got no numbers to draw for {title or y_label!r}; every point is missing")
  x_low, x_high = _range([x for _, points in lines for x, _, _ in points])
  ends = [y + side * half for _, points in lines for _, y, half in points for side in (-1, 1)]
  y_low, y_high = _range(ends)
  if 0 <= y_low < 0.4 * y_high:
    y_low = 0.0  # near enough to zero to show it
  pad = 0.06 * (y_high - y_low)
  y_low, y_high = (y_low - pad if y_low else 0.0), y_high + pad
  across = lambda x: _LEFT + (x - x_low) / (x_high - x_low) * (WIDTH - _LEFT - _RIGHT)
  down = lambda y: HEIGHT - _BOTTOM - (y - y_low) / (y_high - y_low) * (HEIGHT - _TOP - _BOTTOM)
  parts = [f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" xmlns="http://www.w3.org/2000/svg" '
           f'aria-label="{html.escape(title or y_label, quote=True)}">']
  parts += _axes(across, down, (x_low, x_high), (y_low, y_high), x_label, y_label)
  if x_low < 0 < x_high:
    parts.append(f'<line class="border" x1="{across(0):.1f}" x2="{across(0):.1f}" y1="{_TOP}" '
                 f'y2="{HEIGHT - _BOTTOM}"/>')
  number = 0
  for one, points in lines:
    kind = "real" if one.real else f"s{number % 5}"
    number += not one.real
    parts += _line([(across(x), down(y), down(y - half), down(y + half)) for x, y, half in points], kind, one.name)
  return "\n".join([*parts, "</svg>"])


def legend(series) -> str:
  """The names of several lines with their colours, as HTML; nothing for a single nameless one."""
  named = [one for one in series if one.name]
  if not named or len(series) < 2:
    return ""
  items, number = [], 0
  for one in series:
    kind = "real" if one.real else f"s{number % 5}"
    number += not one.real
    items.append(f'<li><svg viewBox="0 0 24 8" aria-hidden="true"><path class="line {kind}" d="M1 4H23"/></svg>'
                 f"{html.escape(one.name)}</li>")
  return f'<ul class="legend">{"".join(items)}</ul>'


def number(value) -> str:
  """A tick's number as short as it goes."""
  return f"{value:.6g}".replace("-", "−")


def _points(one):
  halves = one.interval or [0.0] * len(one.x)
  if not len(one.x) == len(one.y) == len(halves):
    raise ValueError(f"the curve {one.name!r} has {len(one.x)} places, {len(one.y)} values and {len(halves)} "
                     "intervals, expected as many of each")
  return sorted((float(x), float(y), float(half or 0.0)) for x, y, half in zip(one.x, one.y, halves)
                if x is not None and y is not None and math.isfinite(x) and math.isfinite(y))


def _range(values):
  low, high = min(values), max(values)
  if high > low:
    return low, high
  return low - (abs(low) or 1) * 0.5, high + (abs(high) or 1) * 0.5


def _axes(across, down, x_range, y_range, x_label, y_label):
  bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT
  parts = []
  for y in ticks(*y_range):
    parts.append(f'<line class="grid" x1="{_LEFT}" x2="{right}" y1="{down(y):.1f}" y2="{down(y):.1f}"/>')
    parts.append(f'<text class="tick" x="{_LEFT - 8}" y="{down(y) + 4:.1f}" text-anchor="end">{number(y)}</text>')
  parts.append(f'<line class="axis" x1="{_LEFT}" x2="{right}" y1="{bottom}" y2="{bottom}"/>')
  for x in ticks(*x_range, 6):
    parts.append(f'<line class="axis" x1="{across(x):.1f}" x2="{across(x):.1f}" y1="{bottom}" y2="{bottom + 4}"/>')
    parts.append(f'<text class="tick" x="{across(x):.1f}" y="{bottom + 18}" text-anchor="middle">{number(x)}</text>')
  middle = (_TOP + bottom) / 2
  parts.append(f'<text class="label" x="{(_LEFT + right) / 2}" y="{HEIGHT - 8}" text-anchor="middle">'
               f"{html.escape(x_label)}</text>")
  parts.append(f'<text class="label" x="14" y="{middle}" text-anchor="middle" '
               f'transform="rotate(-90 14 {middle})">{html.escape(y_label)}</text>')
  return parts


def _line(points, kind, name):
  """A band, the line over it, and dots where there are few points; points: (x, y, lower edge, upper edge) in pixels."""
  parts = []
  if len(points) > 1 and any(abs(low - high) > 0.5 for _, _, low, high in points):
    edge = [f"{x:.1f},{high:.1f}" for x, _, _, high in points] + [f"{x:.1f},{low:.1f}" for x, _, low, _ in points[::-1]]
    parts.append(f'<polygon class="band {kind}" points="{" ".join(edge)}"/>')
  path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y, _, _ in points)
  parts.append(f'<path class="line {kind}" d="{path}"><title>{html.escape(name)}</title></path>')
  if len(points) <= _DOTS:
    parts += [f'<circle class="dot {kind}" cx="{x:.1f}" cy="{y:.1f}" r="3.2"/>' for x, y, _, _ in points]
  return parts
