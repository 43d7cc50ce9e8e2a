"""`simaps doctor`: check the installation, and report how to repair it."""

import html
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from simaps_viz.cli import NO, OK
from simaps_viz.errors import SIMapsError

if TYPE_CHECKING:
    from packaging.requirements import Requirement
    from packaging.specifiers import SpecifierSet

PACKAGE = "simaps-viz"
DEVELOPERS_EXTRAS = ("dev",)
"""Extras for development, which users need not install."""
LOW_DISK_GB, MIN_DISK_GB = 2.0, 0.2
LOW_MEMORY_GB = 2.0
MAX_FILES = 200_000
"""Files of the cache that are counted."""
DAY_S = 86_400.0
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
BROWSER_TIMEOUT_S = 25.0
_SOFTWARE_RENDERERS = ("swiftshader", "llvmpipe", "softpipe", "software")
_PAGE = """<!doctype html><p id="out">none</p><script>
const gl = document.createElement("canvas").getContext("webgl2");
const info = gl && gl.getExtension("WEBGL_debug_renderer_info");
document.getElementById("out").textContent =
  gl ? "webgl2: " + gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) : "no webgl2";
</script>"""


@dataclass(frozen=True)
class Doctor:
    """Check the installation: versions, compiled kernels, network runtimes, browser, ports, folders, disk, clock.

    Nothing is changed. Exit status 1 means that something has to be put right; warnings do not count.

    Example: simaps doctor --no-browser
    """

    browser: bool = True
    """Also start a browser without a window, if there is one, to see what draws its 3-D."""
    port: int = 8080
    """The page's port."""
    json: bool = False
    """Print it as one JSON line."""

    def run(self) -> int:
        """Run all checks and print their findings; the answer is no when one failed."""
        from simaps_viz.build.pipeline import cache_folder
        from simaps_viz.console.terminal import console, emit, say

        found = [
            check_python(),
            *check_dependencies(),
            check_extras(),
            check_kernels(),
            check_networks(),
            check_rerun(),
            check_gpu(),
            *([check_browser()] if self.browser else []),
            check_port(self.port),
            check_memory(),
            check_clock(),
            check_cache(cache_folder()),
            check_recordings(),
            check_disk(cache_folder()),
        ]
        ok = all(one.status != "fail" for one in found)
        if self.json:
            emit({"ok": ok, "version": version(PACKAGE), "checks": [asdict(one) for one in found]})
            return OK if ok else NO
        for one in found:
            say(f"{one.status:<5} {one.name}: {one.found}\n")
            if one.advice:
                say(f"      -> {one.advice}\n")
            console.file.flush()
        failed, warned = (sum(one.status == status for one in found) for status in ("fail", "warn"))
        end = "all is in order" if ok and not warned else f"{failed} to put right, {warned} to know about"
        say(f"simaps {version(PACKAGE)}: {end}\n")
        return OK if ok else NO


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report."""

    name: str
    """Name of the check."""
    status: Literal["ok", "warn", "fail"]
    """warn: works, but slower or without something; fail: something does not work."""
    found: str
    advice: str = ""
    """How to repair it; empty when nothing needs repair."""


def check_python() -> Finding:
    """Check Python's version against the program's bounds."""
    from packaging.specifiers import SpecifierSet

    found = ".".join(map(str, sys.version_info[:3]))
    bounds = metadata(PACKAGE)["Requires-Python"] or ""
    if within(found, SpecifierSet(bounds)):
        return Finding("Python", "ok", f"{found} ({sys.executable})")
    return Finding("Python", "fail", f"{found}, expected {bounds}", f"install {PACKAGE} with a Python {bounds}")


def check_dependencies() -> list[Finding]:
    """Check each package of the core; those in order share one line."""
    faults, good = [], []
    for one in requirements():
        found = _version(one.name)
        advice = f"pip install '{one.name}{one.specifier}'"
        if found is None:
            faults.append(Finding(one.name, "fail", "not installed", advice))
        elif not within(found, one.specifier):
            faults.append(Finding(one.name, "fail", f"version {found}, expected {one.specifier}", advice))
        else:
            good.append(f"{one.name} {found}")
    return [*faults, Finding("packages", "ok", f"{len(good)} within their bounds: {', '.join(sorted(good))}")]


def check_extras() -> Finding:
    """Check which extras are installed; a package of another version than asked for is a warning."""
    there, missing, wrong = [], [], []
    for extra in sorted(set(metadata(PACKAGE).get_all("Provides-Extra") or []).difference(DEVELOPERS_EXTRAS)):
        asked = [(one, _version(one.name)) for one in requirements(extra) if one.name != PACKAGE]
        (there if all(found for _, found in asked) else missing).append(extra)
        wrong += [f"{one.name} {found} (expected {one.specifier})" for one, found in asked
                  if found and not within(found, one.specifier)]  # fmt: skip
    text = f"installed: {', '.join(there) or 'none'}; not installed: {', '.join(missing) or 'none'}"
    if wrong:
        return Finding("extras", "warn", f"{text}; {', '.join(wrong)}", f"pip install --upgrade '{PACKAGE}'")
    advice = f"if you need one: pip install '{PACKAGE}[{missing[0]}]'" if missing else ""
    return Finding("extras", "ok", text, advice)


def requirements(extra: str = "") -> "list[Requirement]":
    """Return the packages that the core asks for, or those that an extra adds."""
    from packaging.requirements import Requirement

    asked = [Requirement(text) for text in requires(PACKAGE) or []]
    core = [one for one in asked if one.marker is None or one.marker.evaluate({"extra": ""})]
    if not extra:
        return core
    return [one for one in asked if one not in core and one.marker and one.marker.evaluate({"extra": extra})]


def within(version: str, bounds: "SpecifierSet") -> bool:
    """Whether a version keeps its bounds; a pre-release may."""
    from packaging.version import InvalidVersion

    try:
        return bounds.contains(version, prereleases=True)
    except InvalidVersion:
        return False


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def check_kernels() -> Finding:
    """Check whether compiled kernels are kept, and run one."""
    try:
        import numpy as np

        from simaps_viz.mapping import projection

        started = time.perf_counter()
        cells, heights = np.full((2, 2), -1, np.int32), np.zeros((2, 2), np.float32)
        projection.project_pixels(
            np.ones((2, 2), np.float32), 1.0, 1.0, 0.5, 0.5, np.eye(4), 0.1, 6.0, -9.0, 9.0, 0.05, -50, -50, 100, 100,
            cells, heights,
        )  # fmt: skip
        seconds = time.perf_counter() - started
    except Exception as error:  # a broken numba or numpy may raise anything; it is reported
        return Finding("compiled kernels", "fail", _one_line(error), "reinstall numba and numpy: pip install --upgrade")
    if (cells < 0).any():
        return Finding("compiled kernels", "fail", "one gave a wrong answer", "reinstall numba: pip install --upgrade")
    where = kernel_folder(Path(str(projection.__file__)).parent)
    if where is None:
        return Finding("compiled kernels", "warn", "work, but cannot be kept: each start compiles them again (1 min)",
                       "set NUMBA_CACHE_DIR to a folder that can be written")  # fmt: skip
    return Finding("compiled kernels", "ok", f"work ({seconds:.2f} s for the first), kept in {where}")


def kernel_folder(source: Path) -> Path | None:
    """Return the folder of numba's cache for the modules of a folder; None when no cache folder is writable."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    for folder in [Path(chosen)] if chosen else [source / "__pycache__", home]:
        there = next((p for p in (folder, *folder.parents) if p.exists()), None)
        if there is not None and there.is_dir() and os.access(there, os.W_OK | os.X_OK):
            return folder
    return None


