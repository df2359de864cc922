"""motion-jax retarget: a motion to a robot, and a robot's motion back to human joints."""
import argparse
import pathlib

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import FRAME_RATES, real, whole
from motion_jax_studio.cli.reading import MOTION_HELP, add_reading, read_motion
from motion_jax_studio.cli.writing import print_files

_FORMATS = ("unitree_xyzw", "kimodo_wxyz", "gmr", "mjlab", "beyondmimic", "holosoma", "mujoco", "loco_mujoco")
_PICTURES = (".png", ".jpg", ".mp4", ".gif")


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  retarget = commands.add_parser(
      "retarget", help="retarget a motion file to a robot, or a robot's motion back to human joints",
      epilog="STEM.FORMAT.csv or .npz is written for each format, with a .json file that states robot, order of joints "
      "and quaternions, axes, units, rate and licence. Formats: " + ", ".join(_FORMATS) + ".",
      formatter_class=argparse.RawDescriptionHelpFormatter)
  retarget.add_argument("file", help=f"motion file: {MOTION_HELP}; or a robot's .csv or .npz, to convert back")
  retarget.add_argument("--robot", default="g1", help="g1 (Unitree G1), or an MJCF (.xml) or URDF file with "
                        "--robot-mapping")
  retarget.add_argument("--robot-mapping", metavar="FILE.json", help="{human part: body of the robot}, for a robot of "
                        "your own")
  retarget.add_argument("--joints", type=whole(1, 100), metavar="N", help="number of moving joints, for a robot with "
                        "variants (g1: 29 or 23)")
  retarget.add_argument("--format", default="unitree_xyzw", metavar="A,B", help="robot formats to write, separated by "
                        "commas (unitree_xyzw); see below")
  retarget.add_argument("--rate", type=real(*FRAME_RATES), metavar="HZ", help="frames a second of inverse kinematics "
                        "(50); formats whose readers expect a rate are resampled to it")
  retarget.add_argument("--quaternion", choices=("xyzw", "wxyz"), help="quaternion order of a robot's .csv (default: "
                        "detected from the pelvis, which is upright)")
  retarget.add_argument("--out", help="stem of the files to write (FILE without its ending); for a robot's file, the "
                        "motion file to write: .npz (if there is no ending), .bvh .glb .mp4 .html ...")
  retarget.add_argument("--picture", metavar="FILE", help="also draw the robot: .png (a strip), .mp4 or .gif")
  add_reading(retarget)
  retarget.set_defaults(run=_retarget)


def _is_robots(path):
  from motion_jax.robots.npz import is_robots
  return is_robots(path)


def _by_ending(out, formats):
  """(stem, formats) of --out; the ending of a format's files, as in walk.mjlab.npz or walk.csv, selects the format."""
  path = pathlib.Path(out)
  ending = path.suffix.lower()
  if ending not in (".csv", ".npz", ".json"):
    return out, formats
  stem, known = path.with_suffix(""), path.with_suffix("").suffix.removeprefix(".")
  if known in _FORMATS:
    return str(stem.with_suffix("")), known
  usual = {".csv": "unitree_xyzw", ".npz": "mujoco", ".json": formats}[ending]
  return str(stem), formats if formats != _FORMATS[0] else usual


def _retarget(args):
  path = pathlib.Path(args.file)
  back = path.suffix.lower() == ".csv" or path.suffix.lower() == ".npz" and path.is_file() and _is_robots(path)
  if not back and args.out:
    args.out, args.format = _by_ending(args.out, args.format)
  formats = args.format.split(",")
  unknown = [name for name in formats if name not in _FORMATS]
  if unknown:
    raise InputError(f"got robot format {unknown[0]!r}, expected {', '.join(_FORMATS)}")
  if args.picture and pathlib.Path(args.picture).suffix.lower() not in _PICTURES:
    raise InputError(f"got --picture {args.picture}, expected a file that ends in {', '.join(_PICTURES)}")
  from motion_jax import export
  if args.picture:
    export.check_output(args.picture)
  outputs = [export.check_output(part if pathlib.Path(part).suffix else f"{part}.npz")
             for part in (args.out or f"{path.with_suffix('')}_joints.npz").split(",")] if back else []
  from motion_jax import robots
  robot = robots.load(args.robot, args.robot_mapping).with_joints(args.joints)
  if back:
    motion = (robots.read_csv(path, robot, args.quaternion, args.fps) if path.suffix.lower() == ".csv" else
              robots.read_npz(path, robot, args.fps))
    print(f"{path}: {motion.num_frames} frames, {motion.seconds:.1f} s at {motion.fps:g} frames a second; quaternions "
          f"{motion.meta['quaternion_order']}")
    written = [file for out in outputs for file in export.save(motion.to_clip(), out)]
  else:
    clip = read_motion(args.file, args)
    motion = robots.retarget(clip, robot, args.rate or robots.RATE)
    print(f"{path}: {clip.seconds:.1f} s onto {robot.title}, {len(robot.moving)} moving joints, {motion.fps:g} frames "
          f"a second, {motion.meta['seconds_per_second']:.2f} s of work per second of motion")
    print("\n".join(robots.report(motion, clip).lines()))
    stem = args.out or path.with_suffix("")
    written = [file for name in formats for file in robots.write(motion, stem, name)]
  if args.picture:
    written += export.save(motion, args.picture)
  print_files(written)
