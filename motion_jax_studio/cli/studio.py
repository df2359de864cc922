"""motion-jax studio and make: the web studio, and its saved projects without it."""
import pathlib

import motion_jax
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import whole
from motion_jax_studio.cli.reading import MOTION_FILES
from motion_jax_studio.cli.writing import Output, add_out, add_rig

_SHIPPED = pathlib.Path(motion_jax.__file__).parent / "pretrained"


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  studio = commands.add_parser("studio", help="start the web studio: live text-to-motion in the browser")
  studio.add_argument("--model", nargs="+", default=["cmdm-small", "cdamd-small"], metavar="NAME",
                      help="run folders or shipped models; the first one streams (cmdm-small cdamd-small)")
  studio.add_argument("--host", default="127.0.0.1",
                      help="address to listen on (127.0.0.1, this machine only); others need --token")
  studio.add_argument("--port", type=whole(0, 65_535), default=8765, help="port to listen on (8765); 0: any free port")
  studio.add_argument("--token", metavar="TEXT", help="access token (default: a random one, stored in "
                      "~/.local/state/motion_jax; the printed address contains it)")
  studio.add_argument("--public-url", metavar="URL", help="address of a proxy in front of the studio, such as "
                      "https://hub.example.com/user/me/proxy/8765/: it is printed, and its pages are accepted")
  studio.add_argument("--open", action="store_true", help="open the page in a browser")
  studio.set_defaults(run=_studio)

  make = commands.add_parser("make", help="generate the motion of a saved studio project")
  make.add_argument("project", help="project file (.json) of the studio")
  make.add_argument("--take", type=whole(0, 100), help="index of the seed, from 0 (default: the chosen one)")
  add_out(make, "motion.html", "motion.glb,motion.bvh")
  add_rig(make)
  make.set_defaults(run=_make)


def _studio(args):
  from motion_jax_studio.server import server
  for name in args.model:
    if not any(folder.is_dir() for folder in (pathlib.Path(name), _SHIPPED / name)):
      from motion_jax import runs  # takes seconds, only if needed
      runs.resolve_run(name)  # lists the shipped models
  server.serve(args.model, args.host, args.port, args.token, args.open, args.public_url)


def _make(args):
  with progress.part("starting"):
    from motion_jax.utils import cache
    from motion_jax_studio.server.server import require_packages
    require_packages("a project of the studio", "msgspec")
    from motion_jax_studio.server import project
    from motion_jax_studio.server.library import Library
    from motion_jax_studio.server.limits import Limits
  if pathlib.Path(args.project).suffix.lower() in MOTION_FILES:
    raise InputError(f"{args.project} is a motion file, expected a project (.json) saved in the studio; motion-jax "
                     "render converts motion files")
  output, limits = Output(args), Limits()
  saved = project.read(args.project, limits)
  cache.keep_in_user_cache()
  library = Library(project.models_of(saved), warm=False)
  library.start()
  motion = project.generate(saved, library, limits, args.take, lambda note: print(f"note: {note}"))
  for caption in motion.captions:
    print(f"{caption.start:6.1f} to {caption.end:5.1f} s  {caption.text}")
  output.write([motion], constraints=project.control_of(saved))
