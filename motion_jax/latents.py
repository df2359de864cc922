"""Codecs: trained tokenizers, which encode features to scaled latents and decode them.

A codec is one pytree of a network, which is static, its parameters and the scale of its latents; it can be an argument
of jit, grad and pmap. Latents are scaled, `(z - mean) / std` of the encoder's output z, as generators use them. In
files a codec is `tokenizer`, `latent_mean` and `latent_std` (`parts`).
"""
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self

import flax.struct
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import quant
from motion_jax.nets.causal_vae import sample_latent
from motion_jax.shapes import Array, Bool, Float, Int

TOKENIZER, MEAN, STD = "tokenizer", "latent_mean", "latent_std"  # names of a codec's parts in a file
SAMPLED = TOKENIZER, "residual"  # networks in such a file that every sampled motion passes through


@flax.struct.dataclass
class LatentCodec:
  """A trained tokenizer: features (B, T, F), normalized, <-> latents (B, L, C), T = L * frames_per_latent.

  net: the module, static; params: its variables; mean, std (C,): of unscaled latents; 0 and 1: no scaling.
  """
  net: Any = flax.struct.field(pytree_node=False)
  params: Any
  mean: Any = 0.0
  std: Any = 1.0

  @classmethod
  def of(cls, net: Any, parts: Mapping[str, Any]) -> Self:
    """The codec with these `parts`, which may be among others, as in a generator's file."""
    return cls(net, parts[TOKENIZER], parts[MEAN], parts[STD])

  @property
  def parts(self) -> dict:
    """The arrays that a run folder saves, by their names in the file."""
    return {TOKENIZER: self.params, MEAN: self.mean, STD: self.std}

  @property
  def frames_per_latent(self) -> int:
    return self.net.frames_per_latent

  def unscaled(self) -> Self:
    """The same codec without scaling of latents."""
    shape = (self.net.latent_dim,)
    return dataclasses.replace(self, mean=np.zeros(shape, np.float32), std=np.ones(shape, np.float32))

  def scale(self, z: Float[Array, "*lead c"]) -> Float[Array, "*lead c"]:
    return (z - self.mean) / self.std

  def unscale(self, latents: Float[Array, "*lead c"]) -> Float[Array, "*lead c"]:
    return latents * self.std + self.mean

  def real_frames(self, real_mask: Bool[Array, "b l"]) -> Bool[Array, "b t"]:
    """The mask of frames (B, T) from one of latents (B, L)."""
    return jnp.repeat(real_mask, self.frames_per_latent, axis=1)

  def _clips(self, features: Sequence[np.ndarray], num_clips: int, length: int
             ) -> Iterator[tuple[Float[np.ndarray, "1 {length} f"], int]]:
    """A subset of clips (T, F), padded with zeros to one length -> (clip (1, length, F), its whole latents) each."""
    for i in np.linspace(0, len(features) - 1, min(num_clips, len(features))).astype(int):
      clip = features[i][:length]
      padded = np.zeros((1, length, clip.shape[-1]), np.float32)
      padded[0, :len(clip)] = clip
      yield padded, len(clip) // self.frames_per_latent


@flax.struct.dataclass
class VaeCodec(LatentCodec):
  """Codec of a causal variational autoencoder (`nets.causal_vae`), whose encoder gives a distribution."""

  def _distribution(self, features: Float[Array, "b t f"]) -> tuple[Float[Array, "b l c"], Float[Array, "b l c"]]:
    return self.net.apply(self.params, features, method="encode")

  def distribution(self, features: Float[Array, "b t f"]) -> Float[Array, "b l k"]:
    """Mean and log-variance of the unscaled latents, concatenated (B, L, 2 C)."""
    return jnp.concatenate(self._distribution(features), axis=-1)

  def drawn(self, distribution: Float[Array, "b l k"], keys: jax.Array | None = None) -> Float[Array, "b l c"]:
    """Scaled latents from the result of `distribution`: drawn by keys (B,), one per clip, or without keys the means."""
    mean, logvar = jnp.split(distribution, 2, axis=-1)
    return self.scale(mean if keys is None else self._of(mean, logvar, keys))

  def _draw(self, features: Float[Array, "b t f"], keys: jax.Array) -> Float[Array, "b l c"]:
    return self._of(*self._distribution(features), keys)

  @staticmethod
  def _of(mean, logvar, keys):
    noise = jax.vmap(lambda key: jax.random.normal(key, mean.shape[1:]))(keys)
    return sample_latent(mean, logvar, noise)

  def encode(self, features: Float[Array, "b t f"]) -> Float[Array, "b l c"]:
    """Features to latents, the encoder's means."""
    return self.scale(self._distribution(features)[0])

  def sample(self, features: Float[Array, "b t f"], keys: jax.Array) -> Float[Array, "b l c"]:
    """Features to latents drawn by keys (B,), one per clip."""
    return self.scale(self._draw(features, keys))

  def decode(self, latents: Float[Array, "b l c"]) -> Float[Array, "b t f"]:
    return self.net.apply(self.params, self.unscale(latents), method="decode")

  def init_decode_state(self, batch_size: int) -> Any:
    """The decoder's state before the first latents of a stream."""
    return self.net.apply(self.params, batch_size, method="init_decode_state")

  def decode_step(self, latents: Float[Array, "b l c"], state: Any) -> tuple[Float[Array, "b t f"], Any]:
    """(features, state) of the next latents of a stream; the features are those that `decode` gives for the whole."""
    return self.net.apply(self.params, self.unscale(latents), state, method="decode_step")

  def reconstruct(self, features: Float[Array, "b t f"], keys: jax.Array | None = None) -> Float[Array, "b t f"]:
    """Reconstructs features from the means or, with keys (B,), from latents that are drawn."""
    z = self._distribution(features)[0] if keys is None else self._draw(features, keys)
    return self.net.apply(self.params, z, method="decode")

  def fitted(self, features: Sequence[np.ndarray], num_clips: int = 512, length: int = 192) -> Self:
    """The codec whose sampled latents have mean 0 and variance 1 over some training clips, a list of (T, F)."""
    distribution = jax.jit(self._distribution)
    means, variances = [], []
    for padded, count in self._clips(features, num_clips, length):
      mean, logvar = distribution(padded)
      means.append(np.asarray(mean)[0, :count])
      variances.append(np.exp(np.asarray(logvar)[0, :count]))
    z, variance = np.concatenate(means), np.concatenate(variances)
    # Of the samples, not of the means: a channel that the encoder leaves to the prior is then not blown up to size 1.
    return dataclasses.replace(self, mean=z.mean(0), std=np.sqrt(z.var(0) + variance.mean(0)).astype(np.float32))


