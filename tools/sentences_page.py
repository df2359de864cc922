"""Writes the grammar of prompts into docs/sentences.md, between its two marks, from the tables that the parser uses.

  python tools/sentences_page.py
"""
import pathlib
import textwrap

from motion_jax_studio.language import grammar

PAGE = pathlib.Path(__file__).parents[1] / "docs" / "sentences.md"
BEGIN = "<!-- The grammar: written by tools/sentences_page.py from the rules; edit those instead. -->"
END = "<!-- End of the grammar. -->"
WIDTH = 120


def made():
  """The page with the grammar as it is now."""
  before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
  return f"{before}{BEGIN}\n\n{grammar_page()}\n\n{END}{rest.split(END)[1]}"


def grammar_page():
  """The grammar as Markdown: a section per group of rules, each rule with its examples."""
  return "\n\n".join(f"### {title}\n\n" + "\n\n".join(map(_entry, rules)) for title, rules in grammar.GRAMMAR.items())


def _entry(rule):
  """A rule as Markdown: name, meaning, the words of a connector, and the examples as code."""
  words = ", ".join(f"\"{one}\"" for one in getattr(rule, "words", ()) if one != rule.name)
  also = f" In the same way: {words}." if words else ""
  name = "Comma" if rule.name == "," else rule.name.capitalize()
  text = textwrap.fill(f"**{name}.** {rule.meaning}{also}", WIDTH, break_on_hyphens=False)
  return "\n".join([text, "", "```", *(line for one in rule.examples.items() for line in _example(*one)), "```"])


def _example(sentence, parse):
  line = f"{sentence}  →  {parse}"
  return [line] if len(line) <= WIDTH else [sentence, f"    →  {parse}"]


if __name__ == "__main__":
  PAGE.write_text(made(), encoding="utf-8")
