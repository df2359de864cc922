"""The studio's page in a real browser: it plays, takes words, edits, undoes, exports, finds its studio again.

State is read from `window.__studio`. Skipped where selenium (extra `test`) or Chromium is missing. One test of each
kind is slow; the others are exhaustive: page/*.mjs and the tests of the server show their parts without a browser.
"""
import json
import pathlib
import time

import numpy as np
import pytest

from motion_studio.server.app import Studio
from tests.studio.server.browser import Page, needs_a_browser, wait_for, webdriver
from tests.studio.server.conftest import TOKEN, serving

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


@pytest.mark.exhaustive
def test_the_play_head_steps_jumps_and_plays(timeline):
  page = timeline
  page.find("#stage").click()
  page.keys(webdriver.Keys.END)
  last = page.get("frame")
  assert last == page.get("frames") - 1
  page.keys(webdriver.Keys.ARROW_LEFT)
  assert page.get("frame") == last - 1
  page.keys(webdriver.Keys.HOME)
  assert page.get("frame") == 0
  page.keys(" ")
  page.wait("frame > 2")
  page.keys(" ")
  assert not page.get("playing")
  wait_for(lambda: _stays(lambda: page.get("draws")))  # what stays the same is not drawn again
  page.click_at(page.find(".ruler"), 200, 12)
  window = page.get("window")
  wanted = window["start"] + 200 / page.find(".ruler").size["width"] * (window["end"] - window["start"])
  assert abs(page.get("time") - min(wanted, last / 20)) < 0.2
  page.driver.execute_script("document.getElementById('timeline').dispatchEvent(new WheelEvent('wheel', {deltaY: -200,"
                             " clientX: 300, cancelable: true}))")
  closer = page.get("window")
  assert closer["end"] - closer["start"] < window["end"] - window["start"]


@pytest.mark.exhaustive
def test_what_is_exported_opens_elsewhere(timeline):
  from pygltflib import GLTF2

  from motion_jax import export
  page, folder = timeline, timeline.driver.folder
  for old in pathlib.Path(folder).iterdir():  # of another test and the same name: the browser would number the new one
    old.unlink()
  page.find("#export").click()
  page.find("#export-panel[open]")
  wait_for(lambda: page.find("#export-button").is_enabled())  # the formats have come
  for kind in ("bvh", "glb", "npz"):
    page.driver.execute_script(f"document.getElementById('format').value = '{kind}'")
    page.find("#export-button").click()
    name = page.wait(f"exported && window.__studio.exported.name.endsWith('{kind}') && window.__studio.exported.name")
    path = pathlib.Path(folder) / name
    end = time.monotonic() + 20
    while not path.exists() and time.monotonic() < end:
      time.sleep(0.1)
    if kind == "glb":
      assert GLTF2().load(str(path)).animations
    else:
      assert export.load(path).num_frames == page.get("frames")
  joints = np.array(page.get("joints(0, 3)")).reshape(3, 22, 3)
  np.testing.assert_allclose(export.load(path).joints[:3], joints, atol=1e-5)


@pytest.mark.exhaustive
def test_a_project_is_saved_and_opened(timeline, tmp_path):
  page = timeline
  page.find("#save").click()
  path = pathlib.Path(page.driver.folder) / "a-person-walks.json"
  end = time.monotonic() + 20
  while not path.exists() and time.monotonic() < end:
    time.sleep(0.1)
  assert [block["prompt"] for block in json.loads(path.read_text())["blocks"]] == ["a person walks", "a person jumps"]
  frames = page.get("joints(0, 4)")
  page.driver.refresh()
  page.wait("ready && window.__studio.models.length")
  page.find("#mode-timeline").click()
  page.find("#project-file").send_keys(str(path))
  page.wait("blocks.length === 2 && window.__studio.stale === false")
  assert page.get("joints(0, 4)") == frames
  cut = tmp_path / "cut.json"
  cut.write_text(path.read_text()[:200])
  page.find("#project-file").send_keys(str(cut))
  page.wait("errors.some((one) => one.includes('cut'))")
  assert page.prompts() == ["a person walks", "a person jumps"]  # nothing is lost
  assert page.find("#notes").text


@pytest.mark.exhaustive
def test_it_finds_a_studio_again_that_was_started_again(driver, library):
  with serving(Studio(library, TOKEN)) as (port, address):
    driver.get(address)
    page = Page(driver)
    page.wait("live.blocks > 0")
  page.wait("live.connected === false")
  page.wait("status.startsWith('not connected')")  # after a moment of "connecting"
  assert page.get("status") == "not connected: waiting for the studio"
  page.find("#mode-timeline").click()
  page.driver.execute_script("document.getElementById('auto').checked = false")
  page.add_block("a person walks")
  with serving(Studio(library, TOKEN), port):
    page.wait("live.connected")
    page.find("#mode-live").click()
    page.wait("live.reconnects === 1 && window.__studio.live.blocks > 0")
    assert any("the studio is back" in note for note in page.get("notes"))
    assert not page.find("#notes").find_elements("css selector", ".error")  # the cause has gone
    assert page.get("blocks.length") == 1  # nothing is lost
    driver.get("about:blank")


def _stays(value):
  before = value()
  time.sleep(0.5)
  return value() == before
