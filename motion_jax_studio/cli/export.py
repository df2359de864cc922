"""motion-jax export: a model as ONNX graphs, for programs without JAX."""
import pathlib

from motion_jax.utils.errors import InputError
from motion_jax_studio.cli.writing import print_files


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  export = commands.add_parser(
      "export", help="write a model as ONNX graphs that run without JAX: in a browser, Unity, Unreal or C++",
      epilog="FOLDER gets text.onnx, step.onnx, decoder.onnx, joints.onnx and model.json, which states all tensors and "
      "constants; docs/onnx.md has the loop that runs them.")
  export.add_argument("model", metavar="MODEL", help="shipped model or run folder of a CMDM denoiser, such as "
                      "cmdm-small-fast")
  export.add_argument("folder", metavar="FOLDER", help="folder to write")
  export.add_argument("--format", choices=("onnx",), default="onnx", help="format of the graphs (onnx)")
  export.add_argument("--precision", default="float16", help="number format of the stored weights: float32, float16 or "
                      "int8 (float16); arithmetic is float32")
  export.set_defaults(run=_export)


def _export(args):
  from motion_jax.export import graphs
  graphs.require()
  folder = pathlib.Path(args.folder)
  if folder.exists() and not folder.is_dir():
    raise InputError(f"got the folder {folder}, which is a file; name a new folder or an existing one")
  import motion_jax
  from motion_jax.models.abilities import cannot
  model = motion_jax.load(args.model)
  if not model.can("graphs"):
    raise InputError(cannot(model.folder.name, "graphs"))
  print(f"{model.id}, licence {model.license}: weights as {args.precision}")
  written = graphs.write(*model.graphs(), folder, args.precision)
  print(f"{sum(path.stat().st_size for path in written) / 1e6:.1f} MB in all")
  print_files(written)
  print(f"try it: python examples/onnx_stream.py {folder} \"a person walks forward\" --out walk.npy")
