"""Motions that move on the site: made by the library when the site is built, each a page of the HTML export.

All pages share one copy of the viewer's script, so a motion costs its own size only, 60 to 300 kB.
"""
import functools
import hashlib
import html
from collections.abc import Callable
from typing import NamedTuple

import motion_jax as mj
from motion_jax import export
from motion_jax.control import RootPath
from motion_jax.control.compiling import compile
from motion_jax.export.html import VIEWER
from motion_jax.models.results import colors_of
from motion_jax_studio import Pipeline
from tools.site.nav import ROOT

SOURCES = ("motion_jax", "motion_jax_studio")  # what motions depend on
# Small frames: no bar, no caption; the page around them has it. A click or a key still pauses.
STYLE = "<style>#bar, #caption { display: none !important; }</style></head>"


class Shown(NamedTuple):
  """One motion of the gallery. code: as a reader types it; make() -> (clip or clips, options of `export.html_page`)."""
  name: str
  title: str
  code: str
  make: Callable


def _prompt(text, model="cmdm-small", **options):
  return lambda: (Pipeline(model)(text, **options), {})


def _path():
  path = RootPath([[0, 0], [1.6, 1.2], [0, 2.4], [-1.6, 3.6], [0, 4.8]])
  motion = Pipeline("cmdm-small")("a person walks", seed=2, control=[path])
  return motion, {"control": compile([path], motion.num_frames, motion.fps, motion.joints)}


def _seeds():
  return mj.load("cmdm-small").generate(["a person dances"] * 3, num_frames=120, seeds=[3, 4, 5], cleanup=True), {}


def _edit():
  editor = Pipeline("cdamd-small")
  walk = editor("a person walks forward", num_frames=120, seed=4)
  edited = editor.edit(walk, "a person waves the right hand", keep=[(0, 40), (100, 120)], seed=1)
  return edited, {"colors": colors_of(edited)}


GALLERY = (
    Shown("actions", "Two actions at once, then another",
          'motion-jax generate "a person walks forward while waving, then bows" --seed 3 --out actions.html',
          _prompt("a person walks forward while waving, then bows", seed=3)),
    Shown("kick", "A kick", 'motion-jax generate "a person kicks with the right foot" --seed 0 --out kick.html',
          _prompt("a person kicks with the right foot", seed=0)),
    Shown("jump", "Jump forward, three times",
          'motion-jax generate "a person jumps forward three times" --seed 1 --out jump.html',
          _prompt("a person jumps forward three times", seed=1)),
    Shown("path", "Along a path", 'motion-jax generate "a person walks" --path "0,0 1.6,1.2 0,2.4 -1.6,3.6 0,4.8" '
          "--seed 2 --out path.html", _path),
    Shown("seeds", "One prompt, three seeds",
          'motion-jax generate "a person dances" --num-samples 3 --seed 3 --no-plan --out dance.html', _seeds),
    Shown("edit", "Frames regenerated in the middle (orange)",
          'motion-jax edit walk.npz --prompt "a person waves the right hand" --change 2s:5s --out edit.html', _edit),
    Shown("sit", "Sit down, stand up",
          'motion-jax generate "a person sits down, then stands up" --seed 0 --out sit.html',
          _prompt("a person sits down, then stands up", seed=0)),
    Shown("run", "Run and turn", 'motion-jax generate "a person runs in a circle" --seed 0 --out run.html',
          _prompt("a person runs in a circle", seed=0)),
)


def page(clips, title, script="../assets/viewer.js", **options):
  """The export's page for a small frame, with the viewer's script beside it instead of inside."""
  text = export.html_page(clips if isinstance(clips, mj.Clip) else list(clips), title, **options)
  inside = f"<script>{VIEWER.read_text(encoding='utf-8')}</script>"
  assert inside in text, "the export's page no longer holds the viewer's script in an element of its own"
  return text.replace(inside, f'<script src="{script}"></script>').replace("</head>", STYLE)


def frame(name, folder, title):
  """The element that shows a motion; assets/site.js loads it when it is near the screen."""
  return (f'<iframe class="motion" data-src="{folder}motions/{name}.html" title="{html.escape(title, quote=True)}">'
          "</iframe>")


def tab(folder):
  """The field that starts the model in the visitor's tab (assets/site.js), where its page has been built; else ""."""
  if not folder.is_dir():
    return ""
  size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.match("*asyncify*")
             and not path.match("*webgpu*"))
  return f"""<form class="try" action="try/index.html">
<input name="prompt" value="a person walks forward" aria-label="What the person does" autocomplete="off"
 maxlength="2000">
<button class="md-button md-button--primary">Make it move</button>
</form>
<p>The model runs in this tab: the button loads {size / 1e6:.0f} MB, and what you type stays on your computer.</p>"""


def gallery():
  """The motions of gallery.md, each with the command that makes it, as Markdown."""
  lines = ['<div class="gallery" markdown>', ""]
  for shown in GALLERY:
    lines += ['<figure markdown>', "", frame(shown.name, "../", shown.title), "", f"**{shown.title}**", "",
              "```bash", shown.code, "```", "", "</figure>", ""]
  return "\n".join([*lines, "</div>"])


def files(draft=False):
  """{path on the site: contents}: the motions of the gallery and the script that they share. draft: of `newest`."""
  motions = {f"motions/{shown.name}.html": draft and newest(shown.name) or kept(
      shown.name, shown.code, functools.partial(_drawn, shown)) for shown in GALLERY}
  return motions | {"assets/viewer.js": VIEWER.read_text(encoding="utf-8")}


def _drawn(shown):
  clips, options = shown.make()
  return page(clips, shown.title, **options)


KEPT = ROOT / "build" / "kept"


def newest(name):
  """What an earlier build kept under a name, of whatever code; "" for nothing."""
  paths = sorted(KEPT.glob(f"{name}-*"), key=lambda path: path.stat().st_mtime)
  return paths[-1].read_text(encoding="utf-8") if paths else ""


def kept(name, source, make):
  """make(), or what it gave in an earlier build of the same library and the same source; delete build/kept to make all
  of it again."""
  key = hashlib.sha256(source.encode())
  for path in sorted(path for folder in SOURCES for path in (ROOT / folder).rglob("*.py")):
    key.update(path.read_bytes())
  path = KEPT / f"{name}-{key.hexdigest()[:12]}"
  if not path.is_file():
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(make(), encoding="utf-8")
  return path.read_text(encoding="utf-8")
