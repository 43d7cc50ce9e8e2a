"""Version bounds as pyproject.toml has them (``numpy<3,>=2.0``), as far as this program uses them."""

import re
from dataclasses import dataclass

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
    """Tell whether a version keeps all bounds: >=, >, <=, <, ==, !=, separated by commas."""
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
    """Give the leading numbers; ``2.17.7.post6`` counts its post release as one more."""
    numbers = re.match(r"^\d+(?:\.(?:post)?\d+)*", version.strip())
    return tuple(int(part.removeprefix("post")) for part in numbers[0].split(".")) if numbers else (0,)
