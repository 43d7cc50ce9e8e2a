"""Shared by the tests of browser and others."""

from pathlib import Path

from browser import field_of

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.to_file import BuildRequest, build_to_file
from simaps_viz.console.progress import stage_progress

FRAMES = 40


def built(sequence, output: Path):
    with stage_progress(quiet=True) as progress:
        return build_to_file(sequence, BuildRequest("evidence", BuildConfig(), output, history=True), progress)


def fill(page, label, value):
    box = field_of(page, label)
    box.press("Control+a")
    box.press_sequentially(value)  # put there at once, viser's box may not notice it
    box.press("Enter")
    box.blur()
    page.wait_for_timeout(200)
