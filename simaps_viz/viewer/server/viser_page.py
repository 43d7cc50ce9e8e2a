"""What is added to viser's page: a script and a style sheet for what viser leaves out, a cover, and a policy.

``page.js``: viser gives its text boxes and sliders no accessible name, knows neither "/" nor "?" as a key, closes no
window by Escape and misses that key on buttons with hints, forgets which tabs were open, and does not talk to the pages
in its frames. They ask whether this page is light or dark, and are notified when that changes; they hand on the keys
that they do not use themselves, and Tab, which leaves them. ``map.js``: names and outlines of objects under the
pointer, and the map is moved as maps are. ``page.css``: darker labels (viser's
have a contrast of 3.3), no text too small to read, windows as wide as the picture in them, a legend that scrolls by
itself.

viser shows our HTML but runs no script elements in it, so an image of one transparent pixel starts the script.
"""

import base64
import hashlib
import logging
import re
from functools import lru_cache
from html import escape
from importlib import resources
from string import Template

import numpy as np
import zstandard

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.theme import DARK, LIGHT, STICKY, css

logger = logging.getLogger(__name__)

LIGHT_LINK_HOVER: Color = (14, 72, 155)
"""Button of a light page under the pointer."""
SMALLEST_TEXT = "max(12px, .82rem)"
OPENED = "simaps-opened"
"""Class of an element that exists as soon as our part of the page does; the cover of the page waits for it."""

_PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="
_FILES = resources.files("simaps_viz.viewer.server")
_SCRIPT = "".join(_FILES.joinpath(name).read_text(encoding="utf-8") for name in ("page.js", "map.js"))
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

PAGE_SCRIPT = (
    f'<style class="{OPENED}">{_STYLE}</style>'
    f'<img alt="" src="{_PIXEL}" style="display:none" onload="{escape(_SCRIPT)}">'
)
"""HTML to put into a page once, anywhere that is always shown."""

COVERED_S = 90
"""If our part of the page never appears, the cover is removed after this time; viser then shows what it waits for."""
_COVER = (
    "<style>@keyframes simaps-uncover{to{visibility:hidden}}"
    'body::after{content:"Opening the map \\2026";position:fixed;inset:0;z-index:100000;display:grid;'
    "place-items:center;background:#fff;color:#495057;font:1.1rem system-ui,sans-serif;"
    f"animation:simaps-uncover 0s {COVERED_S}s forwards}}body:has(.{OPENED})::after{{display:none}}</style></head>"
).encode()


def covered(page: bytes) -> bytes:
    """Return viser's page with a cover over it that is removed when our part of the page has loaded."""
    head, end, rest = page.rpartition(b"</head>")
    return head + _COVER + rest if end else page


def page_policy(host: str, page: bytes) -> str:
    """Return the Content-Security-Policy of viser's page under the name it is asked by, such as 127.0.0.1:8080."""
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src {script_sources(page)}",  # no eval: only viser's Gaussian splats would need it
            "style-src 'unsafe-inline'",  # viser's widgets have their styles in attributes
            "img-src 'self' data: blob:",
            "media-src data: blob:",
            "font-src data:",
            f"connect-src 'self' ws://{host} wss://{host} data: blob:",
            "worker-src blob:",
            "frame-src 'self'",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
            "object-src 'none'",
        )
    )


@lru_cache(maxsize=4)
def script_sources(page: bytes) -> str:
    """Return the hashes of the scripts that viser's page has, and unpacks itself into, and of our own handler."""
    scripts = [script for script in re.findall(rb"<script[^>]*>(.*?)</script>", page, re.DOTALL) if script]
    if re.search(rb"<script[^>]* data-p=", page):
        try:
            scripts.append(_unpacked(page))
        except (ValueError, TypeError, zstandard.ZstdError):
            logger.warning("viser's page is packed in a way that is not known: its scripts cannot be told apart")
            return "'unsafe-inline' 'wasm-unsafe-eval'"
    hashes = (
        f"'sha256-{base64.b64encode(hashlib.sha256(one).digest()).decode()}'" for one in (*scripts, _SCRIPT.encode())
    )
    return " ".join(("'wasm-unsafe-eval'", "'unsafe-hashes'", *hashes))


def _unpacked(page: bytes) -> bytes:
    """Return the script in the attribute ``data-p``: after ``data-ss`` bytes of styles, zstd-compressed, in base 88.

    Raises:
        ValueError: the page is packed otherwise; TypeError and zstandard.ZstdError likewise.
    """
    packed, styles = (re.search(rb' data-%s="([^"]*)"' % name, page) for name in (b"p", b"ss"))
    alphabet = re.search(rb'const A="((?:[^"\\]|\\.)*)"', page)
    if packed is None or styles is None or alphabet is None:
        raise ValueError("expected data-p, data-ss and an alphabet in viser's page")
    # Five digits are four bytes, the most significant first; of a shorter last group, n digits are n - 1 bytes.
    letters = alphabet[1].replace(b"\\\\", b"\\")
    value = np.zeros(256, np.uint64)
    value[np.frombuffer(letters, np.uint8)] = np.arange(len(letters))
    digits = value[np.frombuffer(packed[1], np.uint8)]
    rest = digits[len(digits) // 5 * 5 :]
    groups = digits[: len(digits) - len(rest)].reshape(-1, 5)
    powers = np.uint64(len(letters)) ** np.arange(4, -1, -1, dtype=np.uint64)
    last = int(rest @ powers[5 - len(rest) :]).to_bytes(max(0, len(rest) - 1), "big")
    content = (groups @ powers).astype(">u4").tobytes() + last
    return zstandard.ZstdDecompressor().decompress(content)[int(styles[1]) :]
