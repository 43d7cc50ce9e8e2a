"""Take pictures of the embedded scene's page, in headless Chromium. `make screenshots` renews those of `assets/`."""

from dataclasses import dataclass
from pathlib import Path

import tyro
from benchmarks.page import browser
from checks.pictures import take

from simaps_viz import BuildConfig, open_sequence
from simaps_viz.app import workbench
from simaps_viz.console.progress import stage_progress
from simaps_viz.scenes.demo import ensure_demo


@dataclass(frozen=True)
class Screenshots:
    """How large the pictures are, and where they go."""

    width: int = 1440
    height: int = 860
    output: Path = Path(__file__).parents[1] / "build"
    only: str = ""
    """Name of one of them."""


def main(config: Screenshots) -> None:
    """Build the embedded scene's map, open the workbench on it, and take its pictures."""
    with stage_progress() as progress:
        sequence = open_sequence(ensure_demo(cache_dir=workbench.cache_folder(), progress=progress))
        simap, recording = workbench.cached_build(sequence, "evidence", BuildConfig(), progress)
    config.output.mkdir(exist_ok=True)
    with browser() as chromium:
        take(chromium, simap, recording, config.output, width=config.width, height=config.height, only=config.only)


if __name__ == "__main__":
    main(tyro.cli(Screenshots))
