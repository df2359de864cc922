"""A stream of motion by numpy and onnxruntime alone: python examples/onnx_stream.py GRAPHS "a person walks" walk.npy"""
import json
import pathlib
import sys

import numpy as np
import onnxruntime
from onnx_noise import normal
from onnx_words import word_pieces

folder, prompt, out, seed, num_blocks = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3], 0, 10
about = json.loads((folder / "model.json").read_text(encoding="utf-8"))
c, graphs = about["constants"], about["graphs"]
session = {name: onnxruntime.InferenceSession(folder / graph["file"]) for name, graph in graphs.items()}
# What a graph hands on to its next run begins as model.json says.
state = {name: {one["name"]: np.broadcast_to(np.array(graph["state"][one["name"]]["start"], one["type"]), one["shape"])
                for one in graph["inputs"] if one["name"] in graph["state"]} for name, graph in graphs.items()}


def run(name, **inputs):
  outputs = [one["name"] for one in graphs[name]["outputs"]]
  made = dict(zip(outputs, session[name].run(outputs, {**inputs, **state[name]})))
  state[name] = {key: made[after["next"]] for key, after in graphs[name]["state"].items()}
  return made


ids = word_pieces(about["tokenizer"], prompt, c["words"])
mask = np.arange(c["words"]) < len(ids)
words = run("text", ids=np.pad(ids, (0, len(mask) - len(ids)))[None].astype(np.int32), mask=mask[None])
# One caption, in the first of the places that a window has; a change of prompt fills another one.
text = {name: np.stack([words[name]] * c["captions"]) for name in ("text_k", "text_v")}
caption, since = np.zeros((1, c["width"]), np.int32), np.full((1, c["width"]), -2**30, np.int32)
ends, joints = {"past": np.array(0, np.int32), "length": np.array(num_blocks * c["block"], np.int32)}, []
for step in range(c["age"] - 1 + num_blocks):
  noise = normal(seed, step, (1, c["block"], c["latent_dim"]))
  clean = run("step", noise=noise, steps=np.array(step, np.int32), **ends, caption=caption, since=since, **text,
              text_mask=np.stack([mask] * c["captions"]))["clean"]
  if step >= c["age"] - 1:  # the first blocks are still noisy
    joints.append(run("joints", features=run("decoder", latents=clean)["features"])["joints"][0])
np.save(out, np.concatenate(joints))
