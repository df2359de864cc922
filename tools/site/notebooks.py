"""The notebooks of examples/notebooks: their code at small sizes, and executed with their outputs as pages of the site.

A choice that takes long says what tests and the site use instead: `num_steps = 4000  # tests: 2, site: 60`.
"""
import html
import json
import re
import tempfile
import time

from tools.site.nav import NOTEBOOKS

CELL = re.compile(r"```python\n(.*?)```", re.DOTALL)


def paths():
  """The notebooks in order."""
  return sorted(NOTEBOOKS.glob("*.md"))


def at_size(code, size):
  """The code with the values of choices that its comments name for a size, "tests" or "site"."""
  choice = re.compile(r"(?m)^(\w+ = )\S.*?(  +#.*\b" + size + r": )(\"[^\"]*\"|[\d.]+)(.*)$")
  return choice.sub(lambda match: f"{match[1]}{match[3]}{match[2]}{match[3]}{match[4]}", code)


def blocks(path, size):
  """The code cells of a notebook at a size."""
  return [at_size(code, size) for code in CELL.findall(path.read_text(encoding="utf-8"))]


def outputs(path):
  """The outputs of each code cell at the site's size, as JSON; run from top to bottom in an empty folder."""
  import jupytext
  import nbclient
  notebook = jupytext.read(path)
  cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
  for cell in cells:
    cell.source = at_size(cell.source, "site")
  began = time.perf_counter()
  with tempfile.TemporaryDirectory() as folder:
    nbclient.NotebookClient(notebook, timeout=1800, kernel_name="python3",
                            resources={"metadata": {"path": folder}}).execute()
  print(f"{path.name}: executed in {time.perf_counter() - began:.0f} s")
  return json.dumps([cell.outputs for cell in cells])


def page(path, results):
  """(Markdown, {mark: HTML}) of a notebook with the outputs of its cells, where `made` has them.

  Markdown leaves the marks alone.
  """
  marks, cells = {}, iter(json.loads(results))

  def with_outputs(block):
    lines = ["```python\n" + at_size(block[1], "site") + "```", ""]
    for shown in _shown(next(cells, [])):
      mark = f"<!-- output {len(marks)} -->"
      marks[mark] = shown
      lines += [mark, ""]
    return "\n".join(lines)

  text = re.sub(r"\A---\n.*?\n---\n", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
  return CELL.sub(with_outputs, text), marks


def _shown(cell):
  """Outputs of a cell as HTML: its text first, then its pictures and motions."""
  printed, drawn = "", []
  for output in cell:
    data = {kind: "".join(value) for kind, value in output.get("data", {}).items() if isinstance(value, str | list)}
    rich = data.get("text/html") or data.get("image/svg+xml")
    if rich:
      drawn.append(f'<div class="output">{rich}</div>')
    elif output.get("name") != "stderr":
      printed += "".join(output.get("text", "")) or data.get("text/plain", "") + "\n"
  return [f'<pre class="output">{html.escape(printed.strip())}</pre>'] * bool(printed.strip()) + drawn
