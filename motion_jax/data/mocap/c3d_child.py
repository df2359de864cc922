"""Reads a C3D file with ezc3d, in a process of its own: that library can crash or take all memory on a damaged file.

  python -m motion_jax.data.mocap.c3d_child FILE OUT.npz

OUT.npz gets points (T, N, 3), labels, rate and units as the file has them.
"""
import sys

import numpy as np


def main(path, out):
  """Writes what the file holds; raises what ezc3d raises."""
  import ezc3d
  file = ezc3d.c3d(path)
  about = file["parameters"]["POINT"]
  units = about.get("UNITS", {"value": []})["value"]
  np.savez(out, points=file["data"]["points"][:3].transpose(2, 1, 0), labels=np.array(about["LABELS"]["value"], str),
           rate=float(about["RATE"]["value"][0]), units=np.array((units or [""])[0], str))


if __name__ == "__main__":
  try:
    main(*sys.argv[1:])
  except ImportError:
    sys.exit(3)
  except Exception as error:
    sys.exit(f"{type(error).__name__}: {error}")
