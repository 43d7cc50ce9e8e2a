"""Score maps of the embedded places in space, beside both baselines; ``--write`` renews its rows in docs/METHOD.md."""

import sys
from collections.abc import Iterator, Sequence
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
    """Renew the table of docs/METHOD.md; rows of places and masks that were not measured stay."""


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


def by_masks(lines: Sequence[str]) -> dict[str, list[str]]:
    """Return the rows of a table by their place and masks, which only the first row of each names."""
    found: dict[str, list[str]] = {}
    name = ""
    for line in lines:
        name = line.split("|")[1].strip() or name
        found.setdefault(name, []).append(line)
    return found


def main(config: Bench) -> None:
    """Score, print each sequence's lines as soon as they are known, and write what was asked for."""
    head, lines = table(["place, masks", "method", "things", "hidden things matched", *SHOWN], []), list[str]()
    sys.stdout.write("\n".join(head) + "\n")
    for report in reports(config):
        new = table([], rows_of(report))[2:]
        sys.stdout.write("\n".join(new) + "\n")
        sys.stdout.flush()
        lines += new
    if config.write:
        before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        old, after = rest.split(END)
        rows = by_masks(old.splitlines()[len(head) :]) | by_masks(lines)
        body = "\n".join([*head, *(line for part in rows.values() for line in part)])
        PAGE.write_text(before + BEGIN + body + "\n" + END + after, encoding="utf-8")


if __name__ == "__main__":
    main(tyro.cli(Bench))
