"""Attack a workbench on this machine, and print what came of it: `python apps/attack.py`."""

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import tyro
from attacks.run import ATTACKS, run_attack
from attacks.target import Target

from simaps_viz.app import workbench
from simaps_viz.mapping.file import load_map
from simaps_viz.viewer.server.access import TOKEN_VARIABLE


@dataclass(frozen=True)
class Attack:
    """What to attack, and how."""

    map: tyro.conf.Positional[Path]
    """Map file (.npz), whose page is attacked."""
    only: str = ""
    """Attacks whose names hold this."""


def main(config: Attack) -> int:
    """Try everything; the exit status is 1 when an attack succeeded."""
    chosen = [attack for attack in ATTACKS if config.only in attack.__name__]
    with tempfile.TemporaryDirectory(prefix="simaps-attack-") as folder:
        recording, secret = Path(folder) / "toy.rrd", Path(folder) / "secret.txt"
        recording.write_bytes(bytes(range(256)) * 40)  # the servers read nothing of it
        secret.write_text(Target.secret_text)
        (Path(folder) / "link.rrd").symlink_to(secret)
        simap, given = load_map(config.map), {TOKEN_VARIABLE: "A-token_of_0123456789_abcdefghij"}
        with (
            workbench.open_workbench(simap, recording=recording, port=8280) as bench,
            mock.patch.dict(os.environ, given),
            workbench.open_workbench(simap, recording=recording, port=8290) as closed,
        ):
            outcomes = [run_attack(attack, Target(bench, closed, secret)) for attack in chosen]
    for one in outcomes:
        sys.stdout.write(f"| {one.name} | {one.what} | {one.tried} | {len(one.succeeded)} |\n")
        for what in one.succeeded[:5]:
            sys.stdout.write(f"    {what}\n")
    tried, succeeded = sum(one.tried for one in outcomes), sum(len(one.succeeded) for one in outcomes)
    sys.stdout.write(f"{len(outcomes)} attacks, {tried} tries, {succeeded} succeeded\n")
    return 1 if succeeded else 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Attack)))
