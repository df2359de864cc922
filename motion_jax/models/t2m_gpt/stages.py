"""Training stage of T2M-GPT, as a pure function: the transformer on codes of the VQ-VAE (`shared.autoencoders`)."""
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.models.shared.autoencoders import item_keys
from motion_jax.models.t2m_gpt.losses import corrupt, draw_step, gpt_loss
from motion_jax.nets.token_gpt import CodeGPT
from motion_jax.training.stage import Stage, mixed_precision
from motion_jax.utils.config_files import module_fields


def init_gpt(net: CodeGPT, rng: jax.Array) -> Any:
  """Random parameters."""
  return net.init(rng, jnp.zeros((1, 1), int), jnp.zeros((1, net.text_dim)))


def gpt_shapes(net: CodeGPT) -> Any:
  """Shapes of the parameters, to check a file against."""
  return jax.eval_shape(lambda: init_gpt(net, jax.random.key(0)))


def gpt_stage(config: ConfigDict) -> Stage:
  """Trains the transformer: codes (B, M) with the end and padding, num_codes (B,) without the end, text_emb (B, 1, E),
  index (B,) place in the whole batch."""
  net = mixed_precision(CodeGPT(**module_fields(config.model)), config)

  def init(batch, rng):
    return init_gpt(net, rng)

  def loss(params, frozen, batch, step, rng):
    draw_rng, item_rng, dropout_rng = jax.random.split(rng, 3)
    target = batch["codes"]
    draws = draw_step(draw_rng, item_keys(item_rng, batch), target.shape[1] - 1, net.num_codes)
    return gpt_loss(net, params, target, batch["num_codes"], batch["text_emb"][:, 0],
                    corrupt(target, draws, config.loss.keep_rate), (dropout_rng, batch["index"]))

  def predict(params, frozen, batch, rng):
    """Sums of the loss and accuracy from true codes, and their weight."""
    target = batch["codes"]
    sums, weight = gpt_loss(net, params, target, batch["num_codes"], batch["text_emb"][:, 0], target[:, :-1])
    return sums | {"weight": weight}

  return Stage(init, loss, predict, in_parts=True,
               about_loss="cross-entropy of the next code, ln of the number of codes at the start")
