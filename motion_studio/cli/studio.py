"""motion-jax studio and make: a page in the browser, and what it saves made without it."""
import pathlib

import motion_jax
from motion_jax.utils import progress
from motion_jax.utils.numerals import whole
from motion_studio.cli import shared

_SHIPPED = pathlib.Path(motion_jax.__file__).parent / "pretrained"


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  studio = commands.add_parser("studio", help="a page in the browser: words become motion while you watch")
  studio.add_argument("--model", nargs="+", default=["cmdm-small", "cdamd-small"], metavar="NAME",
                      help="run folders or names of models that ship (cmdm-small cdamd-small)")
  studio.add_argument("--host", default="127.0.0.1",
                      help="address to listen on (127.0.0.1, this machine alone); another one needs --token")
  studio.add_argument("--port", type=whole(0, 65_535), default=8765, help="port to listen on (8765); 0 is a free one")
  studio.add_argument("--token", metavar="WORDS", help="what a page has to send to be let in; by default a random one, "
                      "kept for you in ~/.local/state/motion_jax and is part of the printed address")
  studio.add_argument("--open", action="store_true", help="open the page in the browser")
  studio.set_defaults(run=_studio)

  make = commands.add_parser("make", help="a project that the studio saved in, its motion out")
  make.add_argument("project", help="a .json file that the studio saved")
  make.add_argument("--take", type=whole(0, 100), help="which of its seeds, counted from 0; by default the chosen one")
  shared.add_out(make, "motion.html", "story.glb,story.bvh")
  shared.add_rig(make)
  make.set_defaults(run=_make)


def _studio(args):
  from motion_studio.server import server
  for name in args.model:
    if not any(folder.is_dir() for folder in (pathlib.Path(name), _SHIPPED / name)):
      from motion_jax import runs  # takes seconds, for which no address should wait
      runs.resolve_run(name)  # says what there is
  server.serve(args.model, args.host, args.port, args.token, args.open)


def _make(args):
  with progress.part("starting"):
    from motion_jax import export
    from motion_studio.cli import control
    from motion_studio.server import project
    from motion_studio.server.library import Library
    from motion_studio.server.limits import Limits
    outputs, limits = shared.outputs_of(args), Limits()
    found = project.read(args.project, limits)
    shared.cache_compiled_code()
  library = Library(project.models_of(found), warm=False)
  library.start()
  motion = project.made(found, library, limits, args.take, lambda note: print(f"note: {note}"))
  for caption in motion.captions:
    print(f"{caption.start:6.1f} to {caption.end:5.1f} s  {caption.text}")
  wanted = project.control_of(found)
  asked = control.drawn(wanted, [motion])[0] if wanted else None
  written = [path for out in outputs for path in export.save(
      motion, out, **shared.file_options(args, out), **control.drawn_options(out, asked, wanted))]
  shared.tell_rig_error(args, [motion], outputs)
  shared.tell_files(written)
