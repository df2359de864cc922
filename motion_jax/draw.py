"""Drawings as SVG: attention masks, sampling schedules, and networks from the shapes of their own code.

  import motion_jax as mj
  mj.draw.mask(mj.nets.block_causal_mask(12, 3)).save("mask.svg")
  mj.draw.schedule(mj.diffusion.staircase(num_steps=8, length=12, lag=2, block=3))
  mj.draw.network(mj.nets.CausalVAE(), x, noise)

A notebook shows them as they are. Colours are those of charts and reports (`motion_jax.look`), in light and dark.
Why not matplotlib or graphviz: see `motion_jax.charts`; and boxes come from shapes of a network's own code.
"""
import html
import math
import os
import pathlib
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from motion_jax import look

__all__ = ["Drawing", "mask", "network", "schedule"]

_CELL, _TITLE, _LABEL = 16, 26, 20  # pixels
_LARGEST = 640   # pixels of a grid; more cells become smaller ones
_USED = ("ink", "soft", "line", "card", "s0")  # colours of motion_jax.look
_WIDTH, _LINE, _GAP, _BETWEEN = 560, 19, 26, 8  # pixels of a network's boxes
_STYLE = f"""<style>
.mj-drawing {{ {look.variables({name: look.LIGHT[name] for name in _USED}, "--mj-")} }}
@media (prefers-color-scheme: dark) {{
  .mj-drawing {{ {look.variables({name: look.DARK[name] for name in _USED}, "--mj-")} }} }}
.mj-drawing text {{ font: 12px {look.FONT}; fill: var(--mj-soft); }}
.mj-drawing .ink {{ fill: var(--mj-ink); }} .mj-drawing .bold {{ font-weight: 600; }}
.mj-drawing .mono {{ font-family: {look.MONO}; font-size: 11px; }}
.mj-drawing .paper {{ fill: var(--mj-card); }} .mj-drawing .cell {{ fill: var(--mj-s0); }}
.mj-drawing .box {{ fill: var(--mj-card); stroke: var(--mj-line); stroke-width: 1.4; }}
.mj-drawing .head {{ fill: var(--mj-s0); opacity: 0.14; }}
.mj-drawing .frame {{ fill: none; stroke: var(--mj-line); }} .mj-drawing .grid {{ stroke: var(--mj-line); }}
.mj-drawing .flow {{ stroke: var(--mj-soft); stroke-width: 1.4; fill: none; }}
</style>"""


class Drawing(str):
  """The text of an <svg> element. `save` writes it as a file; a notebook shows it."""

  def _repr_svg_(self) -> str:
    return str(self)

  def save(self, path: str | os.PathLike) -> pathlib.Path:
    """Writes an .svg file and returns its path. Raises ValueError for another extension."""
    path = pathlib.Path(path)
    if path.suffix.lower() != ".svg":
      raise ValueError(f"got {path.name!r}, expected a name that ends in .svg; drawings are SVG")
    path.write_text(self + "\n", encoding="utf-8")
    return path


def mask(attn_mask: Any, title: str = "") -> Drawing:
  """An attention mask: a row per query, a column per key, filled where the query may attend.

  attn_mask: booleans (L, S), (1, L, S) or (1, 1, L, S), such as `motion_jax.nets.block_causal_mask(12, 3)`.
  Raises ValueError for other shapes, and for numbers that are not 0 or 1.
  """
  cells = _grid(attn_mask, "a mask (L, S), (1, L, S) or (1, 1, L, S)")
  if not np.isin(cells, (0, 1)).all():
    raise ValueError(f"got a mask with the value {cells[~np.isin(cells, (0, 1))][0]:.6g}, expected booleans; a table "
                     "of times is drawn by mj.draw.schedule")
  return _cells(cells, title, "key", "query")


def schedule(times: Any, title: str = "") -> Drawing:
  """A table of times: a row per sampler step, a column per latent, the fuller the cleaner.

  times (N + 1, L): 0 = noise, 1 = clean, such as `motion_jax.diffusion.staircase(num_steps=8, length=12, lag=2)`.
  Raises ValueError for other shapes, and for times outside of 0 to 1.
  """
  cells = _grid(times, "a table of times (N + 1, L)")
  if not ((cells >= 0) & (cells <= 1)).all():
    raise ValueError(f"got times from {cells.min():.6g} to {cells.max():.6g}, expected 0 (noise) to 1 (clean); levels "
                     "become times with mj.diffusion.time_of_level(levels, num_steps)")
  return _cells(cells, title, "latent", "step")


