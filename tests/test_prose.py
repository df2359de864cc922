"""Plain English (style guide, "Comments, docstrings, errors"): words of our own dialect stay out of code and pages.

A room is added to CLEAN when it has been rewritten, and never taken off it. Pages are all checked but those of
UNFINISHED; what stands in quotation marks or in code is not prose.
"""
import argparse
import pathlib
import re

from motion_jax_studio import cli

ROOT = pathlib.Path(__file__).parents[1]
ASSETS = ROOT / "motion_jax_studio" / "assets"
BANNED = re.compile(r"\b(told|asked|anew|led|whoever|nobody|so many|goes on|of it all|"
                    r"who (is|are|has|sits|walks|does|asks|wants|stays|gets))\b", re.IGNORECASE)
CLEAN = ("motion_jax/training", "motion_jax/fit.py", "configs", "motion_jax/nets",
         "motion_jax/quant", "motion_jax/diffusion", "motion_jax/metrics", "motion_jax/convert", "motion_jax/control",
         "motion_jax/analysis", "motion_jax/utils", "motion_jax/retrieval.py", "motion_jax/export", "motion_jax/data",
         "motion_jax/motion", "motion_jax/models",
         "motion_jax/text", "motion_jax/latents.py", "motion_jax/shapes.py",
         "motion_jax_studio/language", "motion_jax_studio/checks", "motion_jax_studio/planning",
         "motion_jax_studio/posing",
         "motion_jax_studio/pipeline.py", "motion_jax_studio/steps.py", "motion_jax_studio/constraining.py",
         "motion_jax_studio/editing.py", "motion_jax_studio/resampling.py",
         "motion_jax_studio/streaming.py", "motion_jax_studio/blending.py",
         "motion_jax/evaluation", "motion_jax/evaluators",
         "motion_jax/runs.py", "motion_jax/paper_tables.py", "motion_jax/charts.py", "tools",
         "benchmarks", "examples",
         "motion_jax_studio/server", "motion_jax_studio/cli", "motion_jax_studio/client.py", "blender")
WORD_LISTS = ("motion_jax/text/lexicon.py", "motion_jax_studio/language/lexicon.py")  # data, not prose
UNFINISHED = ("docs/benchmark/control",)
PAGES = [path for path in sorted({*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"),
                                  *(ROOT / "motion_jax" / "pretrained").glob("*/README.md")})
         if not str(path.relative_to(ROOT)).startswith(UNFINISHED)]


def files_of(place):
  path = ROOT / place
  assert path.exists(), f"{place} has moved: bring CLEAN up to date"
  files = sorted(path.rglob("*.py")) if path.is_dir() else [path]
  return [path for path in files if str(path.relative_to(ROOT)) not in WORD_LISTS]


def banned_words(text):
  """["line number: word in line", ...] of a text."""
  return [f"{number}: {match[0]!r} in {line.strip()!r}" for number, line in enumerate(text.splitlines(), 1)
          for match in BANNED.finditer(line)]


def prose_of(page):
  """A Markdown page without code and without what stands in quotation marks; lines keep their numbers."""
  blank = lambda match: "\n" * match[0].count("\n")
  return re.sub(r'"[^"\n]*"|`[^`\n]+`', "", re.sub(r"(?ms)^```.*?^```", blank, page))


def offenders(texts):
  """["place:line: word in line", ...] of {place: text}."""
  return [f"{place}:{line}" for place, text in texts.items() for line in banned_words(text)]


def read(paths):
  return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}


def test_plain_words_in_code():
  code = read(path for place in CLEAN for path in files_of(place))
  assert len(code) > 400 and not (lines := offenders(code)), "\n".join(lines)


def test_plain_words_in_pages():
  pages = {place: prose_of(text) for place, text in read(PAGES).items()}
  assert len(pages) > 60 and not (lines := offenders(pages)), "\n".join(lines)


def test_plain_words_in_the_studios_page():
  files = read(path for kind in ("js", "html", "css") for path in ASSETS.glob(f"*.{kind}"))
  assert len(files) > 5 and not (lines := offenders(files)), "\n".join(lines)


def _helps(parser):
  """(program, help) of a parser and of its sub-commands."""
  yield parser.prog, parser.format_help()
  for action in parser._actions:
    if isinstance(action, argparse._SubParsersAction):
      for command in dict.fromkeys(action.choices.values()):
        yield from _helps(command)


def test_plain_words_in_help_texts():
  helps = dict(_helps(cli._parser()))
  assert len(helps) > 15 and not (lines := offenders(helps)), "\n".join(lines)


def test_quotations_and_code_are_no_prose():
  page = 'It says "a person is told".\n```\nasked\n```\n`told` is a field.\nMade anew.\n'
  assert banned_words(prose_of(page)) == ["6: 'anew' in 'Made anew.'"]
