"""A clip of six seconds by each method beside its authors' own code in PyTorch, in one run, with random weights.

  python benchmarks/method_peers.py --list                       repositories, commits and the commands that fetch them
  python benchmarks/method_peers.py --peers FOLDER [--methods mdm momask] [--rounds 3] [--out FILE.md]

FOLDER holds the clones, each in a folder named after the method; the authors' code is run from there and is no part of
this library. It needs PyTorch (extra `convert`) and einops; what the networks do not use (CLIP, SMPL, timm) is left out
by empty modules. Both sides have the released sizes, a caption as a vector, the released sampler and guidance, and one
clip of 120 frames, 30 latents, alone, on one core; text encoders and decoders of latents are left out on both sides,
for MLD also the scheduler's arithmetic. In turns, in float32. Columns are medians: processor seconds, and seconds.
"""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import types
from collections.abc import Callable
from typing import Any, NamedTuple
from unittest import mock

import machine  # like results and programs a file beside this one
import results

FRAMES, LATENTS = 120, 30


class Sides(NamedTuple):
  """Functions that make a clip, and the parameters of each."""
  theirs: Callable[[], Any]
  ours: Callable[[], Any]
  their_parameters: int
  our_parameters: int


class Peer(NamedTuple):
  """An authors' repository; unused: modules that its files import and its networks do not use."""
  repository: str
  commit: str
  what: str
  unused: tuple[str, ...]
  build: Callable[[], Sides]


def _count(module, without=()):
  return sum(p.numel() for name, p in module.named_parameters() if not name.startswith(without))


def _ours(run, params, *args):
  """A compiled run(params, *args), and the number of parameters."""
  import jax
  function = jax.jit(run)
  return (lambda: jax.block_until_ready(function(params, *args))), sum(x.size for x in jax.tree.leaves(params))


def _text(size):
  import numpy as np
  return np.random.default_rng(0).standard_normal((1, size), np.float32)


def _net(config, network, shapes):
  """(a network of a config's section, random parameters)."""
  from motion_jax.training.setup import untrained
  from motion_jax.utils.config_files import module_fields
  net = network(**module_fields(config))
  return net, untrained(shapes(net))


def mdm() -> Sides:
  import jax
  import torch
  from diffusion import gaussian_diffusion as gd
  from diffusion.respace import SpacedDiffusion, space_timesteps
  from model.cfg_sampler import ClassifierFreeSampleModel
  from model.mdm import MDM

  from motion_jax.models.mdm import sampling, stages
  from motion_jax.nets.motion_denoiser import MotionDenoiser
  from motion_jax.utils import config_files
  with mock.patch.object(MDM, "load_and_freeze_clip", lambda *_: torch.nn.Identity()):
    model = MDM("", 263, 1, 1, True, "rot6d", True, True, latent_dim=512, ff_size=1024, num_layers=8, num_heads=4,
                data_rep="hml_vec", cond_mode="text", cond_mask_prob=0.1, dataset="humanml")
  model.eval()
  diffusion = SpacedDiffusion(
      use_timesteps=space_timesteps(50, [50]), betas=gd.get_named_beta_schedule("cosine", 50, 1.0),
      model_mean_type=gd.ModelMeanType.START_X, model_var_type=gd.ModelVarType.FIXED_SMALL,
      loss_type=gd.LossType.MSE, rescale_timesteps=False)
  guided, text = ClassifierFreeSampleModel(model), _text(512)
  given = dict(y=dict(text_embed=torch.from_numpy(text)[None], scale=torch.full((1,), 2.5),
                      mask=torch.ones(1, 1, 1, FRAMES, dtype=torch.bool)))
  theirs = lambda: diffusion.p_sample_loop(guided, (1, 263, 1, FRAMES), clip_denoised=False, model_kwargs=given,
                                           progress=False)
  net, params = _net(config_files.load("mdm_denoiser:fast").model, MotionDenoiser, stages.denoiser_shapes)
  noise = lambda m: jax.random.normal(jax.random.fold_in(jax.random.key(0), m), (1, FRAMES, 263))
  run = lambda params, text: sampling.denoise(net, sampling.Plan(50, 50), params, sampling.Condition(text), 2.5, noise)
  return Sides(theirs, *_sides(_ours(run, params, text[:, None]), _count(model)))


