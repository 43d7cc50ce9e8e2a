"""Score maps of the embedded places in space, beside both baselines; ``--write`` renews the table of docs/METHOD.md."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.paper import at_most
from benchmarks.paper_text import table

from simaps_viz.build.methods import build
from simaps_viz.console.progress import stage_progress
from simaps_viz.datasets.open import open_sequence
from simaps_viz.evaluation.space import SpaceReport, evaluate_space
from simaps_viz.scenes.demo import ensure_demo
from simaps_viz.scenes.places import PLACES

PAGE = Path(__file__).parents[1] / "docs" / "METHOD.md"
BEGIN, END = "<!-- begins: apps/bench_space.py -->\n", "<!-- ends: apps/bench_space.py -->\n"
SHOWN = ("PQ", "strict PQ", "volume", "below", "box F1 .25", "on F1", "under F1")
"""Columns of `simaps evaluate --task 3d` that the table has, beside the hidden things."""


@dataclass(frozen=True)
class Bench:
    """How much is measured."""

    sequences: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Folders or manifests with exact ids, such as the house, before the embedded places."""
    places: tuple[str, ...] = tuple(PLACES)
    """Embedded places."""
    errors: tuple[str, ...] = ("none", "light", "medium")
    """Masks."""
    most: int = 300
    """Frames of a place, evenly chosen; 0 = all."""
    write: bool = False
    """Renew the table of docs/METHOD.md."""


def reports(config: Bench) -> Iterator[SpaceReport]:
    """Yield the scores of each sequence and place, rendering what is not there yet."""
    with stage_progress() as progress:
        for path in config.sequences:
            yield evaluate_space(open_sequence(path), ("evidence",), errors=config.errors, build=build)
        for place in config.places:
            manifest = at_most(ensure_demo(place, level="none", progress=progress), config.most)
            yield evaluate_space(open_sequence(manifest), ("evidence",), errors=config.errors, build=build)


def rows_of(report: SpaceReport) -> Iterator[list[str]]:
    """Yield a line for each kind of masks and each method."""
    found, known = report.table(), ""
    for cells in found.rows:
        row = dict(zip(found.columns, cells, strict=True))
        masks = f"{report.name}, {row['errors']}" if row["errors"] != known else ""
        known = row["errors"]
        hidden = f"{row['matched']} of {row['hidden']}"
        yield [masks, row["method"], row["true"], hidden, *(row[name].replace("0.", ".", 1) for name in SHOWN)]


def main(config: Bench) -> None:
    """Score, print each sequence's lines as soon as they are known, and write what was asked for."""
    lines = table(["place, masks", "method", "things", "hidden things matched", *SHOWN], [])
    sys.stdout.write("\n".join(lines) + "\n")
    for report in reports(config):
        new = table([], rows_of(report))[2:]
        sys.stdout.write("\n".join(new) + "\n")
        sys.stdout.flush()
        lines += new
    if config.write:
        before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        _, after = rest.split(END)
        PAGE.write_text(before + BEGIN + "\n".join(lines) + "\n" + END + after, encoding="utf-8")


if __name__ == "__main__":
    main(tyro.cli(Bench))
