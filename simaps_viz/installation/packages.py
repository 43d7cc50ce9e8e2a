"""Checks of Python and the packages."""

import os
import sys
import time
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path

from simaps_viz.installation.bounds import Requirement, parse_requirement, within
from simaps_viz.installation.finding import Finding

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
    """Give what the installed program's metadata asks for."""
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
    """Give where numba keeps what it compiled from files of a folder; None when nowhere can be written."""
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
