"""A few lines that run in the page itself, for what viser 1.1.1 leaves out.

viser gives its text boxes and sliders no accessible name, knows neither "/" nor "?" as a key, closes no window by
Escape, forgets which tabs were open, and tells the pages in its frames nothing. They ask whether this one is light or
dark, and are told when that changes; they hand on the keys that are not theirs, and Tab, which leaves them. A picture
of one transparent pixel carries the lines in, because viser shows our HTML but runs no script elements.
"""

from html import escape

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.theme import DARK, LIGHT, STICKY, css

_PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="

_SCRIPT = """
(() => {
  if (window.simapsPage) return;
  window.simapsPage = true;
  document.documentElement.lang = 'en';

  const press = (element) => {
    for (const kind of ['pointerdown', 'mousedown', 'pointerup', 'mouseup', 'click'])
      element.dispatchEvent(new (kind.startsWith('pointer') ? PointerEvent : MouseEvent)(kind,
        { bubbles: true, cancelable: true, button: 0, pointerId: 1, isPrimary: true }));
  };

  const OPEN = 'simaps-open-tabs';
  const tabs = () => [...document.querySelectorAll('[role=tab]')];
  const titleOf = (tab) => tab.textContent.trim();
  const isOpen = (tab) => tab.getAttribute('aria-selected') === 'true';
  let wanted = [];
  try { wanted = JSON.parse(sessionStorage.getItem(OPEN)) || []; } catch { /* then the first tabs are open */ }
  const reopen = () => {
    for (const tab of wanted.length ? tabs() : []) {
      if (!wanted.includes(titleOf(tab))) continue;
      wanted = wanted.filter((title) => title !== titleOf(tab));
      if (!isOpen(tab)) press(tab);
    }
  };
  document.addEventListener('pointerdown', (event) => { if (event.isTrusted) wanted = []; }, true);
  window.addEventListener('pagehide', () => {
    const open = tabs().filter(isOpen).map(titleOf);
    try { if (open.length) sessionStorage.setItem(OPEN, JSON.stringify(open)); } catch { /* as above */ }
  });

  const nameControls = () => {
    for (const label of document.querySelectorAll('label[for]')) {
      const row = label.closest('.mantine-Flex-root');
      if (!row) continue;
      const text = label.textContent.trim();
      for (const one of row.querySelectorAll('input:not([type=hidden]), textarea:not([aria-hidden]), [role=slider]'))
        if (one.getAttribute('aria-label') !== text) one.setAttribute('aria-label', text);
    }
  };
  const hush = () => {  // viser's remark on graphics without a card lies on the map until it is closed
    for (const one of document.querySelectorAll('.mantine-Notification-root:not([data-simaps])')) {
      if (!one.textContent.startsWith('Software WebGL')) continue;
      one.dataset.simaps = 'seen';
      setTimeout(() => { const close = one.querySelector('button'); if (close) close.click(); }, 6000);
    }
  };
  let waiting = 0;
  const soon = () => {
    if (!waiting) waiting = setTimeout(() => { waiting = 0; nameControls(); reopen(); hush(); }, 100);
  };
  new MutationObserver(soon).observe(document.body, { childList: true, subtree: true, characterData: true });
  nameControls();
  reopen();

  const root = document.documentElement;
  const originOf = (frame) => new window.URL(frame.src).origin;  // URL alone is the document's here
  const tellTheme = (frame) =>
    frame.contentWindow.postMessage({ simapsTheme: root.dataset.mantineColorScheme }, originOf(frame));
  const frames = () => [...document.querySelectorAll('iframe[src^=http]')].filter((frame) => frame.contentWindow);
  const STOPS = 'a[href], button, input:not([type=hidden]), select, textarea, summary, iframe, [tabindex]';
  const isStop = (one) => one.tabIndex >= 0 && !one.disabled && one.getClientRects().length > 0
    && getComputedStyle(one).visibility !== 'hidden';
  const leave = (frame, step) => {
    const stops = [...document.querySelectorAll(STOPS)].filter(isStop);
    for (let i = 1; i < stops.length; i++) {
      const next = stops[(stops.indexOf(frame) + (step < 0 ? -i : i) + stops.length) % stops.length];
      next.focus();
      if (document.activeElement === next) return;
    }
  };
  window.addEventListener('message', (event) => {
    const frame = frames().find((one) => one.contentWindow === event.source && originOf(one) === event.origin);
    const said = event.data || {};
    if (!frame) return;
    if (said.simapsLeave) leave(frame, said.simapsLeave);
    else if (said.simapsKey) document.body.dispatchEvent(
      new KeyboardEvent('keydown', { ...said.simapsKey, bubbles: true, cancelable: true }));
    else tellTheme(frame);
  });
  new MutationObserver(() => frames().forEach(tellTheme))
    .observe(root, { attributes: true, attributeFilter: ['data-mantine-color-scheme'] });
  frames().forEach(tellTheme);

  const withText = (text) => {
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode())
      if (node.data.trim() === text && node.parentElement.offsetParent) return node.parentElement;
    return null;
  };
  const toBox = (label, tabName, tries) => {
    const box = document.querySelector(`[aria-label="${label}"]`);
    if (box && box.offsetParent) { box.focus(); return; }
    if (tries === 0) return;
    const tab = withText(tabName);
    if (tab) press(tab);
    setTimeout(() => { nameControls(); toBox(label, tabName, tries - 1); }, 120);
  };
  document.addEventListener('keydown', (event) => {
    const busy = event.target.closest && event.target.closest('input, textarea, [contenteditable]');
    if (busy || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === '/') { event.preventDefault(); toBox('Command', 'Command', 3); }
    if (event.key === 'f') { event.preventDefault(); toBox('Find', 'Instance', 3); }
    if (event.key === '?') { event.preventDefault(); const help = withText('Help'); if (help) help.click(); }
  });
  window.addEventListener('keydown', (event) => {
    const open = [...document.querySelectorAll('.mantine-Modal-content')].pop();
    const close = open && [...open.querySelectorAll('button')].find((one) => one.textContent.trim() === 'Close');
    if (event.key !== 'Escape' || !close) return;
    event.stopImmediatePropagation();
    close.click();
  }, true);
})();
"""

