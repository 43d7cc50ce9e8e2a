"""Checks of Python and the packages."""

import html
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path
from typing import Literal

from simaps_viz.errors import SIMapsError

_REQUIREMENT = re.compile(r"^([A-Za-z0-9._-]+)(?:\[[^\]]*\])?\s*\(?([^;)]*)\)?\s*(?:;\s*(.*))?$")
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")


@dataclass(frozen=True)
class Requirement:
    """A package, the versions that will do, and the extra that brings it ("" = the core)."""

    package: str
    bounds: str
    extra: str


def parse_requirement(text: str) -> Requirement | None:
    """Read a line of a package's metadata; None when it is of another kind."""
    match = _REQUIREMENT.match(text.strip())
    if match is None:
        return None
    extra = _EXTRA.search(match[3] or "")
    return Requirement(match[1], match[2].replace(" ", ""), extra[1] if extra else "")


def within(version: str, bounds: str) -> bool:
    """Return whether a version keeps all bounds: >=, >, <=, <, ==, !=, separated by commas."""
    return all(_keeps(_key(version), bound.strip()) for bound in bounds.split(",") if bound.strip())


def _keeps(version: tuple[int, ...], bound: str) -> bool:
    match = re.match(r"^(>=|<=|==|!=|>|<)(.+)$", bound)
    if match is None:
        return True  # of a kind this program does not use
    other = _key(match[2])
    size = max(len(version), len(other))
    a, b = (key + (0,) * (size - len(key)) for key in (version, other))
    return {">=": a >= b, "<=": a <= b, "==": a == b, "!=": a != b, ">": a > b, "<": a < b}[match[1]]


def _key(version: str) -> tuple[int, ...]:
    """Return the leading numbers; ``2.17.7.post6`` counts its post release as one more."""
    numbers = re.match(r"^\d+(?:\.(?:post)?\d+)*", version.strip())
    return tuple(int(part.removeprefix("post")) for part in numbers[0].split(".")) if numbers else (0,)


Status = Literal["ok", "warn", "fail"]


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report."""

    name: str
    """What was looked at."""
    status: Status
    """warn: works, but slower or without something; fail: something does not work."""
    found: str
    advice: str = ""
    """What to do; empty when there is nothing."""


LITTLE_DISK_GB, TOO_LITTLE_DISK_GB = 2.0, 0.2
MOST_FILES = 200_000


def check_cache(folder: Path) -> Finding:
    """Check whether the cache can be written, and how much it holds."""
    if not _writable(folder):
        return Finding("cache", "fail", f"{folder} cannot be written",
                       "set SIMAPS_CACHE to a folder that can be")  # fmt: skip
    size, files = _size(folder)
    return Finding("cache", "ok", f"{folder}: {size / 1e6:.0f} MB in {files} files; may be deleted at any time")


def check_recordings() -> Finding:
    """Check the folder of the user's recorded builds."""
    from simaps_viz.recorder.library import RecordingLibrary  # noqa: PLC0415 - rerun is slow to import

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
    if free_gb < TOO_LITTLE_DISK_GB:
        return Finding("disk", "fail", found, "make room, or set SIMAPS_CACHE to another disk")
    if free_gb < LITTLE_DISK_GB:
        return Finding("disk", "warn", found, "make room: the demo takes some 0.2 GB, a recorded build up to 0.1 GB")
    return Finding("disk", "ok", found)


def _existing(folder: Path) -> Path:
    """Return the folder, or the nearest above it that is there."""
    absolute = folder.absolute()
    return next(path for path in (absolute, *absolute.parents) if path.exists())


def _writable(folder: Path) -> bool:
    there = _existing(folder)
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _size(folder: Path) -> tuple[int, int]:
    """Return the bytes and the number of the files in a folder; counting stops at a great many."""
    size = files = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            files += 1
            try:
                size += os.lstat(Path(parent) / name).st_size
            except OSError:  # removed meanwhile
                continue
        if files > MOST_FILES:
            break
    return size, files


LITTLE_MEMORY_GB = 2.0
A_DAY_S = 86_400.0


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
    if free_gb < LITTLE_MEMORY_GB:
        return Finding("memory", "warn", found, "close other programs: the demo with its page takes some 1.5 GB")
    return Finding("memory", "ok", found)


def check_clock(now_s: float | None = None) -> Finding:
    """Check that the clock is not behind the program's own files, and not years ahead of them."""
    now_s = time.time() if now_s is None else now_s
    newest_s = max(path.stat().st_mtime for path in Path(__file__).parent.glob("*.py"))
    said = datetime.fromtimestamp(now_s, tz=UTC).isoformat(timespec="seconds") if 0 <= now_s < 2e11 else str(now_s)
    if now_s < newest_s - A_DAY_S:
        return Finding("clock", "warn", f"{said} is before this program was installed",
                       "set it: certificates, logs and the newest recording go by it")  # fmt: skip
    return Finding("clock", "ok", said)


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


PACKAGE = "simaps-viz"
NOT_ASKED_FOR = ("dev",)
"""Extras of the people who work on the program."""


