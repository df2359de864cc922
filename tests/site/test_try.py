"""The scripts of the page that runs a model in a browser tab, beside Python: run by node."""
import importlib.util
import json
import pathlib
import re
import shutil
import subprocess

import jax
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.models.cmdm.graphs import tokenizer_table
from tests.conftest import ROOT

NODE, PAGE = shutil.which("node"), ROOT / "site" / "try"
SENTENCES = ["a person walks forward, then waves", "A person's CAFÉ-style twirl; 3.5 m!", "zxqj snake \U0001f600 跳",
             "don't  stop", "thevperson walked forward turn around", "a man\tholds a 20kg box (heavy) & spins",
             "naïve ﬁne ½ turn — “quoted” ¿qué?", "x" * 120, "a+b=c <tag> `code` ~5^2 |pipe| $4"]


def sentences(known, count=5000):
  """Random captions: known words, words cut short or joined, accents, capitals, punctuation, other scripts."""
  rng = np.random.default_rng(0)
  odd = ["é", "ñ", "Ü", "-", "'", ", ", "...", "!", " 3.5 ", "½", "ﬁ", "跳", "か", "한", "й", "\U0001f600", "\u200d",
         "\t", "_", "ß", "İ"]
  made = []
  for _ in range(count):
    words = [str(word) for word in rng.choice(known, rng.integers(1, 12))]
    words = [word[:rng.integers(1, 9)] if chance < 0.1 else word.title() if chance < 0.2 else
             word + str(rng.choice(odd)) + word[::-1] if chance < 0.3 else word
             for word, chance in zip(words, rng.random(len(words)))]
    made.append(str(rng.choice([" ", "  ", ", "])).join(words) + str(rng.choice(["", ".", *odd])))
  return made


@pytest.fixture(scope="module")
def expected():
  """What the model's tokenizer and JAX's noise give."""
  encoder = mj.load("cmdm-small-fast").encoder
  draw = lambda seed, block: jax.random.normal(jax.random.fold_in(jax.random.key(seed), block), (96,))
  return {"tokenizer": tokenizer_table(encoder.tokenizer), "known": sorted(encoder.known_words),
          "pieces": [(sentence, encoder.tokenizer.encode(sentence).ids)
                     for sentence in SENTENCES + sentences(sorted(encoder.known_words))],
          "noise": [{"seed": seed, "block": block, "values": draw(seed, block).tolist()}
                    for seed, block in ((0, 0), (7, 3), (2**32 - 1, 1000))]}


@pytest.mark.skipif(NODE is None, reason="there is no node, which runs the page's scripts without a browser")
def test_scripts_do_what_python_does(expected, tmp_path):
  for path in [*PAGE.glob("*.js"), pathlib.Path(__file__).with_name("try.test.mjs")]:
    shutil.copy(path, tmp_path)
  (tmp_path / "package.json").write_text('{"type": "module"}')
  (tmp_path / "expected.json").write_text(json.dumps(expected))
  done = subprocess.run([NODE, "--test", "try.test.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
  assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]


def test_hosts_that_do_not_know_mjs_can_serve_the_tab(tmp_path, monkeypatch):
  """No script ends in .mjs, and the scripts that the worker names are there."""
  spec = importlib.util.spec_from_file_location("build", PAGE / "build.py")
  build = importlib.util.module_from_spec(spec)
  spec.loader.exec_module(build)
  dist = tmp_path / "onnxruntime-web" / "dist"
  dist.mkdir(parents=True)
  for name in (*build.RUNTIME, *build.PACKED):
    (dist / name).write_bytes(b"0")
  monkeypatch.setattr(build, "_graphs", lambda *given: {})
  files = build.build(tmp_path / "tab", modules=tmp_path)
  assert not any(name.endswith(".mjs") for name in files)
  worker = (PAGE / "worker.js").read_text(encoding="utf-8")
  named = re.findall(r"(?:glue: '|binary: '|ort/)([\w.-]+\.(?:m?js|wasm\.gz))'", worker)
  assert len(named) == 6 and {f"ort/{name}" for name in named} <= set(files)


@pytest.mark.skipif(NODE is None, reason="there is no node, which runs the page's scripts without a browser")
@pytest.mark.parametrize("protocol, words", [("file:", "only from a web server"), ("https:", "")])
def test_a_tab_opened_as_a_file_says_what_to_do(protocol, words):
  script = f"""const note = {{}}, location = {{protocol: '{protocol}'}};
    const document = {{getElementById: () => note, body: {{dataset: {{}}}}}};
    {(PAGE / 'start.js').read_text(encoding='utf-8')}
    console.log(note.textContent ?? '')"""
  done = subprocess.run([NODE, "-e", script], capture_output=True, text=True, check=True, timeout=60)
  assert words in done.stdout and bool(done.stdout.strip()) == bool(words)
  html = (PAGE / "index.html").read_text(encoding="utf-8")
  assert html.index('src="start.js"') < html.index('type="module"')  # modules of a file are blocked