def _sides(ours, count):
  run, parameters = ours
  return run, count, parameters


def t2m_gpt() -> Sides:
  import jax
  import jax.numpy as jnp
  import torch
  from models.t2m_trans import Text2Motion_Transformer

  from motion_jax.models.t2m_gpt import sampling, stages
  from motion_jax.nets.token_gpt import CodeGPT
  from motion_jax.utils import config_files
  model, text = Text2Motion_Transformer(512, 1024, 512, 51, 9, 16, 0.1, 4).eval(), _text(512)

  def theirs():  # the loop of its `sample`, without the end, which random weights meet anywhere
    codes = torch.zeros(1, 0, dtype=torch.long)
    for k in range(LATENTS):
      logits = model(codes if k else [], torch.from_numpy(text))[:, -1, :-1]
      codes = torch.cat([codes, torch.distributions.Categorical(logits.softmax(-1)).sample()[:, None]], dim=1)
    return codes

  net, params = _net(config_files.load("t2m_gpt_gpt").model, CodeGPT, stages.gpt_shapes)
  choose, number = sampling.categorical(jax.random.key(0)[None]), jnp.array([LATENTS])
  run = lambda params, text: sampling.sample(net, params, text, choose, number, number)
  return Sides(theirs, *_sides(_ours(run, params, text), _count(model)))


def momask() -> Sides:
  import jax
  import jax.numpy as jnp
  import torch
  from models.mask_transformer.transformer import MaskTransformer, ResidualTransformer

  from motion_jax.models.momask import sampling, stages
  from motion_jax.models.shared import mask_schedule
  from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
  from motion_jax.utils import config_files
  options, text = types.SimpleNamespace(num_tokens=512, num_quantizers=6, device="cpu"), _text(512)
  sizes = dict(code_dim=512, cond_mode="text", latent_dim=384, ff_size=1024, num_layers=8, num_heads=6, dropout=0.2,
               opt=options)
  networks = []
  for kind, more in ((MaskTransformer, {}), (ResidualTransformer, dict(share_weight=True))):
    with mock.patch.object(kind, "load_and_freeze_clip", lambda *_: torch.nn.Identity()):
      networks.append(kind(**sizes, **more).eval())
    networks[-1].encode_text = lambda _: torch.from_numpy(text)
  masked, residual = networks

  def theirs():
    length = torch.tensor([LATENTS])
    codes = masked.generate([""], length, 10, 4, temperature=1, topk_filter_thres=0.9)
    return residual.generate(codes, [""], length, temperature=1, cond_scale=5)

  net, params = _net(config_files.load("momask_masked").model, MaskedCodeTransformer, stages.masked_shapes)
  further, more = _net(config_files.load("momask_residual").model, ResidualCodeTransformer, stages.residual_shapes)
  real, keys = jnp.ones((1, LATENTS), bool), jax.random.key(0)[None]
  counts = mask_schedule.masked_counts(10, [LATENTS])
  chooser = lambda classes, stream: sampling.chooser(sampling.noise_of(keys, LATENTS, classes, stream), 1.0, 0.9)

  def run(params, text):
    codes = sampling.decode_masked(net, params[0], jnp.zeros((1, LATENTS), int), real, real, counts, text, 4.0,
                                   chooser(512, 0)).codes[-1]
    return sampling.add_levels(further, params[1], codes, real, text, 5.0, chooser(513, 1))[0]

  return Sides(theirs, *_sides(_ours(run, (params, more), text), _count(masked) + _count(residual)))


