"""motion-jax convert: the authors' PyTorch weights as run folders."""
import shlex

from motion_jax.utils.numerals import whole


def add_to(commands):
  """Adds the sub-command to those of `motion-jax`."""
  convert = commands.add_parser("convert", help="convert the authors' PyTorch weights to run folders").add_subparsers(
      dest="convert_command", required=True, metavar="WHAT")
  released = convert.add_parser("cmdm", help="CMDM's MAC-VAE and Causal-DiT; without a denoiser, the run of the VAE")
  released.add_argument("--tokenizer", required=True, metavar="FILE", help="net_best_fid.tar of the MAC-VAE")
  released.add_argument("--denoiser", metavar="FILE", help="latest.tar of the Causal-DiT")
  released.add_argument("--weights", choices=("ema", "model"), default="ema",
                        help="averaged weights (ema) or the weights of the last step")
  released.add_argument("--block", type=whole(1, 1000), default=3, help="latents that share a noise level (3)")
  released.set_defaults(run=_convert_cmdm)
  cdamd = convert.add_parser("cdamd", aliases=["mardm"], help="CDAMD's or MARDM's autoencoder and generator; without a "
                                                              "generator, the run of the autoencoder or RVQ-VAE")
  cdamd.add_argument("--tokenizer", metavar="FILE", help="latest.tar of the AE")
  cdamd.add_argument("--generator", metavar="FILE", help="latest.tar of the masked transformer with its DiffMLPs")
  cdamd.add_argument("--rvq", metavar="FILE", help="latest.tar of the RVQ-VAE, which training alone needs")
  cdamd.add_argument("--length", metavar="FILE", help="finest.tar of the length estimator")
  cdamd.add_argument("--weights", choices=("ema", "model"), default="ema",
                     help="of MARDM: averaged weights (ema) or the weights of the last step")
  cdamd.add_argument("--diffusion", choices=("flow", "ddpm"), default="flow",
                     help="how the DiffMLPs were trained: SiT-XL (flow) or DDPM-XL; their tensors have the same shapes")
  cdamd.set_defaults(run=_convert_cdamd)
  momask = convert.add_parser("momask", help="MoMask's RVQ-VAE, masked and residual transformer; without the masked "
                                             "one, the run of the RVQ-VAE")
  momask.add_argument("--tokenizer", required=True, metavar="FILE", help="net_best_fid.tar of the RVQ-VAE")
  momask.add_argument("--masked", metavar="FILE", help="latest.tar of the masked transformer")
  momask.add_argument("--residual", metavar="FILE", help="net_best_fid.tar of the residual transformer")
  momask.add_argument("--length", metavar="FILE", help="finest.tar of the length estimator")
  momask.set_defaults(run=_convert_momask)
  gpt = convert.add_parser("t2m_gpt", help="T2M-GPT's VQ-VAE and GPT; without a GPT, the run of the VQ-VAE")
  gpt.add_argument("--tokenizer", required=True, metavar="FILE", help="net_last.pth of the VQ-VAE")
  gpt.add_argument("--gpt", metavar="FILE", help="net_best_fid.pth of the GPT")
  gpt.set_defaults(run=_convert_t2m_gpt)
  mdm = convert.add_parser("mdm", help="MDM's denoiser; args.json in the same folder states how it was trained")
  mdm.add_argument("file", help="model#########.pt")
  mdm.add_argument("--weights", choices=("ema", "model"), default="ema",
                   help="averaged weights (ema), where the file has them, or the weights of the last step")
  mdm.set_defaults(run=_convert_mdm)
  mld = convert.add_parser("mld", help="MLD's VAE and denoiser")
  mld.add_argument("file", help="1222_mld_humanml3d_FID041.ckpt, or 1216_novae_humanml3d.ckpt without a VAE")
  mld.set_defaults(run=_convert_mld)
  streamer = convert.add_parser("motionstreamer", help="MotionStreamer's causal autoencoder and generator")
  streamer.add_argument("--tokenizer", required=True, metavar="FILE", help="net_last.pth of the causal autoencoder")
  streamer.add_argument("--generator", required=True, metavar="FILE", help="latest.pth of the t2m_model")
  streamer.set_defaults(run=_convert_motionstreamer)
  teacher = convert.add_parser("teacher", help="Part-TMR, TMR or MotionPatches, motion-language teachers")
  teacher.add_argument("file", help="best_model.pt; of TMR its checkpoint, or the folder of its three parts")
  teacher.set_defaults(run=_convert_teacher)
  evaluator = convert.add_parser("evaluator", help="T2M's or MARDM's evaluator: text_mot_match, text_mot_match_clip")
  evaluator.add_argument("file", help="finest.tar")
  evaluator.add_argument("--glove", metavar="FOLDER", help="our_vab_*, the word vectors of T2M's evaluator, which are "
                         "copied to its folder")
  evaluator.add_argument("--text-encoder", metavar="FOLDER",
                         help="clip-vit-base-patch16, for the word pieces of the CLIP-type evaluator")
  evaluator.set_defaults(run=_convert_evaluator)
  stats = {released: "training data", cdamd: "training data (of coordinates Mean_abs.npy, Std_abs.npy)",
           momask: "training (its meta folder)", gpt: "training (VQVAEV3_CB1024_CMT_H1024_NRES3/meta)",
           mdm: "training data", mld: "training data", streamer: "training data", teacher: "training data",
           evaluator: "evaluator"}
  text_encoders = {released: "distilbert-base-uncased", cdamd: "clip-vit-base-patch32",
                   momask: "clip-vit-base-patch32", gpt: "clip-vit-base-patch32",
                   mdm: "clip-vit-base-patch32 or, with words, distilbert-base-uncased",
                   teacher: "distilbert-base-uncased", mld: "clip-vit-large-patch14", streamer: "sentence-t5-xxl"}
  _add_folders(stats, text_encoders, {mld, streamer})  # these two need the embedding of the empty caption


