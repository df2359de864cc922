"""Numbers stand beside the paper's of their own representation, model and sampling, and notes say what is off."""
import types

import pytest

from motion_jax.evaluation import notes, printed, protocols, tables
from motion_jax.evaluation.evaluator import fresh_evaluator
from tests.conftest import load_config


def subject(stage, options=None, **changes):
  config = load_config({"cmdm": "cmdm_denoiser", "tokenizer": "cmdm_tokenizer"}.get(stage, "cdamd_generator"),
                       stage if stage.startswith("mardm") else "full").unlock()
  for path, value in changes.items():
    section, field = path.split("__")
    config[section][field] = value
  return types.SimpleNamespace(model=types.SimpleNamespace(config=config), options=options or {})


@pytest.mark.parametrize("key, one, part, row", [
    (("cmdm", "1"), subject("cmdm"), "", "CMDM w/ FSS"),
    (("cmdm", "1"), subject("cmdm", dict(schedule="ar")), "", "CMDM w/ AR"),
    (("cmdm", "1"), subject("cmdm", dict(schedule="full")), "", None),
    (("cmdm", "3-humanml3d"), subject("cmdm"), "", "CMDM"),
    (("cmdm", "1"), subject("cdamd"), "", None),
    (("cdamd", "1"), subject("cdamd"), "", "CDAMD (two VQ)"),
    (("cdamd", "1"), subject("cdamd", loss__prior_levels=1), "", "CDAMD (first VQ)"),
    (("cdamd", "1"), subject("cdamd", loss__prior_levels=3), "", None),
    (("cdamd", "1"), subject("mardm"), "", "MARDM-SiT-XL"),
    (("cdamd", "1"), subject("mardm_ddpm"), "", None),
    (("cdamd", "1"), subject("cmdm"), "", None),
    (("cdamd", "3"), subject("cdamd"), "suffix", "suffix: CDAMD"),
    (("cdamd", "3"), subject("mardm"), "suffix", "suffix: MARDM"),
    (("cmdm", "6"), subject("mardm"), "", "MARDM-SiT"),
    (("cmdm", "8"), subject("tokenizer"), "", "MAC-VAE 64, 1/4"),
    (("cmdm", "8"), subject("tokenizer", model__teacher_dim=0, model__causal=False), "", "VAE 64, 1/4"),
    (("cmdm", "8"), subject("tokenizer", model__latent_dim=16, model__num_halvings=3), "", "MAC-VAE 16, 1/8"),
    (("cmdm", "8"), subject("cmdm"), "", None),
])
def test_a_row_goes_with_its_like(key, one, part, row):
  assert printed.printed_row(tables.paper_table(*key), one, part) == row


def test_only_an_evaluator_of_the_papers_representation_compares():
  paper = lambda name, layout, rows: printed.paper_of(
      protocols.get_protocol(name), fresh_evaluator("t2m", layout), rows)
  assert paper("kit", "coordinates_kit", {})["table"] == "2" and paper("kit", "full_kit", {}) is None
  assert paper("editing", "full", {}) is None and paper("long-horizon", "coordinates", {}) is None
  found = paper("cdamd-66", "coordinates", {"a": (subject("mardm"), ""), "b": (subject("cmdm"), "")})
  assert found["row"] == {"a": "MARDM-SiT-XL"} and found["also"] == ["CDAMD (two VQ)"]


def test_what_has_to_be_said():
  number = lambda *values: dict(mean=1.0, interval=0.1, values=list(values))
  result = dict(metrics=["fid", "multimodality"], notes=["of our own"], rows={
      "real": {"fid": number(1, 2, 3)}, "a": {"fid": number(1, 2, 3), "multimodality": number(1), "x": number(1, 2)}},
      sanity=dict(fid_halves=0.25, failures=["it fails"], warnings=["it is odd"]), controls=dict(failures=["up"]),
      record=dict(code={"commit": "new"}, data=dict(excluded_clips=[[f"c{i}", "NaN"] for i in range(5)],
                                                    shared_with_train=["s1"]),
                  models=[dict(row="a", sampled_by=[{"code": {"commit": "old"}}]),
                          dict(row="b", sampled_by=[{"code": {"commit": "new"}}])]))
  assert notes.of(result, tables.label) == [
      "Ours: mean ± 95 % interval of 3 repeats (MModality: 1): over draws of captions, cuts and noise, not over other "
      "test clips.",
      "of our own.",
      "FID of real is of other cuts of the same clips; two halves of the real motions that share no clip are 0.250 "
      "apart.",
      "Does not look right: it fails.", "Mind: it is odd.", "Control failed: up.",
      "5 clips left out (c0: NaN; c1: NaN; c2: NaN; ..).",
      "1 clips of the split are in train, too (s1): numbers are too good.",
      "Motions of a were made by code old, judged by new."]
