"""Writes the grammar of prompts into docs/sentences.md, between its two marks, from the tables that the parser uses.

  python tools/sentences_page.py
"""
import pathlib

from motion_studio.language import grammar

PAGE = pathlib.Path(__file__).parents[1] / "docs" / "sentences.md"
BEGIN = "<!-- The grammar: written by tools/sentences_page.py from motion_studio/language; edit the rules instead. -->"
END = "<!-- End of the grammar. -->"


def made():
  """The page with the grammar as it is now."""
  before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
  return f"{before}{BEGIN}\n\n{grammar.page()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
  PAGE.write_text(made(), encoding="utf-8")
