"""Settings and fixtures of all tests."""

import gc
import signal
import subprocess
import sys
from contextlib import ExitStack
from itertools import chain, zip_longest
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# How long an example takes says how busy the machine is, not whether the program is right; and a change is judged by
# the same examples everywhere. Others are drawn by `pytest --hypothesis-profile=others`, and by `apps/fuzz.py`.
settings.register_profile(
    "same examples", max_examples=30, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("others", settings.get_profile("same examples"), derandomize=False, max_examples=1000)
settings.load_profile("same examples")


SLOW_FOLDERS = {"docs", "process"}
BEGUN_FIRST = ("checking", "process", "docs", "live", "scenes", "language", "segmentation", "evaluation", "viewer")
"""The folders whose files take long: begun last, one of them would keep one worker busy and leave the others idle."""


@pytest.hookimpl(tryfirst=True)  # before workers are started
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile kernels and tests once, in a fresh checkout, before several workers and their processes each do it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # begun in the background: so would be what tests interrupt
        signal.signal(signal.SIGINT, signal.default_int_handler)
    tests = Path(__file__).parent
    starts_workers = getattr(session.config.option, "numprocesses", None) and not hasattr(session.config, "workerinput")
    if starts_workers and not any((tests.parent / "simaps_viz").rglob("*.nbi")):
        collect = [sys.executable, "-m", "pytest", "--collect-only", "-p", "no:cacheprovider", str(tests)]
        with subprocess.Popen(collect, cwd=tests.parent, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL):
            subprocess.run([sys.executable, tests / "helpers" / "compile_kernels.py"], check=True)


@pytest.hookimpl(tryfirst=True)  # before `-m` chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that are given the browser, by whatever fixture, and those of the folders that start processes.

    Files that take long come first, in turn one of the browser, which mostly waits, and one of another folder, which
    computes meanwhile; the tests of one file keep their order.
    """
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    drawn = [tests for path, tests in files.items() if path.parent.name == "browser"]
    others = [tests for path, tests in files.items() if path.parent.name != "browser"]
    others.sort(key=lambda tests: BEGUN_FIRST.index(name) if (name := tests[0].path.parent.name) in BEGUN_FIRST else 99)
    items[:] = chain.from_iterable(chain.from_iterable(zip_longest(drawn, others, fillvalue=[])))
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker("browser")
        if item.path.parent.name in SLOW_FOLDERS:
            item.add_marker("slow")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Look for no garbage while files are imported, which leaves next to none: each worker does so for all tests."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def _keep() -> None:
    """Let garbage be looked for in what comes from now on only: what is imported stays, and is half a million objects.

    A workbench looks for it whenever its last page has closed.
    """
    gc.collect()
    gc.freeze()


def pytest_collection_finish() -> None:
    """See ``_keep``."""
    _keep()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    """Write what attacks sent (bytes that are no text) as escapes: a worker cannot send a report that holds it."""
    outcome = yield
    report = outcome.get_result()
    report.sections = [(name, _sendable(text)) for name, text in report.sections]
    if report.failed and report.longrepr is not None:
        report.longrepr = _sendable(str(report.longrepr))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Report in one line how many tests had no real recordings to run on."""
    skipped = [report.longrepr for report in terminalreporter.stats.get("skipped", [])]
    lacking = sum(isinstance(why, tuple) and "shared" in why[2] for why in skipped)
    if lacking:
        terminalreporter.write_line(f"{lacking} tests on real recordings were left out: ../shared/data is not here")


def _sendable(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


_chromium: ExitStack = ExitStack()
_started: list = []


@pytest.fixture(scope="module")
def browser():
    """Debian's Chromium: the same for all files in a row that need it."""
    from browser import chromium  # noqa: PLC0415 - tests without a page do not need it

    if not _started:
        _started.append(_chromium.enter_context(chromium()))
    return _started[0]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None):
    """Close the browser before a file that does not need it: it keeps an event loop running in their thread."""
    try:
        return (yield)
    finally:
        if nextitem is None or (nextitem.path != item.path and nextitem.get_closest_marker("browser") is None):
            _started.clear()
            _chromium.close()
        if nextitem is not None and nextitem.path != item.path:
            _keep()
