"""Checks of other programs: rerun's viewer, a graphics card's driver, a browser."""

import html
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from simaps_viz.errors import SIMapsError
from simaps_viz.installation.finding import Finding

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
TIMEOUT_S = 25.0
_PAGE = """<!doctype html><p id="out">none</p><script>
const gl = document.createElement("canvas").getContext("webgl2");
const info = gl && gl.getExtension("WEBGL_debug_renderer_info");
document.getElementById("out").textContent =
  gl ? "webgl2: " + gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) : "no webgl2";
</script>"""
_SOFTWARE = ("swiftshader", "llvmpipe", "softpipe", "software")


def check_rerun() -> Finding:
    """Check whether rerun's web viewer can be taken out of its program, as the page needs it."""
    try:
        from simaps_viz.recorder.web_viewer import viewer_assets  # noqa: PLC0415 - slow to import

        size = sum(len(content) for content, _ in viewer_assets().values())
    except SIMapsError as error:
        return Finding("recorded builds", "fail", str(error), "pip install 'rerun-sdk==0.41.0'")
    except Exception as error:  # a broken rerun raises whatever comes; the doctor tells it
        found = f"{type(error).__name__}: {error}"
        return Finding("recorded builds", "fail", found, "pip install --force-reinstall 'rerun-sdk==0.41.0'")
    return Finding("recorded builds", "ok", f"rerun's web viewer is there ({size / 1e6:.0f} MB)")


def check_gpu() -> Finding:
    """Check for a graphics card that networks could run on."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return Finding("GPU", "ok", "none found; maps are built on the CPU, networks run there too, slower")
    try:
        done = subprocess.run([program, "-L"], capture_output=True, text=True, timeout=10.0, check=False)
    except (OSError, subprocess.SubprocessError) as error:
        return Finding("GPU", "warn", f"nvidia-smi did not answer ({type(error).__name__})", "check the driver")
    cards = [line.partition("(UUID")[0].strip() for line in done.stdout.splitlines() if line.startswith("GPU")]
    if done.returncode or not cards:
        return Finding("GPU", "warn", "nvidia-smi finds no card", "check the driver, or go on without")
    return Finding("GPU", "ok", ", ".join(cards), "networks use it with the package onnxruntime-gpu")


def check_browser() -> Finding:
    """Start a browser without a window, if one is found, and ask what draws its 3-D."""
    program = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if program is None:
        return Finding("browser", "ok", "no Chromium found to ask; any browser with WebGL 2 and WebAssembly will do")
    try:
        renderer = _renderer(program)
    except (OSError, subprocess.SubprocessError) as error:
        return Finding("browser", "warn", f"{program} did not answer ({type(error).__name__})",
                       "open the page in it and look, or use --no-browser")  # fmt: skip
    if renderer is None or not renderer.startswith("webgl2: "):
        return Finding("browser", "warn", f"{program}: no WebGL 2 without a window",
                       "look at chrome://gpu in it; the 3-D page needs WebGL 2")  # fmt: skip
    drawn_by = renderer.removeprefix("webgl2: ")
    if any(word in drawn_by.lower() for word in _SOFTWARE):
        return Finding("browser", "warn", f"{program}: WebGL 2 in software ({drawn_by})",
                       "works, slower; with a graphics card, look at chrome://gpu")  # fmt: skip
    return Finding("browser", "ok", f"{program}: WebGL 2 by {drawn_by}")


def _renderer(program: str) -> str | None:
    with tempfile.TemporaryDirectory(prefix="simaps-doctor-", ignore_cleanup_errors=True) as folder:
        page = Path(folder) / "page.html"
        page.write_text(_PAGE, encoding="utf-8")
        command = [
            program, "--headless", "--no-first-run", "--disable-background-networking", "--disable-component-update",
            "--disable-sync", "--enable-unsafe-swiftshader", f"--user-data-dir={folder}/profile", "--dump-dom",
            *(["--no-sandbox"] if os.name == "posix" and os.geteuid() == 0 else []), page.as_uri(),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    match = re.search(r'<p id="out">([^<]*)</p>', done.stdout)
    return html.unescape(match[1]) if match else None
