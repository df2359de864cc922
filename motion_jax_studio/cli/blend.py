"""motion-jax blend: a transition between two motions."""
from motion_jax.utils.numerals import real
from motion_jax_studio.cli import shared


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  blend = commands.add_parser("blend", help="blend from one motion into another")
  blend.add_argument("first", help=f"first motion: {shared.MOTION_HELP}")
  blend.add_argument("second", help="second motion; it is moved and rotated on the ground to follow the first")
  blend.add_argument("--seconds", type=real(0.1, 10, "seconds"), default=1.0, help="length of the transition (1)")
  shared.add_out(blend, "blended.html", "both.mp4,both.bvh")
  shared.add_reading(blend)
  shared.add_rig(blend)
  shared.add_film(blend, "in every output format")
  blend.set_defaults(run=_blend)


def _blend(args):
  from motion_jax_studio.blending import blended
  outputs = shared.outputs_of(args)
  first, second = (shared.read_motion(path, args) for path in (args.first, args.second))
  clip, border = blended(first, second, args.seconds)
  clip = clip.replace(source=f"{args.first}, then {args.second}")
  print(f"{args.first} blends into {args.second} at {border:.2f} s, within {args.seconds:g} s")
  shared.save(args, [shared.trimmed(args, clip)], outputs)