def network(module: Any, *inputs: Any, title: str = "") -> Drawing:
  """A linen module as boxes: submodules in the order in which they first run, and the shapes that go in and come out.

  inputs: what `module(...)` takes, as arrays or `jax.ShapeDtypeStruct`s. Nothing is computed: shapes and parameter
  counts come from `jax.eval_shape` of the module's own code. Equal neighbours, such as layers, share a box.
  """
  calls, total, output = _traced(module, inputs)
  boxes = _merged([call for call in calls if len(call.path) == 1], calls)
  marks = [f'<text class="ink bold" x="{_WIDTH / 2}" y="20" text-anchor="middle">'
           f"{html.escape(title or type(module).__name__)}, {_count(total)} parameters</text>"]
  top = 34.0
  marks.append(_flow_text(", ".join(_shape(array) for array in inputs if hasattr(array, "shape")), top))
  marks.append(f'<path class="flow" d="M{_WIDTH / 2} {top + 8:.0f}v14m-4 -5l4 5l4 -5"/>')
  top += _GAP - _BETWEEN
  for box in boxes:
    top += _BETWEEN
    height = 26 + _LINE * len(box.lines) + 4
    marks += [f'<rect class="box" x="10" y="{top:.0f}" width="{_WIDTH - 20}" height="{height}" rx="7"/>',
              f'<rect class="head" x="10" y="{top:.0f}" width="{_WIDTH - 20}" height="24" rx="7"/>',
              f'<text class="ink bold" x="20" y="{top + 16:.0f}">{html.escape(box.title)}</text>',
              f'<text x="{_WIDTH - 20}" y="{top + 16:.0f}" text-anchor="end">{_count(box.params)}</text>']
    for row, (left, right, inner) in enumerate(box.lines):
      y = top + 24 + _LINE * (row + 1) - 5
      marks += [f'<text class="{"" if inner else "ink"}" x="{36 if inner else 20}" y="{y:.0f}">'
                f"{html.escape(left)}</text>",
                f'<text class="mono" x="{_WIDTH - 20}" y="{y:.0f}" text-anchor="end">{html.escape(right)}</text>']
    top += height
  top += _GAP
  marks.append(f'<path class="flow" d="M{_WIDTH / 2} {top - 24:.0f}V{top - 10:.0f}m-4 -5l4 5l4 -5"/>')
  marks.append(_flow_text(output, top))
  return _drawing(marks, _WIDTH, math.ceil(top + 14), title or type(module).__name__)


# --- grids ---------------------------------------------------------------------------------------------------------


def _grid(values, expected):
  cells = np.asarray(values, np.float64)
  while cells.ndim > 2 and cells.shape[0] == 1:
    cells = cells[0]
  if cells.ndim != 2 or not cells.size:
    raise ValueError(f"got shape {np.shape(values)}, expected {expected}; of a batch, draw one: mask[:1]")
  return cells


def _cells(cells, title, across, down):
  """A grid of squares whose opacity is a cell's value, with the names of both axes. Runs of a row are one shape."""
  rows, columns = cells.shape
  size = min(_CELL, _LARGEST / max(rows, columns))
  left, top = 34, (_TITLE if title else 4) + _LABEL
  marks = []
  if title:
    marks.append(f'<text class="ink bold" x="{left}" y="16">{html.escape(title)}</text>')
  marks.append(f'<text x="{left}" y="{top - 6}">{across} 0 to {columns - 1}</text>')
  marks.append(f'<text x="14" y="{top}" text-anchor="end" transform="rotate(-90 14 {top})">'
               f"{down} 0 to {rows - 1}</text>")
  marks.append(f'<rect class="paper" x="{left}" y="{top}" width="{columns * size:g}" height="{rows * size:g}"/>')
  for row, line in enumerate(cells):
    borders = [0, *(np.flatnonzero(np.diff(line)) + 1), columns]
    for first, past in zip(borders, borders[1:]):
      if line[first] > 0:
        shade = f' opacity="{line[first]:.2g}"' if line[first] < 1 else ""
        marks.append(f'<rect class="cell" x="{left + first * size:g}" y="{top + row * size:g}" '
                     f'width="{(past - first) * size:g}" height="{size:g}"{shade}/>')
  if size >= 6:
    steps = [f"M{left + k * size:g} {top}v{rows * size:g}" for k in range(1, columns)]
    steps += [f"M{left} {top + k * size:g}h{columns * size:g}" for k in range(1, rows)]
    marks.append(f'<path class="frame" stroke-width="0.6" d="{"".join(steps)}"/>')
  marks.append(f'<rect class="frame" x="{left}" y="{top}" width="{columns * size:g}" height="{rows * size:g}"/>')
  width = max(left + columns * size, left + 7.5 * len(title)) + 10
  return _drawing(marks, math.ceil(width), math.ceil(top + max(rows * size, 70) + 8), title or f"{down} by {across}")


