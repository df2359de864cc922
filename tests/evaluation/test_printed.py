"""Numbers stand beside the paper's of their own representation, model and sampling, and notes say what is off."""
import runpy
import types

import pytest

from motion_jax import paper_tables
from motion_jax.evaluation import protocols
from motion_jax.evaluation.report import notes, printed, tables
from motion_jax.evaluation.result import Result
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.training import checkpoint
from tests.conftest import ROOT, load_config

NAMES = {"cmdm": "cmdm_denoiser", "tokenizer": "cmdm_tokenizer", "cdamd": "cdamd_generator", "mardm": "cdamd_generator"}


def candidate(name, options=None, scale=None, **changes):
  """A model of a config such as "cmdm", "cmdm:small" or "ablations/cdamd:cm", changed and sampled by options."""
  file, _, size = name.partition(":")
  config = load_config(NAMES.get(file, file), size or ("mardm" if file == "mardm" else "full")).unlock()
  for path, value in changes.items():
    section, field = path.split("__")
    config[section][field] = value
  return types.SimpleNamespace(model=types.SimpleNamespace(config=config), options=options or {}, guidance_scale=scale)


def reads(layout):
  """An evaluator, as far as it matters here."""
  return types.SimpleNamespace(layout=types.SimpleNamespace(name=layout))


# Sampled otherwise than in print, of another representation or protocol: no row. That every printed row is reached is
# shown below.
@pytest.mark.parametrize("protocol, name, options, rows", [
    ("cmdm-259", "cmdm", {}, ["1 CMDM w/ FSS", "4 CMDM", "8 MAC-VAE 64, 1/4", "9 Part-TMR", "10 M",
                              "11 DistilBERT words"]),
    ("cmdm-259", "cmdm", dict(schedule="ar"), ["1 CMDM w/ AR", "4 w/o FSS"]),
    ("cmdm-259", "cmdm", dict(num_steps=20, lag=5), ["4 FSS K=20, L=5"]),
    ("cmdm-259", "cmdm", dict(num_steps=20, lag=7), []), ("cmdm-259", "cmdm", dict(scale=2.0), []),
    ("cmdm-259", "cmdm", dict(schedule="fss", num_steps=50, lag=2, scale=3.0), ["1 CMDM w/ FSS"]),
    ("cmdm-259", "ablations/cmdm:no-adaln/denoiser", dict(schedule="ar"), []),
    ("cmdm-259", "ablations/cmdm:ar/denoiser", {}, ["1 CMDM w/ AR", "4 w/o FSS"]),
    ("cmdm-67", "mardm", {}, []),  # of coordinates, where the paper's has 67 columns
    ("long-horizon", "cmdm", dict(way="stream"), []),
    ("cdamd-66", "cdamd", dict(solver="dopri5", unmasked_only=False), ["1 CDAMD (two VQ)"]),
    ("cdamd-66", "cdamd", dict(num_iterations=18), []),
    ("editing suffix", "cdamd", {}, ["3 suffix: CDAMD"]),
])
def test_a_row_goes_with_its_like(protocol, name, options, rows):
  protocol, _, part = protocol.partition(" ")
  options = dict(options)
  one = candidate(name, scale=options.pop("scale", None), options=options)
  found, _ = printed.printed_rows(protocols.get_protocol(protocol), one, part)
  assert [" ".join(row[1:]) for row in found][:len(rows)] == rows and (rows or not found)


# Whose numbers the papers print beside their own: models of others that are not among our methods
# (docs/papers/baselines.md says what each would take), and real motions.
BASELINES = {"GT", "MMM", "MoMask++", "MDM-SMPL", "MDM-SMPL w/ DiffCollage", "MDM-SMPL w/ STMC", "MotionLCM V2",
             "StableMoFusion", "EnergyMoGen", "SALAD", "MotionDiffuse", "ReMoDiffuse", "BAMM", "ACMDM-S-PS22",
             "FlowMDM", "MARDM", "PriorMDM", "GMD", "OmniControl", "TLControl", "MaskControl", "ProjFlow",
             "MoTok-DDM-4", "MoTok-DDM-4 (RandomOne)", "MotionLCM V2+CtrlNet", "ACMDM-S+CtrlNet", "ACMDM-S+DNO"}
BASELINES |= {f"{task}: BAMM" for task in masking.TASKS}


FURTHER = [f"{file}:{size}" for file, sizes in {
    "mdm_denoiser": ("full", "essential", "fast", "fast_essential", "words", "dip", "goals", "kit",
                     "snapmogen"),
    "mld_denoiser": ("full", "67", "v2"), "momask_masked": ("full", "kit", "snapmogen"),
    "t2m_gpt_gpt": ("full", "kit", "snapmogen"), "motionstreamer_generator": ("full", "snapmogen")}.items()
           for size in sizes]


def every_model():
  """(name, candidate) of all configs that are judged, at full size, and of all that the papers do with them."""
  for file in ("cmdm_denoiser", "cmdm_tokenizer", "cdamd_generator"):
    sizes = ("full", "essential", "kit", "snapmogen", "babel") if "cmdm" in file else (
        "full", "kit", "67", "263", "mardm", "mardm_ddpm", "mardm_67", "mardm_ddpm_67", "mardm_kit", "mardm_263",
        "mardm_snapmogen")
    for size in sizes:
      for options in (None, dict(schedule="ar")) if file == "cmdm_denoiser" else (None,):
        yield f"{file}:{size} {options or ''}", candidate(f"{file}:{size}", options)
  for name in FURTHER:
    yield name, candidate(name)
  for paper, stages in (("cmdm", ("tokenizer", "denoiser")), ("cdamd", ("generator",))):
    rows = runpy.run_path(str(ROOT / "configs" / "ablations" / f"{paper}.py"))["ROWS"]
    yield from ((f"{row}/{stage}", candidate(f"ablations/{paper}:{row}/{stage}")) for row in rows for stage in stages)