def check_python() -> Finding:
    """Python's version against the program's bounds."""
    found = ".".join(map(str, sys.version_info[:3]))
    bounds = metadata(PACKAGE)["Requires-Python"] or ""
    if within(found, bounds):
        return Finding("Python", "ok", f"{found} ({sys.executable})")
    return Finding("Python", "fail", f"{found}, expected {bounds}", f"install {PACKAGE} with a Python {bounds}")


def requirements() -> list[Requirement]:
    """Return what the installed program's metadata asks for."""
    return [one for text in requires(PACKAGE) or [] if (one := parse_requirement(text)) is not None]


def check_dependencies() -> list[Finding]:
    """Check each package of the core; those in order share one line."""
    core = [one for one in requirements() if not one.extra]
    faults = [fault for one in core if (fault := _fault(one)) is not None]
    good = [f"{one.package} {_version(one.package)}" for one in core if _fault(one) is None]
    return [*faults, Finding("packages", "ok", f"{len(good)} within their bounds: {', '.join(sorted(good))}")]


def check_extras() -> Finding:
    """Check which extras are there; a package of another version than asked for is worth knowing."""
    wanted: dict[str, list[Requirement]] = {}
    for one in requirements():
        if one.extra and one.extra not in NOT_ASKED_FOR and one.package != PACKAGE:
            wanted.setdefault(one.extra, []).append(one)
    wrong = [f"{o.package} {_version(o.package)} (expected {o.bounds})" for all_of in wanted.values() for o in all_of
             if _version(o.package) and not within(_version(o.package) or "", o.bounds)]  # fmt: skip
    there = sorted(name for name, all_of in wanted.items() if all(_version(one.package) for one in all_of))
    missing = sorted(set(wanted) - set(there))
    found = f"installed: {', '.join(there) or 'none'}; not installed: {', '.join(missing) or 'none'}"
    if wrong:
        return Finding("extras", "warn", f"{found}; {', '.join(wrong)}", f"pip install --upgrade '{PACKAGE}'")
    advice = f"if you need one: pip install '{PACKAGE}[{missing[0]}]'" if missing else ""
    return Finding("extras", "ok", found, advice)


def check_kernels() -> Finding:
    """Check whether compiled kernels are kept, and run one."""
    try:
        import numpy as np  # noqa: PLC0415 - a broken one is a finding

        from simaps_viz.mapping import projection  # noqa: PLC0415 - as above

        started = time.perf_counter()
        cells, heights = np.full((2, 2), -1, np.int32), np.zeros((2, 2), np.float32)
        projection.project_pixels(
            np.ones((2, 2), np.float32), 1.0, 1.0, 0.5, 0.5, np.eye(4), 0.1, 6.0, -9.0, 9.0, 0.05, -50, -50, 100, 100,
            cells, heights,
        )  # fmt: skip
        seconds = time.perf_counter() - started
    except Exception as error:  # a broken numba or numpy raises whatever comes; the doctor tells it
        return Finding("compiled kernels", "fail", _one_line(error), "reinstall numba and numpy: pip install --upgrade")
    if (cells < 0).any():
        return Finding("compiled kernels", "fail", "one gave a wrong answer", "reinstall numba: pip install --upgrade")
    where = kernel_folder(Path(str(projection.__file__)).parent)
    if where is None:
        return Finding("compiled kernels", "warn", "work, but cannot be kept: each start compiles them anew (a minute)",
                       "set NUMBA_CACHE_DIR to a folder that can be written")  # fmt: skip
    return Finding("compiled kernels", "ok", f"work ({seconds:.2f} s for the first), kept in {where}")


def kernel_folder(source: Path) -> Path | None:
    """Return where numba keeps what it compiled from files of a folder; None when nowhere can be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    for folder in [Path(chosen)] if chosen else [source / "__pycache__", home]:
        there = next((p for p in (folder, *folder.parents) if p.exists()), None)
        if there is not None and there.is_dir() and os.access(there, os.W_OK | os.X_OK):
            return folder
    return None


def check_networks() -> Finding:
    """Check what segmentation networks would run on."""
    if _version("onnxruntime") is None and _version("onnxruntime-gpu") is None:
        return Finding("networks", "ok", "onnxruntime is not installed; masks that come with a sequence need none",
                       "for --segmentation NET.onnx: pip install onnxruntime")  # fmt: skip
    try:
        from simaps_viz.segmentation.session import available_providers  # noqa: PLC0415 - slow to import

        providers = available_providers()
    except Exception as error:  # as above, of a broken onnxruntime
        return Finding("networks", "fail", f"onnxruntime: {_one_line(error)}", "pip install --upgrade onnxruntime")
    return Finding("networks", "ok", f"onnxruntime can run them on {', '.join(providers)}")


def _fault(one: Requirement) -> Finding | None:
    found = _version(one.package)
    if found is None:
        return Finding(one.package, "fail", "not installed", f"pip install '{one.package}{one.bounds}'")
    if not within(found, one.bounds):
        advice = f"pip install '{one.package}{one.bounds}'"
        return Finding(one.package, "fail", f"version {found}, expected {one.bounds}", advice)
    return None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _one_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:160]}"
