"""What a check found."""

from dataclasses import dataclass
from typing import Literal

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