def layout_of(protocol):
  return protocol.paper_layout or (protocol.layouts or ("full",))[0]


def test_every_printed_row_is_reached_and_shown():
  """All configs, all protocols that print beside a paper: each row of both papers stands under some table of ours, but
  for the named baselines; and none of them without being an own one, or named by the config."""
  shown, unknown = {}, []
  for name, one in every_model():
    rows = paper_tables.rows_of(one.model.config)
    unknown += [(name, key, row) for key, row in rows.items() if not any(
        known.endswith(row) for known in tables.paper_table(*key.split(" ", 1)).rows)]
    assert not rows or paper_tables.matches_paper_row(one.model.config) == (name != "mld_denoiser:v2"), name
    for protocol in protocols.PROTOCOLS.values():
      if protocol.paper is None:
        continue
      parts = masking.TASKS if protocol.task == "editing" else ("",)
      ours = {f"{part}: {name}" if part else name: (one, part) for part in parts}
      paper = printed.paper_of(protocol, reads(layout_of(protocol)), ours)
      found = [tuple(each.values()) for partners in paper["row"].values() for each in partners]
      found += [tuple(each) for each in paper["also"] if not isinstance(each, str)]
      if found:
        result = Result(protocol.name, "", {key: {} for key in ours}, list(ours), [], paper)
        text = tables.markdown(result)
        for key in found:
          assert key[2] in text, (name, protocol.name, key)
          shown.setdefault(key, set()).add(name)
  assert not unknown
  every = {(*key, row) for key, table in tables.paper_tables().items() for row in table.rows}
  left = {key for key in every - shown.keys() if key[2] not in BASELINES}
  assert not left, sorted(left)
  assert {key[2] for key in every - shown.keys()} == BASELINES  # and every name of the list is needed


def test_only_the_config_itself_judged_as_the_table_was_is_marked():
  marked = lambda one, whole=True: not printed.paper_of(
      protocols.get_protocol("cmdm-259"), reads("full"), {"a": (one, "")}, whole)["unmarked"]
  assert marked(candidate("cmdm")) and marked(candidate("cmdm", dict(schedule="ar")))
  assert not marked(candidate("cmdm"), whole=False)
  assert not marked(candidate("cmdm:small")) and not marked(candidate("cmdm", model__width=256))
  assert not marked(candidate("cmdm", loss__level_block=1))
  assert marked(candidate("cmdm", train__num_steps=3, data__folder="else"))  # what learned less is still that model


def test_a_run_folder_keeps_its_claim(tmp_path):
  for name in ("cmdm", "cdamd", "tokenizer", "ablations/cdamd:bcm"):
    config = candidate(name).model.config
    checkpoint.save_config(tmp_path, config)
    loaded = checkpoint.load_config(tmp_path)
    assert paper_tables.matches_paper_row(loaded) and paper_tables.rows_of(loaded) == paper_tables.rows_of(config)


def test_only_an_evaluator_of_the_papers_representation_compares():
  paper = lambda name, layout, rows: printed.paper_of(protocols.get_protocol(name), reads(layout), rows)
  assert paper("kit", "coordinates_kit", {})["table"] == "2" and paper("kit", "full_kit", {}) is None
  assert paper("editing", "full", {}) is None and paper("long-horizon", "coordinates", {}) is None
  found = paper("cdamd-66", "coordinates", {"a": (candidate("mardm"), ""), "b": (candidate("cmdm"), "")})
  assert found["row"] == {"a": [dict(system="cdamd", table="1", row="MARDM-SiT-XL")]}
  assert found["also"] == ["CDAMD (two VQ)", ["cmdm", "speed", "CMDM w/ FSS"]] and found["unmarked"] == []


def test_what_has_to_be_said():
  number = lambda *values: dict(mean=1.0, interval=0.1, values=list(values))
  result = Result("t2m-263", "", row_order=[], metrics=["fid", "multimodality"], notes=["of our own"], rows={
      "real": {"fid": number(1, 2, 3)}, "a": {"fid": number(1, 2, 3), "multimodality": number(1), "x": number(1, 2)}},
      sanity=dict(fid_halves=0.25, failures=["it fails"], warnings=["it is odd"]), controls=dict(failures=["up"]),
      provenance=dict(code={"commit": "new"}, data=dict(excluded_clips=[[f"c{i}", "NaN"] for i in range(5)],
                                                        shared_with_train=["s1"]),
                      models=[dict(row="a", sampled_by=[{"code": {"commit": "old"}}]),
                              dict(row="b", sampled_by=[{"code": {"commit": "new"}}])]))
  said = notes.of(result, tables.label)
  wanted = ("of 3 repeats (MModality: 1)", "of our own", "0.250 apart", "it fails", "it is odd", "Control failed: up",
            "5 clips left out (c0: NaN; c1: NaN; c2: NaN; ..)", "1 clips of the split are in train",
            "a were made by code old, judged by new")
  assert len(said) == len(wanted) and all(words in line for words, line in zip(wanted, said))
