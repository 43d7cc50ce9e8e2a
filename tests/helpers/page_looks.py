"""Shared by the tests of browser and others."""

import time

from browser import PATIENCE_S, mine, until
from playwright.sync_api import expect

CHAIR_1 = 1


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
    "Map": "Resolution",
    "Command": "Follow robot",
    "Build": "Map as it was then",
    "Instance": "Why is this one object?",
}
"""A text of each tab, with an object selected."""


def tabs(page, says):
    """Return the tabs there are, once those that must be there are."""
    for name in says:
        expect(page.get_by_role("tab", name=name, exact=True)).to_be_visible()
    return [one.get_attribute("title") or one.inner_text() for one in page.get_by_role("tab").all() if one.is_visible()]


def open_tab(page, name, text):
    """Open a tab, and wait until it is seen in full."""
    page.get_by_role("tab", name=name, exact=True).click()
    expect(page.get_by_text(text, exact=True).first).to_be_visible()
    page.wait_for_function(STILL)


def faults(page):
    """Return what cannot be read and what has no name; names come a moment after what they name."""
    end = time.monotonic() + PATIENCE_S
    while page.evaluate(NAMELESS) and time.monotonic() < end:
        page.wait_for_timeout(40)
    return page.evaluate(UNREADABLE) + page.evaluate(NAMELESS)


def go_dark(page, session):
    """Make the page dark, and wait until the workbench colours it so too."""
    page.keyboard.press("l")
    page.wait_for_function("() => document.documentElement.dataset.mantineColorScheme === 'dark'")
    until(page, lambda: session.theme.dark)


def select_chair_1(page, bench):
    """Select an object and wait until the page has all that was told to it until then."""
    mine(bench).select(CHAIR_1)
    assert bench.wait_idle(PATIENCE_S)
    expect(page.locator(".simaps-selected", has_text="chair 1")).to_be_visible()
