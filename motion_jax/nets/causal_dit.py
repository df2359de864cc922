"""CMDM's Causal-DiT: a denoiser in which every latent frame carries its own noise level.

Source: docs/papers/cmdm.md#causal-dit, #masks.

`__call__` is the whole network. The sampler calls parts of it, because most intermediate results do not change from
step to step: `modulation` depends on the noise level only, `text_keys_values` on the caption only, and keys and values
of finished latents are cached; `window` runs the latents in denoising against that cache. The parts scan one layer over
stacked parameters (`stack_layers`), so only one layer is compiled.
"""
from typing import Any, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import shapes
from motion_jax.nets.attention import Attention, rotary_table, turn
from motion_jax.nets.layers import Dense, broadcast_to_length, timestep_embedding
from motion_jax.nets.masks import two_way_mask
from motion_jax.shapes import Array, AttentionMask, Bool, Float, Int, Num

PREDICTION_FLOOR = 0.02  # one of the default 50 sampling steps
ADAPTER_RANK = 128       # hidden width of a `ControlAdapter`
TIME_LEFT_ROWS = 24      # embeddings of the latents that are left, a third of an octave apart: 0, 0.26, ... 202 latents
SIZES = {"S": dict(num_heads=2, depth=4, width=512), "M": dict(num_heads=4, depth=8, width=512),
         "L": dict(num_heads=6, depth=12, width=768), "XL": dict(num_heads=8, depth=16, width=1024)}
# Not of the paper: about 1 and 3 billion parameters, with heads of 128 channels, for meshes (docs/pods.md).
LARGER_SIZES = {"1B": dict(num_heads=12, depth=24, width=1536), "3B": dict(num_heads=16, depth=40, width=2048)}


def size(name: str, **fields: Any) -> dict[str, Any]:
  """Fields of a size of the paper's Table 10 or a larger one; feed-forward 2 D is what its parameter counts mean."""
  sizes = SIZES | LARGER_SIZES
  if name not in sizes:
    raise ValueError(f"got size {name!r}, expected one of {', '.join(sizes)}")
  return sizes[name] | dict(ff_width=2 * sizes[name]["width"]) | fields


class Text(NamedTuple):
  """What cross-attention needs of captions: keys and values (B, S, H, D / H) of a layer, or (depth, B, S, H, D / H) of
  all; mask (B, S), or (B, L, S) where the latents of one motion have words of their own.

  null (1, 1, D), if given, is the layer's whole output for a dropped caption: its words are all alike, so attention to
  them is a constant (docs/papers/cmdm.md#text). A batch of 2 B then means B latents with their captions and B without.
  """
  k: Float[Array, "*depth b s h k"]
  v: Float[Array, "*depth b s h k"]
  mask: Bool[Array, "b *l s"]
  null: Float[Array, "*depth 1 1 d"] | None = None


# Keys and values of latents, of one layer or of all, (depth, B, L, H, K).
KeysValues = tuple[Float[Array, "*depth b _ h k"], Float[Array, "*depth b _ h k"]]


