"""Attack a workbench on this machine, and print what came of it: `python apps/attack.py MAP.npz`.

Everything that is attacked is a copy, in folders of its own: the map, a recording, the data, cache and configuration
of a user. Each file in them, and each file of this checkout, is looked at before and after every attack; one that
changed, came or is gone counts as a success.
"""

import os
import shutil
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from unittest import mock

import tyro
from attacks.changes import OWN, build_to_stop
from attacks.files import CHECKOUT, Watched, user_folders
from attacks.run import ATTACKS, run_attack
from attacks.target import Target

from simaps_viz.app import workbench
from simaps_viz.mapping.file import load_map
from simaps_viz.mapping.mending import open_mending
from simaps_viz.recorder.library import RecordingLibrary
from simaps_viz.viewer.server.access import OWNER_VARIABLE, TOKEN_VARIABLE


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
    with user_folders() as folder:
        copy = _copies(folder, config.map)
        simap, given = load_map(copy), {TOKEN_VARIABLE: "A-token_of_0123456789_abcdefghij"}
        given[OWNER_VARIABLE] = f"{given[TOKEN_VARIABLE]}-owner"
        recording, secret = copy.with_name("toy.rrd"), copy.with_name("secret.txt")
        opened = partial(
            workbench.open_workbench, simap, recording=recording, map_path=copy, mending=open_mending(copy)
        )
        with (
            opened(port=8280) as bench,
            mock.patch.dict(os.environ, given),
            opened(port=8290) as closed,
        ):
            for one in (bench, closed):
                one.services = replace(one.services, panels=(*one.services.panels, build_to_stop(folder)))
            watched = Watched([folder, CHECKOUT, config.map.absolute().parent])
            outcomes = [run_attack(attack, Target(bench, closed, secret), watched) for attack in chosen]
    for one in outcomes:
        sys.stdout.write(f"| {one.name} | {one.what} | {one.tried} | {len(one.succeeded)} |\n")
        for what in one.succeeded[:5]:
            sys.stdout.write(f"    {what}\n")
    tried, succeeded = sum(one.tried for one in outcomes), sum(len(one.succeeded) for one in outcomes)
    sys.stdout.write(f"{len(outcomes)} attacks, {tried} tries, {succeeded} succeeded\n")
    return 1 if succeeded else 0


def _copies(folder: Path, map_path: Path) -> Path:
    """Fill a user's folders with a recording and all files of a map; returns the map."""
    work = folder / "work"
    for file in map_path.parent.glob(f"{map_path.stem}*"):
        if file.is_file():
            shutil.copy2(file, work)
    recording = work / "toy.rrd"
    recording.write_bytes(bytes(range(256)) * 40)  # the servers read nothing of it
    library = RecordingLibrary()
    library.trash.mkdir()
    for place in (library.folders[0] / f"{OWN}.rrd", library.trash / "old.rrd"):
        shutil.copy2(recording, place)
    (work / "secret.txt").write_text(Target.secret_text)
    (work / "link.rrd").symlink_to(work / "secret.txt")
    return work / map_path.name


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Attack)))
