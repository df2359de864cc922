"""Every row of the papers' ablation tables has a config that trains."""
import runpy

import pytest

from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.cmdm.setup import not_sampled
from motion_jax.models.tmr.space import make_teacher
from tests.conftest import ROOT, load_config, some_of, traced_loss_shape

pytestmark = pytest.mark.usefixtures("kept_features")
CMDM = runpy.run_path(str(ROOT / "configs" / "ablations" / "cmdm.py"))
CDAMD = runpy.run_path(str(ROOT / "configs" / "ablations" / "cdamd.py"))
# Rows that differ in sampling alone are the default to train.
TRAINED = [(row, stage) for row, (_, changes) in CMDM["ROWS"].items() for stage, change in changes.items()
           if not change or not all(path.startswith("sampler.") for path in change)]

TRAINED_CDAMD = [(row, "generator") for row, (_, _, changes) in CDAMD["ROWS"].items()
                 if (not all(path.startswith("sampler.") for path in changes) or row == "mardm")
                 and row != "no-dcca"]  # which is "cm" again
TRAINED_CDAMD += [("263", "autoencoder"), ("263", "rvq"), ("67", "autoencoder"), ("67", "rvq")]


# {"row-stage": (the paper's configs, row, stage)}
BOTH = {"-".join(pair): (paper, *pair) for paper, pairs in ((CMDM, TRAINED), (CDAMD, TRAINED_CDAMD)) for pair in pairs}
TRACED = ("one-level-denoiser", "vae-tokenizer", "teacher-tmr-teacher", "text-clip-sentence-denoiser", "67-generator",
          "mardm-generator")


@pytest.mark.parametrize("name", some_of(BOTH, slow=TRACED))
def test_the_loss_of_a_row_is_one_number(name):
  paper, row, stage = BOTH[name]
  assert traced_loss_shape(paper["get_config"](f"{row}/{stage}/tiny")) == ()


def test_cdamds_rows_change_what_they_name():
  loss = lambda row: CDAMD["get_config"](row).loss
  assert [loss(row).prior_levels for row in ("one-vq", "default", "all-vq", "no-prior")] == [1, 2, 4, 0]
  assert [loss(row).mask for row in ("default", "cm", "bcm", "mardm")] == ["dccm", "causal", "bcm", "bidirectional"]
  masks = lambda row: (loss(row).mask, CDAMD["get_config"](row).sampler.mask)
  assert {row: masks(row) for row in ("one-vq", "dccm-inference", "bcm", "bcm-inference", "cm")} == {
      "one-vq": ("dccm", "causal"), "dccm-inference": ("dccm", "dccm"), "bcm": ("bcm", "causal"),
      "bcm-inference": ("bcm", "bcm"), "cm": ("causal", "causal")}
  row, named = CDAMD["get_config"]("mardm/generator/full"), load_config("cdamd_generator", "mardm")
  assert all(row[part] == named[part] for part in ("sampler", "loss", "optimizer", "model", "paper_row"))
  # a share of its steps; docs/papers/cdamd.md#mardm
  assert CDAMD["get_config"]("mardm/generator/small").optimizer.boundaries == (pytest.approx(50 / 180),)


@pytest.mark.parametrize("row", CDAMD["ROWS"])
def test_cdamds_rows_share_the_parts_of_their_representation(row):
  for size in ("full", "small", "mini"):
    config = CDAMD["get_config"](f"{row}/generator/{size}")
    columns = config.tokenizer.features
    home = {66: "default", 263: "263", 67: "67"}[columns]
    assert config.frozen.tokenizer == f"runs/ablations/{home}/autoencoder"
    assert config.frozen.prior == (f"runs/ablations/{home}/rvq" if config.loss.prior_levels else "")
    for stage in ("autoencoder", "rvq"):
      part = CDAMD["get_config"](f"{home}/{stage}/{size}")
      assert (part.model.features, part.data.layout) == (columns, config.data.layout)


@pytest.mark.parametrize("row", CMDM["ROWS"])
def test_rows_at_full_and_small_size_say_where_their_parts_are(row):
  for size in ("full", "small", "mini"):
    config = CMDM["get_config"](f"{row}/denoiser/{size}")
    _, changes = CMDM["ROWS"][row]
    assert config.frozen.tokenizer == f"runs/ablations/{row if 'tokenizer' in changes else 'default'}/tokenizer"
    assert config.model.latent_dim == config.tokenizer.latent_dim


def test_teachers_of_table_9_are_the_published_ones():
  """Each row's teacher has its own base, its tokenizer looks for it, and a tiny tokenizer has one of that kind."""
  for row, kind, layout in (("teacher-tmr", "tmr", "full"),
                            ("teacher-motion-patches", "motion_patches", "coordinates")):
    for size in ("full", "small", "mini"):
      teacher, tokenizer = (CMDM["get_config"](f"{row}/{stage}/{size}") for stage in ("teacher", "tokenizer"))
      assert (teacher.model.kind, teacher.data.layout) == (kind, layout)
      assert tokenizer.frozen.teacher == f"runs/ablations/{row}/teacher"
      assert make_teacher(teacher.model, layout).dim == tokenizer.model.teacher_dim
    tiny = CMDM["get_config"](f"{row}/tokenizer/tiny")
    assert tiny.teacher.kind == kind and tiny.frozen.teacher == "random-init"


def test_one_level_for_all_is_sampled_as_it_is_trained():
  """Without a choice at the command line: all frames at once, each with the same level."""
  config = CMDM["get_config"]("one-level/denoiser/tiny")
  assert (config.loss.level_block, config.sampler.schedule) == (0, "full")
  chosen = lambda config, **choices: CmdmSampling(**choices).resolved(config, context=48).about()
  assert (chosen(config)["schedule"], chosen(config)["lag"]) == ("full", 0)
  assert (chosen(config, schedule="fss")["schedule"], chosen(config, schedule="fss")["lag"]) == ("fss", 2)
  assert chosen(load_config("cmdm_denoiser", "tiny"))["lag"] == 2


@pytest.mark.parametrize("row, words", [
    ("vae", ["looks both ways"]), ("one-level", ["cleans all latents together"]), ("default", []),
    ("paper-ddpm", ["'ancestral': way=chain"])])
def test_what_a_row_cannot_do_is_said_before_training(row, words):
  notes = not_sampled(CMDM["get_config"](f"{row}/denoiser/tiny"))
  assert len(notes) == len(words) and all(word in note for word, note in zip(words, notes))


def test_mistakes_are_told():
  for paper, name, told in (
      (CDAMD, "bcn", "expected one of default"), (CDAMD, "bcm/vae", "autoencoder, rvq, generator"),
      (CDAMD, "bcm/rvq/big", "full, small, .*mini, tiny"), (CMDM, "vea", "expected one of default"),
      (CMDM, "vae/vae", "teacher, tokenizer, denoiser"), (CMDM, "vae/tokenizer/big", "laptop, mini or tiny")):
    with pytest.raises(ValueError, match=told):
      paper["get_config"](name)
