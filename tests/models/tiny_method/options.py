"""How the tiny method is sampled."""
import dataclasses

from motion_jax.models.options import SamplingOptions, number


@dataclasses.dataclass(frozen=True)
class TinySampling(SamplingOptions):
  """Beside guidance, how far motions of one sentence differ."""
  spread: float | None = number("size of the noise that a seed adds to features (0.1)", (0, 10), float)


OPTIONS = TinySampling
