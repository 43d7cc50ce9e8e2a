"""A script and a style sheet that run in viser's page itself, for what viser leaves out.

``page.js``: viser gives its text boxes and sliders no accessible name, knows neither "/" nor "?" as a key, closes no
window by Escape, forgets which tabs were open, and does not talk to the pages in its frames. They ask whether this page
is light or dark, and are notified when that changes; they hand on the keys that they do not use themselves, and Tab,
which leaves them. ``page.css``: darker labels (viser's have a contrast of 3.3), no text too small to read, windows as
wide as the picture in them, a legend that scrolls by itself.

viser shows our HTML but runs no script elements in it, so an image of one transparent pixel starts the script.
"""

from html import escape
from importlib import resources
from string import Template

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.theme import DARK, LIGHT, STICKY, css

LIGHT_LINK_HOVER: Color = (14, 72, 155)
"""Button of a light page under the pointer."""
SMALLEST_TEXT = "max(12px, .82rem)"
OPENED = "simaps-opened"
"""Class of an element that exists as soon as our part of the page does; the cover of the page waits for it."""

_PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="
_FILES = resources.files(__package__)
_SCRIPT = _FILES.joinpath("page.js").read_text(encoding="utf-8")
_STYLE = Template(_FILES.joinpath("page.css").read_text(encoding="utf-8")).substitute(
    light_dim=css(LIGHT.dim),
    light_link=css(LIGHT.link),
    light_link_hover=css(LIGHT_LINK_HOVER),
    light_text=css(LIGHT.text),
    dark_dim=css(DARK.dim),
    dark_link=css(DARK.link),
    dark_text=css(DARK.text),
    smallest_text=SMALLEST_TEXT,
    sticky=STICKY,
)

HANDLERS = (_SCRIPT,)
"""All inline event handlers of our HTML; the page's Content-Security-Policy allows these and no others."""

PAGE_SCRIPT = (
    f'<style class="{OPENED}">{_STYLE}</style>'
    f'<img alt="" src="{_PIXEL}" style="display:none" onload="{escape(_SCRIPT)}">'
)
"""HTML to put into a page once, anywhere that is always shown."""