class Block(nn.Module):
  """Self-attention, cross-attention to the words, feed-forward; x (B, L, D), modulation (B, L, 6, D)."""
  width: int
  num_heads: int
  ff_width: int
  dtype: Any
  attention: str = "xla"

  def setup(self) -> None:
    xavier: dict[str, Any] = dict(kernel_init=nn.initializers.xavier_uniform(), dtype=self.dtype)
    norm = lambda affine: nn.LayerNorm(epsilon=1e-6, use_scale=affine, use_bias=affine, dtype=self.dtype)
    self.film = Dense(6 * self.width, ("embed", "film"), kernel_init=nn.initializers.zeros, dtype=self.dtype)
    self.norm1, self.norm2, self.norm3 = norm(False), norm(True), norm(False)
    self.self_attn, self.cross_attn = (Attention(self.width, self.num_heads, self.dtype, implementation=self.attention)
                                       for _ in range(2))
    self.ff_in = Dense(self.ff_width, ("embed", "mlp"), **xavier)
    self.ff_out = Dense(self.width, ("mlp", "embed"), **xavier)

  def modulation(self, level: Float[Array, "*lead d"]) -> Float[Array, "*lead 6 d"]:
    """level (..., D) -> (..., 6, D): shift, scale, gate of attention, then of the feed-forward."""
    film = self.film(nn.silu(level))
    return film.reshape(film.shape[:-1] + (6, self.width))

  def text(self, words: Float[Array, "b s d"], mask: Bool[Array, "b *l _"],
           null_word: Float[Array, "1 1 d"] | None = None) -> Text:
    null = None if null_word is None else self.cross_attn(null_word, null_word)
    return Text(*self.cross_attn.keys_values(words), mask, null)

  def _modulated(self, x: Float[Array, "b l d"], scale: Float[Array, "#b #l d"], shift: Float[Array, "#b #l d"]
                 ) -> Float[Array, "b l d"]:
    return scale * x + shift + x

  def _to_words(self, x: Float[Array, "b l d"], text: Text) -> Float[Array, "b l d"]:
    batch = text.k.shape[0]
    y = self.cross_attn.queries(self.norm2(x[:batch]))
    mask = text.mask[:, None] if text.mask.ndim == 3 else text.mask[:, None, None, :]
    y = self.cross_attn.attend(y, text.k, text.v, mask)
    if text.null is None:
      return y
    return jnp.concatenate([y, jnp.broadcast_to(text.null, y.shape)])

  def step(self, x: Float[Array, "b l d"], modulation: Float[Array, "#b #l 6 d"], text: Text,
           attn_mask: Bool[Array, "#b 1 l s"], table: tuple[Array, Array], past: KeysValues | None = None
           ) -> tuple[Float[Array, "b l d"], KeysValues]:
    """-> (x, (k, v)) with the keys and values of x before rotation; past (k, v): those of earlier latents, rotated.

    table: `rotary_table` of the positions of x."""
    shift1, scale1, gate1, shift2, scale2, gate2 = (part[..., 0, :] for part in jnp.split(modulation, 6, axis=-2))
    y = self._modulated(self.norm1(x), scale1, shift1)
    q, (k, v) = self.self_attn.queries(y), self.self_attn.keys_values(y)
    new = k, v
    q, k = turn(q, table), turn(k, table)
    if past is not None:
      k, v = (jnp.concatenate([a.astype(b.dtype), b], axis=1) for a, b in zip(past, (k, v)))
    x = x + gate1 * self.self_attn.attend(q, k, v, attn_mask)
    x = x + self._to_words(x, text)
    y = self._modulated(self.norm3(x), scale2, shift2)
    return x + gate2 * self.ff_out(nn.gelu(self.ff_in(y), approximate=True)), new


class ControlAdapter(nn.Module):
  """Adds constraints to the tokens x (B, L, D) at times t (B, L) before a layer, by a bottleneck D -> rank -> D.

  control_emb (B, L, rank) is one layer's part of `CausalDiT.control_tokens`; latents whose has_control (B, L, 1) is 0
  stay unchanged. control_emb may have B / 2 rows: the second half of x is then the same latents without their captions,
  and both halves get the same addition. This halves the cost, and guidance acts on the caption alone.
  """
  width: int
  dtype: Any

  @nn.compact
  def __call__(self, x: Float[Array, "b l d"], control_emb: Float[Array, "_ l k"],
               has_control: Float[Array, "_ l 1"], t: Float[Array, "_ l"]) -> Float[Array, "b l d"]:
    # Powers of t let the weight of a constraint change from pure noise to a nearly clean latent.
    times = jnp.stack([t, t ** 2, t ** 4], axis=-1).astype(self.dtype)[:len(control_emb)]
    hidden = Dense(ADAPTER_RANK, ("embed", None), dtype=self.dtype, name="down")(
        nn.LayerNorm(epsilon=1e-6, use_scale=False, use_bias=False, dtype=self.dtype)(x[:len(control_emb)]))
    hidden = nn.silu(hidden + control_emb + Dense(ADAPTER_RANK, dtype=self.dtype, name="time")(times))
    up = Dense(self.width, (None, "embed"), kernel_init=nn.initializers.zeros, dtype=self.dtype, name="up")
    added = has_control * up(hidden)
    return x + (added if len(added) == len(x) else jnp.concatenate([added, added]))


