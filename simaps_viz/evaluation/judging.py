"""People judge runs without knowing whose they are: a session file, one JSON line after the other.

The file holds the runs in the order they are shown, then one line for each answer, written through to the disk at
once; so a session resumes where it was, whatever happened. It also holds the methods: whoever judges must not read it.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np

from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole
from simaps_viz.io.limits import MAX_JSON_BYTES, read_bytes

FORMAT: Final = "simaps-judging/1"
Answered = Literal["yes", "no", "skip"]
"""Did it do what it was told? skip: the judge cannot tell."""
_HIDDEN: Final = ("method", "errors", "seed", "automatic", "strict", "wrong", "reason", "program", "planned", "meant")
"""Keys that would reveal the method, or the automatic verdict."""


@dataclass(frozen=True)
class BlindRun:
    """The part of a run that the judge is shown."""

    run_id: str
    """Does not reveal the method."""
    shown: Mapping[str, Any]
    """Command, start, track, stops and whether it refused or collided; never the method."""
    number: int
    """From 1, in the order of the session."""
    total: int


@dataclass(frozen=True)
class HumanScore:
    """Answers of the judges on one method."""

    yes: int = 0
    no: int = 0
    skipped: int = 0
    left: int = 0
    """Not judged yet."""

    @property
    def share(self) -> float | None:
        """Share of yes among yes and no; None before the first."""
        return self.yes / (self.yes + self.no) if self.yes + self.no else None


@dataclass
class JudgingSession:
    """An open session; make one with `start_session` or `resume_session`."""

    path: Path
    runs: Sequence[Mapping[str, Any]]
    """In the order shown, each with its ``run_id``."""
    answers: dict[str, Answered] = field(default_factory=dict)
    """{run_id: the last answer}."""

    def next_run(self) -> BlindRun | None:
        """Return the first run nobody has answered for; None when all are done. Asking again returns the same one."""
        for number, run in enumerate(self.runs, start=1):
            if run["run_id"] not in self.answers:
                shown = {key: value for key, value in run.items() if key not in (*_HIDDEN, "run_id")}
                return BlindRun(str(run["run_id"]), shown, number, len(self.runs))
        return None

    def judge(self, run_id: str, answer: Answered) -> None:
        """Note an answer, on the disk before this returns; a later answer for the same run replaces it.

        Raises:
            InputError: no such run or answer, or the file cannot be written.
        """
        if answer not in get_args(Answered):
            raise InputError(f"judging: expected {', '.join(get_args(Answered))}, found {answer!r}")
        if all(run["run_id"] != run_id for run in self.runs):
            raise InputError(f"judging: expected a run of {self.path}, found {run_id!r}")
        line = json.dumps({"event": "answer", "run_id": run_id, "answer": answer}) + "\n"
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"{self.path}: expected to append an answer, found {error}") from error
        self.answers[run_id] = answer

    def summary(self) -> dict[tuple[str, str], HumanScore]:
        """Return {(errors, method): what people say}, in alphabetical order."""
        scores: dict[tuple[str, str], dict[str, int]] = {}
        fields = {"yes": "yes", "no": "no", "skip": "skipped"}
        for run in self.runs:
            score = scores.setdefault((run["errors"], run["method"]), dict.fromkeys((*fields.values(), "left"), 0))
            answered = self.answers.get(run["run_id"])
            score[fields[answered] if answered else "left"] += 1
        return {key: HumanScore(**scores[key]) for key in sorted(scores)}


def start_session(path: Path, runs: Sequence[Mapping[str, Any]], *, seed: int = 0) -> JudgingSession:
    """Write a new session file with runs in random order.

    Args:
        path: where; must not exist yet.
        runs: from `NavigationRun.to_json`.
        seed: of the order.

    Raises:
        InputError: there is nothing to judge, the file exists, or it cannot be written.
    """
    if not runs:
        raise InputError(f"{path}: expected at least one run to judge, found none")
    if path.exists():
        raise InputError(f"{path}: expected a new file, found one; go on with it, or name another")
    order = np.random.default_rng(seed).permutation(len(runs))
    shuffled = [{"run_id": f"run-{n:04d}", **dict(runs[int(i)])} for n, i in enumerate(order, start=1)]
    lines = [json.dumps({"format": FORMAT, "seed": seed, "runs": len(runs)})]
    lines += [json.dumps({"event": "run", **run}) for run in shuffled]
    write_whole(path, ("\n".join(lines) + "\n").encode(), "the session")
    return JudgingSession(path, shuffled)


def resume_session(path: Path) -> JudgingSession:
    """Resume a session; a last line that a crash cut short is removed.

    Raises:
        InputError: it is not a session file, or a line of it is damaged (named).
    """
    text = read_bytes(path, MAX_JSON_BYTES, "a session file").decode("utf-8", errors="replace")
    whole, _, torn = text.rpartition("\n")
    lines = whole.split("\n") if whole else []
    records = [_record(path, number, line) for number, line in enumerate(lines, start=1)]
    if not records or records[0].get("format") != FORMAT:
        raise InputError(f"{path}: expected a session file ({FORMAT}), found something else")
    runs = [{k: v for k, v in r.items() if k != "event"} for r in records if r.get("event") == "run"]
    names = [run.get(key) for run in runs for key in ("run_id", "errors", "method")]
    if len(runs) != records[0].get("runs") or not all(isinstance(name, str) for name in names):
        raise InputError(f"{path}: expected {records[0].get('runs')} runs, found {len(runs)}")
    if torn:
        os.truncate(path, len(whole.encode("utf-8")) + 1)
    answers = {str(r.get("run_id")): r["answer"] for r in records if r.get("event") == "answer"}
    return JudgingSession(path, runs, answers)


def _record(path: Path, number: int, line: str) -> dict[str, Any]:
    try:
        record = json.loads(line)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {number}: expected JSON, found {error.msg}") from error
    except (ValueError, RecursionError) as error:  # a number of thousands of digits; nested too deeply
        raise InputError(f"{path}: line {number}: expected JSON of sensible depth, found none") from error
    answered = record.get("answer") if isinstance(record, dict) else None
    unknown = not isinstance(answered, str) or answered not in get_args(Answered)
    if not isinstance(record, dict) or (record.get("event") == "answer" and unknown):
        raise InputError(f"{path}: line {number}: expected a run or an answer, found {line[:40]!r}")
    return record
