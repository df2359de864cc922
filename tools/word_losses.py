"""Losses by which the small text encoder learns its teacher's features, and keeps contrasts apart."""
import jax
import jax.numpy as jnp

from motion_jax.text import bert

WEIGHTS = dict(sentence=1.0, similarity=5.0, ranking=0.2, word=0.5, identity=0.25, concept=0.15,
               contrast=1.0, anchor=1.5)
APART, TOGETHER, SENTENCE_APART = 0.1, 0.75, 0.8  # cosines that hard negatives come to lie under, synonyms over


def unit(x):
  return x / jnp.maximum(jnp.linalg.norm(x, axis=-1, keepdims=True), 1e-6)


def loss_fn(params, batch, model, start=None):
  """Weighted sum of the losses named in the module docstring, and each of them. start: what training began with."""
  mask, aligned, pairs = batch["mask"], batch["aligned"], batch["pairs"]
  hidden = model.apply({"params": params["bert"]}, batch["ids"], mask)
  sentence, target = _sentence(params, hidden, mask), batch["vector"]
  ours, theirs = sentence @ sentence.T, target @ target.T
  off = 1 - jnp.eye(len(ours))
  logits = lambda s: jax.nn.log_softmax(jnp.where(off > 0, s / 0.07, -1e9), axis=-1)
  real = mask & aligned[:, None]
  average = lambda value: (value * real).sum() / jnp.maximum(real.sum(), 1)
  word = 1 - (unit(hidden @ params["word"]) * unit(batch["hidden"])).sum(-1)
  identity = 1 - (unit(hidden @ params["identity"]) * unit(batch["static"])).sum(-1)
  scores = unit(hidden) @ unit(params["prototypes"]).T / 0.1
  label = batch["label"]
  cross = -jnp.take_along_axis(jax.nn.log_softmax(scores), jnp.maximum(label, 0)[..., None], -1)[..., 0]
  pair_hidden = model.apply({"params": params["bert"]}, pairs["ids"], pairs["mask"])
  losses = dict(
      sentence=(1 - (sentence * target).sum(-1)).mean(),
      similarity=((ours - theirs) ** 2 * off).sum() / off.sum(),
      ranking=(off * jnp.exp(logits(theirs)) * (logits(theirs) - logits(ours))).sum(-1).mean(),
      word=average(word), identity=average(identity),
      concept=(cross * (label >= 0)).sum() / jnp.maximum((label >= 0).sum(), 1),
      contrast=_contrast(params, pair_hidden, pairs))
  if start is not None:
    losses["anchor"] = (_moved(model, start, batch, hidden) + _moved(model, start, pairs, pair_hidden)) / 2
  return sum(WEIGHTS[name] * value for name, value in losses.items()), losses


def _sentence(params, hidden, mask):
  return unit(bert.mean_words(hidden, mask) @ params["sentence"])


def _contrast(params, hidden, pairs):
  """How far pairs, rows 2i and 2i + 1, are from lying apart or together, by their words and as sentences."""
  slot = pairs["slot"][..., None]
  words = unit((hidden * slot).sum(1) / slot.sum(1))
  near = (words[::2] * words[1::2]).sum(-1)
  sentences = _sentence(params, hidden, pairs["mask"])
  as_sentences = (sentences[::2] * sentences[1::2]).sum(-1)
  apart = jax.nn.relu(near - APART) + 0.5 * jax.nn.relu(as_sentences - SENTENCE_APART)
  return jnp.where(pairs["alike"], 0.5 * jax.nn.relu(TOGETHER - near), apart).mean()


def _moved(model, start, batch, hidden):
  """Mean squared distance of word features from those of the start, in shares of their squared length."""
  before = model.apply({"params": start}, batch["ids"], batch["mask"])
  weight = batch["held"] * batch["mask"]
  return (((hidden - before) ** 2).sum(-1) / (before ** 2).sum(-1) * weight).sum() / weight.sum()
