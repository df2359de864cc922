"""Plain English (style guide, "Comments, docstrings, errors"): words of our own dialect stay out of the rooms listed.

A room is added to CLEAN when it has been rewritten, and never taken off it.
"""
import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).parents[1]
BANNED = re.compile(r"\b(told|asked|anew|led|whoever|nobody|so many|goes on|of it all|"
                    r"who (is|are|has|sits|walks|does|asks|wants|stays|gets))\b", re.IGNORECASE)
CLEAN = ("motion_jax/nets", "motion_jax/quant", "motion_jax/diffusion", "motion_jax/metrics", "motion_jax/convert",
         "motion_jax/control", "motion_jax/latents.py", "motion_jax/shapes.py", "motion_jax/utils/lazy.py")


def files_of(place):
  path = ROOT / place
  assert path.exists(), f"{place} has moved: bring CLEAN up to date"
  return sorted(path.rglob("*.py")) if path.is_dir() else [path]


@pytest.mark.parametrize("path", [path for place in CLEAN for path in files_of(place)],
                         ids=lambda path: str(path.relative_to(ROOT)))
def test_plain_words(path):
  found = [f"{path.name}:{number}: {match[0]!r} in {line.strip()!r}"
           for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
           for match in BANNED.finditer(line)]
  assert not found, "\n".join(found)
