"""MotionStreamer's released weights as run folders (docs/papers/motionstreamer.md#files)."""
import pathlib
from typing import Any

import ml_collections
import numpy as np

from motion_jax.convert.parts import Network, check_free, encoder_of, heads_of, network, read_part, stats_of, write
from motion_jax.latents import VaeCodec
from motion_jax.models.motionstreamer.stages import END, generator_shapes, make_generator, tokenizer_shapes
from motion_jax.models.motionstreamer.weight_names import autoencoder_names, generator_names
from motion_jax.models.shared.captioned_batches import NO_CAPTION
from motion_jax.motion.representations import layout_for
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.training import checkpoint
from motion_jax.training.setup import text_identity

TEXT = "sentence-t5-xxl"
HEADS = {768: 12}
# The released latent that ends a motion of HumanML3D (docs/papers/motionstreamer.md#latents).
RELEASED_END = np.array([
    -.03545712, -.11705846, -.05517992, .00844862, .04809663, .00272764, .18799046, -.02028011, .01018141, .03007844,
    -.03314216, -.03098543, .02590478, .00261714, .01297793, -.10481539], np.float32)


def autoencoder(path: str | pathlib.Path) -> Network:
  """The causal autoencoder, "net" of net_last.pth."""
  what, part = "causal autoencoder", read_part(path, ("net",))
  width, features, _ = part.shape("tae.encoder.model.0.conv.weight", what, 3)
  halvings = part.count(r"tae\.encoder\.model\.(\d+)\.0\.conv\.weight")
  depth = part.count(r"tae\.encoder\.model\.2\.1\.model\.(\d+)\.conv1\.weight")
  fields = dict(features=features, latent_dim=part.shape("tae.decode_proj.weight", what, 2)[1], width=width,
                num_halvings=halvings, dilations=tuple(3 ** b for b in reversed(range(depth))))
  vae = CausalVAE(**fields)
  return network(what, part, vae, fields, tokenizer_shapes(vae), autoencoder_names(halvings, depth))


def generator(path: str | pathlib.Path, num_heads: int | None = None) -> Network:
  """Transformer and head, "trans" of latest.pth. Fields are a model section."""
  what, part = "MotionStreamer generator", read_part(path, ("trans",))
  width, latent_dim = part.shape("transformer.wte.weight", what, 2)
  depth = part.count(r"transformer\.h\.(\d+)\.")
  scale = float(np.asarray(part.state.get("transformer.h.0.attn.scale", 0.0)))
  # The attention's scale is log2(places^2 - places); a file has no other trace of their number.
  places = round((1 + (1 + 4 * 2 ** scale) ** 0.5) / 2)
  fields = dict(
      transformer=dict(latent_dim=latent_dim, width=width, depth=depth,
                       num_heads=heads_of(num_heads, width, HEADS.get(width)),
                       text_dim=part.shape("transformer.cond_embed.weight", what, 2)[1], max_length=places,
                       mlp_width=part.shape("transformer.h.0.mlp.c_fc1.weight", what, 2)[0]),
      head=dict(width=part.shape("diff_loss.net.input_proj.weight", what, 2)[0],
                depth=part.count(r"diff_loss\.net\.res_blocks\.(\d+)\.")))
  net = make_generator(ml_collections.ConfigDict(fields))
  return network(what, part, net, fields, generator_shapes(net), generator_names(depth, fields["head"]["depth"]))


def write_motionstreamer(out: str | pathlib.Path, autoencoder_file: str | pathlib.Path,
                         generator_file: str | pathlib.Path, stats: Any, text: str, num_heads: int | None = None
                         ) -> list[Network]:
  """The run folder of a released MotionStreamer -> the Networks.

  stats: a folder with the mean and std of the training data, Mean.npy and Std.npy. text: folder of the text encoder,
  sentence-T5-XXL, which is needed: the run keeps the vector of an empty caption.
  """
  check_free(out)
  vae, network = autoencoder(autoencoder_file), generator(generator_file, num_heads)
  sizes = network.fields["transformer"]
  if sizes["latent_dim"] != vae.fields["latent_dim"]:
    raise ValueError(f"the generator makes latents of {sizes['latent_dim']} numbers, those of the autoencoder have "
                     f"{vae.fields['latent_dim']}; they are of different trainings")
  encoder = encoder_of(text, sizes["text_dim"], "generator", TEXT)
  codec, layout = VaeCodec(vae.module, vae.params).unscaled(), layout_for(vae.fields["features"])
  nothing = np.zeros((1, codec.frames_per_latent, vae.fields["features"]), np.float32)
  end = RELEASED_END if sizes["latent_dim"] == len(RELEASED_END) else np.asarray(codec.encode(nothing))[0, 0]
  config = dict(stage="motionstreamer.generator", model=network.fields, tokenizer=vae.fields,
                frozen=dict(text=str(text), text_level="sentence", tokenizer=checkpoint.FROZEN),
                diffusion=dict(num_steps=50),
                loss=dict(drop_rate=0.1, copies=4, crop_rate=1 / 3, mean_latents=False, unit_latents=False,
                          replace_ramp=0),
                data=dict(layout=layout.name, mode="benchmark", max_frames=300, max_words=64),
                sampler=dict(guidance_scale=4.0, num_steps=50))
  frozen = codec.parts | {END: end, NO_CAPTION: np.asarray(encoder.no_caption())}
  write(out, config, [vae, network], network.params, stats_of(stats, vae.fields["features"]), frozen,
        {checkpoint.TEXT: text_identity(encoder)})
  return [vae, network]
