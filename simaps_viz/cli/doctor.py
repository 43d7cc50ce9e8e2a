"""`simaps doctor`: is this installation in order, and if not, what to do?"""

from dataclasses import asdict, dataclass
from importlib.metadata import version

from simaps_viz.cli.installation import Finding
from simaps_viz.console.terminal import console, emit, say


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
    from simaps_viz.app.workbench import cache_folder  # noqa: PLC0415 - as above
    from simaps_viz.cli import (  # noqa: PLC0415 - only needed here
        installation,
    )

    found = [
        installation.check_python(),
        *installation.check_dependencies(),
        installation.check_extras(),
        installation.check_kernels(),
        installation.check_networks(),
        installation.check_rerun(),
        installation.check_gpu(),
        *([installation.check_browser()] if command.browser else []),
        installation.check_port(command.port),
        installation.check_memory(),
        installation.check_clock(),
        installation.check_cache(cache_folder()),
        installation.check_recordings(),
        installation.check_disk(cache_folder()),
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
