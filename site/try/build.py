"""Builds the page that runs a model in a browser tab into a folder that any static host can serve.

  python site/try/build.py OUT            needs the extra `onnx`, node and npm
  python -m http.server -d OUT            then open http://localhost:8000

The graphs come from `motion-jax export`, three.js from the viewer's bundle, onnxruntime-web from npm (package.json).
Large files are packed by gzip, which the page unpacks itself.
"""
import argparse
import gzip
import hashlib
import json
import pathlib
import shutil
import subprocess

import motion_jax
from motion_jax.export import graphs
from motion_jax.export.html import VIEWER, resting_body
from motion_jax.models.cmdm.graphs import graphs_of

HERE = pathlib.Path(__file__).parent
PAGE = ("index.html", "style.css", "start.js", "main.js", "worker.js", "stream.js", "words.js", "noise.js", "files.js",
        "bvh.js", "glb.js", "sw.js")
RUNTIME = ("ort.wasm.min.mjs", "ort-wasm-simd-threaded.mjs", "ort.webgpu.min.mjs",
           "ort-wasm-simd-threaded.asyncify.mjs")
PACKED = ("ort-wasm-simd-threaded.wasm", "ort-wasm-simd-threaded.asyncify.wasm")


def build(out, model="cmdm-small-fast", precision="float16", modules=None):
  """Writes the page; returns {file: bytes}. modules: a node_modules folder that holds onnxruntime-web."""
  out = pathlib.Path(out)
  (out / "model").mkdir(parents=True, exist_ok=True)
  (out / "ort").mkdir(exist_ok=True)
  if modules is None:
    subprocess.run(["npm", "install", "--no-package-lock", "--ignore-scripts", "--silent"], cwd=HERE, check=True)
    modules = HERE / "node_modules"
  runtime = pathlib.Path(modules) / "onnxruntime-web" / "dist"
  for name in PAGE:
    shutil.copy(HERE / name, out / name)
  shutil.copy(VIEWER, out / "viewer.js")
  for name in RUNTIME:  # hosts that do not know .mjs send it as bytes, which no browser runs as a script
    shutil.copy(runtime / name, out / "ort" / f"{pathlib.Path(name).stem}.js")
  for name in PACKED:
    _pack(runtime / name, out / "ort" / f"{name}.gz")
  about = _graphs(out / "model", model, precision)
  (out / "model" / "body.json").write_text(json.dumps(resting_body()))
  sizes = {path.name: path.stat().st_size for path in sorted(out.rglob("*.gz"))}
  version = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(out.rglob("*.gz")))).hexdigest()[:12]
  (out / "model" / "files.json").write_text(json.dumps({"version": version, "sizes": sizes, "about": about}))
  return {str(path.relative_to(out)): path.stat().st_size for path in sorted(out.rglob("*")) if path.is_file()}


def _graphs(folder, model, precision):
  """Packed graphs of a model; what model.json says."""
  for path in graphs.write(*graphs_of(motion_jax.load(model)), folder, precision):
    if path.suffix == ".onnx":
      _pack(path, path.with_name(path.name + ".gz"))
      path.unlink()
  about = json.loads((folder / graphs.MANIFEST).read_text(encoding="utf-8"))
  (folder / graphs.MANIFEST).unlink()
  return about


def _pack(source, target):
  target.write_bytes(gzip.compress(source.read_bytes(), 9, mtime=0))


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("out", help="folder to write")
  parser.add_argument("--model", default="cmdm-small-fast", help="shipped model or run folder of a CMDM denoiser")
  parser.add_argument("--precision", choices=graphs.PRECISIONS, default="float16", help="numbers of the stored weights")
  args = parser.parse_args()
  files = build(args.out, args.model, args.precision)
  needed = sum(size for name, size in files.items() if "asyncify" not in name and "webgpu" not in name)
  print("\n".join(f"{size:>10,}  {name}" for name, size in files.items()))
  print(f"{needed / 1e6:.1f} MB for a visitor, {sum(files.values()) / 1e6:.1f} MB with WebGPU; serve it: "
        f"python -m http.server -d {args.out}")


if __name__ == "__main__":
  main()