def _drawing(marks, width, height, title):
  return Drawing("\n".join([
      f'<svg class="mj-drawing" xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
      f'viewBox="0 0 {width} {height}" role="img" aria-label="{html.escape(title, quote=True)}">',
      _STYLE, *marks, "</svg>"]))


# --- networks ------------------------------------------------------------------------------------------------------


class _Call(NamedTuple):
  """A submodule: its path below the network, its class, {method: "shape → shape"} and its parameters."""
  path: tuple[str, ...]
  kind: str
  methods: dict[str, str]
  params: int


class _Box(NamedTuple):
  """lines: (text, shapes, whether it is of a part of the box)."""
  title: str
  params: int
  lines: list[tuple[str, str, bool]]


def _traced(module, inputs):
  """(the calls of submodules, the number of parameters, the output's shape) of a call of the module."""
  import flax.linen as nn
  import jax
  seen: dict[tuple[str, ...], tuple[str, dict[str, str]]] = {}

  def note(call, args, kwargs, context):
    output = call(*args, **kwargs)
    name = context.method_name
    if context.module.path and _shapes(args, 1) and (name == "__call__" or not name.startswith(("_", "setup"))):
      _, methods = seen.setdefault(context.module.path, (type(context.module).__name__, {}))
      methods.setdefault(name, f"{_shapes(args, 2)} → {_shapes([output], 1)}")
    return output

  def run(*arrays):
    with nn.intercept_methods(note):
      return module.init_with_output(jax.random.key(0), *arrays)

  output, variables = jax.eval_shape(run, *inputs)
  params = {tuple(part.key for part in path): math.prod(leaf.shape)
            for path, leaf in jax.tree_util.tree_leaves_with_path(variables.get("params", {}))}
  of = lambda path: sum(count for name, count in params.items() if name[:len(path)] == path)
  calls = [_Call(path, kind, methods, of(path)) for path, (kind, methods) in seen.items()]
  return calls, sum(params.values()), _shapes([output], 3)


def _merged(shown: Sequence[_Call], calls: Sequence[_Call]) -> list[_Box]:
  """The boxes of modules, each with its methods and its parts."""
  boxes = []
  for title, run in _runs(shown):
    lines = [(method if method != "__call__" else "call", shapes, False) for method, shapes in run[0].methods.items()]
    inner = [call for call in calls if call.path[:-1] == run[0].path and call.kind != "Dropout"]
    lines += [(part, next(iter(same[0].methods.values()), ""), True) for part, same in _runs(inner)]
    boxes.append(_Box(title, sum(item.params for item in run), lines))
  return boxes


def _runs(calls: Sequence[_Call]) -> list[tuple[str, list[_Call]]]:
  """[(title, modules)]: neighbours that differ in the number of their name alone stand together."""
  stem = lambda call: re.sub(r"_?\d+$", "", call.path[-1])
  runs: list[list[_Call]] = []
  for item in calls:
    if runs and all(of(runs[-1][0]) == of(item) for of in (stem, lambda c: (c.kind, c.methods, c.params))):
      runs[-1].append(item)
    else:
      runs.append([item])
  return [(f"{f'{len(run)} × {stem(run[0])}' if len(run) > 1 else run[0].path[-1]}: {run[0].kind}", run)
          for run in runs]


def _shapes(values, most):
  """The shapes of the first arrays of a tree of values."""
  import jax
  shapes = [_shape(leaf) for leaf in jax.tree.leaves(list(values)) if getattr(leaf, "ndim", 0)]
  return ", ".join(shapes[:most]) + ", …" * (len(shapes) > most)


def _shape(array):
  return "(" + ", ".join(map(str, array.shape)) + ")"


def _count(number):
  return f"{number / 1e6:.2f} M" if number >= 1e6 else f"{number / 1e3:.1f} k" if number >= 1e3 else str(number)


def _flow_text(text, y):
  return f'<text class="mono" x="{_WIDTH / 2}" y="{y:.0f}" text-anchor="middle">{html.escape(text)}</text>'
