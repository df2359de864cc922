"""The networks that cached frame-wise sampling takes (`models.cmdm.streaming`), as a Protocol."""
from typing import Any, Protocol, runtime_checkable

from motion_jax.shapes import Array, Bool, Float


@runtime_checkable
class FrameWiseNetwork(Protocol):
  """A linen module with a velocity per latent frame, whose attention can look at cached keys and values.

  `CausalDiT` is one. Methods are called through `apply(stack_layers(params), ..., method="window")`. A network with
  captions also has `text_keys_values(text_emb, text_mask, with_null)`, one that takes constraints
  `control_tokens(control)`; what these return is text and control of `window`, which are None without.
  """
  latent_dim: int  # C
  width: int       # of all heads together
  num_heads: int
  depth: int       # layers, each with keys and values in the cache
  dtype: Any

  @property
  def apply(self) -> Any:
    """That of every linen module."""

  def stack_layers(self, params: Any) -> Any:
    """Parameters as the methods below take them."""

  def modulation(self, t: Float[Array, " n"]) -> Array:
    """What depends on the time alone, computed once for all times (N,) of a sampler."""

  def window(self, x: Float[Array, "b w c"], t: Float[Array, "#b w"], modulation: Any,
             text: Any, attn_mask: Bool[Array, "#b 1 w k"], positions: Any, past: Any = None, control: Any = None
             ) -> tuple[Array, Any]:
    """(velocity of the latents x at times t, (keys, values) of all layers, unturned). Keys are those of past, as
    `turn_keys` returns them, followed by those of x; both (depth, B, L, num_heads, width / num_heads)."""

  def turn_keys(self, cache: Any, positions: Any) -> Any:
    """Cached (keys, values) of all layers, keys with their positions applied, which count from the window."""
