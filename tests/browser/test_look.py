"""Keys, the dark page and the colours of classes, in Debian's Chromium on the toy map."""

import cv2
import numpy as np
import pytest
from browser import field_of, mine, open_workbench, until, wait_for_color, watched_page
from page_looks import CHAIR_1, select_chair_1
from playwright.sync_api import expect

from simaps_viz.colors.classes import instance_color
from simaps_viz.drawing.theme import DARK, LIGHT
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.map import MapPanel

OPEN_FLOOR = (3.0, -0.9)
PAUSE_MS = 250


def press(page, key):
    page.keyboard.press(key)
    page.wait_for_timeout(PAUSE_MS)


def test_a_key_makes_the_page_dark_and_light_again(bench, page):
    chair = bench.simap.by_id(CHAIR_1).centroid_m[:2]
    wait_for_color(bench, page, OPEN_FLOOR, LIGHT.floor)
    press(page, "l")
    wait_for_color(bench, page, OPEN_FLOOR, DARK.floor)
    wait_for_color(bench, page, chair, instance_color(CHAIR_1))  # objects keep their colours
    page.wait_for_function("() => document.documentElement.dataset.mantineColorScheme === 'dark'")
    expect(page.get_by_text("never seen").locator("i")).to_have_css("background-color", f"rgb{DARK.unseen}")
    page.get_by_role("button", name="Light / dark").or_(page.get_by_text("Light / dark")).first.click()
    wait_for_color(bench, page, OPEN_FLOOR, LIGHT.floor)


@pytest.mark.parametrize("focused", ["button", "box to tick"])
def test_escape_selects_nothing_wherever_the_focus_is(bench, page, focused):
    """Also on a button whose hint is open, which keeps the key from viser's commands, and on a box to tick."""
    session = mine(bench)
    select_chair_1(page, bench)
    if focused == "button":
        page.get_by_role("button", name="Light / dark", exact=True).click()
        page.mouse.move(1, 1)
        page.get_by_role("button", name="Light / dark", exact=True).hover()
        expect(page.get_by_role("tooltip")).to_be_visible()
    else:
        page.get_by_label("Draw joints").first.click()
    assert page.evaluate("document.activeElement.matches('button, input')")
    press(page, "Escape")
    until(page, lambda: session.selected is None)


FIRST_VIEWS = """() => {
  window.firstViews = [];
  const look = () => {
    const { camera, nodeRefFromName } = window.__viserMutable || {};
    if (camera && nodeRefFromName && nodeRefFromName['/map']) window.firstViews.push(camera.position.length());
    requestAnimationFrame(look);
  };
  look();
}"""


def test_the_selection_is_a_chip_and_a_press_on_it_selects_nothing(bench, page):
    select_chair_1(page, bench)
    chip = page.locator(".simaps-selected")
    expect(chip).to_contain_text("chair 1 ✕")
    chip.click()
    until(page, lambda: mine(bench).selected is None)
    expect(chip).to_have_count(0)


def test_the_map_does_not_jump_on_the_first_load(bench, browser):
    with watched_page(browser) as found:
        found.add_init_script(f"({FIRST_VIEWS})()")
        open_workbench(found, bench)
        found.wait_for_function("() => window.firstViews.length > 40")
        seen = found.evaluate("window.firstViews")
        assert max(seen) < 1.01 * min(seen)


def test_keys_typed_into_a_box_are_letters(bench, page):
    press(page, "/")
    box = page.get_by_label("Command", exact=True).and_(page.locator("textarea"))
    expect(box).to_be_focused()
    page.keyboard.type("to the table, L3T?")
    expect(box).to_have_value("to the table, L3T?")
    until(
        page, lambda: mine(bench).panels[CommandPanel].texts[0] == "to the table, L3T?"
    )  # a key would have come before
    assert page.evaluate("document.documentElement.dataset.mantineColorScheme") == "light"


# Digit after digit in one go, so that no machine is too slow for the pause; returns how many the field was told.
TYPES = """(field, texts) => {
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
  let told = 0;
  const hear = () => { told++; };
  field.addEventListener('input', hear);
  field.focus();
  for (const text of texts) {
    set.call(field, text);
    field.dispatchEvent(new InputEvent('input', { bubbles: true }));
  }
  field.removeEventListener('input', hear);
  return told;
}"""


def test_a_typed_number_counts_at_enter_or_after_a_pause_and_not_at_each_digit(bench, page):
    panel, seen = mine(bench).panels[MapPanel], []
    panel._k.on_update(lambda event: seen.append(event.target.value))
    for texts, ends in ((["8", "80"], "Enter"), (["7", "70"], "pause"), (["6", "60"], "leaving")):
        seen.clear()
        field = field_of(page, "K (%)")
        assert field.evaluate(TYPES, texts) == 0
        if ends == "Enter":
            field.press("Enter")
        elif ends == "leaving":
            field.blur()
        until(page, lambda: seen)
        expect(field).to_have_value(texts[-1])
        assert set(seen) == {float(texts[-1])} and mine(bench).cut.percent == seen[0]


def test_a_number_that_is_being_typed_outlives_one_that_is_set_meanwhile(bench, page):
    panel, field = mine(bench).panels[MapPanel], field_of(page, "K (%)")
    field.press("Control+a")
    page.keyboard.type("8")
    panel._k.value = 7.0  # as the map of another method does that comes now
    page.wait_for_timeout(300)
    page.keyboard.type("0")
    page.keyboard.press("Enter")
    until(page, lambda: mine(bench).cut.percent == 80.0)
    expect(field).to_have_value("80")


def test_the_help_lists_every_key_and_closes(page):
    press(page, "?")
    title = page.get_by_text("How to use this page")
    expect(title).to_be_visible()
    for key in ("Space", "[", "]", "T", "3", "Esc", "L", "H or ?", "/"):
        expect(page.locator("kbd", has_text=key).first).to_be_attached()
    expect(page.get_by_text("the share of what frames saw of two parts")).to_be_attached()
    # It is as wide as its lines are, and nothing of them is seen beside Close or below it, however far one has read.
    dialog = page.locator(".mantine-Modal-content")
    box, close = dialog.bounding_box(), page.get_by_role("button", name="Close").bounding_box()
    assert box and close and box["width"] > 600
    left, bottom = box["x"] + 2, box["y"] + box["height"] - 2
    strips = [(left, close["y"], close["x"] - 4 - left), (left, close["y"] + close["height"] + 4, box["width"] / 2)]
    for _ in range(4):
        for x, y, width in strips:
            clip = {"x": x, "y": y, "width": width, "height": bottom - y}
            seen = cv2.imdecode(np.frombuffer(page.screenshot(clip=clip), np.uint8), cv2.IMREAD_COLOR)
            assert seen is not None and np.ptp(seen.reshape(-1, 3), axis=0).max() < 8
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 100)
        page.mouse.wheel(0, 23)
        page.wait_for_timeout(PAUSE_MS)
    press(page, "Escape")
    expect(title).not_to_be_visible()
    press(page, "h")
    expect(title).to_be_visible()
    page.get_by_role("button", name="Close").click()
    expect(title).not_to_be_visible()
