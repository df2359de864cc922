"""docs/sentences.md shows the grammar that the parser has."""
from motion_studio.language import grammar
from tools import sentences_page


def test_the_page_is_up_to_date():
  page = sentences_page.PAGE.read_text(encoding="utf-8")
  assert page == sentences_page.made(), "run python tools/sentences_page.py"
  assert all(sentence in page for _, sentence, _ in grammar.examples())
