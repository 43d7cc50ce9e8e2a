"""Reproduce the paper's table on the embedded places: `make paper` prints it and renews docs/PAPER.md and README.md."""

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.paper import PaperSettings, measure_places
from benchmarks.paper_text import paper_page, readme_table, success_table

from simaps_viz.console.progress import stage_progress

ROOT = Path(__file__).parents[1]
BEGIN, END = "<!-- begins: make paper -->\n", "<!-- ends: make paper -->\n"


@dataclass(frozen=True)
class Paper:
    """How much is measured; less than the default only to try it out."""

    measured: PaperSettings
    write: bool = False
    """Renew docs/PAPER.md, and the table of README.md."""


def main(config: Paper) -> None:
    """Measure, print the table, and write what was asked for."""
    with stage_progress() as progress:
        results = measure_places(config.measured, progress)
    spent = ", ".join(f"{part} {seconds:.0f} s" for part, seconds in results.seconds.items())
    sys.stdout.write("\n".join([*success_table(results), f"Wall-clock time: {spent}"]) + "\n")
    if config.write:
        (ROOT / "docs" / "PAPER.md").write_text(paper_page(results), encoding="utf-8")
        readme = (ROOT / "README.md").read_text(encoding="utf-8")
        before, rest = readme.split(BEGIN)
        _, after = rest.split(END)
        text = before + BEGIN + "\n".join(readme_table(results)) + "\n" + END + after
        (ROOT / "README.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(tyro.cli(Paper))