def check_networks() -> Finding:
    """Check which execution providers segmentation networks would run on."""
    if _version("onnxruntime") is None and _version("onnxruntime-gpu") is None:
        return Finding("networks", "ok", "onnxruntime is not installed; masks that come with a sequence need none",
                       "for --segmentation NET.onnx: pip install onnxruntime")  # fmt: skip
    try:
        from simaps_viz.segmentation.session import available_providers

        providers = available_providers()
    except Exception as error:  # as above, of a broken onnxruntime
        return Finding("networks", "fail", f"onnxruntime: {_one_line(error)}", "pip install --upgrade onnxruntime")
    return Finding("networks", "ok", f"onnxruntime can run them on {', '.join(providers)}")


def _one_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:160]}"


def check_rerun() -> Finding:
    """Check whether rerun's web viewer can be taken out of its program, as the page needs it."""
    try:
        from simaps_viz.recorder.web_viewer import viewer_assets

        size = sum(len(content) for content, _ in viewer_assets().values())
    except SIMapsError as error:
        return Finding("recorded builds", "fail", str(error), "pip install 'rerun-sdk==0.41.0'")
    except Exception as error:  # a broken rerun may raise anything; it is reported
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
        return Finding("GPU", "warn", "nvidia-smi finds no card", "check the driver, or continue without")
    return Finding("GPU", "ok", ", ".join(cards), "networks use it with the package onnxruntime-gpu")


