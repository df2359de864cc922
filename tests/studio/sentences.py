"""Tables of sentences, tests/fixtures/sentences/NAME.txt: one a line, with what it means behind "=>"."""
import pathlib

FOLDER = pathlib.Path(__file__).parents[1] / "fixtures" / "sentences"


def table(name):
  """[(sentence, meaning)], the meaning "" where a line has none; lines that begin with "# " are headings."""
  lines = (FOLDER / f"{name}.txt").read_text(encoding="utf-8").splitlines()
  rows = [line.partition("=>") for line in lines if line and not line.startswith("# ")]
  return [(sentence.strip(), meaning.strip()) for sentence, _, meaning in rows]


def in_words(requirements):
  """Requirements as the tables have them: "kick/left x2 exactly, turn 50 to 130 degrees"."""
  return ", ".join(kind + (f"/{side}" if side else "") + (f" x{times}" if times != 1 else "")
                   + (" exactly" if counted else "") + (f" {degrees[0]:g} to {degrees[1]:g} degrees" if degrees else "")
                   for kind, side, times, counted, degrees in requirements)
