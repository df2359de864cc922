"""Makes motion_jax_studio/assets/suggestions.json: what the shipped model can do, each with a small moving figure.

  python tools/suggestions.py

A prompt is kept if the model knows its words and the motion meets the prompt's requirements; prompts whose figures did
not show what they say were taken out of the list below by eye. A figure is 22 joints seen from the front and a little
from the side: int8 of a sixtieth of a metre, x to the right and y up, with the pelvis at x = 0.
"""
import base64
import json
import pathlib

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils import cache
from motion_jax_studio import Pipeline

OUT = pathlib.Path(__file__).parents[1] / "motion_jax_studio" / "assets" / "suggestions.json"
SECONDS, FPS, SCALE = 4.0, 8, 60  # length of a figure, frames a second, steps a metre
SIDE = np.radians(25.0)           # from where the body is seen, 0 is in front of it

PROMPTS = {
    "walk and run": """walks forward; walks slowly; walks fast; walks backward; walks in a curve to the left;
      walks in a curve to the right; runs forward; runs in a circle; jogs forward; walks with long steps; walks
      with small steps; marches; walks like a zombie; walks like an old person; walks with a limp; walks
      happily; walks sadly; walks angrily; walks proudly""",
    "turn and stand": """stands still; turns around; turns left; turns right; steps to the left; steps to the
      right; takes a step back""",
    "sit, lie and kneel": """sits down; stands up from a chair; sits on a chair; squats; ducks""",
    "jump and exercise": """jumps up; jumps up and down; leaps; walks up the stairs; jumps forward; hops on one leg;
      does squats; stretches the arms; swings the arms;
      bends to the side; bends forward""",
    "arms and hands": """waves the right hand; waves the left hand; waves both hands; raises both arms; raises
      the right arm; raises the left arm; points forward with the right hand; bows; throws something with the
      right hand; throws a ball; drinks from a cup""",
    "fight": """punches with the right hand; punches with the left hand; boxes; kicks with the right leg; kicks
      with the left leg; blocks; swings a sword; draws a sword""",
    "dance and sport": """dances; dances ballet; dances salsa; dances happily; kicks a ball; balances on one
      leg""",
    "feel": """is happy and jumps; cheers; laughs""",
}


def figure(joints, fps):
  """(n, 22, 2) int8 of joints (T, 22, 3)."""
  joints = np.asarray(joints, np.float64)[np.arange(0, len(joints), fps / FPS).astype(int)]
  across = joints[0, 1, [0, 2]] - joints[0, 2, [0, 2]]  # from the right hip to the left one
  heading = np.arctan2(-across[1], across[0]) + SIDE
  x = joints @ [np.cos(heading), 0.0, -np.sin(heading)]
  points = np.stack([x - x[:, :1], joints[..., 1]], -1)
  return np.clip(np.round(points * SCALE), -127, 127).astype(np.int8)


def rows_of(pipeline, kind, prompts):
  """The suggestions of these prompts that the model does as they say."""
  model = pipeline.model
  known = [prompt for prompt in prompts if not model.captions.unknown_words(prompt)]
  made = pipeline(known, seconds=SECONDS, seeds=[0] * len(known))
  kept = [(prompt, motion) for prompt, motion in zip(known, made) if not motion.meta.get("unmet")]
  print(f"{kind}: without", sorted(set(prompts) - {prompt for prompt, _ in kept}))
  return [{"prompt": prompt, "kind": kind,
           "figure": base64.b64encode(figure(motion.joints, model.fps).tobytes()).decode()} for prompt, motion in kept]


def main():
  cache.keep_in_user_cache()
  pipeline = Pipeline("cmdm-small")
  pipeline.warns = False
  rows = [row for kind, text in PROMPTS.items()
          for row in rows_of(pipeline, kind, [f"a person {' '.join(words.split())}" for words in text.split(";")])]
  head = {"fps": FPS, "scale": SCALE, "parents": [int(parent) for parent in HUMANML3D.parents]}
  lines = ",\n".join(json.dumps(row) for row in rows)
  OUT.write_text(json.dumps(head)[:-1] + ', "rows": [\n' + lines + "\n]}\n")
  print(f"{len(rows)} suggestions, {OUT.stat().st_size / 1024:.0f} KB")


if __name__ == "__main__":
  main()
