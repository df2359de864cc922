"""The page keeps work through reloads and closed tabs."""
import time

import pytest

from tests.studio.server.browser import needs_a_browser, webdriver

pytestmark = [pytest.mark.slow, needs_a_browser]
KEPT = ("project", "mode", "span", "selection", "undoDepth", "frames", "frame", "made")


def _edited(page):
  """A timeline of two blocks with a span that has been changed; the span stays marked."""
  window = page.get("window")
  second = page.find(".strip").size["width"] / (window["end"] - window["start"])
  page.drag(page.find(".strip"), int(second * 0.6), x=second * 0.5)
  page.find("#edit-prompt").send_keys("a person kicks")
  page.driver.execute_script("document.getElementById('edit-row').requestSubmit()")
  page.wait("made && window.__studio.busy === null")


def _saved(page):
  page.wait("kept.works && !window.__studio.kept.pending")
  time.sleep(0.3)  # the browser writes


def test_a_reload_loses_nothing(timeline, studio, monkeypatch):
  page = timeline
  _edited(page)
  page.driver.execute_script("document.activeElement.blur()")
  page.keys(webdriver.Keys.HOME, *[webdriver.Keys.ARROW_RIGHT] * 14)
  page.wait("editColors[0] === true")
  assert page.find("#caption").text == "a person kicks" and page.find("#legend").text.split() == ["kept", "regenerated"]
  page.keys(webdriver.Keys.END)
  before, joints = {name: page.get(name) for name in KEPT}, page.get("joints(0, 20)")
  _saved(page)
  monkeypatch.setattr(studio.handler, "make_multi_prompt", lambda *words, **more: 1 / 0)  # nothing is made again
  page.driver.refresh()
  page.wait("ready && window.__studio.blocks.length === 2")
  assert {name: page.get(name) for name in KEPT} == before and page.get("joints(0, 20)") == joints
  assert not page.get("stale") and "your project was restored" in page.get("notes")[0]
  page.control(webdriver.Keys.CONTROL, "z")
  assert page.get("undoDepth") == before["undoDepth"] - 1 and not page.get("project.edits")
  page.wait("stale === false")  # the motion before the edit was kept as well
  page.control(webdriver.Keys.CONTROL, webdriver.Keys.SHIFT, "z")
  assert page.get("project") == before["project"]
  _saved(page)
  assert not page.get("leaving")
  page.wait("live.run > 0 && window.__studio.live.state === 'paused'")  # behind the timeline the live motion waits


@pytest.mark.exhaustive
def test_a_tab_that_was_closed_is_taken_over_and_an_open_one_is_not(timeline, address_below_a_path):
  page, driver = timeline, timeline.driver
  _saved(page)
  tabs = [driver.current_window_handle]
  for expected in ([], ["a person walks", "a person jumps"]):  # while the first tab is open, and after it was closed
    driver.switch_to.new_window("tab")
    driver.get(address_below_a_path)
    page.wait("ready")
    assert [block["prompt"] for block in page.get("blocks")] == expected
    tabs.append(driver.current_window_handle)
    driver.switch_to.window(tabs.pop(0))
    driver.close()
    driver.switch_to.window(tabs[-1])
