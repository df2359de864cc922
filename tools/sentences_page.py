"""The grammar of prompts in docs/sentences.md, between two marks, from the tables that the parser uses.

`python tools/build_docs.py` writes it.
"""
import pathlib
import textwrap

from motion_jax_studio.language import grammar

PAGE = pathlib.Path(__file__).parents[1] / "docs" / "sentences.md"
BEGIN = "<!-- The grammar: written by tools/build_docs.py from the rules; edit those instead. -->"
END = "<!-- End of the grammar. -->"
WIDTH = 120


def page():
  """The page with the grammar as it is now."""
  before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
  return f"{before}{BEGIN}\n\n{grammar_page()}\n\n{END}{rest.split(END)[1]}"


def grammar_page():
  """The grammar as Markdown: a section per group of rules, each rule with its examples."""
  return "\n\n".join(f"### {title}\n\n" + "\n\n".join(map(_entry, rules)) for title, rules in grammar.GRAMMAR.items())


def _entry(rule):
  """A rule as Markdown: name, meaning, the words of a connector, and the examples as code."""
  words = ", ".join(f"\"{word}\"" for word in getattr(rule, "words", ()) if word != rule.name)
  also = f" In the same way: {words}." if words else ""
  name = "Comma" if rule.name == "," else rule.name.capitalize()
  text = textwrap.fill(f"**{name}.** {rule.meaning}{also}", WIDTH, break_on_hyphens=False)
  examples = [line for example in rule.examples.items() for line in _example(*example)]
  return "\n".join([text, "", "```", *examples, "```"])


def _example(sentence, parse):
  line = f"{sentence}  →  {parse}"
  return [line] if len(line) <= WIDTH else [sentence, f"    →  {parse}"]