def _add_folders(stats, text_encoders, required):
  """Adds the flags of folders. stats, text_encoders: {parser: what the folder is}; required: parsers that need a text
  encoder."""
  for parser, source in stats.items():
    parser.add_argument("--stats", required=True, metavar="FOLDER",
                        help=f"Mean.npy and Std.npy of the {source}, which checkpoints do not contain")
    parser.add_argument("--heads", type=whole(1, 1024),
                        help="number of attention heads, for sizes other than the papers'")
    parser.add_argument("--out", required=True, metavar="FOLDER", help="new folder to write")
  for parser, name in text_encoders.items():
    parser.add_argument("--text-encoder", metavar="FOLDER", required=parser in required,
                        help=f"{name}, as Hugging Face lays it out")


def _convert_cmdm(args):
  from motion_jax.models.cmdm.weights import write_cmdm
  _print_converted(args, write_cmdm(args.out, args.tokenizer, args.stats, args.denoiser, args.text_encoder,
                                 args.weights, args.heads, args.block), args.denoiser)


def _convert_cdamd(args):
  from motion_jax.models.cdamd.weights import write_cdamd
  _print_converted(args, write_cdamd(args.out, args.tokenizer, args.stats, args.generator, args.rvq, args.length,
                                     args.text_encoder, args.weights, args.heads, args.diffusion), args.generator)


def _convert_momask(args):
  from motion_jax.models.momask.weights import write_momask
  _print_converted(args, write_momask(args.out, args.tokenizer, args.stats, args.masked, args.residual, args.length,
                                      args.text_encoder, args.heads), args.masked)


def _convert_t2m_gpt(args):
  from motion_jax.models.t2m_gpt.weights import write_t2m_gpt
  _print_converted(args, write_t2m_gpt(args.out, args.tokenizer, args.stats, args.gpt, args.text_encoder, args.heads),
                   args.gpt)


def _convert_mdm(args):
  from motion_jax.models.mdm.weights import write_mdm
  _print_converted(args, write_mdm(args.out, args.file, args.stats, args.text_encoder, args.weights, args.heads), True)


def _convert_mld(args):
  from motion_jax.models.mld.weights import write_mld
  _print_converted(args, write_mld(args.out, args.file, args.stats, args.text_encoder, args.heads), True)


def _convert_motionstreamer(args):
  from motion_jax.models.motionstreamer.weights import write_motionstreamer
  _print_converted(args, write_motionstreamer(args.out, args.tokenizer, args.generator, args.stats, args.text_encoder,
                                              args.heads), True)


def _convert_teacher(args):
  from motion_jax.models.tmr.weights import write_teacher
  _print_converted(args, write_teacher(args.out, args.file, args.stats, args.text_encoder, args.heads))


def _convert_evaluator(args):
  from motion_jax.evaluators.weights import write_evaluator
  _print_converted(args, write_evaluator(args.out, args.file, args.stats, args.heads, args.glove, args.text_encoder))


def _print_converted(args, networks, generates=None):
  print(*networks, f"wrote {args.out}", sep="\n")
  if generates:
    print(f"try it: motion-jax generate \"a person waves\" --model {shlex.quote(args.out)}")
