"""One tab of a studio in a real browser. Needs selenium, of the extra `test`."""
import contextlib
import shutil
import time

import pytest

webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium, of the extra `test`")
JavascriptException = pytest.importorskip("selenium.common.exceptions").JavascriptException
PATIENCE = 90  # seconds
CHROMIUM, DRIVER = (shutil.which(name) for name in ("chromium", "chromedriver"))
needs_a_browser = pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs a browser, chromium with its "
                                     "chromedriver (Debian: apt install chromium chromium-driver)")


class Page:
  """One tab of a studio."""

  def __init__(self, driver):
    self.driver = driver

  def get(self, expression):
    return self.driver.execute_script(f"return window.__studio && window.__studio.{expression}")

  def wait(self, expression, seconds=PATIENCE):
    """Until an expression of `__studio` is true; what it is."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
      with contextlib.suppress(JavascriptException):  # of what is not there yet
        if found := self.get(expression):
          return found
      time.sleep(0.1)
    raise AssertionError(f"{expression} did not become true: {self.get('status')}, errors {self.get('errors')}, "
                         f"notes {self.get('notes')}, live {self.get('live')}")

  def find(self, selector):
    return self.driver.find_element("css selector", selector)

  def all(self, selector):
    return self.driver.find_elements("css selector", selector)

  def keys(self, *keys):
    webdriver.ActionChains(self.driver).send_keys(*keys).perform()

  def control(self, *keys):
    chain = webdriver.ActionChains(self.driver)
    for key in keys[:-1]:
      chain.key_down(key)
    chain.send_keys(keys[-1])
    for key in keys[:-1]:
      chain.key_up(key)
    chain.perform()

  def click_at(self, element, x, y):
    """Clicks x, y pixels from an element's upper left corner."""
    box = element.size
    chain = webdriver.ActionChains(self.driver)
    chain.move_to_element_with_offset(element, x - box["width"] // 2, y - box["height"] // 2).click().perform()

  def drag(self, element, by, x=None):
    """Drags from x pixels into an element (its middle) so many pixels to the right."""
    chain = webdriver.ActionChains(self.driver)
    start = 0 if x is None else x - element.size["width"] // 2
    chain.move_to_element_with_offset(element, int(start), 0).click_and_hold()
    chain.move_by_offset(by // 2, 0).move_by_offset(by - by // 2, 0).release().perform()

  def block(self, number):
    """A block's element, counted from the left."""
    return sorted(self.all(".block"), key=lambda element: element.location["x"])[number]

  def double_click(self, element):
    """The field of words that a double click opens; the driver's two clicks are one each where the machine is slow."""
    for _ in range(5):
      webdriver.ActionChains(self.driver).double_click(element).perform()
      if fields := self.all(".words"):
        return fields[0]
    raise AssertionError("a double click opened nothing")

  def add_block(self, words):
    """Clicks into the empty part of the track and types."""
    track = self.find(".track")
    blocks = self.all(".block")
    x = max((b.location["x"] + b.size["width"] - track.location["x"] for b in blocks), default=10) + 12
    self.click_at(track, x, 24)
    field = self.find(".words")
    self.driver.execute_script("arguments[0].value = arguments[1]", field, words)  # the driver types no emoji
    field.send_keys(webdriver.Keys.ENTER)

  def prompts(self):
    return self.get("prompts")
