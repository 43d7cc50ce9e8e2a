"""`simaps doctor`: is this installation in order, and if not, what to do?"""

from dataclasses import asdict, dataclass
from importlib.metadata import version

from simaps_viz.installation.finding import Finding
from simaps_viz.terminal import console, emit, say


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


def doctor(command: Doctor) -> bool:
    """Run all checks and print them; gives whether none failed."""
    from simaps_viz.installation import folders, machine, packages, programs  # noqa: PLC0415 - only needed here
    from simaps_viz.wiring import cache_folder  # noqa: PLC0415 - as above

    found = [
        packages.check_python(),
        *packages.check_dependencies(),
        packages.check_extras(),
        packages.check_kernels(),
        packages.check_networks(),
        programs.check_rerun(),
        programs.check_gpu(),
        *([programs.check_browser()] if command.browser else []),
        machine.check_port(command.port),
        machine.check_memory(),
        machine.check_clock(),
        folders.check_cache(cache_folder()),
        folders.check_recordings(),
        folders.check_disk(cache_folder()),
    ]
    ok = all(one.status != "fail" for one in found)
    if command.json:
        emit({"ok": ok, "version": version("simaps-viz"), "checks": [asdict(one) for one in found]})
        return ok
    for one in found:
        _print(one)
    failed, warned = (sum(one.status == status for one in found) for status in ("fail", "warn"))
    end = "all is in order" if ok and not warned else f"{failed} to put right, {warned} to know about"
    say(f"simaps {version('simaps-viz')}: {end}\n")
    return ok


def _print(one: Finding) -> None:
    say(f"{one.status:<5} {one.name}: {one.found}\n")
    if one.advice:
        say(f"      -> {one.advice}\n")
    console.file.flush()
