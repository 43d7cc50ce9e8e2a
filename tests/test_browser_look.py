"""Keys, the dark page, names and contrast of what is written, in Debian's Chromium on the toy map."""

import time

import pytest
from browser import PATIENCE_S, mine, open_workbench, toy_workbench, until, wait_for_color, watched_page
from playwright.sync_api import expect
from toy_maps import toy_map

from simaps_viz.labels import instance_color
from simaps_viz.map_colors import class_colors
from simaps_viz.viewer.drawing.theme import DARK, LIGHT

CHAIR_1 = 1
OPEN_FLOOR = (3.0, -0.9)
READABLE = 4.5
PAUSE_MS = 250

UNREADABLE = """() => {
  const linear = (v) => { v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; };
  const light = (c) => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const parse = (text) => {
    const n = (text.match(/[-\\d.]+/g) || [0, 0, 0, 0]).map(Number);
    if (text.startsWith('color(srgb')) return [n[0] * 255, n[1] * 255, n[2] * 255, n.length > 3 ? n[3] : 1];
    return [n[0], n[1], n[2], n.length > 3 ? n[3] : 1];
  };
  const over = (top, under, share) => [0, 1, 2].map((i) => top[i] * share + under[i] * (1 - share));
  const bad = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    if (!node.data.trim() || !element.checkVisibility() || element.closest('style, script, [data-disabled]')) continue;
    let opacity = 1;
    const grounds = [];
    for (let at = element; at; at = at.parentElement) {
      const style = getComputedStyle(at);
      grounds.push(parse(style.backgroundColor));
      opacity *= Number(style.opacity);
    }
    let ground = document.documentElement.dataset.mantineColorScheme === 'dark' ? [20, 20, 20] : [255, 255, 255];
    for (const one of grounds.reverse()) ground = over(one, ground, one[3]);
    const color = parse(getComputedStyle(element).color);
    const seen = over(color, ground, color[3] * opacity);
    const [low, high] = [light(seen), light(ground)].sort((a, b) => a - b);
    const ratio = (high + 0.05) / (low + 0.05);
    if (ratio < 4.5) bad.push(`${ratio.toFixed(2)} ${node.data.trim().slice(0, 40)}`);
  }
  return bad;
}"""
NAMELESS = """() => ['input:not([type=hidden])', 'textarea:not([aria-hidden])', '[role=slider]']
  .flatMap((kind) => [...document.querySelectorAll(kind)])
  .filter((one) => one.checkVisibility() && !one.getAttribute('aria-label') && !(one.labels && one.labels.length))
  .map((one) => one.outerHTML.slice(0, 120))"""
STILL = """() => document.getAnimations().every((one) => one.playState !== 'running')
  && [...document.querySelectorAll('.mantine-Modal-content, .mantine-Modal-overlay')]
    .every((one) => getComputedStyle(one).opacity === '1')"""
"""Nothing fades in or out, which would be read as a weak contrast."""
SAYS = {
    "Map": "Reset K and resolution",
    "Command": "Follow robot",
    "Build": "Map as it was then",
    "Instance": "Why is this one object?",
}
"""A text of each tab, with an object selected."""


@pytest.fixture(scope="module")
def bench(browser):
    with toy_workbench() as workbench:
        yield workbench


@pytest.fixture
def page(browser, bench):
    with watched_page(browser) as found:
        open_workbench(found, bench)
        found.evaluate("() => document.querySelectorAll('.mantine-Notification-root').forEach((note) => note.remove())")
        yield found


def press(page, key):
    page.keyboard.press(key)
    page.wait_for_timeout(PAUSE_MS)


def tabs(page, says):
    """Give the tabs there are, once those that must be there are."""
    for name in says:
        expect(page.get_by_role("tab", name=name, exact=True)).to_be_visible()
    return [one.inner_text() for one in page.get_by_role("tab").all() if one.is_visible()]


