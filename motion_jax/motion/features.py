"""The names of `motion.representations`, for code that imports them from here."""
from motion_jax.motion import representations
from motion_jax.motion.representations import *  # noqa: F403
from motion_jax.motion.skeleton import HUMANML3D, SKELETONS, bone_lengths, facing

__all__ = [*representations.__all__, "HUMANML3D", "SKELETONS", "bone_lengths", "facing"]