DARKER: Color = (14, 72, 155)
"""Of a button of a light page under the pointer."""
SMALLEST = "max(12px, .82rem)"
"""No text is smaller."""

_STYLE = f"""
:root[data-mantine-color-scheme=light] {{
  --mantine-color-dimmed: {css(LIGHT.dim)};
  --mantine-color-gray-filled: {css(LIGHT.dim)};
  --mantine-color-custom-filled: {css(LIGHT.link)};
  --mantine-primary-color-filled: {css(LIGHT.link)};
  --mantine-color-custom-filled-hover: {css(DARKER)};
  --mantine-primary-color-filled-hover: {css(DARKER)};
}}
:root[data-mantine-color-scheme=dark] {{
  --mantine-color-dimmed: {css(DARK.dim)};
  --mantine-color-text: {css(DARK.text)};
}}
[role=tab][aria-selected=true], .mantine-Button-root[data-variant=outline] {{
  color: light-dark({css(LIGHT.link)}, {css(DARK.link)}) !important;
}}
[role=tab] {{ padding-inline: .5rem !important; }}
.mantine-Text-root:has(> label) {{ letter-spacing: 0 !important; line-height: 1.25 !important; }}
.mantine-Slider-markLabel {{ font-size: {SMALLEST} !important; color: var(--mantine-color-dimmed); }}
.mantine-Input-input {{ font-size: {SMALLEST} !important; letter-spacing: 0 !important; }}
.mantine-Button-root[data-block] {{ height: auto !important; min-height: 2em; padding-block: .25rem; }}
.mantine-Button-root[data-block] .mantine-Button-label {{ white-space: normal; line-height: 1.25; }}
.mantine-Combobox-option {{ font-size: {SMALLEST} !important; }}
.mantine-Notification-description {{ color: var(--mantine-color-dimmed) !important; }}
input.mantine-Input-input {{ line-height: normal !important; }}
.mantine-Button-root[data-size=compact-xs] {{ --button-fz: {SMALLEST} !important; }}
.mantine-Button-root[style*=gray-filled]:not([data-disabled]) {{
  background: light-dark(#e9ecef, #3d4148) !important;
  color: light-dark({css(LIGHT.text)}, {css(DARK.text)}) !important;
}}
.mantine-Button-root[style*=gray-filled]:not([data-disabled]):hover {{
  background: light-dark(#dde1e6, #4a4f57) !important;
}}
.mantine-Modal-content:has(img) {{ flex: 0 1 max(60rem, 70vw) !important; }}
.mantine-Modal-content img {{ max-height: calc(90vh - 11rem); object-fit: contain; }}
div:has(> .{STICKY}) {{ position: sticky; top: 0; z-index: 3; background: var(--mantine-color-body); }}
.simaps-legend {{ max-height: clamp(8.5em, calc(45vh - 236px), 40em); overflow-y: auto; }}
textarea[aria-label=Find] {{
  max-height: 1.7rem !important; min-height: 0 !important; padding-block: .2rem !important; resize: none !important;
  overflow: hidden !important; white-space: nowrap !important;
}}
"""
"""Darker labels (viser's have a contrast of 3.3), set less tight; nothing too small to read; second choices that stand
back behind the first; windows with a picture as wide as the picture needs; the box to find things in has one line; the
legend is as long as the page has room for, and scrolls by itself, so that what is under it stays in sight."""

HANDLERS = (_SCRIPT,)
"""All inline event handlers of our HTML; the page's Content-Security-Policy lets in these and no others."""

OPENED = "simaps-opened"
"""Class of an element that is there as soon as our part of the page is; `server.opening` waits for it."""

PAGE_SCRIPT = (
    f'<style class="{OPENED}">{_STYLE}</style>'
    f'<img alt="" src="{_PIXEL}" style="display:none" onload="{escape(_SCRIPT)}">'
)
"""HTML to put into a page once, anywhere that is always shown."""