@flax.struct.dataclass
class AutoencoderCodec(LatentCodec):
  """Codec of a deterministic, non-causal autoencoder (`nets.autoencoder`), which needs to know where clips end.

  real_mask (B, L): True for latents that are not padding.
  """

  def encode(self, features: Float[Array, "b t f"], real_mask: Bool[Array, "b l"]) -> Float[Array, "b l c"]:
    """Features to latents, zero at padding."""
    z = self.net.apply(self.params, features, real_mask=self.real_frames(real_mask), method="encode")
    return jnp.where(real_mask[..., None], self.scale(z), 0.0)

  def decode(self, latents: Float[Array, "b l c"], real_mask: Bool[Array, "b l"]) -> Float[Array, "b t f"]:
    return self.net.apply(self.params, self.unscale(latents), real_mask=real_mask, method="decode")

  def reconstruct(self, features: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"], real_mask: Bool[Array, "b l"]
                  ) -> Float[Array, "b t f"]:
    """Reconstructs features; frame_mask (B, T): True for frames that are not padding."""
    z = self.net.apply(self.params, features, real_mask=frame_mask, method="encode")
    return self.net.apply(self.params, z, real_mask=real_mask, method="decode")

  def fitted(self, features: Sequence[np.ndarray], num_clips: int = 512, length: int = 192) -> Self:
    """The codec whose latents have mean 0 and variance 1 over some training clips, a list of (T, F)."""
    encode = jax.jit(lambda x, real_mask: self.net.apply(self.params, x, real_mask=real_mask, method="encode"))
    rows = []
    for padded, count in self._clips(features, num_clips, length):
      frame_mask = np.arange(length)[None] < count * self.frames_per_latent
      rows.append(np.asarray(encode(padded, frame_mask))[0, :count])
    z = np.concatenate(rows)
    return dataclasses.replace(self, mean=z.mean(0), std=z.std(0) + 1e-6)


@flax.struct.dataclass
class RvqCodec(LatentCodec):
  """Codec of an RVQ-VAE, whose latents are residually quantized. params: {"params", "codebooks"}."""

  @property
  def _codes(self) -> Float[Array, "q k c"]:
    return self.params["codebooks"]["codes"]

  def encode(self, features: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None
             ) -> tuple[Int[Array, "b l q"], Float[Array, "q b l c"]]:
    """Features, of frame_mask (B, T), to code indices (B, L, Q) and code vectors of each level (Q, B, L, C)."""
    return quant.rvq.encode(self._codes, self.net.apply(self.params, features, real_mask=frame_mask, method="encode"))

  def decode(self, indices: Int[Array, "b l q"], num_levels: int | None = None,
             real_mask: Bool[Array, "b l"] | None = None) -> Float[Array, "b t f"]:
    """Code indices (B, L, Q) to features, from the first num_levels levels only if that is given."""
    vectors = quant.rvq.decode(self._codes, indices, num_levels)
    return self.net.apply(self.params, vectors, real_mask=real_mask, method="decode")

  def reconstruct(self, features: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"] | None = None
                  ) -> Float[Array, "b t f"]:
    """Reconstructs features from their codes."""
    return self.decode(self.encode(features, frame_mask)[0])
