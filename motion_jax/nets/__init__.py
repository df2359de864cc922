"""Networks as linen modules: arrays in, arrays out; no losses, no schedules."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.nets.attention import Attention, RMSNorm, dot_product_attention, rotary
  from motion_jax.nets.autoencoder import Autoencoder, ConvStack
  from motion_jax.nets.causal_dit import CausalDiT, ControlAdapter
  from motion_jax.nets.causal_vae import CausalVAE, sample_latent
  from motion_jax.nets.convs import CausalConv
  from motion_jax.nets.diffusion_mlp import DiffusionMLP, Generator
  from motion_jax.nets.gru import GRU
  from motion_jax.nets.latent_diffusion import TokenDenoiser, TokenVAE
  from motion_jax.nets.latent_llama import LatentGenerator, LatentLlama, LlamaBlock
  from motion_jax.nets.layers import Dense, Dropout, broadcast_to_length, layer_norm, promote_to_f32, timestep_embedding
  from motion_jax.nets.length_estimator import LengthEstimator
  from motion_jax.nets.masked_transformer import GatedTransformer, MaskedTransformer
  from motion_jax.nets.masks import (
    block_causal_mask,
    dual_causal_mask,
    known_or_past_mask,
    latent_mask,
    padding_mask,
    sliding_mask,
    two_way_mask,
    with_text,
  )
  from motion_jax.nets.motion_denoiser import MotionDenoiser
  from motion_jax.nets.motion_patches import MotionPatches
  from motion_jax.nets.part_tmr import PartTMR
  from motion_jax.nets.post_norm import PostNormDecoderLayer, PostNormLayer, sinusoid_table, sinusoids
  from motion_jax.nets.skip_transformer import SkipTransformer
  from motion_jax.nets.tmr import TMR
  from motion_jax.nets.token_gpt import CodeGPT
  from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
  from motion_jax.nets.vit import ViT

__all__ = ["Attention", "Autoencoder", "CausalConv", "CausalDiT", "CausalVAE", "CodeGPT", "ControlAdapter",
           "ConvStack", "Dense", "DiffusionMLP", "Dropout", "GRU", "GatedTransformer", "Generator", "LatentGenerator",
           "LatentLlama", "LengthEstimator", "LlamaBlock", "MaskedCodeTransformer", "MaskedTransformer",
           "MotionDenoiser", "MotionPatches", "PartTMR", "PostNormDecoderLayer", "PostNormLayer", "RMSNorm",
           "ResidualCodeTransformer", "SkipTransformer", "TMR", "TokenDenoiser", "TokenVAE", "ViT",
           "block_causal_mask", "broadcast_to_length", "dot_product_attention", "dual_causal_mask",
           "known_or_past_mask", "latent_mask", "layer_norm", "padding_mask", "promote_to_f32", "rotary",
           "sample_latent", "sinusoid_table", "sinusoids", "sliding_mask", "timestep_embedding",
           "two_way_mask", "with_text"]

__getattr__, __dir__ = lazy.attach(__name__)
