"""All attacks by name, and running them."""

import inspect
import time
from collections.abc import Callable
from dataclasses import dataclass

from attacks import changes, floods, messages, requests
from attacks.files import Watched
from attacks.target import Target, Tries

Attack = Callable[[Target], Tries]
ATTACKS: tuple[Attack, ...] = tuple(
    found
    for module in (requests, messages, changes, floods)
    for name, found in vars(module).items()
    if inspect.isgeneratorfunction(found) and not name.startswith("_") and found.__module__ == module.__name__
)
"""In the order of their files."""


@dataclass(frozen=True)
class Outcome:
    """How one attack went."""

    name: str
    what: str
    tried: int
    succeeded: tuple[str, ...]
    """What its successful tries brought about."""
    seconds: float


def run_attack(attack: Attack, target: Target, watched: Watched | None = None) -> Outcome:
    """Try everything of one attack, and then whether an honest page still works and all files are as they were."""
    begun = time.monotonic()
    before = watched.files() if watched else {}
    found = [*attack(target), target.is_well()]
    if watched:
        found += watched.changes(before) or [None]
    what = (inspect.getdoc(attack) or "").partition("\n")[0]
    succeeded = tuple(one for one in found if one is not None)
    return Outcome(attack.__name__, what, len(found), succeeded, time.monotonic() - begun)
