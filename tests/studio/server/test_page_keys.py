"""The body is posed in the studio's page and its keys are met, in a real browser (see test_page.py)."""
import numpy as np
import pytest

from tests.studio.server.browser import needs_a_browser, webdriver

pytestmark = [pytest.mark.slow, needs_a_browser]


def _at(page, handle):
  return page.driver.execute_script("return window.__studio.handleAt(arguments[0])", handle)


def _drag(page, handle, right, down, steps=3):
  """Drags a handle of the body by pixels to the right and down, as far as the window goes."""
  left, top, _ = _at(page, handle)
  width, height = page.driver.execute_script("return [innerWidth, innerHeight]")
  right, down = min(right, width - 4 - left), min(down, height - 4 - top)
  chain = webdriver.ActionChains(page.driver, duration=30)
  pointer = chain.w3c_actions.pointer_action
  pointer.move_to_location(round(left), round(top)).pointer_down()
  for step in range(1, steps + 1):
    pointer.move_to_location(round(left + right * step / steps), round(top + down * step / steps))
  pointer.pointer_up()
  chain.perform()


def _made(page):
  page.wait("stale === false && window.__studio.busy === null")


def _joints(page):
  frames = page.get("frames")
  return np.array(page.get(f"joints(0, {frames})")).reshape(frames, 22, 3)


def _still(page, frame):
  """Goes to a frame, without a camera that follows, and waits until it is drawn."""
  page.driver.execute_script("document.getElementById('follow').checked && document.getElementById('follow').click()")
  for centre in (False, True):  # on the body of this frame, so that all handles are in the view
    draws = page.get("draws")
    page.driver.execute_script("arguments[1] && document.getElementById('centre').click();"
                               "window.__studio.seek(arguments[0] / 20)", frame, centre)
    page.wait(f"frame === {frame} && window.__studio.draws > {draws}")


def test_a_hand_is_dragged_keyed_and_met(timeline):
  """The frames outside the span stay equal bit for bit; a preview comes at once; undo, reload and save keep the key."""
  page = timeline
  before = _joints(page)
  _still(page, 30)
  _drag(page, "left_hand", 30, -40)
  assert page.get("previewTime") < 50 * 4  # Chromium draws in software here, beside other work
  keys = page.get("keys")
  assert [(key["track"], key["frame"]) for key in keys] == [("left_hand", 30)]
  assert page.get("preview") or page.get("stale") is False
  edit, = page.get("project.edits")
  (key,), ((first, past),) = edit["control"]["constraints"], edit["change"]
  _made(page)
  after, kept = _joints(page), [*range(first), *range(past, len(before))]
  assert (after[kept] == before[kept]).all() and not (after[30] == before[30]).all()
  assert np.abs(after[30, 20] - key["positions"][0]).max() < 1e-3
  page.keys("k")
  assert [key["track"] for key in page.get("keys")] == ["left_hand", "pose"] or (
      {key["track"] for key in page.get("keys")} == {"left_hand", "pose"})
  page.control(webdriver.Keys.CONTROL, "z")
  assert page.get("keys") == keys
  page.wait("kept.pending === false")
  page.driver.refresh()
  page.wait("ready")
  page.wait("keys.length === 1")
  assert page.get("keys") == keys and page.get("project.edits") == [edit] and not page.get("errors")


def test_keys_are_selected_moved_copied_and_deleted(timeline):
  page = timeline
  _still(page, 20)
  _drag(page, "right_hand", -20, -30)
  assert page.get("selectedKeys") == [{"track": "right_hand", "frame": 20}]
  dot = page.find(".key")
  second = page.find("#timeline").size["width"] / (page.get("window.end") - page.get("window.start"))
  page.drag(dot, round(0.5 * second))
  assert [key["frame"] for key in page.get("keys")] == [30]
  _still(page, 44)
  page.control(webdriver.Keys.CONTROL, "d")
  assert [key["frame"] for key in page.get("keys")] == [30, 44]
  page.driver.execute_script("const s = document.getElementById('key-slack'); s.value = 3; s.onchange()")
  _made(page)
  assert not page.get("errors")
  page.find("#stage").click()
  page.keys(webdriver.Keys.ESCAPE)
  assert page.get("selectedKeys") == []
  page.find(".key").click()
  page.keys("x")
  assert [key["frame"] for key in page.get("keys")] == [44]
  _still(page, 10)
  _drag(page, "hips", 260, 0)  # farther than a body can lean
  assert "hips" in [key["track"] for key in page.get("keys")] and not page.get("rings")
  pelvis = page.get("project.edits.at(-1).control.constraints[0].positions[0]")
  assert np.isfinite(pelvis).all() and np.abs(pelvis).max() < 5


def test_the_body_has_its_share_of_the_window(timeline):
  page = timeline
  page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
      "width": 1280, "height": 720, "deviceScaleFactor": 1, "mobile": False})
  try:
    _still(page, 20)
    _drag(page, "left_hand", 10, -20)
    share, gap = page.driver.execute_script("""const box = (id) => document.getElementById(id).getBoundingClientRect();
        return [box('stage').height / innerHeight, box('stage').top - box('notes').bottom]""")
    assert share >= 0.55 and gap >= 0  # notes are above the body
    unnamed = page.driver.execute_script("""
        const named = (one) => one.labels?.length || one.ariaLabel || one.textContent.trim() || one.title;
        return [...document.querySelectorAll('button, input, select, [role=separator]')]
          .filter((one) => one.checkVisibility() && !named(one)).map((one) => one.outerHTML)""")
    assert not unnamed
  finally:
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
