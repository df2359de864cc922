"""The studio's page in a real browser: it opens, plays, takes words, edits, undoes, exports, finds its studio again.

State is asked of `window.__studio`. Skipped where selenium (extra `test`) or Chromium is missing.
"""
import json
import pathlib
import time

import numpy as np

from tests.studio.server.browser import Page, needs_a_browser, serving, wait_for, webdriver

pytestmark = needs_a_browser


def test_it_opens_and_walks(page):
  page.wait("live.blocks > 0")
  first = page.get("time")
  page.wait(f"time > {first} + 0.3")
  assert page.get("figures") == 1 and page.get("live.connected") and page.get("status") == "live"
  assert not page.get("errors")


def test_new_words_change_the_motion_at_the_next_block_and_nothing_before(page):
  page.wait("live.blocks > 2")
  field = page.find("#prompt")
  field.clear()
  committed, begun = page.get("live.committed"), page.get("live.begun")
  before = page.get(f"joints(0, {committed})")
  field.send_keys("a person jumps", webdriver.Keys.ENTER)
  words = page.wait("live.words[1]")
  per_block = page.get("live.blockFrames")
  # The page hears of frames a little after they have been made, so a block more may have begun meanwhile.
  assert words["prompt"] == "a person jumps" and committed <= words["from"] <= begun + 4 * per_block
  page.wait(f"live.end > {words['from']} + {per_block}")
  assert page.get(f"joints(0, {committed})") == before
  page.wait("live.latency !== null")


def test_pause_resume_and_the_same_seed_again(page):
  page.wait("live.blocks > 2 && window.__studio.live.played > 0.3")
  page.find("#stage").click()
  page.keys(" ")
  page.wait("live.state === 'paused'")
  played = page.get("live.played")
  time.sleep(0.5)
  assert page.get("live.played") == played
  page.keys(webdriver.Keys.ARROW_LEFT)
  assert page.get("time") < played
  page.keys(" ")
  page.wait(f"live.played > {played}")
  before = page.get("joints(0, 8)")
  page.find("#restart").click()
  page.wait("live.run === 2 && window.__studio.live.blocks > 1")
  assert page.get("joints(0, 8)") == before


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


def test_a_change_makes_anew_only_from_there(timeline):
  page = timeline
  page.find("#cleanup").click()  # without it frames are the same up to the very change
  page.wait("stale === false && window.__studio.busy === null")
  half = round(page.get("blocks[0].seconds") * 20)
  before = page.get(f"joints(0, {half})")
  page.double_click(page.block(1)).send_keys("a person jumps high", webdriver.Keys.ENTER)
  page.wait("stale === false && window.__studio.busy === null && window.__studio.reply.same_frames > 0")
  assert page.get(f"joints(0, {half})") == before and page.get("reply.same_frames") >= half


def test_a_span_is_made_anew_and_takes_stand_side_by_side(timeline):
  page = timeline
  window = page.get("window")
  second = page.find(".strip").size["width"] / (window["end"] - window["start"])
  page.drag(page.find(".strip"), int(second * 0.6), x=second * 0.5)
  span = page.get("span")
  assert 8 <= span[0] <= 12 and 20 <= span[1] <= 24
  page.find("#edit-prompt").send_keys("a person kicks", webdriver.Keys.ENTER)
  made = page.wait("made")
  assert made[0][0] <= span[0] and made[-1][1] >= span[1]
  page.find("#add-take").click()
  page.wait("stale === false && window.__studio.busy === null")
  assert [take["made"] for take in page.get("takes")] == [True, True]
  page.find("#side").click()
  page.wait("figures === 2")
  page.all("#takes button")[0].click()
  assert page.get("project.chosen") == 0 and page.get("made") == made


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
  newer = tmp_path / "newer.json"
  newer.write_text(json.dumps(json.loads(path.read_text()) | {"version": 2}))
  page.find("#project-file").send_keys(str(newer))
  page.wait("errors.some((one) => one.includes('is of version 2'))")
  cut = tmp_path / "cut.json"
  cut.write_text(path.read_text()[:200])
  page.find("#project-file").send_keys(str(cut))
  page.wait("errors.some((one) => one.includes('cut'))")
  nothing = tmp_path / "nothing.npz"
  nothing.write_bytes(b"no motion")
  page.find("#motion-file").send_keys(str(nothing))
  page.wait("errors.length > 2")
  assert page.prompts() == ["a person walks", "a person jumps"]  # nothing is lost
  assert page.find("#notes").text


def test_an_imported_motion_is_gone_on_from(page, tmp_path, library):
  path = tmp_path / "walk.npy"
  motion = library.pipeline("tiny", "generate")("a person walks", seconds=2.0, seed=1)
  np.save(path, np.asarray(motion.joints, np.float32))
  page.find("#mode-timeline").click()
  page.find("#motion-file").send_keys(str(path))
  page.wait("stale === false && window.__studio.frames > 20")
  frames = page.get("frames")
  page.add_block("a person jumps")
  page.wait(f"stale === false && window.__studio.busy === null && window.__studio.frames > {frames}")
  assert not page.get("errors")


