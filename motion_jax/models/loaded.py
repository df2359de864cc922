"""A run folder as a loaded model: parameters, statistics, identity, licence and training captions."""
import functools
import hashlib
from typing import TYPE_CHECKING, Any

import jax

from motion_jax.models.abilities import Able, cannot, missing_ability
from motion_jax.utils.errors import InputError

if TYPE_CHECKING:
  from motion_jax.models.shared.captions import TrainingCaptions
  from motion_jax.motion.stats import Stats
  from motion_jax.runs import Run
  from motion_jax.text.encoder import TextEncoder


class LoadedRun(Able):
  """A run folder whose parameters are on the device, with the text encoder that it was trained on."""

  def __init__(self, run: "Run", encoder: "TextEncoder", text_dim: int, frames_per_latent: int, frozen_shapes: Any,
               shapes: Any) -> None:
    """text_dim: width of the text embeddings that the network takes; shapes: of the parameters in the folder."""
    self.folder, self.config, self.encoder, self.frames_per_latent = run.folder, run.config, encoder, frames_per_latent
    self.params_file = run.params_file
    if encoder.dim != text_dim:
      raise InputError(f"the text encoder gives {encoder.dim} numbers a {encoder.level.removesuffix('s')}, the model "
                       f"in {run.folder} was trained on {text_dim}; pass the encoder named {run.config.frozen.text!r} "
                       "as text")
    run.check_encoder(encoder)
    self.stats: Stats = run.stats
    # In one call, which compiles nothing: jnp.asarray is a small program for every shape.
    self.frozen = jax.device_put(run.frozen(frozen_shapes) if frozen_shapes else {})
    self.params = jax.device_put(run.params(shapes))

  if not TYPE_CHECKING:
    def __getattr__(self, name):
      """For names that do not exist: the error says which model has the ability of that name."""
      if ability := missing_ability(self, name):
        raise AttributeError(cannot(self.folder.name, ability))
      return object.__getattribute__(self, name)  # also raises again the error of a property

  def __repr__(self) -> str:
    return (f"{type(self).__name__}({self.folder.name!r}: {self.num_params / 1e6:.1f} M parameters, "
            f"{self.stats.layout.name} features, {self.fps:g} frames a second)")

  # --- identity -------------------------------------------------------------------------------------------------

  @property
  def fps(self) -> float:
    return self.stats.layout.skeleton.fps

  @property
  def smoothing(self) -> float:
    """How much the cleanup smooths its motions, in frames: config.cleanup.smoothing, of `motion.cleanup` by default."""
    from motion_jax.motion.cleanup import SMOOTHING
    return float(self.config.get("cleanup", {}).get("smoothing", SMOOTHING))

  @property
  def num_params(self) -> int:
    """Parameters of all networks that every sampled motion passes through, without the text encoder and a length
    estimator."""
    from motion_jax.latents import SAMPLED
    return sum(x.size for x in jax.tree.leaves((self.params, [self.frozen.get(name, {}) for name in SAMPLED])))

  @functools.cached_property
  def id(self) -> str:
    """Folder name and a hash of the weights, which files of its motions carry as their source."""
    digest = hashlib.sha256((self.folder / self.params_file).read_bytes()).hexdigest()[:12]
    return f"{self.folder.name}@{digest}"

  @property
  def license(self) -> str:
    """Text of its folder's LICENSE.txt; "" without one."""
    return self._text("LICENSE.txt")

  @property
  def limits(self) -> str:
    """Known limits, from its folder's LIMITS.txt; "" without one."""
    return self._text("LIMITS.txt")

  def _text(self, name):
    path = self.folder / name
    return path.read_text(encoding="utf-8", errors="replace").strip() if path.is_file() else ""

  @functools.cached_property
  def captions(self) -> "TrainingCaptions":
    """Statistics of the captions that it was trained on; empty where its folder does not keep them."""
    from motion_jax.models.shared.captions import TrainingCaptions
    from motion_jax.text.captions import SUBJECTS
    subjects = SUBJECTS if self.config.data.get("vary_subject") else ()  # training had these, too
    return TrainingCaptions.of_folder(self.folder, self.encoder, self.fps, subjects)

