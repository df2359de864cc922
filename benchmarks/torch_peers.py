"""The networks and losses of `benchmarks/train_step.py` in PyTorch, written plainly, and a step of theirs."""

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn


class Conv(nn.Module):
  """Causal convolution over (B, C, T)."""

  def __init__(self, features, out, kernel, stride=1, dilation=1):
    super().__init__()
    self.conv = nn.Conv1d(features, out, kernel, stride, dilation=dilation)
    self.context = (kernel - 1) * dilation + 1 - stride

  def forward(self, x):
    return self.conv(F.pad(x, (self.context, 0)))


class ResBlock(nn.Module):

  def __init__(self, width, dilation):
    super().__init__()
    self.conv, self.pointwise = Conv(width, width, 3, dilation=dilation), nn.Conv1d(width, width, 1)

  def forward(self, x):
    return x + self.pointwise(F.relu(self.conv(F.relu(x))))


class Vae(nn.Module):
  """The tokenizer; gaussian: its latents are drawn."""

  def __init__(self, features, latent_dim, width, num_halvings, dilations, gaussian=True):
    super().__init__()
    self.gaussian = gaussian
    encoder = [Conv(features, width, 3), nn.ReLU()]
    for _ in range(num_halvings):
      encoder += [Conv(width, width, 4, 2), *(ResBlock(width, dilation) for dilation in dilations)]
    encoder += [Conv(width, width, 3)] + ([nn.Conv1d(width, 2 * latent_dim, 1)] if gaussian else [])
    decoder = [nn.Conv1d(latent_dim, width, 1)] if gaussian else []
    decoder += [Conv(width, width, 3), nn.ReLU()]
    for _ in range(num_halvings):
      decoder += [*(ResBlock(width, dilation) for dilation in dilations), nn.Upsample(scale_factor=2),
                  Conv(width, width, 3)]
    decoder += [Conv(width, width, 3), nn.ReLU(), Conv(width, features, 3)]
    self.encoder, self.decoder = nn.Sequential(*encoder), nn.Sequential(*decoder)

  def encode(self, x):
    y = self.encoder(x.transpose(1, 2)).transpose(1, 2)
    return y.chunk(2, -1) if self.gaussian else (y, None)

  def forward(self, x, noise):
    mean, logvar = self.encode(x)
    logvar = logvar.clamp(-30, 20)
    z = mean + torch.exp(logvar / 2) * noise
    return self.decoder(z.transpose(1, 2)).transpose(1, 2), mean, logvar


