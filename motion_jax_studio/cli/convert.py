"""motion-jax convert: the authors' PyTorch weights as run folders."""
import importlib
import inspect
import shlex
from typing import NamedTuple

from motion_jax.utils.numerals import whole


class _Source(NamedTuple):
  """Weights of one method. files: {flag: (parameter of `write`, help)}, a flag without dashes is an argument, one that
  ends in ! is required; stats, text: what these folders are; generates: the parameter without which a run generates no
  motion, "file" for all runs."""
  help: str
  write: str
  files: dict[str, tuple[str, str]]
  stats: str = "training data"
  text: str = ""
  generates: str = ""


_ENCODER = "as Hugging Face lays it out"
_SOURCES = {
    "cmdm": _Source("CMDM's MAC-VAE and Causal-DiT; without a denoiser, the run of the VAE", "models.cmdm", {
        "--tokenizer!": ("tokenizer_file", "net_best_fid.tar of the MAC-VAE"),
        "--denoiser": ("denoiser_file", "latest.tar of the Causal-DiT")}, text="distilbert-base-uncased",
        generates="denoiser_file"),
    "cdamd": _Source("CDAMD's or MARDM's autoencoder and generator; without a generator, the run of the autoencoder or "
                     "RVQ-VAE", "models.cdamd", {
        "--tokenizer": ("tokenizer_file", "latest.tar of the AE"),
        "--generator": ("generator_file", "latest.tar of the masked transformer with its DiffMLPs"),
        "--rvq": ("rvq_file", "latest.tar of the RVQ-VAE, which training alone needs"),
        "--length": ("length_file", "finest.tar of the length estimator")},
        "training data (of coordinates Mean_abs.npy, Std_abs.npy)", "clip-vit-base-patch32", "generator_file"),
    "momask": _Source("MoMask's RVQ-VAE, masked and residual transformer; without the masked one, the run of the "
                      "RVQ-VAE", "models.momask", {
        "--tokenizer!": ("tokenizer_file", "net_best_fid.tar of the RVQ-VAE"),
        "--masked": ("masked_file", "latest.tar of the masked transformer"),
        "--residual": ("residual_file", "net_best_fid.tar of the residual transformer"),
        "--length": ("length_file", "finest.tar of the length estimator")}, "training (its meta folder)",
        "clip-vit-base-patch32", "masked_file"),
    "t2m_gpt": _Source("T2M-GPT's VQ-VAE and GPT; without a GPT, the run of the VQ-VAE", "models.t2m_gpt", {
        "--tokenizer!": ("tokenizer_file", "net_last.pth of the VQ-VAE"),
        "--gpt": ("gpt_file", "net_best_fid.pth of the GPT")}, "training (VQVAEV3_CB1024_CMT_H1024_NRES3/meta)",
        "clip-vit-base-patch32", "gpt_file"),
    "mdm": _Source("MDM's denoiser; args.json in the same folder states how it was trained", "models.mdm", {
        "file": ("file", "model#########.pt")}, text="clip-vit-base-patch32 or, with words, distilbert-base-uncased",
        generates="file"),
    "mld": _Source("MLD's VAE and denoiser", "models.mld", {
        "file": ("file", "1222_mld_humanml3d_FID041.ckpt, or 1216_novae_humanml3d.ckpt without a VAE")},
        text="clip-vit-large-patch14", generates="file"),
    "motionstreamer": _Source("MotionStreamer's causal autoencoder and generator", "models.motionstreamer", {
        "--tokenizer!": ("autoencoder_file", "net_last.pth of the causal autoencoder"),
        "--generator!": ("generator_file", "latest.pth of the t2m_model")}, text="sentence-t5-xxl",
        generates="generator_file"),
    "teacher": _Source("Part-TMR, TMR or MotionPatches, motion-language teachers", "models.tmr", {
        "file": ("file", "best_model.pt; of TMR its checkpoint, or the folder of its three parts")},
        text="distilbert-base-uncased"),
    "evaluator": _Source("T2M's or MARDM's evaluator: text_mot_match, text_mot_match_clip", "evaluators", {
        "file": ("file", "finest.tar")}, "evaluator",
        "clip-vit-base-patch16, for the word pieces of the CLIP-type evaluator")}
_REQUIRE_TEXT = ("mld", "motionstreamer")  # these two need the embedding of the empty caption


def add_to(commands):
  """Adds the sub-command to those of `motion-jax`."""
  convert = commands.add_parser("convert", help="convert the authors' PyTorch weights to run folders").add_subparsers(
      dest="convert_command", required=True, metavar="WHAT")
  for name, source in _SOURCES.items():
    parser = convert.add_parser(name, help=source.help, aliases=["mardm"] if name == "cdamd" else [])
    for flag, (dest, text) in source.files.items():
      options = {"dest": dest, "metavar": "FILE", "required": flag.endswith("!")} if flag.startswith("--") else {}
      parser.add_argument(flag.rstrip("!"), help=text, **options)
    if name in ("cmdm", "cdamd", "mdm"):
      parser.add_argument("--weights", choices=("ema", "model"), default="ema", help="averaged weights (ema), where "
                          "the file has them, or the weights of the last step")
    if name == "cmdm":
      parser.add_argument("--block", type=whole(1, 1000), default=3, help="latents that share a noise level (3)")
    if name == "cdamd":
      parser.add_argument("--diffusion", choices=("flow", "ddpm"), default="flow", help="how the DiffMLPs were "
                          "trained: SiT-XL (flow) or DDPM-XL; their tensors have the same shapes")
    if name == "evaluator":
      parser.add_argument("--glove", metavar="FOLDER", help="our_vab_*, the word vectors of T2M's evaluator, which are "
                          "copied to its folder")
    parser.add_argument("--stats", required=True, metavar="FOLDER", help=f"Mean.npy and Std.npy of the {source.stats}, "
                        "which checkpoints do not contain")
    parser.add_argument("--heads", dest="num_heads", metavar="N", type=whole(1, 1024), help="number of attention "
                        "heads, for sizes other than the papers'")
    parser.add_argument("--out", required=True, metavar="FOLDER", help="new folder to write")
    parser.add_argument("--text-encoder", dest="text", metavar="FOLDER", required=name in _REQUIRE_TEXT,
                        help=source.text if name == "evaluator" else f"{source.text}, {_ENCODER}")
    parser.set_defaults(run=_convert, source=name)


def _convert(args):
  source = _SOURCES[args.source]
  write = getattr(importlib.import_module(f"motion_jax.{source.write}.weights"), f"write_{args.source}")
  takes = inspect.getfullargspec(write)
  networks = write(**{name: getattr(args, name) for name in (*takes.args, *takes.kwonlyargs)})
  print(*networks, f"wrote {args.out}", sep="\n")
  if source.generates and getattr(args, source.generates):
    print(f"try it: motion-jax generate \"a person waves\" --model {shlex.quote(args.out)}")
