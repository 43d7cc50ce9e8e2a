"""Print what many people at once do to one server: `python apps/load.py --clients 20 --minutes 3`.

The server is that of a new user, whose files have to be as they were in the end, as those of this checkout.
"""

import asyncio
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from attacks import load as page_load
from attacks.files import CHECKOUT, Watched, user_folders

from simaps_viz import BuildConfig, open_sequence
from simaps_viz.app import workbench
from simaps_viz.console.progress import stage_progress
from simaps_viz.mapping.file import load_map
from simaps_viz.scenes.demo import ensure_demo


@dataclass(frozen=True)
class Load:
    """How many people, and how long."""

    clients: int = 20
    minutes: float = 3.0
    map: Path | None = None
    """Map file (.npz); by default the embedded café, with its recorded build."""
    port: int = 8180


def main(config: Load) -> int:
    """Run it; the exit status is 1 when an answer was lost or went to the wrong page, or a file was changed."""
    path = config.map
    if path is None:
        with stage_progress() as progress:
            sequence = open_sequence(ensure_demo(cache_dir=workbench.cache_folder(), progress=progress))
            path = workbench.cached_build(sequence, "evidence", BuildConfig(), progress)[1].with_suffix(".npz")
    with user_folders() as folder:
        for file in path.parent.glob(f"{path.stem}*"):
            if file.is_file():
                shutil.copy2(file, folder / "work")
        watched = Watched([folder, CHECKOUT, path.absolute().parent])
        before = watched.files()
        server = page_load.Server(folder / "work" / path.name, config.port)

        def tell(when: str) -> None:
            say(f"{when}: {server.state()}; {page_load.busy()}")

        try:
            seconds, simap = config.minutes * 60.0, load_map(path)
            tally = asyncio.run(page_load.load(server.url, simap, clients=config.clients, seconds=seconds, tell=tell))
        finally:
            server.close()
        changed = watched.changes(before)
    for kind in tally.seconds:
        say(tally.line(kind))
    say(f"{config.clients} pages, {config.minutes:g} min: {tally}, {len(changed)} files changed")
    for one in (*tally.lost[:10], *tally.crossed[:10], *changed[:10]):
        say(one)
    return 1 if tally.lost or tally.crossed or changed else 0


def say(line: str) -> None:
    """Write a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Load)))
