"""Provenance: what was evaluated, by which evaluators, with which draws and code, so that anyone can repeat a number.
"""
import dataclasses
import hashlib
import importlib.metadata
import pathlib
import platform

import jax

from motion_jax.training.code_version import commit

_PACKAGES = ("jax", "jaxlib", "flax", "numpy", "scipy", "safetensors", "tokenizers")


def describe(harness, folders, candidates, replications, devices) -> dict:
  """The JSON object "provenance" of results.json; it does not depend on when or how fast an evaluation ran."""
  protocol, test_set = harness.protocol, harness.test_set
  words = sorted({caption for captions in test_set.captions for caption in captions})
  timelines = protocol.timelines and hashlib.sha256(pathlib.Path(protocol.timelines).read_bytes()).hexdigest()
  return dict(
      protocol=dataclasses.asdict(protocol) | {"replications": replications, "timelines": timelines},
      evaluators=[_evaluator(evaluator) for evaluator in dict.fromkeys((harness.evaluator, harness.clip_evaluator))
                  if evaluator],
      data=dict(folders=[pathlib.Path(folder).name for folder in folders], format=test_set.format, split=protocol.split,
                split_hash=test_set.hash, items=len(test_set), samples=harness.count, shared_with_train=test_set.shared,
                excluded=len(test_set.excluded), excluded_clips=[list(pair) for pair in test_set.excluded]),
      models=[dict(row=candidate.name, **candidate.about, **_against_training(candidate.model, words),
                   sampled_by=candidate.sampled_by) for candidate in candidates],
      question=question(harness, candidates), seed=harness.seed, replications=replications, limit=harness.limit,
      precision=_precision(), device=_device(devices), versions=_versions(), code=commit())


def question(harness, candidates) -> dict:
  """The identity of an evaluation, apart from the number of replications: results of another one must not be
  overwritten.
  """
  return dict(protocol=harness.protocol.name, seed=harness.seed, limit=harness.limit, split=harness.test_set.hash,
              sizes=[harness.protocol.sequences, harness.protocol.segments],
              evaluators=[evaluator.hash for evaluator in (harness.evaluator, harness.clip_evaluator) if evaluator],
              models=[[candidate.name, candidate.about["hash"], candidate.about["guidance_scale"],
                       candidate.about["sampling"]]
                      for candidate in candidates])


def maker(devices) -> dict:
  """Code and device that generate motions, stored with the samples."""
  return dict(code=commit(), jax=importlib.metadata.version("jax"), device=devices[0].device_kind if devices else None)


def _evaluator(evaluator):
  return dict(name=pathlib.Path(evaluator.name).name, kind=evaluator.kind, hash=evaluator.hash, words=evaluator.words(),
              statistics=evaluator.stats.fingerprint, layout=evaluator.layout.name, mode=evaluator.mode,
              dim=evaluator.dim)


def _against_training(model, captions):
  """Words of the test captions that a model did not see in training, and how many of these captions it did see, with
  any subject; nothing for a model without text."""
  if not model.can("generate"):
    return dict(unknown_words=[], captions_seen=None)
  known = model.captions
  return dict(unknown_words=sorted({word for caption in captions for word in known.unknown_words(caption)}),
              captions_seen=[sum(map(known.knows, captions)), len(captions)])


def _precision():
  return dict(arrays="float64" if jax.config.jax_enable_x64 else "float32",
              matmul=str(jax.config.jax_default_matmul_precision or "default"), scores="float64")


def _device(devices):
  return dict(backend=jax.default_backend(), kind=devices[0].device_kind, count=len(devices),
              machine=platform.machine())


def _versions():
  versions = {"python": platform.python_version()}
  for name in (*_PACKAGES, "motion-jax"):
    try:
      versions[name] = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
      versions[name] = "a checkout that is not installed"
  return versions
