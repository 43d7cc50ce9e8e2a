"""Covers viser's own page until ours is laid out in it: on a busy machine that takes seconds."""

import gzip
from functools import lru_cache

from websockets.http11 import Response

from simaps_viz.viewer.page_script import OPENED

LONGEST_S = 30
"""A page that never comes is uncovered after so long: viser's says what it waits for."""
_STYLE = (
    "<style>@keyframes simaps-uncover{to{visibility:hidden}}"
    'body::after{content:"Opening the map \\2026";position:fixed;inset:0;z-index:100000;display:grid;'
    "place-items:center;background:#fff;color:#495057;font:1.1rem system-ui,sans-serif;"
    f"animation:simaps-uncover 0s {LONGEST_S}s forwards}}body:has(.{OPENED})::after{{display:none}}</style></head>"
).encode()


def cover(response: Response) -> None:
    """Add the cover to a page of HTML; anything else stays as it is."""
    kind = response.headers.get("Content-Type", "")
    if response.status_code != 200 or not kind.startswith("text/html") or not response.body:
        return
    response.body = covered(bytes(response.body), zipped=response.headers.get("Content-Encoding") == "gzip")
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


@lru_cache(maxsize=4)
def covered(body: bytes, *, zipped: bool) -> bytes:
    """Give a page of HTML, gzipped or not, with the cover."""
    head, end, rest = (gzip.decompress(body) if zipped else body).rpartition(b"</head>")
    page = head + _STYLE + rest if end else rest
    return gzip.compress(page, mtime=0) if zipped else page
