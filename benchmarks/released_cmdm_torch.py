"""CMDM's released code on prompts and noise of `released_cmdm.py`, for a Python with torch, einops and transformers.

  python benchmarks/released_cmdm_torch.py sample --code CMDM --files FOLDER --text-encoder FOLDER --prompts FOLDER
  python benchmarks/released_cmdm_torch.py lookalikes --code CMDM --files FOLDER

FOLDER of files is laid out as the authors' README says: checkpoints/t2m/pretrained_vae/model/net_best_fid.tar,
pretrained_dit/model/latest.tar, text_mot_match_full/model/finest.tar, text_mot_match/model/finest.tar, glove/,
datasets/HumanML3D/. "lookalikes" writes all but the data with random weights at full size, by the authors' own classes,
and a DistilBERT in distilbert/.
"""
import argparse
import json
import pathlib
import pickle
import sys
import types

import numpy as np
import torch
from released_names import DENOISER, EVALUATORS, TOKENIZER

BATCH = 32  # the evaluation's


def modules(code, text_encoder=None):
  """(dit, vae) of the authors' code. Packages that sampling does not use may be missing."""
  sys.path.insert(0, str(code))
  for name, attribute in (("torchdiffeq", "odeint"), ("clip", "load")):
    try:
      __import__(name)
    except ImportError:
      sys.modules[name] = types.ModuleType(name)
      setattr(sys.modules[name], attribute, None)
  from models import VAE, Causal_DiT
  load = Causal_DiT.load_bert  # of a name on the hub
  Causal_DiT.load_bert = lambda _: torch.nn.Identity() if text_encoder is None else load(str(text_encoder))
  return Causal_DiT.dit, VAE.vae


@torch.no_grad()
def sample(args):
  """Writes the features, not normalized, of each line of prompts.jsonl, from the noise beside it."""
  dit, vae = modules(args.code, args.text_encoder)
  files, read = pathlib.Path(args.files), lambda path: torch.load(path, map_location="cpu", weights_only=True)
  ae = vae(input_width=263, output_emb_width=64)
  ae.load_state_dict(read(files / TOKENIZER)["ae"], strict=False)
  model = dit(input_dim=ae.output_emb_width, cond_mode="text", sampling_timesteps=args.num_steps)
  missing, unknown = model.load_state_dict(read(files / DENOISER)["ema_model"], strict=False)
  assert not unknown and all(name.startswith("clip_model.") for name in missing), (missing, unknown)
  mean, std = (np.load(files / "datasets" / "HumanML3D" / f"{name}.npy") for name in ("Mean", "Std"))
  device = torch.device(args.device)
  ae, model = ae.eval().to(device), model.eval().to(device)
  folder = pathlib.Path(args.prompts)
  lines = [json.loads(line) for line in (folder / "prompts.jsonl").read_text().splitlines()]
  lines = [line for line in lines if not (folder / line["file"]).exists()]
  drawn = torch.randn
  for first in range(0, len(lines), BATCH):
    batch = lines[first:first + BATCH]
    counts = [line["frames"] // 4 for line in batch]
    noise = np.zeros((len(batch), max(counts), 1, 64), np.float32)
    for row, line, count in zip(noise, batch, counts):
      row[:count, 0] = np.load(folder / "noise" / f"{line['seed']}.npy")[:count]
    torch.randn = lambda *shape, noise=noise, **_: torch.from_numpy(noise).to(device)
    try:
      latents = model.generate([line["caption"] for line in batch], torch.tensor(counts), args.scale)
    finally:
      torch.randn = drawn
    latents = latents[:, :, 0]
    made = ae.decode(latents if ae.encode_dim == "b l d" else latents[:, :, None]).cpu().numpy()
    for line, motion in zip(batch, made.reshape(len(batch), -1, 263)):
      (folder / line["file"]).parent.mkdir(parents=True, exist_ok=True)
      np.save(folder / line["file"], (motion * std + mean)[:line["frames"]].astype(np.float32))
    print(f"PyTorch: {first + len(batch)} of {len(lines)} motions", flush=True)


def lookalikes(args):
  """Random weights in the released files, with what a training leaves beside them."""
  torch.manual_seed(0)
  dit, vae = modules(args.code)
  ae, model = vae(input_width=263, output_emb_width=64), dit(input_dim=64, cond_mode="text")
  for one in model.parameters():  # gates that begin at 0 would hide mistakes
    if not one.any():
      torch.nn.init.normal_(one, std=0.02)
  state = {name: value for name, value in model.state_dict().items() if not name.startswith("clip_model.")}
  _save(args, TOKENIZER, {"ae": ae.state_dict(), "ep": 49, "total_it": 9})
  _save(args, DENOISER, {"model": {name: -value for name, value in state.items()}, "ema_model": state, "ep": 499,
                         "opt_model": torch.optim.AdamW(model.parameters()).state_dict()})
  from utils import evaluators
  for columns, place in EVALUATORS.items():
    _save(args, place, {
        "movement_encoder": evaluators.MovementConvEncoder(columns, 512, 512).state_dict(),
        "text_encoder": evaluators.TextEncoderBiGRUCo(300, 15, 512, 512, "cpu").state_dict(),
        "motion_encoder": evaluators.MotionEncoderBiGRUCo(512, 1024, 512, "cpu").state_dict(), "epoch": 1})
  words = sorted({"sos", "eos", "unk", "a", "person", "walks", "jumps", "runs", "waves", "the", "right", "hand"})
  glove = pathlib.Path(args.files) / "glove"
  glove.mkdir(parents=True, exist_ok=True)
  np.save(glove / "our_vab_data.npy", torch.randn(len(words), 300).numpy())
  for name, value in (("words", words), ("idx", {word: i for i, word in enumerate(words)})):
    (glove / f"our_vab_{name}.pkl").write_bytes(pickle.dumps(value))
  from transformers import DistilBertConfig, DistilBertModel, DistilBertTokenizerFast
  text = pathlib.Path(args.files) / "distilbert"
  DistilBertModel(DistilBertConfig()).save_pretrained(text)
  letters = "abcdefghijklmnopqrstuvwxyz0123456789.,-'"
  (text / "vocab.txt").write_text("\n".join(["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *letters,
                                             *(f"##{letter}" for letter in letters)]) + "\n")
  DistilBertTokenizerFast(str(text / "vocab.txt")).save_pretrained(text)


def _save(args, place, content):
  path = pathlib.Path(args.files) / place
  path.parent.mkdir(parents=True, exist_ok=True)
  torch.save(content, path)


if __name__ == "__main__":
  parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
  parser.add_argument("command", choices=("sample", "lookalikes"))
  parser.add_argument("--code", required=True, help="checkout of YU1ut/CMDM")
  parser.add_argument("--files", required=True, help="folder with checkpoints/, glove/ and datasets/")
  parser.add_argument("--text-encoder", help="folder of distilbert-base-uncased")
  parser.add_argument("--prompts", help="folder of prompts.jsonl and noise/")
  parser.add_argument("--num-steps", type=int, default=50)
  parser.add_argument("--scale", type=float, default=3.0)
  parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
  given = parser.parse_args()
  {"sample": sample, "lookalikes": lookalikes}[given.command](given)
