"""Files of motion capture become clips, by the ending of their names."""
from motion_jax.data.mocap.asf import amc_clip
from motion_jax.data.mocap.bvh import bvh_clip

READERS = {".bvh": bvh_clip, ".amc": amc_clip}