class CausalDiT(nn.Module):
  """Velocity of latents x (B, L, C) at times t (B, L) under a caption, 0 = noise, 1 = clean; predicts="ddpm": the noise
  of the paper's levels instead (`models.cmdm.ddpm_forcing`).

  t may also be (B, L / n), one time for n neighbours: the modulation is then computed once for them and repeated.
  """
  latent_dim: int = 64
  width: int = 512
  depth: int = 8
  num_heads: int = 4
  ff_width: int = 1024
  text_dim: int = 768
  block: int = 3
  use_rope: bool = True
  use_adaln: bool = True  # False: the time embedding is added to the tokens instead (ablation)
  predicts: str = "velocity"  # the raw output: velocity; eps or x1, converted to the velocity; or "ddpm", its noise
  time_scale: float = 1.0  # factor on t before its embedding; 1000 for the levels of a DDPM
  dtype: Any = jnp.float32
  control: int = 0  # numbers per latent that encode its constraints (`motion_jax.control.conditioning`); 0: none
  remat: bool = False  # recompute each block in the backward pass instead of storing its activations
  attention: str = "xla"  # of `attention.dot_product_attention`: "xla", or "cudnn" for 16 bits on NVIDIA's GPUs
  two_way: bool = False  # latents in denoising (0 < t < 1) see one another in both directions (`masks.two_way_mask`)
  time_left: bool = False  # tokens get an embedding of how many latents their caption has left
  scan_layers: bool = False  # in training, compile one layer and scan it `depth` times instead of compiling each

  # Parity: blocks of 3 latents that see one another, the RMS norm of queries and keys, a feed-forward of 2 D and no
  # norm before the output are the code's; the paper has a mask per latent (block = 1) and says nothing of the rest.
  def setup(self) -> None:
    if self.predicts not in ("velocity", "eps", "x1", "ddpm"):
      raise ValueError(f"got predicts {self.predicts!r}, expected velocity, eps, x1 or ddpm")
    xavier: dict[str, Any] = dict(kernel_init=nn.initializers.xavier_uniform(), dtype=self.dtype)
    normal: dict[str, Any] = dict(kernel_init=nn.initializers.normal(0.02), dtype=self.dtype)
    self.x_in, self.text_in = (Dense(self.width, (None, "embed"), **xavier) for _ in range(2))
    self.time_in = Dense(self.width, (None, "mlp"), **normal)
    self.time_out = Dense(self.width, ("mlp", "embed"), **normal)
    block = nn.remat(Block, methods=["step"]) if self.remat else Block
    self.blocks = [block(self.width, self.num_heads, self.ff_width, self.dtype, self.attention, name=f"block{i}")
                   for i in range(self.depth)]
    self.out = Dense(self.latent_dim, ("embed", None), kernel_init=nn.initializers.zeros, dtype=self.dtype)
    if self.time_left:  # zero at first: a network that is trained further begins as it was
      self.time_left_rows = self.param("time_left_rows", nn.initializers.zeros, (1 + TIME_LEFT_ROWS, self.width))
    if self.control:
      self.control_in = Dense(2 * self.width, (None, "mlp"), **xavier)
      self.control_out = Dense(self.depth * ADAPTER_RANK, ("mlp", None), **xavier)
      self.adapters = [ControlAdapter(self.width, self.dtype, name=f"adapter{i}") for i in range(self.depth)]

  def level(self, t: Float[Array, "*lead"]) -> Float[Array, "*lead d"]:
    """Time embedding (..., D) of t (...)."""
    t = t if self.time_scale == 1 else t * self.time_scale
    return self.time_out(nn.silu(self.time_in(timestep_embedding(t))))

  def stack_layers(self, params: Any) -> Any:
    """Parameters with those of all layers stacked: leaves (depth, ...) of "blocks" and "adapters".

    The sampler's methods take these; unstacked parameters they stack in every call. `__call__` takes unstacked ones.
    """
    layers = dict(params["params"])
    for kind in ("block", "adapter"):
      rows = [layers.pop(name) for name in (f"{kind}{i}" for i in range(self.depth)) if name in layers]
      if rows:
        layers[f"{kind}s"] = jax.tree.map(
            lambda *leaves: (np if isinstance(leaves[0], np.ndarray) else jnp).stack(leaves), *rows)
    return {"params": layers}

  def _stacked(self, kind: str) -> Any:
    """The stacked parameters of "blocks" or "adapters"."""
    params = self.variables["params"]
    return params[kind] if kind in params else self.stack_layers({"params": params})["params"][kind]

  def _block(self) -> Block:
    return Block(self.width, self.num_heads, self.ff_width, self.dtype, self.attention, parent=None)

  def modulation(self, t: Float[Array, "*lead"]) -> Float[Array, "depth *lead 6 d"]:
    """Shifts, scales and gates of all layers, which depend on t alone: (depth, ..., 6, D)."""
    if not self.use_adaln:
      return jnp.stack(self._modulations(t))
    level, block = self.level(t), self._block()
    of_layer = lambda params: block.apply({"params": params}, level, method="modulation")
    return jax.lax.map(of_layer, self._stacked("blocks"))

  def _modulations(self, t: Float[Array, "*lead"]) -> list[Float[Array, "*lead 6 d"]]:
    level = self.level(t)
    if not self.use_adaln:
      # The identity, with gates of 1: `window` adds the time embedding to the tokens instead.
      plain = jnp.zeros(level.shape[:-1] + (6, self.width), level.dtype).at[..., 2, :].set(1).at[..., 5, :].set(1)
      return [plain] * self.depth
    return [block.modulation(level) for block in self.blocks]

  def text_keys_values(self, text_emb: Float[Array, "b s e"], text_mask: Bool[Array, " b *l"], with_null: bool = False
                       ) -> Text:
    """Keys and values of the words for all layers, from text_emb (B, S, E) and text_mask (B, S).

    with_null adds the constants for latents without a caption: its word features are 0 (docs/papers/cmdm.md#text).
    """
    words = self.text_in(text_emb.astype(self.dtype))
    null_word = self.text_in(jnp.zeros((1, 1, self.text_dim), self.dtype)) if with_null else None
    block = self._block()

    def of_layer(params):
      text: Any = block.apply({"params": params}, words, text_mask, null_word, method="text")
      return text.k, text.v, text.null

    k, v, null = jax.lax.map(of_layer, self._stacked("blocks"))
    return Text(k, v, text_mask, null)

  def control_tokens(self, control: Float[Array, "b l n"]) -> Float[Array, "b l control"]:
    """Embeds the constraints once per motion, for all layers: control (B, L, N) -> (B, L, depth * rank + 1).

    The first number of control, which is copied to the end of the result, is 1 where a latent has a constraint, else 0.
    """
    if control.shape[-1] != self.control:
      raise ValueError(f"got {control.shape[-1]} numbers of control a latent, this network takes {self.control}"
                       + ("" if self.control else ": it was trained without; train one with data.control"))
    hidden = nn.silu(self.control_in(control.astype(self.dtype)))
    return jnp.concatenate([self.control_out(hidden), control[..., :1].astype(self.dtype)], axis=-1)

  def _table(self, positions: Num[Array, "*#b w"]) -> tuple[Array, Array]:
    return rotary_table(positions * self.use_rope, self.width // self.num_heads, self.dtype)

  def turn_keys(self, cache: KeysValues, positions: Num[Array, " p"]) -> KeysValues:
    """Cached (k, v) (depth, B, P, H, K) with the keys rotated to positions (P,), as `window` takes them."""
    k, v = cache
    return turn(k, self._table(positions)), v

  def window(self, x: Float[Array, "b w c"], t: Float[Array, "#b w"],
             modulation: Float[Array, "depth #b #w 6 d"], text: Text,
             attn_mask: Bool[Array, "#b 1 w s"], positions: Num[Array, "*#b w"],
             past: KeysValues | None = None, control: Float[Array, "_ w control"] | None = None,
             left: Int[Array, "#b w"] | None = None) -> tuple[Float[Array, "b w c"], KeysValues]:
    """Velocity of a window of latents and its keys and values: x (B, W, C), modulation (depth, B or 1, W, 6, D).

    text: of text_keys_values. positions (W,) or (B, W). past: (k, v) (depth, B, P, H, K) of the latents before the
    window, keys rotated; attn_mask (B or 1, 1, W, P + W) masks unused ones. control: of control_tokens. left: of
    `__call__`.
    -> (velocity, (k, v)) with the keys and values of x (depth, B, W, H, K), keys not rotated.
    """
    latents, x, attn_mask = x, self._timed(self.x_in(x.astype(self.dtype)), left), self._seen(attn_mask, t)
    if not self.use_adaln:
      x = x + self.level(t)
    block, table, added = self._block(), self._table(positions), None
    if control is not None:
      adapter, has_control = ControlAdapter(self.width, self.dtype, parent=None), control[..., -1:]
      added = self._stacked("adapters"), jnp.stack(jnp.split(control[..., :-1], self.depth, axis=-1))

    def layer(x, row):
      params, modulation, k, v, null, past, added = row
      if added is not None:
        x = adapter.apply({"params": added[0]}, x, added[1], has_control, t)
      return block.apply({"params": params}, x, modulation, Text(k, v, text.mask, null), attn_mask, table, past,
                         method="step")

    rows = self._stacked("blocks"), modulation, text.k, text.v, text.null, past, added
    x, new = jax.lax.scan(layer, x, rows)
    return self._to_velocity(self.out(x), latents, t), new

  def _timed(self, x: Float[Array, "b l d"], left: Int[Array, "#b l"] | None) -> Float[Array, "b l d"]:
    """Tokens with the embedding of the latents that are left, if the network has one; negative or None: unknown.

    Rows of the embedding are spaced evenly in log2(1 + left) and interpolated: the end counts most.
    """
    if not self.time_left:
      return x
    rows = self.time_left_rows.astype(x.dtype)
    if left is None:
      return x + rows[0]
    place = jnp.clip(3 * jnp.log2(1.0 + jnp.maximum(left, 0)), 0, TIME_LEFT_ROWS - 1)
    low = jnp.minimum(place.astype(jnp.int32), TIME_LEFT_ROWS - 2)
    share = (place - low).astype(x.dtype)[..., None]
    known = (1 - share) * rows[1 + low] + share * rows[2 + low]
    return x + jnp.where(left[..., None] < 0, rows[0], known)

  def _seen(self, attn_mask: Bool[Array, "#b 1 l k"], t: Float[Array, "#b l"]) -> Bool[Array, "_ 1 l k"]:
    """What latents at times t attend to, of a mask that knows no times."""
    return two_way_mask(attn_mask, (t > 0) & (t < 1)) if self.two_way else attn_mask

  def _to_velocity(self, y: Float[Array, "b l c"], x: Float[Array, "b l c"], t: Float[Array, "#b l"]
                   ) -> Float[Array, "b l c"]:
    """Converts a prediction at x = t x1 + (1 - t) eps to the velocity x1 - eps.

    The conversion divides by t or 1 - t; divisors are floored at a sampler's step (`PREDICTION_FLOOR`).
    """
    if self.predicts in ("velocity", "ddpm"):
      return y
    x, t = x.astype(y.dtype), t[..., None].astype(y.dtype)
    if self.predicts == "eps":
      return (x - y) / jnp.maximum(t, PREDICTION_FLOOR)
    return (y - x) / jnp.maximum(1 - t, PREDICTION_FLOOR)

  def __call__(self, x: Float[Array, "b l c"], t: Float[Array, "b m"], text_emb: Float[Array, "b s e"],
               attn_mask: AttentionMask, text_mask: Bool[Array, "b *m s"],
               control: Float[Array, "_ l n"] | None = None, left: Int[Array, "#b l"] | None = None
               ) -> Float[Array, "b l c"]:
    """x (B, L, C), t (B, L) or (B, L / n), text_emb (B, S, E), attn_mask (B or 1, 1, L, L), text_mask (B, S)
    or (B, L, S); control (B, L, N) as in `control_tokens`, or (B / 2, L, N), see `ControlAdapter`. left (B, L): how
    many latents its caption has left, each latent included, for a network with time_left; negative or None: unknown."""
    shapes.check(x=(x, "BLC"), t=(t, "BM"), text_emb=(text_emb, "BSE"))
    (batch, length, _), words = x.shape, text_emb.shape[1]
    for name, mask, expected in (("attn_mask", attn_mask, ((batch, 1, length, length), (1, 1, length, length))),
                                 ("text_mask", text_mask, ((batch, words), (batch, length, words)))):
      if mask.shape not in expected:
        raise ValueError(f"got {name} of shape {mask.shape}, expected {expected[0]} or {expected[1]}, for x {x.shape} "
                         f"and text_emb {text_emb.shape}")
    if self.control and self.is_initializing():
      control = jnp.zeros(x.shape[:2] + (self.control,), self.dtype)
    added = None if control is None else self.control_tokens(control)
    if length % t.shape[1]:
      raise ValueError(f"got {t.shape[1]} times for {length} latents, expected one each or one per whole block")
    attn_mask = self._seen(attn_mask, jnp.repeat(t, length // t.shape[1], axis=1))
    if self.scan_layers and not self.is_initializing():
      return self._scanned(x, t, text_emb, attn_mask, text_mask, added, left)
    modulation = self._modulations(t)
    if t.shape[1] != length:
      modulation = [broadcast_to_length(part, length // t.shape[1]) for part in modulation]
      t = jnp.repeat(t, length // t.shape[1], axis=1)
    words, table = self.text_in(text_emb.astype(self.dtype)), self._table(jnp.arange(length))
    control_emb = [] if added is None else jnp.split(added[..., :-1], self.depth, axis=-1)
    latents, x = x, self._timed(self.x_in(x.astype(self.dtype)), left)
    if not self.use_adaln:
      x = x + self.level(t)
    for i, block in enumerate(self.blocks):
      x = x if added is None else self.adapters[i](x, control_emb[i], added[..., -1:], t)
      x, _ = block.step(x, modulation[i], block.text(words, text_mask), attn_mask, table)
    return self._to_velocity(self.out(x), latents, t)

  def _scanned(self, x: Float[Array, "b l c"], t: Float[Array, "b m"], text_emb: Float[Array, "b s e"],
               attn_mask: AttentionMask, text_mask: Bool[Array, "b *m s"],
               control: Float[Array, "_ l control"] | None, left: Int[Array, "#b l"] | None) -> Float[Array, "b l c"]:
    """`__call__` by one scan over the layers, whose parameters it stacks; files and optimizers have them apart."""
    level, words = self.level(t), self.text_in(text_emb.astype(self.dtype))
    plain = None if self.use_adaln else self._modulations(t)[0]
    count, table = x.shape[1] // t.shape[1], self._table(jnp.arange(x.shape[1]))
    t = jnp.repeat(t, count, axis=1)

    def layer(block, x):
      modulation = broadcast_to_length(block.modulation(level) if plain is None else plain, count)
      return block.step(x, modulation, block.text(words, text_mask), attn_mask, table)[0], None

    latents, x = x, self._timed(self.x_in(x.astype(self.dtype)), left)
    if not self.use_adaln:
      x = x + self.level(t)
    stack = lambda modules: jax.tree.map(lambda *leaves: jnp.stack(leaves), *(module.variables for module in modules))
    block, stacked = self.blocks[0].clone(parent=None), stack(self.blocks)
    if control is None:
      x, _ = jax.lax.scan(lambda x, params: block.apply(params, x, method=layer), x, stacked)
      return self._to_velocity(self.out(x), latents, t)
    adapter, has_control = self.adapters[0].clone(parent=None), control[..., -1:]

    def step(x, row):
      block_params, adapter_params, control_emb = row
      return block.apply(block_params, adapter.apply(adapter_params, x, control_emb, has_control, t), method=layer)

    control_emb = jnp.stack(jnp.split(control[..., :-1], self.depth, axis=-1))
    x, _ = jax.lax.scan(step, x, (stacked, stack(self.adapters), control_emb))
    return self._to_velocity(self.out(x), latents, t)
