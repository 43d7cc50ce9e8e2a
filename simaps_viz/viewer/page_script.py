"""A few lines that run in the page itself, for what viser 1.1.1 leaves out: names of inputs, and two keys.

viser gives its text boxes and sliders no accessible name, and knows neither "/" nor "?" as a key. A picture of one
transparent pixel carries the lines in, because viser shows our HTML but runs no script elements.
"""

from html import escape

from simaps_viz.viewer.drawing.theme import DARK, LIGHT, css

_PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="

_SCRIPT = """
(() => {
  if (window.simapsPage) return;
  window.simapsPage = true;
  document.documentElement.lang = 'en';

  const nameControls = () => {
    for (const label of document.querySelectorAll('label[for]')) {
      const row = label.closest('.mantine-Flex-root');
      if (!row) continue;
      const text = label.textContent.trim();
      for (const one of row.querySelectorAll('input:not([type=hidden]), textarea:not([aria-hidden]), [role=slider]'))
        if (one.getAttribute('aria-label') !== text) one.setAttribute('aria-label', text);
    }
  };
  let waiting = 0;
  const soon = () => { if (!waiting) waiting = setTimeout(() => { waiting = 0; nameControls(); }, 100); };
  new MutationObserver(soon).observe(document.body, { childList: true, subtree: true, characterData: true });
  nameControls();

  const withText = (text) => {
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode())
      if (node.data.trim() === text && node.parentElement.offsetParent) return node.parentElement;
    return null;
  };
  const press = (element) => {
    for (const kind of ['pointerdown', 'mousedown', 'pointerup', 'mouseup', 'click'])
      element.dispatchEvent(new (kind.startsWith('pointer') ? PointerEvent : MouseEvent)(kind,
        { bubbles: true, cancelable: true, button: 0, pointerId: 1, isPrimary: true }));
  };
  const toCommand = (tries) => {
    const box = document.querySelector('[aria-label="Command"]');
    if (box && box.offsetParent) { box.focus(); return; }
    if (tries === 0) return;
    const tab = withText('Command');
    if (tab) press(tab);
    setTimeout(() => { nameControls(); toCommand(tries - 1); }, 120);
  };
  document.addEventListener('keydown', (event) => {
    const busy = event.target.closest && event.target.closest('input, textarea, [contenteditable]');
    if (busy || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === '/') { event.preventDefault(); toCommand(3); }
    if (event.key === '?') { event.preventDefault(); const help = withText('Help'); if (help) help.click(); }
  });
})();
"""

_STYLE = f"""
:root[data-mantine-color-scheme=light] {{
  --mantine-color-dimmed: {css(LIGHT.dim)};
  --mantine-color-gray-filled: {css(LIGHT.dim)};
  --mantine-color-custom-filled: {css(LIGHT.link)};
  --mantine-primary-color-filled: {css(LIGHT.link)};
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
.mantine-Slider-markLabel {{ font-size: .68rem !important; color: var(--mantine-color-dimmed); }}
"""
"""Darker labels (viser's have a contrast of 3.3), set less tight; marks of sliders large enough to read."""

HANDLERS = (_SCRIPT,)
"""All inline event handlers of our HTML; the page's Content-Security-Policy lets in these and no others."""

PAGE_SCRIPT = f'<style>{_STYLE}</style><img alt="" src="{_PIXEL}" style="display:none" onload="{escape(_SCRIPT)}">'
"""HTML to put into a page once, anywhere that is always shown."""
