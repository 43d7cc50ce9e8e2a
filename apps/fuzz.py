"""Run every reader on damaged and hostile input, and print what came of it. See docs/RELIABILITY.md.

Readers run as a new user. A file of theirs or of this checkout that was changed, came or is gone is a finding.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))  # the targets use the tests' samples

from attacks.files import CHECKOUT, Watched, user_folders
from attacks.fuzz_guided import guide
from attacks.fuzz_runner import faults, fuzz, quotas, table
from attacks.fuzz_targets import TARGETS


@dataclass(frozen=True)
class Fuzz:
    """How many cases of what."""

    cases: int = 20_000
    """In all; they are shared out by what a case costs."""
    targets: tuple[str, ...] = ()
    """Only these; by default all."""
    seed: int = 0
    """Case n of a target is always the same."""
    seconds: float = 1e9
    """Stop after so long."""
    results: Path | None = None
    """Keep the numbers in this file; run again, it goes on from there."""
    guided: bool = False
    """Let coverage guide the choices (atheris, extra fuzz), in the pure Python targets."""


def main(config: Fuzz) -> int:
    """Fuzz and print; the exit status is 0 when nothing was found."""
    unknown = [name for name in config.targets if name not in TARGETS]
    if unknown:
        sys.stderr.write(f"--targets: expected some of {', '.join(TARGETS)}, found {unknown[0]}\n")
        return 2
    names = [n for n in config.targets or TARGETS if TARGETS[n].guided or not config.guided]
    run = guide if config.guided else fuzz
    wanted = quotas(config.cases, names)
    with user_folders() as folder:
        watched = Watched([folder, CHECKOUT])
        tallies = run(wanted, watched, seed=config.seed, results=config.results, seconds=config.seconds)
    sys.stdout.write(table(tallies) + "\n")
    for one in faults(tallies.values()):
        sys.stdout.write(f"{one['target']} case {one['case']}: {one['kind']} at {one['where']}: {one['detail']}\n")
    return int(any(tally.findings for tally in tallies.values()))


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Fuzz)))
