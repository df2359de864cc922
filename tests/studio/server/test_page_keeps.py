"""The page keeps work through reloads and closed tabs, and blocks where a file is imported; dialogs and ideas."""
import time

import numpy as np
import pytest

from tests.studio.server.browser import needs_a_browser, wait_for, webdriver

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


def _escape(page):
  page.driver.execute_script("document.activeElement.blur()")  # as a button is left that was clicked
  page.keys(webdriver.Keys.ESCAPE)


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
def test_a_tab_that_was_closed_is_taken_over_and_an_open_one_is_not(timeline, address):
  page, driver = timeline, timeline.driver
  _saved(page)
  first = driver.current_window_handle
  driver.switch_to.new_window("tab")
  driver.get(address)
  page.wait("ready")
  assert page.get("blocks") == []  # the project of the other tab
  second = driver.current_window_handle
  driver.switch_to.window(first)
  driver.close()
  driver.switch_to.window(second)
  driver.switch_to.new_window("tab")
  driver.get(address)
  page.wait("ready")
  assert page.prompts() == ["a person walks", "a person jumps"] and page.get("mode") == "timeline"
  third = driver.current_window_handle
  driver.switch_to.window(second)
  driver.close()
  driver.switch_to.window(third)


@pytest.mark.exhaustive
def test_an_import_asks_before_it_touches_the_blocks(timeline, tmp_path, library):
  page, path = timeline, tmp_path / "walk.npy"
  motion = library.pipeline("tiny", "generate")("a person walks", seconds=2.0, seed=1)
  np.save(path, np.asarray(motion.joints, np.float32))
  project, frames = page.get("project"), page.get("frames")
  page.find("#motion-file").send_keys(str(path))
  wait_for(lambda: page.driver.execute_script("return document.getElementById('import-panel').open"))
  assert "the timeline has 2 blocks" in page.find("#import-question").text
  _escape(page)
  assert page.get("project") == project and not page.get("stale") and page.get("frames") == frames
  page.find("#motion-file").send_keys(str(path))
  page.find("#import-panel button[value=instead]").click()
  page.wait(f"stale === false && window.__studio.frames === {motion.num_frames}")
  assert page.prompts() == [] and page.get("figures") == 1
  page.find("#new").click()
  page.wait("figures === 0")
  assert page.get("steps") == 0  # no footprints without a body
  page.control(webdriver.Keys.CONTROL, "z")
  page.wait(f"figures === 1 && window.__studio.frames === {motion.num_frames}")
  page.control(webdriver.Keys.CONTROL, "z")
  page.wait("blocks.length === 2 && window.__studio.stale === false")


@pytest.mark.exhaustive
def test_ideas_are_searched_and_taken_by_keyboard(page):
  page.wait("live.blocks > 0")
  page.find("#ideas-button").click()
  wait_for(lambda: page.all("#ideas [role=option]"))
  field = page.find("#prompt")
  field.clear()
  field.send_keys("kick")
  first = page.driver.execute_async_script("""
    const done = arguments[0], look = () => {
      const options = [...document.querySelectorAll("#ideas [role=option]")];
      if (options.length) done(options[0].dataset.prompt);
      else setTimeout(look, 100);
    };
    look();""")
  field.send_keys(webdriver.Keys.ESCAPE)
  assert not page.find("#ideas").is_displayed() and field.get_attribute("value") == "kick"
  field.send_keys(webdriver.Keys.ARROW_DOWN)
  wait_for(lambda: page.all("#ideas [role=option]"))
  field.send_keys(webdriver.Keys.ARROW_DOWN)
  assert field.get_attribute("aria-activedescendant") and field.get_attribute("aria-expanded") == "true"
  field.send_keys(webdriver.Keys.ENTER)
  assert field.get_attribute("value") == first
  page.wait(f"prompts.includes({first!r})")