def test_other_sampling_begins_anew_and_is_saved(page):
  page.wait("live.blocks > 0")
  page.find("#sampling").click()
  page.driver.execute_script("document.getElementById('seed').value = '12'")
  page.find("#sampling-fields input[name=num_steps]").send_keys("4", webdriver.Keys.ENTER)
  page.wait("live.run === 2 && window.__studio.live.blocks > 0")
  assert page.get("live.seed") == 12
  page.find("#to-timeline").click()
  assert page.get("project.sampling") == {"num_steps": 4} and page.get("project.seeds") == [12]
  page.wait("stale === false && window.__studio.busy === null")
  live = page.get("joints(0, 6)")
  page.find("#sampling").click()
  page.find("#sampling-fields input[name=num_steps]").send_keys("0", webdriver.Keys.ENTER)  # 40 of them
  page.wait("stale === false && window.__studio.busy === null && window.__studio.project.sampling.num_steps === 40")
  assert page.get("joints(0, 6)") != live
  page.find("#sampling").click()
  field = page.find("#seed")
  field.clear()
  field.send_keys("-1", webdriver.Keys.ENTER)
  assert "whole number" in page.find("#sampling-status").text and page.get("project.seeds") == [12]
  field.send_keys(webdriver.Keys.ESCAPE)


def test_what_cannot_be_made_is_told_and_nothing_is_lost(page):
  page.wait("live.blocks > 0")
  say = "const field = document.getElementById('prompt'); field.value = arguments[0]; field.form.requestSubmit();"
  page.driver.execute_script(say, "x" * 10_000)
  page.wait("errors.some((one) => one.includes('10,000 characters'))")
  page.driver.execute_script(say, "  ")
  page.wait("errors.length === 2")
  page.driver.execute_script(say, "a person waves 👋🏽 \u202e<script>alert(1)</script>")
  page.wait("live.words.length === 2")
  assert "👋🏽" in page.get("prompts")[1] and page.get("live.run") == 1
  page.find("#mode-timeline").click()
  page.find("#make").click()
  page.wait("errors.some((one) => one.includes('timeline is empty'))")
  page.find("#save").click()
  page.wait("errors.some((one) => one.includes('no blocks to save'))")
  page.find("#export").click()
  page.wait("errors.some((one) => one.includes('no motion to export'))")
  page.driver.execute_script("document.getElementById('auto').checked = false")
  page.add_block("a person walks 🙂")
  edge = page.find(".block .edge")
  page.drag(edge, -edge.location["x"])
  assert page.get("blocks[0].seconds") == 0.6 and page.prompts() == ["a person walks 🙂"]
  assert all("\n" not in one for one in page.get("errors"))


def test_a_tab_that_hangs_stops_its_stream_and_goes_on(page, studio):
  page.wait("live.blocks > 2")
  stream = next(iter(studio.streams))
  page.driver.execute_script("setTimeout(() => { const end = Date.now() + 7000; while (Date.now() < end); }, 20)")
  time.sleep(4)
  sent = stream._sequence
  time.sleep(2)
  assert stream._sequence == sent  # nothing is sampled for a page that acknowledges nothing
  assert page.wait(f"live.end > {12 * (sent + 3)} && window.__studio.live.connected")
  assert page.get("live.run") == 1 and not page.get("errors")


def test_three_tabs_have_streams_of_their_own(page, address):
  driver, first = page.driver, page.driver.current_window_handle
  tabs = []
  for _ in range(2):
    driver.switch_to.new_window("tab")
    driver.get(address)
    page.wait("live.blocks > 1")
    tabs.append(driver.current_window_handle)
  for tab in tabs:
    driver.switch_to.window(tab)
    driver.close()
  driver.switch_to.window(first)
  page.wait("live.blocks > 1")
  assert not page.get("errors")


def test_limbs_are_turned_as_exports_turn_them(page):
  """The page turns joints of a frame alone, exports smooth over time: a few degrees about the limbs' own axes."""
  from motion_jax.data.datasets.synthetic import synthetic_clips
  from motion_jax.motion.pose import to_pose
  joints = np.asarray(synthetic_clips(seed=0, num=1)[0].joints)[:40]
  turned = np.array(page.driver.execute_async_script("""
    const [frames, done] = arguments, {Turns, three: {Vector3, Quaternion}} = window.motionParts;
    import("./api.js").then((api) => api.body()).then((body) => {
      const turns = new Turns(body.names, body.parents, body.rest), all = body.names.map(() => new Quaternion());
      done(frames.map((frame) => {
        turns.set(frame.map((place) => new Vector3(...place)), all);
        return all.map(({w, x, y, z}) => [w, x, y, z]);
      }));
    });""", joints.tolist()))
  cosine = np.abs((turned * to_pose(joints).turned).sum(-1)).clip(0, 1)
  angle = np.degrees(2 * np.arccos(cosine))
  assert np.median(angle) < 2 and np.median(angle, axis=0).max() < 20, np.median(angle, axis=0).round(1)


def test_the_floor_follows_the_camera_by_whole_lines(page):
  moved = page.driver.execute_script("""
    const box = document.body.appendChild(document.createElement("div")), stage = new window.motionParts.Stage(box);
    stage.carry(1000.4, -700.6);
    stage.draw();
    return [stage.ground, stage.shade].map(({position}) => [position.x, position.z]);""")
  assert moved == [[1000, -701], [1000, -701]]


def test_it_finds_a_studio_again_that_was_started_again(driver, library):
  with serving(library, 0) as (port, address):
    driver.get(address)
    page = Page(driver)
    page.wait("live.blocks > 0")
  page.wait("live.connected === false")
  page.wait("status.startsWith('not connected')")  # after a moment of "connecting"
  assert page.get("status") == "not connected: waiting for the studio"
  page.find("#mode-timeline").click()
  page.driver.execute_script("document.getElementById('auto').checked = false")
  page.add_block("a person walks")
  with serving(library, port):
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