def mld() -> Sides:
  import jax
  import torch
  from mld.models.architectures.mld_denoiser import MldDenoiser

  from motion_jax.models.mld import sampling, stages
  from motion_jax.nets.latent_diffusion import TokenDenoiser
  from motion_jax.utils import config_files
  options = types.SimpleNamespace(SKIP_CONNECT=True, VAE_TYPE="mld", DIFF_PE_TYPE="mld")
  model, text = MldDenoiser(options, latent_dim=[1, 256], num_layers=9, text_encoded_dim=768).eval(), _text(768)
  words = torch.from_numpy(text).repeat(2, 1)[:, None]

  def theirs():
    x = torch.randn(1, 1, 256)
    for t in range(981, 0, -20):
      without, with_text = model(torch.cat([x, x]), torch.tensor(t), words)[0].chunk(2)
      x = x - 0.02 * (without + 7.5 * (with_text - without))
    return x

  net, params = _net(config_files.load("mld_denoiser").model, TokenDenoiser, lambda net: stages.denoiser_shapes(net, 1))
  noise = lambda m: jax.random.normal(jax.random.fold_in(jax.random.key(0), m), (1, 1, 256))
  run = lambda params, text: sampling.denoise(net, sampling.Plan(), params, text, 0 * text, 7.5, noise)
  return Sides(theirs, *_sides(_ours(run, params, text[:, None]), _count(model, ("mem_pos",))))  # which is not used


def motionstreamer() -> Sides:
  import jax
  import jax.numpy as jnp
  import torch
  from models.llama_model import LLaMAHF, LLaMAHFConfig

  from motion_jax.models.motionstreamer import sampling, stages
  from motion_jax.training.setup import untrained
  from motion_jax.utils import config_files
  cpu, text = torch.device("cpu"), _text(768)
  model = LLaMAHF(LLaMAHFConfig.from_name("Normal_size"), 9, 16, cpu).eval()
  encoder = types.SimpleNamespace(encode=lambda caption: text[0] if not caption else text)
  theirs = lambda: model.sample_for_eval_CFG(["walk"], length=FRAMES, tokenize_model=encoder, device=cpu)
  config = config_files.load("motionstreamer_generator").model
  net = stages.make_generator(config)
  params, keys = untrained(stages.generator_shapes(net)), jax.random.key(0)
  draw = lambda k, m: jax.random.normal(jax.random.fold_in(jax.random.fold_in(keys, k), m), (1, 16))

  def run(params, text):
    plan = sampling.Plan()
    segment = sampling.begin(net, plan, params, text, 0 * text, jnp.zeros((1, 0, 16)), 0)
    return sampling.sample_segment(net, plan, params, segment, 4.0, draw, LATENTS)[0]

  return Sides(theirs, *_sides(_ours(run, params, text), _count(model)))


PEERS = {
    "mdm": Peer("GuyTevet/motion-diffusion-model", "d4fd88c86d9210b85323783a73acb9b794d73e44",
                "50 guided steps, 8 layers of width 512",
                ("clip", "model.rotation2xyz", "model.BERT.BERT_encoder", "data_loaders.humanml.scripts",
                 "data_loaders.humanml.scripts.motion_process", "utils.loss_util", "spacy"), mdm),
    "mld": Peer("ChenFengYe/motion-latent-diffusion", "081ce3152e5a95b14a4495fb2d32939c257c6216",
                "50 guided steps, 9 skip-connected layers of width 256", ("mld.utils.temos_utils",), mld),
    "t2m_gpt": Peer("Mael-zys/T2M-GPT", "b1446f1239f0fce579f922b5b10dd1b1103669cc",
                    "30 codes, 18 layers of width 1024", (), t2m_gpt),
    "momask": Peer("EricGuo5513/momask-codes", "94a6636c9c463b7a9414c3401a6f1b67e6c51824",
                   "10 rounds and 5 residual levels, guided, two networks of 8 layers of width 384", ("clip",), momask),
    "motionstreamer": Peer("zju3dv/MotionStreamer", "9ecbb2569c3cfa9b91034f17cb6478153b9e65c7",
                           "30 latents of 50 guided steps, 12 layers of width 768 and a head of 9 of 1792",
                           ("timm", "timm.layers", "timm.layers.mlp"), motionstreamer),
}