def open_tab(page, name, text):
    """Open a tab, and wait until it is seen in full."""
    page.get_by_role("tab", name=name, exact=True).click()
    expect(page.get_by_text(text, exact=True).first).to_be_visible()
    page.wait_for_function(STILL)


def faults(page):
    """Give what cannot be read and what has no name; names come a moment after what they name."""
    end = time.monotonic() + PATIENCE_S
    while page.evaluate(NAMELESS) and time.monotonic() < end:
        page.wait_for_timeout(40)
    return page.evaluate(UNREADABLE) + page.evaluate(NAMELESS)


def go_dark(page, session):
    """Make the page dark, and wait until the workbench colours it so too."""
    page.keyboard.press("l")
    page.wait_for_function("() => document.documentElement.dataset.mantineColorScheme === 'dark'")
    until(page, lambda: session.parts.page.theme.dark)


def select_chair_1(page, bench):
    """Select an object and wait until the page has all that was told to it until then."""
    mine(bench).select(CHAIR_1)
    assert bench.wait_idle(PATIENCE_S)
    expect(page.get_by_text("chair 1 of 3").first).to_be_visible()


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


def test_keys_select_nothing_stand_up_and_step(bench, page):
    session = mine(bench)
    session.select(CHAIR_1)
    until(page, lambda: session.selected == CHAIR_1)
    press(page, "Escape")
    until(page, lambda: session.selected is None)
    last = session.frame
    press(page, "[")
    until(page, lambda: session.frame == last - 1)
    press(page, "]")
    until(page, lambda: session.frame == last)
    press(page, "3")
    page.wait_for_function("() => window.__viserMutable.nodeRefFromName['/blocks/0'] != null")
    press(page, "t")
    page.wait_for_function("() => window.__viserMutable.nodeRefFromName['/blocks/0'] == null")


def test_keys_typed_into_a_box_are_letters(bench, page):
    press(page, "/")
    box = page.get_by_label("Command", exact=True).and_(page.locator("textarea"))
    expect(box).to_be_focused()
    page.keyboard.type("to the table, L3T?")
    expect(box).to_have_value("to the table, L3T?")
    until(page, lambda: mine(bench).robot._panel.said[0] == "to the table, L3T?")  # a key would have come before
    assert page.evaluate("document.documentElement.dataset.mantineColorScheme") == "light"


def test_the_help_lists_every_key_and_closes(page):
    press(page, "?")
    title = page.get_by_text("How to use this page")
    expect(title).to_be_visible()
    for key in ("Space", "[", "]", "T", "3", "Esc", "L", "H or ?", "/"):
        expect(page.locator("kbd", has_text=key).first).to_be_attached()
    expect(page.get_by_text("the share of what frames saw of two parts")).to_be_attached()
    press(page, "Escape")
    expect(title).not_to_be_visible()
    press(page, "h")
    expect(title).to_be_visible()
    page.get_by_role("button", name="Close").click()
    expect(title).not_to_be_visible()


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_every_text_can_be_read_and_every_control_has_a_name(bench, page, dark):
    if dark:
        go_dark(page, mine(bench))
    select_chair_1(page, bench)
    bad = {}
    for name in tabs(page, SAYS):
        open_tab(page, name, SAYS[name])
        bad[name] = faults(page)
    assert set(SAYS) <= set(bad)
    assert not any(bad.values()), bad
    press(page, "h")
    expect(page.get_by_text("How to use this page")).to_be_visible()
    page.wait_for_function(STILL)
    assert page.evaluate(UNREADABLE) == []


def test_classes_have_the_colours_of_the_legend(bench, page):
    session = mine(bench)
    session.parts.map.set_look("class", None)
    session.repaint()
    of_class = class_colors(toy_map())
    for one in bench.simap.instances:
        wait_for_color(bench, page, one.centroid_m[:2], of_class[one.label])
    for label, color in of_class.items():
        entry = page.locator(".simaps-entry", has_text=label).first.locator("i")
        expect(entry).to_have_css("background-color", f"rgb{color}")
