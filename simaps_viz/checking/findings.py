"""What a check says: findings in words and numbers, and the correction that goes with them."""

from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["error", "warning", "note"]
"""error: the map would be wrong. warning: it may be. note: something could not be judged."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or could not be judged."""

    kind: str
    severity: Severity
    message: str
    """One sentence for somebody who has never seen the inside of this program."""
    measure: dict[str, Any] = field(default_factory=dict)
    """The numbers behind it; angles in degrees, lengths in metres, shares 0-1."""

    def to_json(self) -> dict[str, Any]:
        """Return it as one flat object."""
        return {"kind": self.kind, "severity": self.severity, "message": self.message, **self.measure}


@dataclass(frozen=True)
class Bar:
    """One hypothesis in the picture of the evidence."""

    label: str
    share: float
    """Agreement of neighbouring frames, 0-1."""
    stated: bool = False
    """It is what the files say."""
    chosen: bool = False
    """It is what the check believes."""


@dataclass(frozen=True)
class Correction:
    """What to change so that frames agree."""

    changes: tuple[str, ...]
    """In words."""
    values: dict[str, Any]
    """The new values by manifest key or file; only what changes."""
    agreement_before: float
    """Share of points of neighbouring frames that agree, as the files are (0-1)."""
    agreement_after: float

    def to_json(self) -> dict[str, Any]:
        """Return it as an object."""
        return {
            "changes": list(self.changes),
            **self.values,
            "agreement_before": round(self.agreement_before, 4),
            "agreement_after": round(self.agreement_after, 4),
        }
