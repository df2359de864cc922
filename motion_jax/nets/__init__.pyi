from .attention import Attention, RMSNorm, dot_product_attention, rotary
from .autoencoder import Autoencoder, ConvStack
from .causal_dit import CausalDiT, ControlAdapter
from .causal_vae import CausalVAE, sample_latent
from .convs import CausalConv
from .diffusion_mlp import DiffusionMLP, Generator
from .gru import GRU
from .latent_diffusion import TokenDenoiser, TokenVAE
from .latent_llama import LatentGenerator, LatentLlama, LlamaBlock
from .layers import Dense, Dropout, broadcast_to_length, layer_norm, promote_to_f32, timestep_embedding
from .length_estimator import LengthEstimator
from .masked_transformer import GatedTransformer, MaskedTransformer
from .masks import (
  block_causal_mask,
  dual_causal_mask,
  known_or_past_mask,
  latent_mask,
  padding_mask,
  sliding_mask,
  two_way_mask,
  with_text,
)
from .motion_denoiser import MotionDenoiser
from .motion_patches import MotionPatches
from .part_tmr import PartTMR
from .post_norm import PostNormDecoderLayer, PostNormLayer, sinusoid_table, sinusoids
from .skip_transformer import SkipTransformer
from .tmr import TMR
from .token_gpt import CodeGPT
from .token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from .vit import ViT

__all__ = ["Attention", "Autoencoder", "CausalConv", "CausalDiT", "CausalVAE", "CodeGPT", "ControlAdapter",
           "ConvStack", "Dense", "DiffusionMLP", "Dropout", "GRU", "GatedTransformer", "Generator", "LatentGenerator",
           "LatentLlama", "LengthEstimator", "LlamaBlock", "MaskedCodeTransformer", "MaskedTransformer",
           "MotionDenoiser", "MotionPatches", "PartTMR", "PostNormDecoderLayer", "PostNormLayer", "RMSNorm",
           "ResidualCodeTransformer", "SkipTransformer", "TMR", "TokenDenoiser", "TokenVAE", "ViT",
           "block_causal_mask", "broadcast_to_length", "dot_product_attention", "dual_causal_mask",
           "known_or_past_mask", "latent_mask", "layer_norm", "padding_mask", "promote_to_f32", "rotary",
           "sample_latent", "sinusoid_table", "sinusoids", "sliding_mask", "timestep_embedding",
           "two_way_mask", "with_text"]
