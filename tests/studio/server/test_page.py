"""The studio's page in a real browser: it plays, takes words, edits, undoes.

State is read from `window.__studio`. Skipped where selenium (extra `test`) or Chromium is missing. What else the page
does is shown without a browser, by page/*.mjs and the tests of the server.
"""
import time

import pytest

from tests.studio.server.browser import needs_a_browser, webdriver

pytestmark = [pytest.mark.slow, needs_a_browser]


def test_a_live_motion_takes_words_pauses_and_begins_again(page):
  """New words change what has not begun and nothing before; the same seed gives the same motion."""
  page.wait("live.blocks > 2 && window.__studio.live.played > 0.3")
  assert page.get("figures") == 1 and page.get("live.connected") and page.get("status") == "live"
  page.find("#stage").click()
  page.keys(" ")
  page.wait("live.state === 'paused'")
  played, first = page.get("live.played"), page.get("joints(0, 8)")
  time.sleep(0.5)
  assert page.get("live.played") == played
  page.keys(webdriver.Keys.ARROW_LEFT)
  assert page.get("time") < played
  page.keys(" ")
  page.wait(f"live.played > {played}")
  page.find("#restart").click()
  page.wait("live.run === 2 && window.__studio.live.blocks > 2")
  assert page.get("joints(0, 8)") == first
  field = page.find("#prompt")
  field.clear()
  committed, begun = page.get("live.committed"), page.get("live.begun")
  before = page.get(f"joints(0, {committed})")
  field.send_keys("a person jumps", webdriver.Keys.ENTER)
  words = page.wait("live.words.find((one) => one.prompt === 'a person jumps')")
  per_block = page.get("live.blockFrames")
  # The page hears of frames a little after they have been made, so a block more may have begun meanwhile.
  assert committed <= words["from"] <= begun + 4 * per_block
  page.wait(f"live.end > {words['from']} + {per_block}")
  assert page.get(f"joints(0, {committed})") == before and not page.get("errors")


def test_blocks_are_edited_with_the_habits_of_editors(timeline):
  page = timeline
  page.double_click(page.block(0)).send_keys("a person runs", webdriver.Keys.ENTER)  # the old words are marked
  assert page.prompts() == ["a person runs", "a person jumps"]
  length = page.get("blocks[0].seconds")
  page.drag(page.block(0).find_element("css selector", ".edge"), 120)
  assert page.get("blocks[0].seconds") > length
  page.drag(page.block(0), 500)
  assert page.prompts() == ["a person jumps", "a person runs"]
  page.control(webdriver.Keys.CONTROL, "z")
  assert page.prompts() == ["a person runs", "a person jumps"]
  page.control(webdriver.Keys.CONTROL, webdriver.Keys.SHIFT, "z")
  assert page.prompts() == ["a person jumps", "a person runs"]
  depth = page.get("undoDepth")
  webdriver.ActionChains(page.driver).context_click(page.block(1)).perform()
  assert page.prompts() == ["a person jumps"]
  page.block(0).click()
  page.keys(webdriver.Keys.DELETE)
  assert page.prompts() == [] and page.get("undoDepth") == depth + 2
  page.control(webdriver.Keys.CONTROL, "z")
  page.control(webdriver.Keys.CONTROL, "z")
  page.wait("stale === false && window.__studio.busy === null")
  assert page.prompts() == ["a person jumps", "a person runs"] and not page.get("errors")
  page.find("#details").click()  # what each step did, in one line each
  page.wait("busy === null && document.getElementById('figures').textContent.includes('sample: 2 prompts in sequence')")
  assert page.find("#figures").get_attribute("title").splitlines()[0] == "plan: a person jumps | a person runs"
