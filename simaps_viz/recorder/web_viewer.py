"""All that is bound to rerun 0.41's web viewer: its two assets, the page that hosts it, and what that page may load.

Whoever serves the page answers, on one origin:

- ``GET /rerun/`` (any name) with :func:`rerun_page`, under the header ``Content-Security-Policy``;
- ``GET /rerun/re_viewer.js`` and ``/rerun/re_viewer_bg.wasm`` with :func:`viewer_assets`;
- ``GET /rerun/events`` with server-sent events: ``{"set_time": {"timeline": "frame", "time": 12}}``, and
  ``{"show": "/recordings/cafe.rrd"}`` to show another recording in the place of those shown;
- ``POST /rerun/event``: one viewer event as JSON, e.g. ``{"type": "time_update", "timeline": "frame", "time": 12}``;
- the recordings themselves, under whatever address it handed to :func:`rerun_page`.
"""

import base64
import hashlib
import html
import importlib.metadata
import importlib.util
import json
import os
import socket
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import resources
from pathlib import Path
from string import Template

from simaps_viz.errors import InputError, SIMapsError

RERUN_VERSION = "0.41"
"""The only version this module was written for; neither the page nor its messages are a public interface of rerun."""

_FILES = resources.files("simaps_viz.recorder")
_SCRIPT = _FILES.joinpath("rerun_page.js").read_text(encoding="utf-8")
_PAGE = Template(_FILES.joinpath("rerun_page.html").read_text(encoding="utf-8"))
_SCRIPT_HASH = base64.b64encode(hashlib.sha256(_SCRIPT.encode()).digest()).decode()

CONTENT_SECURITY_POLICY = "; ".join(
    (
        "default-src 'none'",
        f"script-src 'self' 'wasm-unsafe-eval' 'sha256-{_SCRIPT_HASH}'",
        "style-src 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "connect-src 'self' data: blob:",
        "worker-src 'self' blob:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'self'",
    )
)
"""Header value for the page: nothing but its own server can be reached, whatever the viewer tries."""

_ASSETS = {"re_viewer.js": "text/javascript", "re_viewer_bg.wasm": "application/wasm"}
_START_TIMEOUT_S = 30.0

_THEMES = ("page", "light", "dark")


def rerun_page(recordings: Sequence[str], *, theme: str = "page", note: str = "") -> str:
    """Return the HTML page that shows recordings in rerun's web viewer.

    Args:
        recordings: addresses of ``.rrd`` files, absolute or relative to the page, or of live streams
            (``rerun+/proxy`` on the same server, or ``rerun+http://127.0.0.1:9876/proxy``).
        theme: "light", "dark", or "page": as the workbench that shows it in a frame is, at every moment; alone, as the
            system is.
        note: a sentence over the viewer; empty = none.

    Raises:
        InputError: unknown theme.
    """
    if theme not in _THEMES:
        raise InputError(f"theme: expected one of {', '.join(_THEMES)}, found {theme!r}")
    config = json.dumps({"recordings": list(recordings), "theme": theme}).replace("<", "\\u003c")
    return _PAGE.substitute(theme=theme, note=html.escape(note), config=config, script=_SCRIPT)


def check_version(version: str | None = None) -> None:
    """Raise SIMapsError unless rerun (the installed one by default) is of the version the page was written for."""
    found = version or importlib.metadata.version("rerun-sdk")
    if not found.startswith(f"{RERUN_VERSION}."):
        raise SIMapsError(
            f"rerun-sdk: expected version {RERUN_VERSION}.x, found {found}: its web viewer cannot be docked;"
            " open the recording with the command 'rerun FILE.rrd' instead"
        )


@cache
def viewer_assets() -> dict[str, tuple[bytes, str]]:
    """Return the web viewer's files as {name: (content, content type)}: ``re_viewer.js`` and ``re_viewer_bg.wasm``.

    They are shipped inside rerun's own program, which only hands them out over HTTP, so it is run for half a second
    on 127.0.0.1. (``rerun.serve_web_viewer`` would listen on every interface until this process ends.)

    Raises:
        SIMapsError: rerun is of another version, or did not hand the files out.
    """
    check_version()
    with _rerun_server() as address:
        return {name: (_fetch(f"{address}/{name}"), kind) for name, kind in _ASSETS.items()}


def _program() -> Path:
    """Find the rerun program the wheel brought along."""
    spec = importlib.util.find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise SIMapsError("rerun-sdk: its program (package rerun_cli) is missing; reinstall rerun-sdk")
    folder = Path(spec.origin).parent
    for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
        if (folder / name).is_file():
            return folder / name
    raise SIMapsError(f"{folder}: expected the rerun program in it, found none; reinstall rerun-sdk")


@contextmanager
def _rerun_server() -> Iterator[str]:
    """Run rerun's web server on a free port of 127.0.0.1; returns its address and ends it afterwards.

    Its home is an empty folder: on a first session rerun sends no usage data, and it leaves no files behind.
    """
    with tempfile.TemporaryDirectory(prefix="simaps-rerun-") as home:
        web_port, data_port = free_port(), free_port()
        command = [str(_program()), "--serve-web", "--bind", "127.0.0.1"]
        command += ["--web-viewer-port", str(web_port), "--port", str(data_port)]
        homes = ("HOME", "USERPROFILE", "APPDATA", "LOCALAPPDATA", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME")
        environment = os.environ | dict.fromkeys(homes, home)
        process = subprocess.Popen(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            address = f"http://127.0.0.1:{web_port}"
            _wait_until_up(process, address)
            yield address
        finally:
            process.terminate()
            process.wait()


def _wait_until_up(process: subprocess.Popen[bytes], address: str) -> None:
    deadline = time.monotonic() + _START_TIMEOUT_S
    while time.monotonic() < deadline:
        try:
            _fetch(f"{address}/re_viewer.js")
            return
        except SIMapsError:
            if process.poll() is not None:
                break
            time.sleep(0.05)
    state = "it is still starting" if process.poll() is None else f"it ended with status {process.returncode}"
    raise SIMapsError(f"rerun-sdk: expected its web server to answer at {address}, found that {state}")


def _fetch(address: str) -> bytes:
    # A proxy of the environment has no business with this machine's own server.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(address, timeout=_START_TIMEOUT_S) as response:
            return response.read()
    except (urllib.error.URLError, OSError) as error:
        raise SIMapsError(f"{address}: expected rerun's web viewer there, found: {error}") from error


def free_port() -> int:
    """Find an unused port of 127.0.0.1."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
