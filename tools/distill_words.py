"""Trains the small text encoder that ships, `motion_jax/pretrained/words`, from all-MiniLM-L6-v2.

  python tools/distill_words.py --teacher DIR --captions archive/captions.jsonl ... --out motion_jax/pretrained/words
  ... --start motion_jax/pretrained/words --out FOLDER    goes on from an encoder and keeps its features where it can,
                                                          so that a model trained on them adapts fast
  python tools/distill_words.py --report FOLDER --before motion_jax/pretrained/words --captions ... [--teacher DIR]

DIR is a Hugging Face folder (config.json, model.safetensors, tokenizer.json) of a BERT with mean pooling. One CPU core
takes about 20 minutes. The student is a DistilBERT-shaped network of a few MB. It learns, per sentence, the teacher's
sentence vector and how a batch's sentences resemble each other; per word piece, the teacher's hidden state and the
piece's own identity; for the phrases of tools/movement_sentences.py, to lie near its synonyms and away from all other
movements, since the teacher has left and right nearly on one spot; and, in pairs of sentences that differ in one word
(tools/contrast_sentences.py), to part slowly from quickly, twice from three times, with from without.
"""
import argparse
import functools
import json
import pathlib
import random
import re
import time

import contrast_sentences
import jax
import jax.numpy as jnp
import measure_words
import movement_sentences
import numpy as np
import optax
import tqdm
from safetensors.numpy import load_file, save_file
from tokenizers import Tokenizer
from word_losses import loss_fn, unit

from motion_jax.text import bert
from motion_jax.text.encoder import load_text_encoder
from motion_jax.utils.atomic import atomic_path

FIELDS = dict(width=128, num_layers=3, num_heads=4, mlp_width=512, max_positions=64)
SPECIAL = ("[PAD]", "[UNK]", "[CLS]", "[SEP]")
BUCKETS = (12, 20, 40)
NUM_PAIRS, PAIR_PIECES = 24, 24  # hard negatives and synonyms of a step, and the most word pieces of one
LOOSE = 0.1  # weight by which a word that a contrast has to move is held where it was
SWEEP = ("{w}", "{w}", "a person {w}.", "someone {w} {v}", "a {w} person", "{w} {v}", "a person with a {w}",
         "a person is {w}", "someone moves {w}")
FUNCTION_WORDS = set(
    "a an the of on in with to at by for from into and or as is are be their his her its it he she they them this that "
    "one s ' someone something oneself while then".split())


def pad(encodings, length):
  ids = np.zeros((len(encodings), length), np.int32)
  for row, encoding in zip(ids, encodings):
    row[:len(encoding)] = encoding[:length]
  return ids, np.arange(length) < np.array([min(len(e), length) for e in encodings])[:, None]