def check_browser() -> Finding:
    """Start a headless browser, if one is found, and ask which renderer draws its WebGL."""
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
    if any(word in drawn_by.lower() for word in _SOFTWARE_RENDERERS):
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
        done = subprocess.run(command, capture_output=True, text=True, timeout=BROWSER_TIMEOUT_S, check=False)
    match = re.search(r'<p id="out">([^<]*)</p>', done.stdout)
    return html.unescape(match[1]) if match else None


def check_port(port: int) -> Finding:
    """Check whether the page's port on 127.0.0.1 is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or str(error)
            return Finding("port", "warn", f"127.0.0.1:{port} cannot be used ({why})",
                           "the page takes the next free one; --port chooses another")  # fmt: skip
    return Finding("port", "ok", f"127.0.0.1:{port} is free")


def check_memory(meminfo: Path = Path("/proc/meminfo")) -> Finding:
    """Check how much memory is left."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        lines = dict(line.split(":", 1) for line in meminfo.read_text().splitlines() if ":" in line)
        free_gb = int(lines["MemAvailable"].split()[0]) / 1e6
    except (OSError, KeyError, ValueError):
        return Finding("memory", "ok", f"unknown; {cores} cores")
    found = f"{free_gb:.1f} GB free, {cores} cores"
    if free_gb < LOW_MEMORY_GB:
        return Finding("memory", "warn", found, "close other programs: the demo with its page takes some 1.5 GB")
    return Finding("memory", "ok", found)


def check_clock(now_s: float | None = None) -> Finding:
    """Check that the clock is not behind the program's own files, and not years ahead of them."""
    now_s = time.time() if now_s is None else now_s
    newest_s = max(path.stat().st_mtime for path in Path(__file__).parent.glob("*.py"))
    date = datetime.fromtimestamp(now_s, tz=UTC).isoformat(timespec="seconds") if 0 <= now_s < 2e11 else str(now_s)
    if now_s < newest_s - DAY_S:
        return Finding("clock", "warn", f"{date} is before this program was installed",
                       "set it: certificates, logs and the newest recording depend on it")  # fmt: skip
    return Finding("clock", "ok", date)


def check_cache(folder: Path) -> Finding:
    """Check whether the cache can be written, and how much it holds."""
    if not _writable(folder):
        return Finding("cache", "fail", f"{folder} cannot be written",
                       "set SIMAPS_CACHE to a folder that can be")  # fmt: skip
    size, files = _size(folder)
    return Finding("cache", "ok", f"{folder}: {size / 1e6:.0f} MB in {files} files; may be deleted at any time")


def _size(folder: Path) -> tuple[int, int]:
    """Return the bytes and the number of the files in a folder; counting stops after `MAX_FILES`."""
    size = files = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            files += 1
            try:
                size += os.lstat(Path(parent) / name).st_size
            except OSError:  # removed meanwhile
                continue
        if files > MAX_FILES:
            break
    return size, files


def check_recordings() -> Finding:
    """Check the folder of the user's recorded builds."""
    from simaps_viz.recorder.library import RecordingLibrary

    library = RecordingLibrary()
    entries = library.entries()
    broken = [entry.name for entry in entries if entry.fault]
    found = f"{len(entries)} in {', '.join(map(str, library.folders))}"
    if not _writable(library.folders[0]):
        return Finding("recordings", "warn", f"{found}; {library.folders[0]} cannot be written",
                       "set SIMAPS_RECORDINGS to a folder that can be")  # fmt: skip
    if broken:
        return Finding("recordings", "warn", f"{found}; cannot be opened: {', '.join(broken)}",
                       f"delete: simaps recordings delete {broken[0]} --yes")  # fmt: skip
    return Finding("recordings", "ok", found)


def check_disk(folder: Path) -> Finding:
    """Check how much room is left where the cache is."""
    there = _existing(folder)
    free_gb = shutil.disk_usage(there).free / 1e9
    found = f"{free_gb:.1f} GB free at {there}"
    if free_gb < MIN_DISK_GB:
        return Finding("disk", "fail", found, "make room, or set SIMAPS_CACHE to another disk")
    if free_gb < LOW_DISK_GB:
        return Finding("disk", "warn", found, "make room: the demo takes some 0.2 GB, a recorded build up to 0.1 GB")
    return Finding("disk", "ok", found)


def _existing(folder: Path) -> Path:
    """Return the folder, or its nearest parent that exists."""
    absolute = folder.absolute()
    return next(path for path in (absolute, *absolute.parents) if path.exists())


def _writable(folder: Path) -> bool:
    there = _existing(folder)
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)
