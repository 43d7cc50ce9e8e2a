"""The page around rerun's web viewer, without a browser: which viewer it is, and what it may load."""

import base64
import hashlib
import importlib.metadata
import json
import re
import shutil
from pathlib import Path

import pytest

from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.recorder import web_viewer
from simaps_viz.recorder.web_viewer import CONTENT_SECURITY_POLICY, check_version, rerun_page, viewer_assets


def test_assets_are_the_viewer() -> None:
    assets = viewer_assets()
    assert {name: kind for name, (_, kind) in assets.items()} == {
        "re_viewer.js": "text/javascript",
        "re_viewer_bg.wasm": "application/wasm",
    }
    assert b"class WebHandle" in assets["re_viewer.js"][0]
    assert assets["re_viewer_bg.wasm"][0].startswith(b"\0asm") and len(assets["re_viewer_bg.wasm"][0]) > 10_000_000


def test_other_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    check_version()
    check_version("0.41.7")
    with pytest.raises(SIMapsError, match=r"expected version 0\.41\.x, found 0\.410\.0"):
        check_version("0.410.0")
    viewer_assets.cache_clear()
    monkeypatch.setattr(importlib.metadata, "version", lambda _: "0.42.0")
    with pytest.raises(SIMapsError, match=r"found 0\.42\.0"):
        viewer_assets()


def test_missing_program_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    viewer_assets.cache_clear()
    monkeypatch.setattr(web_viewer, "_program", lambda: Path(shutil.which("false") or ""))
    with pytest.raises(SIMapsError, match="ended with status 1"):
        viewer_assets()


def test_page_runs_its_own_script_and_no_other() -> None:
    page = rerun_page(["/a.rrd"])
    inline = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(inline) == 1
    digest = base64.b64encode(hashlib.sha256(inline[0].encode()).digest()).decode()
    scripts = next(d for d in CONTENT_SECURITY_POLICY.split("; ") if d.startswith("script-src"))
    assert f"'sha256-{digest}'" in scripts and "unsafe-inline" not in scripts and "'unsafe-eval'" not in scripts
    assert re.findall(r"https?://[^\s;]+", CONTENT_SECURITY_POLICY) == []


def test_addresses_cannot_break_out_of_the_page() -> None:
    nasty = "/</script><script>alert(1)</script>.rrd"
    page = rerun_page([nasty], theme="dark")
    assert page.count("<script>") == 1
    config = re.search(r'id="config">(.*?)</script>', page)
    assert config is not None and json.loads(config[1]) == {"recordings": [nasty], "theme": "dark"}


def test_unknown_theme() -> None:
    with pytest.raises(InputError, match="light, dark, found 'pink'"):
        rerun_page([], theme="pink")
