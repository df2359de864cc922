"""Shipped models without their networks, for tests of words: loading one takes seconds, its captions do not."""
import json
from types import SimpleNamespace

from motion_jax import runs
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.shared.captions import TrainingCaptions
from motion_jax.motion.representations import get_layout
from motion_jax.text.captions import SUBJECTS
from motion_jax.text.encoder import load_text_encoder


class Captioned(TextToMotionModel):
  """The training captions and the text encoder of a shipped model."""
  abilities = ("sample_segments",)
  stats = SimpleNamespace(layout=get_layout("full"))

  def __init__(self, name):
    run = runs.load_run(name)
    with open(run.folder / "captions.json", encoding="utf-8") as file:
      rows = json.load(file)
    self.folder, self.config, self.encoder = run.folder, run.config, load_text_encoder(run.text)
    self.captions = TrainingCaptions(*zip(*rows), self.encoder, subjects=SUBJECTS)