def measure(method, folder, rounds) -> dict:
  """A method's row, in this process."""
  if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # one core: threads that wait for another count as work
  import torch
  torch.set_num_threads(1)
  torch.Tensor.cuda = lambda tensor, *_, **__: tensor  # some lines name the device
  sys.path.insert(0, str(folder / method))
  for name in PEERS[method].unused:
    sys.modules[name] = mock.MagicMock()
  torch.manual_seed(0)
  sides = PEERS[method].build()
  found, others = {"theirs": [], "ours": []}, []
  with torch.no_grad():
    for i in range(rounds + 1):
      for side in found:  # in turns, so that a busy machine slows both
        with machine.cost() as cost:
          getattr(sides, side)()
        if i:  # the first one compiles
          found[side].append((cost.processor, cost.wall))
          others.append(cost.others or 0.0)
  row = {side: [statistics.median(one) for one in zip(*times)] for side, times in found.items()}
  return row | dict(parameters=(sides.their_parameters, sides.our_parameters), others=statistics.median(others))


def table(found) -> str:
  lines = []
  for method, row in found.items():
    if "error" in row:
      lines.append([method, PEERS[method].what, "", "", "", "", "", "", row["error"]])
      continue
    (their_cpu, their_wall), (our_cpu, our_wall) = row["theirs"], row["ours"]
    theirs, ours = (f"{count / 1e6:.1f}" for count in row["parameters"])
    lines.append([method, PEERS[method].what, theirs if theirs == ours else f"{theirs} and {ours}", f"{their_cpu:.3f}",
                  f"{our_cpu:.3f}", f"{their_cpu / our_cpu:.2f}", f"{their_wall / our_wall:.2f}",
                  f"{FRAMES / our_wall:.0f}", machine.mark(row["others"])])
  return results.markdown(["method", "what is computed", "parameters, M", "PyTorch, processor s", "ours, processor s",
                           "ratio", "ratio on the clock", "our frames a second", "remark"], lines)


def listed() -> str:
  return results.markdown(["method", "repository", "how to fetch it"], [
      [method, f"[{peer.repository}](https://github.com/{peer.repository})",
       f"`git clone https://github.com/{peer.repository} {method} && git -C {method} checkout {peer.commit[:12]}`"]
      for method, peer in PEERS.items()])


def main(argv=None):
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  add = parser.add_argument
  add("--peers", type=pathlib.Path, help="folder of the clones, each in a folder named after its method")
  add("--methods", nargs="+", choices=PEERS, default=list(PEERS))
  add("--rounds", type=int, default=3)
  add("--out", type=pathlib.Path, help="Markdown file for the table")
  add("--list", action="store_true", help="print which repositories are compared and how to fetch them")
  add("--row", choices=PEERS, help=argparse.SUPPRESS)
  args = parser.parse_args(argv)
  if args.list or not args.peers:
    print(listed())
    return 0 if args.list else parser.error("give --peers, the folder of the clones")
  if args.row:  # a process for each: their modules have the same names
    print("\n" + json.dumps(measure(args.row, args.peers, args.rounds)))
    return 0
  import torch
  about = (f"{machine.today()}, commit {machine.commit(pathlib.Path(__file__).parent)}, "
           f"{machine.words(machine.describe())}, PyTorch {torch.__version__}.\n\n")
  found = {}
  for method in args.methods:
    if not (args.peers / method).is_dir():
      print(f"{method}: no folder {args.peers / method}; --list says how to fetch it", file=sys.stderr)
      continue
    done = subprocess.run([sys.executable, __file__, "--peers", args.peers, "--row", method, "--rounds",
                           str(args.rounds)], stdout=subprocess.PIPE, text=True, check=False)
    found[method] = json.loads(done.stdout.splitlines()[-1]) if not done.returncode else dict(error="it did not run")
    if args.out:  # after each: a run that is cut short keeps what it measured
      args.out.write_text(f"{about}{table(found)}\n", encoding="utf-8")
  print(f"{about}{table(found)}")
  return 1 if any("error" in row for row in found.values()) else 0


if __name__ == "__main__":
  raise SystemExit(main())
