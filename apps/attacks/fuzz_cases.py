"""What a fuzzing target is, and what came of one case: success, a refusal in one line, or a finding."""

import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import TracebackType

from simaps_viz.errors import SIMapsError

Case = Callable[[Random], object]
"""Makes one input of random choices and gives it to the program."""
PATIENCE_S = 10.0
"""Processor time of one case; more is a hang."""
MAX_MESSAGE = 1500


@dataclass(frozen=True)
class Target:
    """One way into the program."""

    name: str
    prepare: Callable[[Path], Case]
    """Makes what all cases need, in a folder of its own."""
    weight: int = 1
    """Cases of it for every thousand of all."""
    guided: bool = False
    """Pure Python, so coverage can guide it."""


class Hang(BaseException):
    """A case took too long; nothing in the program may catch it."""


@dataclass(frozen=True)
class Finding:
    """Something that must not happen."""

    target: str
    case: int
    kind: str
    """"traceback", "hang", "message", "died" or "file"."""
    where: str
    """The last line of this program on the way, and the kind of error: findings of one fault share it."""
    detail: str

    def __str__(self) -> str:
        return f"{self.target} case {self.case}: {self.kind} at {self.where}: {self.detail}"


def choices(target: str, seed: int, case: int) -> Random:
    """Return the random numbers of a case: the same ones whenever it is run."""
    return Random(f"{seed}/{target}/{case}")


def limit_time() -> None:
    """Have a case that takes too long end in `Hang`."""

    def over(number: int, frame: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, over)


def try_case(target: Target, case: Case, number: int, source: Random) -> str | Finding:
    """Run one case: "accepted", "refused" or a finding."""
    signal.setitimer(signal.ITIMER_PROF, PATIENCE_S)
    try:
        case(source)
    except SIMapsError as error:
        return _judge_message(target, number, error)
    except (Exception, Hang) as error:
        kind = "hang" if isinstance(error, Hang) else "traceback"
        text = " ".join(str(error).split())[:300]
        return Finding(target.name, number, kind, f"{_last_line(error.__traceback__)} {type(error).__name__}", text)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return "accepted"


def _judge_message(target: Target, number: int, error: SIMapsError) -> str | Finding:
    """Check that a refusal is one line that can be printed anywhere."""
    text = str(error)
    fault = ""
    if len(text.splitlines()) != 1:
        fault = "not one line"
    elif len(text) > MAX_MESSAGE:
        fault = f"{len(text)} characters"
    elif any(c != "\t" and not c.isprintable() for c in text):
        fault = "characters that cannot be printed"
    if not fault:
        return "refused"
    where = f"{_last_line(error.__traceback__)} {type(error).__name__}"
    return Finding(target.name, number, "message", where, f"{fault}: {text[:300]!a}")


def _last_line(trace: TracebackType | None) -> str:
    frames = traceback.extract_tb(trace)
    own = [f for f in frames if "simaps_viz" in f.filename] or frames
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else "?"


def write(line: str) -> None:
    """Write a line of progress to standard error."""
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
