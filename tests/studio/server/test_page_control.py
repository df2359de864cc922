"""Paths and poses that are asked for in the studio's page, in a real browser (see test_page.py)."""
import numpy as np
import pytest

from tests.studio.server.browser import needs_a_browser, webdriver

pytestmark = [pytest.mark.slow, needs_a_browser]


def click_floor(page, x, z, button=None):
  """Clicks a point of the floor, metres; button: "right", or the point (x, z) to which it is dragged."""
  left, top = page.driver.execute_script("return window.__studio.screenOf(arguments[0], arguments[1])", x, z)
  chain = webdriver.ActionChains(page.driver, duration=50)
  chain.w3c_actions.pointer_action.move_to_location(round(left), round(top))
  if button == "right":
    chain.w3c_actions.pointer_action.context_click()
  elif button is None:
    chain.w3c_actions.pointer_action.click()
  else:
    left, top = page.driver.execute_script("return window.__studio.screenOf(arguments[0], arguments[1])", *button)
    chain.w3c_actions.pointer_action.pointer_down()
    chain.w3c_actions.pointer_action.move_to_location(round(left) - 9, round(top))
    chain.w3c_actions.pointer_action.move_to_location(round(left), round(top))
    chain.w3c_actions.pointer_action.pointer_up()
  chain.perform()


def path_of(page, count=None):
  """Points of the path that is asked for, once it has so many."""
  if count:
    page.wait(f"control.find((one) => one.type === 'root_path')?.points.length === {count}")
  return np.array(next((one["points"] for one in page.get("control") if one["type"] == "root_path"), []))


def test_a_path_is_drawn_followed_and_undone(timeline):
  """It belongs to the selected block alone; blocks are chosen and sized by keys."""
  page = timeline
  page.find("#stage").click()
  page.keys(webdriver.Keys.ARROW_UP)
  first = page.get("blocks")[0]
  assert page.get("selection") == first["id"]
  page.control(webdriver.Keys.SHIFT, webdriver.Keys.ARROW_DOWN)
  seconds = page.get("blocks")[0]["seconds"]
  assert first["seconds"] - 0.6 <= seconds < first["seconds"]
  page.find("#draw-path").click()
  for x, z in ((0.5, 0), (1.0, 0.8), (0.3, 1.4), (-0.6, 1.2)):
    click_floor(page, x, z)
  assert np.abs(path_of(page, 4) - [[0.5, 0], [1.0, 0.8], [0.3, 1.4], [-0.6, 1.2]]).max() < 0.03
  page.wait("marks.points === 4")
  assert page.get("busy") is None  # nothing is made of half a path
  click_floor(page, 1.0, 0.8, button=(1.3, 0.5))
  assert np.abs(path_of(page, 4)[1] - [1.3, 0.5]).max() < 0.03
  click_floor(page, 0.3, 1.4, button="right")
  path_of(page, 3)
  page.keys(webdriver.Keys.DELETE)
  path_of(page, 2)
  for _ in range(2):
    page.control(webdriver.Keys.CONTROL, "z")
  assert len(path_of(page, 4)) == 4 and page.prompts() == ["a person walks", "a person jumps"]
  page.keys(webdriver.Keys.ESCAPE)
  assert not page.get("drawing")
  page.wait("stale === false && window.__studio.busy === null && window.__studio.report")
  times, last = page.get("control")[0]["times"], round(20 * seconds) - 1
  assert times[0] == 0 and times[-1] == last / 20
  joints = np.array(page.get(f"joints({last}, {last + 1})")).reshape(22, 3)
  assert np.abs(joints[0, [0, 2]] - path_of(page)[-1]).max() < 5e-3
  assert "off by" in page.find("#off").text and page.get("report.off.worst") < 10
  page.find("#stage").click()
  page.keys(webdriver.Keys.HOME, *[webdriver.Keys.ARROW_RIGHT] * 24)
  page.find("#keep-pose").click()
  page.wait("stale === false && window.__studio.busy === null && window.__studio.marks.poses === 1")
  assert [one["type"] for one in page.get("control")] == ["root_path", "keyframe"]
  assert len(page.all("#constraints .chip")) == 2 and not page.get("errors")
  page.find("#constraints .chip:last-child button:last-child").click()
  assert len(page.get("control")) == 1
  page.control(webdriver.Keys.CONTROL, "z")
  assert len(page.get("control")) == 2