class Teacher:
  """Sentence vectors and last hidden states of the big encoder."""

  def __init__(self, folder):
    folder = pathlib.Path(folder)
    self.fields = bert.bert_fields(json.loads((folder / "config.json").read_text()))
    self.params = bert.params_from_reference(load_file(folder / "model.safetensors"), self.fields)
    self.tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    self.tokenizer.no_padding()
    model = bert.Bert(**self.fields)
    self._apply = jax.jit(lambda params, ids, mask: model.apply({"params": params}, ids, mask))

  def __call__(self, sentences, batch=64, progress=False):
    """-> sentence vectors (N, 384), list of N hidden states (S_i, 384) float16."""
    encodings = [e.ids for e in self.tokenizer.encode_batch(sentences)]
    order = np.argsort([len(e) for e in encodings], kind="stable")
    vectors, hidden = np.zeros((len(sentences), self.fields["width"]), np.float32), [None] * len(sentences)
    for start in tqdm.trange(0, len(order), batch, disable=not progress, desc="teacher"):
      rows = order[start:start + batch]
      length = -(-max(len(encodings[i]) for i in rows) // 4) * 4
      ids, mask = pad([encodings[i] for i in rows] + [[0]] * (batch - len(rows)), length)
      states = self._apply(self.params, ids, mask)
      vectors[rows] = np.asarray(bert.mean_sentence(states, jnp.asarray(mask)))[:len(rows)]
      for i, state in zip(rows, np.asarray(states)):
        hidden[i] = state[:len(encodings[i])].astype(np.float16)
    return vectors, hidden


def student_vocabulary(teacher, sentences, size):
  """The pieces that matter, teacher order: special, letters, those of the sentences, then the most ordinary ones."""
  pieces = sorted(teacher.tokenizer.get_vocab().items(), key=lambda item: item[1])
  keep = {piece for piece, _ in pieces if re.fullmatch(r"(##)?[a-z0-9]|[!-/:-@\[-`{-~]", piece)}
  for encoding in teacher.tokenizer.encode_batch(sentences):
    keep.update(encoding.tokens)
  for piece, _ in pieces:  # the vocabulary is sorted by how ordinary a piece is
    if len(keep) >= size:
      break
    if re.fullmatch(r"(##)?[a-z]+", piece):
      keep.add(piece)
  ordered = [piece for piece, _ in pieces if piece in keep and piece not in SPECIAL and not piece.startswith("[")]
  return list(SPECIAL) + ordered


def student_tokenizer(folder, vocabulary):
  """The teacher's tokenizer over fewer pieces."""
  data = json.loads((pathlib.Path(folder) / "tokenizer.json").read_text())
  ids = {piece: i for i, piece in enumerate(vocabulary)}
  data["model"]["vocab"] = ids
  data["truncation"] = data["padding"] = None
  data["added_tokens"] = [{**token, "id": ids[token["content"]]} for token in data["added_tokens"]
                          if token["content"] in SPECIAL]
  for name, token in data["post_processor"]["special_tokens"].items():
    token["ids"] = [ids[name]]
  return Tokenizer.from_str(json.dumps(data))


def sweep_sentences(vocabulary, others, rng):
  """Short phrases around every ordinary word, so that words outside the grammar keep the teacher's meaning too."""
  held_out = movement_sentences.is_held_out
  words = [w for w in vocabulary if re.fullmatch(r"[a-z]{3,}", w) and not held_out(w)]
  found = dict.fromkeys(words)
  for word in words + [w for w in others if not held_out(w)]:
    found[rng.choice(SWEEP).format(w=word, v=rng.choice(words))] = None
  return list(found)


def concept_labels(grammar, tokenizer, sentence, names):
  """Concept index of each piece, -1 for none."""
  encoding = tokenizer.encode(sentence)
  labels = np.full(len(encoding.ids), -1, np.int32)
  for start, end, concept in grammar.spans(sentence):
    for i, (a, b) in enumerate(encoding.offsets):
      if a < b and a >= start and b <= end and sentence[a:b] not in FUNCTION_WORDS:
        labels[i] = names[concept]
  return labels


class Corpus:
  """Sentences with the teacher's targets, drawn in batches of one length bucket."""

  def __init__(self, groups, teacher, tokenizer, grammar, vocabulary, pairs, loose=()):
    """pairs: a `Pairs`; loose: words that need not stay where they were."""
    self.sentences = [s for _, sentences in groups for s in sentences]
    share = np.concatenate([np.full(len(sentences), weight / len(sentences)) for weight, sentences in groups])
    self.vectors, hidden = teacher(self.sentences, progress=True)
    flat = np.concatenate([h[1:-1] for h in hidden]).astype(np.float32)
    self.mean = flat.mean(0)
    encodings = tokenizer.encode_batch(self.sentences)
    self.ids = [e.ids for e in encodings]
    theirs = teacher.tokenizer.encode_batch(self.sentences)
    self.aligned = np.array([a.tokens == b.tokens for a, b in zip(encodings, theirs)])
    self.hidden = hidden
    self.pairs, self.held = pairs, [held_weights(tokenizer, s, loose) for s in self.sentences]
    names = {name: i for i, name in enumerate(grammar.concepts)}
    self.labels = [concept_labels(grammar, tokenizer, s, names) for s in self.sentences]
    table = teacher.params["words"]["embedding"]
    table = table - table.mean(0)
    lookup = teacher.tokenizer.get_vocab()
    self.static = table[[lookup[piece] for piece in vocabulary]]  # (V, 384)
    lengths = np.array([len(i) for i in self.ids])
    self.buckets = []
    for low, high in zip((0, *BUCKETS), BUCKETS):
      rows = np.flatnonzero((lengths > low) & (lengths <= high))
      self.buckets.append((high, rows, share[rows] / share[rows].sum(), share[rows].sum()))

  def batch(self, rng, size):
    length, rows, share, _ = self.buckets[rng.choice(len(self.buckets), p=np.array([b[3] for b in self.buckets])
                                                     / sum(b[3] for b in self.buckets))]
    size = size * BUCKETS[0] // length if length > BUCKETS[1] else size
    chosen = rng.choice(rows, size, p=share)
    ids, mask = pad([self.ids[i] for i in chosen], length)
    hidden, label = np.zeros((size, length, self.vectors.shape[1]), np.float32), np.full((size, length), -1, np.int32)
    held = np.zeros((size, length), np.float32)
    for row, i in enumerate(chosen):
      if self.aligned[i]:
        hidden[row, :len(self.ids[i])] = self.hidden[i].astype(np.float32) - self.mean
      label[row, :len(self.ids[i])] = self.labels[i]
      held[row, :len(self.ids[i])] = self.held[i]
    return dict(ids=ids, mask=mask, hidden=hidden, label=label, aligned=self.aligned[chosen], held=held,
                vector=self.vectors[chosen], static=self.static[ids], pairs=self.pairs.batch(rng))


class Pairs:
  """Sentences two by two (`contrast_sentences.pairs`) as word pieces, those of the words that count marked."""

  def __init__(self, pairs, tokenizer, loose=()):
    found = []
    for _, *both, alike in pairs:
      encodings = [tokenizer.encode(marked.text) for marked in both]
      if max(len(encoding.ids) for encoding in encodings) <= PAIR_PIECES:
        found.append((both, encodings, alike))
    rows = [(marked, encoding) for both, encodings, _ in found for marked, encoding in zip(both, encodings)]
    self.ids, self.mask = pad([encoding.ids for _, encoding in rows], PAIR_PIECES)
    self.slot, self.held = (np.zeros(self.ids.shape, kind) for kind in (bool, np.float32))
    for row, (marked, encoding) in enumerate(rows):
      self.slot[row, :len(encoding.ids)] = [any(start <= a < b <= end for start, end in marked.spans)
                                            for a, b in encoding.offsets]
      self.held[row, :len(encoding.ids)] = held_weights(tokenizer, marked.text, loose)
    self.words = [[marked.text[a:b].lower() for a, b in marked.spans] for marked, _ in rows]
    self.alike = np.array([alike for *_, alike in found])

  def batch(self, rng, size=NUM_PAIRS):
    chosen = rng.choice(len(self.alike), size, replace=False)
    rows = np.stack([2 * chosen, 2 * chosen + 1], -1).ravel()
    return dict(ids=self.ids[rows], mask=self.mask[rows], slot=self.slot[rows], held=self.held[rows],
                alike=self.alike[chosen])

  def too_near(self, model, params, limit=0.3, share=0.2):
    """The words of pairs that mean different things whose features lie too near each other in too many of them."""
    hidden = jax.jit(model.apply)({"params": params}, self.ids, self.mask)
    slot = self.slot[..., None]
    words = np.asarray(unit((hidden * slot).sum(1) / slot.sum(1)))
    near, counts = (words[::2] * words[1::2]).sum(-1), {}
    for pair in np.flatnonzero(~self.alike):
      for word in {*self.words[2 * pair], *self.words[2 * pair + 1]}:
        counts.setdefault(word, []).append(near[pair] > limit)
    return {word for word, found in counts.items() if np.mean(found) > share}


def held_weights(tokenizer, sentence, loose):
  """How firmly each piece of a sentence is held where it was: 1, LOOSE in words that have to move."""
  encoding = tokenizer.encode(sentence)
  weights = np.ones(len(encoding.ids), np.float32)
  spans = [m.span() for m in re.finditer(r"[\w-]+", sentence) if m[0].lower() in loose]
  for i, (a, b) in enumerate(encoding.offsets):
    if any(start <= a < b <= end for start, end in spans):
      weights[i] = LOOSE
  return weights


def initial_params(rng, fields, corpus, num_concepts):
  model = bert.Bert(**fields)
  init_rng, word_rng, identity_rng, prototype_rng = jax.random.split(rng, 4)
  params = dict(bert=model.init(init_rng, jnp.zeros((1, 4), jnp.int32), jnp.ones((1, 4), bool))["params"])
  # The teacher's word vectors, on their principal axes: a start that already knows most synonyms.
  basis = np.linalg.svd(corpus.static, full_matrices=False)[2][:fields["width"]]
  params["bert"]["words"]["embedding"] = jnp.asarray(corpus.static @ basis.T)
  normal = lambda key, shape: jax.random.normal(key, shape) / np.sqrt(fields["width"])
  width, wide = fields["width"], corpus.vectors.shape[1]
  return params | dict(sentence=jnp.asarray(basis, jnp.float32), identity=normal(identity_rng, (width, wide)),
                       word=normal(word_rng, (width, wide)), prototypes=normal(prototype_rng, (num_concepts, width)))


def params_of(folder, corpus, num_concepts):
  """Params of the encoder in a folder; the heads, which no folder keeps, are those that fit its features best."""
  encoder = load_text_encoder(folder)
  sentences = np.random.default_rng(0).permutation(np.flatnonzero(corpus.aligned))[:4000]
  ours = [encoder._feature(corpus.sentences[i]) for i in sentences]
  features = np.concatenate(ours)
  fitted = lambda targets: jnp.asarray(np.linalg.lstsq(features, np.concatenate(targets), rcond=None)[0])
  labels = np.concatenate([corpus.labels[i] for i in sentences])
  width = features.shape[1]
  prototypes = np.random.default_rng(1).standard_normal((num_concepts, width)).astype(np.float32) / np.sqrt(width)
  for concept in set(labels) - {-1}:
    prototypes[concept] = np.asarray(unit(features[labels == concept])).mean(0)
  return dict(bert=encoder.params, sentence=jnp.asarray(encoder._sentence.projection.T),
              word=fitted([corpus.hidden[i].astype(np.float32) - corpus.mean for i in sentences]),
              identity=fitted([corpus.static[corpus.ids[i]] for i in sentences]), prototypes=jnp.asarray(prototypes))


def train(corpus, fields, num_concepts, steps, batch_size, seed, learning_rate=2e-3, params=None):
  """params: to go on from, and to stay near of; fresh ones without."""
  model, start = bert.Bert(**fields), params and jax.tree.map(jnp.copy, params["bert"])
  params = params or initial_params(jax.random.key(seed), fields, corpus, num_concepts)
  schedule = optax.warmup_cosine_decay_schedule(0.0, learning_rate, max(1, min(300, steps // 10)), steps, 0.0)
  tx = optax.chain(optax.clip_by_global_norm(1.0), optax.adamw(schedule, b2=0.98, weight_decay=0.01))
  opt_state = tx.init(params)

  @functools.partial(jax.jit, donate_argnums=(0, 1))
  def step_fn(params, opt_state, batch):
    grads, losses = jax.grad(loss_fn, has_aux=True)(params, batch, model, start)
    updates, opt_state = tx.update(grads, opt_state, params)
    return optax.apply_updates(params, updates), opt_state, losses

  rng = np.random.default_rng(seed)
  bar = tqdm.trange(steps, desc="student", mininterval=20, miniters=1)
  for step in bar:
    params, opt_state, losses = step_fn(params, opt_state, corpus.batch(rng, batch_size))
    if step % 200 == 0:
      bar.set_postfix_str(" ".join(f"{name} {float(value):.3f}" for name, value in losses.items()))
  return params


def save(out, params, fields, tokenizer, known, corpus_size):
  """Writes a Hugging Face folder of model_type distilbert with a sentence projection, float16."""
  state = bert.params_to_reference(params["bert"], fields)
  state["sentence_projection.weight"] = np.asarray(params["sentence"]).T
  state = {name: np.ascontiguousarray(array, np.float16) for name, array in state.items()}
  config = dict(model_type="distilbert", vocab_size=fields["vocab_size"], dim=fields["width"],
                n_layers=fields["num_layers"], n_heads=fields["num_heads"], hidden_dim=fields["mlp_width"],
                max_position_embeddings=fields["max_positions"], activation="gelu",
                sentence_dim=int(state["sentence_projection.weight"].shape[0]), trained_on=f"{corpus_size} sentences")
  out = pathlib.Path(out)
  with atomic_path(out / "model.safetensors") as path:
    save_file(state, path)
  for name, text in (("config.json", json.dumps(config, indent=2) + "\n"), ("tokenizer.json", tokenizer.to_str()),
                     ("known_words.txt", "\n".join(known) + "\n")):
    with atomic_path(out / name) as path:
      path.write_text(text, encoding="utf-8")


def read_captions(files):
  found = {}
  for file in files:
    for line in pathlib.Path(file).read_text(encoding="utf-8").splitlines():
      found.update(dict.fromkeys(json.loads(line)["text"]))
  return list(found)


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("--teacher", help="needed for training; a report says without it what asks for no teacher")
  parser.add_argument("--captions", nargs="*", default=[], help="captions.jsonl files with a list of texts a line")
  parser.add_argument("--more-captions", nargs="*", default=[], help="further files, none of which is held out")
  parser.add_argument("--out")
  parser.add_argument("--start", help="an encoder to go on from, with its word pieces")
  parser.add_argument("--report", metavar="FOLDER", help="measure this encoder and train nothing")
  parser.add_argument("--before", metavar="FOLDER", help="the encoder that a report compares with")
  parser.add_argument("--steps", type=int, help="5,500, or 1,500 from a start")
  parser.add_argument("--learning-rate", type=float, help="0.002, or 0.0005 from a start")
  parser.add_argument("--batch-size", type=int, default=96)
  parser.add_argument("--num-sentences", type=int, default=14_000, help="drawn from the grammar")
  parser.add_argument("--vocabulary", type=int, default=6500)
  parser.add_argument("--seed", type=int, default=0)
  args = parser.parse_args()
  if not args.report and not (args.teacher and args.out):
    parser.error("training needs --teacher and --out; to measure an encoder give --report")
  start, rng = time.time(), random.Random(args.seed)

  teacher, grammar = args.teacher and Teacher(args.teacher), movement_sentences.Grammar()
  captions = read_captions(args.captions)
  unseen = set(rng.sample(captions, len(captions) // 20))  # measured on, never trained on
  captions = [c for c in dict.fromkeys(captions + read_captions(args.more_captions)) if c not in unseen]
  drawn = grammar.sentences(args.num_sentences + 300, args.seed)
  events = contrast_sentences.event_sentences(6200, args.seed)
  composed = contrast_sentences.composed(6200, args.seed)
  sets = {"captions": sorted(unseen), "grammar": drawn[-300:],
          "new shapes and words": movement_sentences.unseen_sentences(),
          "captions by kinematics": events[-200:], "several actions": composed[-200:]}
  if args.report:
    measure_words.report(args.report, args.before, teacher, sets, captions)
    return
  drawn, events, composed = drawn[:-300], events[:-200], composed[:-200]
  movement = captions + drawn + grammar.minimal() + events + composed
  if args.start:
    tokenizer = load_text_encoder(args.start).tokenizer
    vocabulary = [piece for piece, _ in sorted(tokenizer.get_vocab().items(), key=lambda item: item[1])]
  else:
    vocabulary = student_vocabulary(teacher, movement, args.vocabulary)
    tokenizer = student_tokenizer(args.teacher, vocabulary)
  rarer = sorted((i, w) for w, i in teacher.tokenizer.get_vocab().items()
                 if re.fullmatch(r"[a-z]{4,}", w) and w not in set(vocabulary))
  sweep = sweep_sentences(vocabulary, [w for _, w in rarer[:3000]], rng)
  fields = FIELDS | dict(vocab_size=len(vocabulary))
  drawn_pairs, loose = contrast_sentences.pairs(20_000, args.seed), set()
  if args.start:
    loose = Pairs(drawn_pairs[:3000], tokenizer).too_near(bert.Bert(**fields), load_text_encoder(args.start).params)
    print(f"too near each other: {', '.join(sorted(loose))}")
  print(f"{len(captions)} captions, {len(drawn)} drawn, {len(grammar.minimal())} plain, {len(events)} by kinematics, "
        f"{len(composed)} of several actions, {len(sweep)} of the word sweep; {len(vocabulary)} word pieces, "
        f"{len(grammar.concepts)} concepts", flush=True)
  corpus = Corpus([(0.2, captions), (0.2, drawn), (0.1, grammar.minimal()), (0.15, events), (0.1, composed),
                   (0.25, sweep)] if captions else
                  [(0.35, drawn), (0.15, grammar.minimal()), (0.15, events), (0.1, composed), (0.25, sweep)],
                  teacher, tokenizer, grammar, vocabulary, Pairs(drawn_pairs, tokenizer, loose), loose)
  print(f"teacher done after {time.time() - start:.0f} s, {corpus.aligned.mean():.3f} of sentences cut alike",
        flush=True)
  params = args.start and params_of(args.start, corpus, len(grammar.concepts))
  params = train(corpus, fields, len(grammar.concepts), args.steps or (1500 if args.start else 5500), args.batch_size,
                 args.seed, args.learning_rate or (5e-4 if args.start else 2e-3), params)
  known = {w for s in movement for w in re.findall(r"[a-z]+", s.lower())}
  if args.start:
    known |= load_text_encoder(args.start).known_words
  save(args.out, params, fields, tokenizer, sorted(known), len(corpus.sentences))
  print(f"wrote {args.out} after {(time.time() - start) / 60:.1f} minutes")
  measure_words.report(args.out, args.before or args.start, teacher, sets, captions)


if __name__ == "__main__":
  main()
