"""Make the pictures of the README from the embedded scene, in headless Chromium. `make screenshots`."""

from dataclasses import dataclass
from pathlib import Path

import tyro
from playwright.sync_api import Page, sync_playwright

from simaps_viz import BuildConfig, open_sequence, wiring
from simaps_viz.progress import stage_progress
from simaps_viz.scenes.demo import ensure_demo
from simaps_viz.viewer.workbench import Workbench

ASSETS = Path(__file__).parents[1] / "assets"
CHROMIUM = ["--no-sandbox", "--disable-quic", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@dataclass(frozen=True)
class Screenshots:
    """How large the pictures are, and where they go."""

    width: int = 1440
    height: int = 860
    output: Path = ASSETS / "workbench.png"


def pose_for_the_picture(page: Page, workbench: Workbench) -> None:
    """Wait for the recorded build, take viser's notice about software rendering away, select a chair."""
    page.goto(f"{workbench.url}/?fixedDpr=1")
    page.wait_for_timeout(20_000)
    page.evaluate("document.querySelectorAll('.mantine-Notification-root').forEach(e => e.remove())")
    chairs = workbench.simap.of_class("chair")
    workbench.select(sorted(chairs, key=lambda chair: chair.frames)[-4].id)
    workbench.wait_idle()
    page.wait_for_timeout(3_000)


def main(config: Screenshots) -> None:
    """Build the embedded scene's map, open the workbench on it, and take its picture."""
    with stage_progress() as progress:
        sequence = open_sequence(ensure_demo(cache_dir=wiring.cache_folder(), progress=progress))
        simap, recording = wiring.cached_build(sequence, "evidence", BuildConfig(), progress)
    with wiring.workbench(simap, recording=recording, port=8080) as workbench, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=CHROMIUM)
        page = browser.new_page(viewport={"width": config.width, "height": config.height})
        pose_for_the_picture(page, workbench)
        page.screenshot(path=config.output)
        browser.close()


if __name__ == "__main__":
    main(tyro.cli(Screenshots))
