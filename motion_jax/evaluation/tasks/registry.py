"""Tasks by the name that a protocol gives them."""
from motion_jax.evaluation.tasks.base import Task
from motion_jax.evaluation.tasks.control import Control
from motion_jax.evaluation.tasks.editing import Editing
from motion_jax.evaluation.tasks.generation import Generation
from motion_jax.evaluation.tasks.long_horizon import LongHorizon
from motion_jax.evaluation.tasks.reconstruction import Reconstruction
from motion_jax.evaluation.tasks.timelines import Timelines

TASKS: dict[str, type[Task]] = {
    "generation": Generation, "reconstruction": Reconstruction, "editing": Editing, "long_horizon": LongHorizon,
    "timelines": Timelines, "control": Control}
