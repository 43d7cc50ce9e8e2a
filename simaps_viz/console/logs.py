"""The log of the program: for people on stderr, for programs as JSON lines in a file.

Every command takes ``--verbose`` and ``--log FILE``, anywhere among its other options.
"""

import json
import logging
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from simaps_viz.errors import InputError

HELP = "Every command also takes --verbose (how long each stage took) and --log FILE (JSON lines, appended)."
logger = logging.getLogger("simaps_viz")
_PLAIN = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName"}


@dataclass(frozen=True)
class LogOptions:
    """What is logged, and where."""

    verbose: bool = False
    """Log to stderr what is done and how long it took."""
    file: Path | None = None
    """Append everything to this file, one JSON object a line."""


def take_log_options(arguments: Sequence[str]) -> tuple[list[str], LogOptions]:
    """Take ``--verbose`` and ``--log FILE`` out of a command line; words after ``--`` are left alone.

    Raises:
        InputError: --log without a file.
    """
    rest, verbose, file = [], False, None
    waiting = list(arguments)
    while waiting:
        word = waiting.pop(0)
        if word == "--":
            rest += [word, *waiting]
            break
        if word == "--verbose":
            verbose = True
        elif word == "--log" or word.startswith("--log="):
            value = word.partition("=")[2] if "=" in word else (waiting.pop(0) if waiting else "")
            if not value or value.startswith("--"):
                raise InputError("--log: expected a file to append to, found none")
            file = Path(value)
        else:
            rest.append(word)
    return rest, LogOptions(verbose, file)


@contextmanager
def logged(options: LogOptions, console: Console) -> Iterator[None]:
    """Write log records of the block where the options say; an unexpected exception is logged and raised again.

    Raises:
        InputError: the file cannot be written.
    """
    handlers: list[logging.Handler] = [_ForPeople(console, logging.INFO if options.verbose else logging.WARNING)]
    level, propagates = logger.level, logger.propagate
    try:
        if options.file is not None:
            handlers.append(_open_file(options.file, console))
        for handler in handlers:
            logger.addHandler(handler)
        logger.setLevel(logging.DEBUG if options.file else handlers[0].level)
        logger.propagate = False
        yield
    except (SystemExit, KeyboardInterrupt, InputError):
        raise
    except Exception:
        if options.file is not None:
            logger.critical("a fault of the program", exc_info=True, extra={"event": "fault", "people": False})
        raise
    finally:
        logger.propagate = propagates
        logger.setLevel(level)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()


def log_stages(seconds: dict[str, float]) -> None:
    """Log how long each stage took, and the total."""
    if not seconds:
        return
    for stage, value in seconds.items():
        logger.info("%-34s %8.2f s", stage, value, extra={"event": "stage", "stage": stage, "seconds": value})
    if len(seconds) > 1:
        total = round(sum(seconds.values()), 4)
        logger.info("%-34s %8.2f s", "together", total, extra={"event": "stages", "seconds": total})


@contextmanager
def logged_command(name: str, options: Any) -> Iterator["CommandLog"]:
    """Log the start of a command, and how it ended."""
    log = CommandLog()
    started = time.perf_counter()
    logger.debug("simaps %s", name, extra={"event": "started", "command": name, "options": _plain(options)})
    try:
        yield log
    finally:
        seconds = round(time.perf_counter() - started, 4)
        logger.debug(
            "simaps %s: status %s after %.2f s", name, log.status, seconds,
            extra={"event": "ended", "command": name, "status": log.status, "seconds": seconds},
        )  # fmt: skip


@dataclass
class CommandLog:
    """How a command ended."""

    status: int | None = None
    """Exit status; None = ended by a fault of the program."""


class JsonLines(logging.Formatter):
    """Formats a record as one line of JSON: time (UTC), level, logger, message, and its extra fields."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, tz=UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            "process": record.process,
            "thread": record.threadName,
        }
        line |= {key: value for key, value in vars(record).items() if key not in _PLAIN and key != "people"}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str, ensure_ascii=False)


class _ForPeople(logging.Handler):
    """Writes on the console that shows the progress bars."""

    def __init__(self, console: Console, level: int) -> None:
        super().__init__(level)
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        if not getattr(record, "people", True):
            return
        style = "red" if record.levelno >= logging.ERROR else "yellow" if record.levelno >= logging.WARNING else "dim"
        text = record.getMessage()
        if record.exc_info and record.exc_info[1] is not None:
            text += f": {type(record.exc_info[1]).__name__}: {record.exc_info[1]}"
        self._console.print(text, markup=False, soft_wrap=True, style=style)


class _ToFile(logging.FileHandler):
    """A log file. When it cannot be written any more, e.g. on a full disk, this is reported once and work continues."""

    def __init__(self, path: Path, console: Console) -> None:
        super().__init__(path, encoding="utf-8")
        self._console, self._name, self._failed = console, path, False

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            super().handleError(record)
        elif not self._failed:
            self._failed = True
            text = f"{self._name}: the log ends here, it could not be written: {error.strerror or error}"
            self._console.print(text, markup=False, soft_wrap=True, style="yellow")

    def close(self) -> None:
        with suppress(OSError):  # from what was still to be written; it was reported before
            super().close()


def _open_file(path: Path, console: Console) -> logging.Handler:
    if path.is_dir() or not os.access(path.absolute().parent, os.W_OK):
        raise InputError(f"{path}: expected a file in a folder that can be written for --log, found none")
    try:
        handler = _ToFile(path, console)
    except OSError as error:
        raise InputError(f"{path}: could not open the log: {error.strerror or error}") from error
    handler.setFormatter(JsonLines())
    handler.setLevel(logging.DEBUG)
    return handler


def _plain(options: Any) -> Any:
    """Return a command's options as plain values."""
    fields = getattr(options, "__dataclass_fields__", None)
    if fields is None:
        return options if isinstance(options, str | int | float | bool | None) else str(options)
    return {name: _plain(getattr(options, name)) for name in fields}