def time_numbers(t, count=256):
  angles = t[..., None] * 10_000.0 ** (-torch.arange(count // 2) / (count // 2))
  return torch.cat([angles.cos(), angles.sin()], -1)


class Attention(nn.Module):
  """Queries and keys are normalized, where `normalize` says so, and turned by their positions."""

  def __init__(self, width, heads, normalize=True, dropout=0.0):
    super().__init__()
    self.heads, self.dropout = heads, dropout
    self.q, self.k, self.v, self.out = (nn.Linear(width, width) for _ in range(4))
    self.q_norm = nn.RMSNorm(width // heads, eps=1e-6) if normalize else nn.Identity()
    self.k_norm = nn.RMSNorm(width // heads, eps=1e-6) if normalize else nn.Identity()

  def forward(self, x, words, mask, turn=None):
    split = lambda y: y.unflatten(-1, (self.heads, -1)).transpose(1, 2)
    q, k, v = self.q_norm(split(self.q(x))), self.k_norm(split(self.k(words))), split(self.v(words))
    if turn is not None:
      q, k = turn(q), turn(k)
    y = F.scaled_dot_product_attention(q, k, v, mask, self.dropout if self.training else 0.0)
    return self.out(y.transpose(1, 2).flatten(2))


def rotary(length, size):
  angles = torch.arange(length)[:, None] * 10_000.0 ** (-torch.arange(size // 2) / (size // 2))
  cos, sin = angles.cos(), angles.sin()

  def turn(x):
    even, odd = x[..., 0::2], x[..., 1::2]
    return torch.stack([even * cos - odd * sin, even * sin + odd * cos], -1).flatten(-2)

  return turn


class DitBlock(nn.Module):

  def __init__(self, width, heads, ff_width):
    super().__init__()
    self.film = nn.Linear(width, 6 * width)
    self.norm1, self.norm3 = (nn.LayerNorm(width, eps=1e-6, elementwise_affine=False) for _ in range(2))
    self.norm2 = nn.LayerNorm(width, eps=1e-6)
    self.self_attn, self.cross_attn = Attention(width, heads), Attention(width, heads)
    self.ff_in, self.ff_out = nn.Linear(width, ff_width), nn.Linear(ff_width, width)

  def forward(self, x, level, words, mask, word_mask, turn, block):
    film = self.film(F.silu(level)).repeat_interleave(block, 1)
    shift1, scale1, gate1, shift2, scale2, gate2 = film.chunk(6, -1)
    y = self.norm1(x) * (1 + scale1) + shift1
    x = x + gate1 * self.self_attn(y, y, mask, turn)
    x = x + self.cross_attn(self.norm2(x), words, word_mask)
    y = self.norm3(x) * (1 + scale2) + shift2
    return x + gate2 * self.ff_out(F.gelu(self.ff_in(y), approximate="tanh"))


class Dit(nn.Module):

  def __init__(self, latent_dim, width, depth, num_heads, ff_width, text_dim, block):
    super().__init__()
    self.block, self.head_size = block, width // num_heads
    self.x_in, self.text_in = nn.Linear(latent_dim, width), nn.Linear(text_dim, width)
    self.time_in, self.time_out = nn.Linear(256, width), nn.Linear(width, width)
    self.blocks = nn.ModuleList(DitBlock(width, num_heads, ff_width) for _ in range(depth))
    self.out = nn.Linear(width, latent_dim)

  def forward(self, x, t, text_emb, mask, word_mask):
    level = self.time_out(F.silu(self.time_in(time_numbers(t[:, ::self.block]))))
    words, turn, x = self.text_in(text_emb), rotary(x.shape[1], self.head_size), self.x_in(x)
    for block in self.blocks:
      x = block(x, level, words, mask, word_mask, turn, self.block)
    return self.out(x)


def torch_denoiser(config, batch):
  fields = ("latent_dim", "width", "depth", "num_heads", "ff_width", "block", "text_dim")
  dit = Dit(**{name: config.model[name] for name in fields})
  block, length = config.model.block, batch["distribution"].shape[1]
  given = {name: torch.from_numpy(np.asarray(array)) for name, array in batch.items()}
  real = torch.arange(length) < (given["num_frames"] // 4)[:, None]
  groups = torch.arange(length) // block
  mask = (groups[:, None] >= groups)[None, None] & real[:, None, None]
  word_mask = given["text_mask"][:, None, None]

  def loss():
    mean, logvar = given["distribution"].chunk(2, -1)
    z1 = torch.where(real[..., None], mean + torch.exp(logvar / 2) * torch.randn_like(mean), 0.0)
    t = torch.rand(len(z1), length // block).repeat_interleave(block, 1)
    noise = torch.randn_like(z1)
    text_emb = torch.where(torch.rand(len(z1))[:, None, None] < 0.1, 0.0, given["text_emb"])
    x = t[..., None] * z1 + (1 - t[..., None]) * noise
    error = ((dit(x, t, text_emb, mask, word_mask) - (z1 - noise)) ** 2).mean(-1)
    return torch.where(real, error, 0.0).sum() / real.sum()

  return dit, loss


def torch_tokenizer(config, batch):
  vae = Vae(**{name: config.model[name] for name in ("features", "latent_dim", "width", "num_halvings", "dilations")})
  x = torch.from_numpy(batch["features"])
  size = min(config.loss.micro_batch, len(x))

  def nll(y, x):
    square = (y - x) ** 2
    log_sigma = -6 + F.softplus(torch.log(square.mean().sqrt().clamp(min=1e-8)) + 6)
    return square.sum() / (2 * torch.exp(2 * log_sigma)) + square.numel() * (log_sigma + 0.9189385)

  def loss():
    total = 0.0
    for part in x.split(size):
      y, mean, logvar = vae(part, torch.randn(len(part), part.shape[1] // 4, config.model.latent_dim))
      kl = -0.5 * (1 + logvar - mean ** 2 - logvar.exp()).sum((1, 2)).mean()
      total = total + nll(y, part) + config.loss.kl_weight * kl + config.loss.root_weight * nll(y[..., :4],
                                                                                               part[..., :4])
    return total / (len(x) // size)

  return vae, loss


class MaskedBlock(nn.Module):

  def __init__(self, width, heads, ff_width, dropout):
    super().__init__()
    self.films = nn.ModuleList(nn.Linear(width, 2 * width) for _ in range(3))
    self.norm = nn.LayerNorm(width, eps=1e-5, elementwise_affine=False)
    self.self_attn, self.cross_attn = (Attention(width, heads, False, dropout) for _ in range(2))
    self.ff_in, self.ff_out, self.drop = nn.Linear(width, ff_width), nn.Linear(ff_width, width), nn.Dropout(dropout)

  def forward(self, x, cond, text, mask, cross_mask):
    def norm(x, i):
      scale, shift = self.films[i](text).chunk(2, -1)
      return self.norm(x) * (1 + scale) + shift

    y = norm(x, 0)
    x = x + self.drop(self.self_attn(y, y, mask))
    x = x + self.drop(self.cross_attn(norm(x, 1), cond, cross_mask))
    return x + self.drop(self.ff_out(self.drop(F.gelu(self.ff_in(norm(x, 2))))))


class HeadBlock(nn.Module):

  def __init__(self, width):
    super().__init__()
    self.film, self.norm = nn.Linear(width, 3 * width), nn.LayerNorm(width, eps=1e-6)
    self.ff_in, self.ff_out = nn.Linear(width, width), nn.Linear(width, width)

  def forward(self, x, y):
    shift, scale, gate = self.film(F.silu(y)).chunk(3, -1)
    return x + gate * self.ff_out(F.silu(self.ff_in(self.norm(x) * (1 + scale) + shift)))


class Generator(nn.Module):

  def __init__(self, transformer, head):
    super().__init__()
    width, channels, wide = transformer.width, transformer.latent_dim, head.width
    self.x_in, self.text_in = nn.Linear(channels, width), nn.Linear(transformer.text_dim, width)
    self.positions = nn.Parameter(torch.randn(1, transformer.max_length, width))
    self.hidden = nn.Parameter(torch.zeros(1, 1, channels))
    self.blocks = nn.ModuleList(MaskedBlock(width, transformer.num_heads, transformer.ff_width, transformer.dropout)
                                for _ in range(transformer.depth))
    self.time_in, self.time_out = nn.Linear(256, wide), nn.Linear(wide, wide)
    self.condition_in, self.row_in = nn.Linear(width, wide), nn.Linear(channels, wide)
    self.head = nn.ModuleList(HeadBlock(wide) for _ in range(head.depth))
    self.film, self.norm = nn.Linear(wide, 2 * wide), nn.LayerNorm(wide, eps=1e-6, elementwise_affine=False)
    self.out = nn.Linear(wide, channels)

  def condition(self, x, text_emb, mask, cross_mask):
    words = self.text_in(text_emb)
    x = self.x_in(x) + self.positions[:, :x.shape[1]]
    for block in self.blocks:
      x = block(x, words, words[:, :1], mask, cross_mask)
    return x

  def predict(self, x, t, condition):
    y = self.time_out(F.silu(self.time_in(time_numbers(t)))) + self.condition_in(condition)
    x = self.row_in(x)
    for block in self.head:
      x = block(x, y)
    scale, shift = self.film(F.silu(y)).chunk(2, -1)
    return self.out(self.norm(x) * (1 + scale) + shift)


def torch_generator(config, batch):
  sizes = {name: config.tokenizer[name] for name in ("features", "latent_dim", "width", "num_halvings", "dilations")}
  encoder = Vae(**(sizes | dict(width=sizes["latent_dim"])), gaussian=False).requires_grad_(False)
  net = Generator(config.model.transformer, config.model.head)
  given = {name: torch.from_numpy(np.asarray(array)) for name, array in batch.items()}
  length, copies = batch["features"].shape[1] // 4, config.loss.copies
  real = torch.arange(length) < (given["num_frames"] // 4)[:, None]

  def loss():
    with torch.no_grad():
      z1 = torch.where(real[..., None], encoder.encode(given["features"])[0], 0.0)
    share = torch.cos(torch.rand(len(z1)) * np.pi / 2)
    masked = (torch.rand(real.shape).argsort(-1) < (length * share).round().clamp(min=1)[:, None]) & real
    x = torch.where(masked[..., None], net.hidden, z1)
    mask = (real & ~masked)[:, None, None] | torch.eye(length, dtype=bool)[None, None]
    condition = net.condition(x, given["text_emb"][:, :1], mask, torch.ones(1, 1, 1, 1, dtype=bool))
    rows, condition = z1[masked].repeat(copies, 1), condition[masked].repeat(copies, 1)  # as the reference takes them
    t, noise = torch.rand(len(rows)), torch.randn_like(rows)
    x = t[:, None] * rows + (1 - t[:, None]) * noise
    return ((net.predict(x, t, condition) - (rows - noise)) ** 2).mean()

  return net, loss


def torch_step(config, network, loss):
  """-> step(), a whole one."""
  optimizer = torch.optim.AdamW(network.parameters(), 1e-4, (config.optimizer.beta1, config.optimizer.beta2),
                                weight_decay=config.optimizer.weight_decay)
  parameters, decay = list(network.parameters()), config.optimizer.ema_decay
  average = [p.detach().clone() for p in parameters] if decay else []

  def step():
    optimizer.zero_grad(set_to_none=True)
    value = loss()
    value.backward()
    norm = nn.utils.clip_grad_norm_(parameters, config.optimizer.clip_norm or float("inf"))
    if torch.isfinite(norm) and (not config.optimizer.skip_loss or value <= config.optimizer.skip_loss):
      optimizer.step()
      if average:
        torch._foreach_lerp_(average, parameters, 1 - decay)
    return value.item()

  return step
