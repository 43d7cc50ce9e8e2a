"""The embedded café at once: the shipped map and recording are shown while the frames are rendered behind the page."""

import threading
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import viser
from rich.progress import Progress as Bars

from simaps_viz.app import workbench
from simaps_viz.build.pipeline import BuildConfig, cache_folder
from simaps_viz.console.logs import logger
from simaps_viz.console.progress import StageProgress
from simaps_viz.datasets.open import open_sequence
from simaps_viz.drawing.theme import note_html
from simaps_viz.errors import SIMapsError
from simaps_viz.events import Progress
from simaps_viz.mapping.file import load_map
from simaps_viz.mapping.mending import Mending, open_mending
from simaps_viz.navigation.agent import start_pose
from simaps_viz.scenes.demo import demo_manifest, ensure_demo
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.panels.live import ProgressPanel, head_html
from simaps_viz.viewer.server.access import Access
from simaps_viz.viewer.workbench import Workbench

SHIPPED_MAP = Path(__file__).parents[2] / "recordings" / "cafe-evidence.npz"
"""The default build of the café, with its recording (.rrd) beside it; in a checkout only. Both are made
by `make recordings`."""
SHIPPED_METHOD = "evidence"
SHIPPED_LEVEL = "light"
STAGES = {
    "building the scene": "Preparing the café",
    "rendering frames": "Rendering the café's frames",
    "simulating network errors": "Simulating a network's errors",
    "mapping frames": "Building the map with its history",
    "finding instances": "Finding the objects",
}
"""Words for the stages of `ensure_demo` and of a build."""
NOTE = "Pictures of objects, masks, comparison, editing and history follow with them; all else works already."


class _StoppedError(Exception):
    """The page was closed before the frames were there."""


@dataclass(frozen=True)
class FramesState:
    """How far the work behind the page is."""

    stage: str = "building the scene"
    done: int = 0
    total: int = 1
    status: str = "working"
    """working, done or failed."""
    error: str = ""
    """Why it failed, in words."""


def serve_shipped(simap: SIMap, *, port: int, access: Access, browser: bool, llm: str | None) -> None:
    """Serve the page of the shipped map until Ctrl-C; panels that need the frames are added once these are rendered."""
    frames, recording = DemoFrames(), SHIPPED_MAP.with_suffix(".rrd")
    services = replace(
        workbench.services_of(simap, recording, lambda: frames.mending),
        panels=(frames.panel(), *frames.first),
        model=workbench.language_model(llm),
        look_back=workbench.look_back(lambda: frames.map_path),
    )
    with Workbench(simap, services=services, port=port, access=access, start=start_pose(simap)) as page:
        workbench.tell_where(page, browser=browser)
        frames.start(page)
        try:
            page.wait()
        finally:
            frames.stop()


def shipped_demo(method: str, config: BuildConfig, level: str) -> SIMap | None:
    """Return the shipped map as if it had been built from frames that are still to be rendered.

    None where it would not help: another build is asked for, the frames are rendered already, or nothing is shipped.
    """
    if (method, config, level) != (SHIPPED_METHOD, BuildConfig(), SHIPPED_LEVEL):
        return None
    manifest = demo_manifest(level=level, cache_dir=cache_folder())
    if manifest.is_file() or not (SHIPPED_MAP.is_file() and SHIPPED_MAP.with_suffix(".rrd").is_file()):
        return None
    simap = load_map(SHIPPED_MAP)
    return replace(simap, provenance={**simap.provenance, "sequence": str(manifest)})


class DemoFrames:
    """Renders the café's frames in a thread, builds the map with its history from them, and completes a page."""

    def __init__(self) -> None:
        """Begin with ``start``."""
        self._state = FramesState()
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None
        self.mending: Mending | None = None
        """The edits of the map, once its file is there."""
        self.map_path: Path | None = None
        """The map file; its history is stored next to it."""
        self._maps = workbench.maps_of(workbench.truth_beside(SHIPPED_MAP))
        self.first = workbench.panels_without_frames(self._maps)
        """The panels that the page has while the frames are rendered, beside how far that is."""

    def state(self) -> FramesState:
        """Return how far it is."""
        return self._state

    def panel(self) -> PanelSpec:
        """Return what shows how far it is, in the tab Map; a finished page has it no more."""
        return PanelSpec("Map", viser.Icon.MAP, lambda page: FramesPanel(page.gui, self))

    def start(self, page: Workbench) -> None:
        """Begin to render."""
        self._thread = threading.Thread(target=self._work, args=(page,), name="demo-frames", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Request a stop: a partly rendered sequence is removed, and a build leaves a log from which it can resume."""
        self._cancel.set()
        if self._thread is not None:
            self._thread.join(30.0)

    def _work(self, page: Workbench) -> None:
        progress = _PageProgress(self._report)
        try:
            manifest = ensure_demo(level=SHIPPED_LEVEL, cache_dir=cache_folder(), progress=progress)
            simap, recording = workbench.cached_build(open_sequence(manifest), SHIPPED_METHOD, BuildConfig(), progress)
            self.map_path = recording.with_suffix(".npz")
            self.mending = open_mending(self.map_path, simap)
            panels = workbench.panels_of(simap, self.mending, self._maps, self.first)
            # The recording that is docked shows the same build, so it stays.
            page.finish(self.mending.simap(), panels)
            self._state = replace(self._state, status="done")
        except _StoppedError:
            pass
        except SIMapsError as error:
            self._state = replace(self._state, status="failed", error=str(error))
        except Exception as error:  # the page has to report it; the log has it in full
            logger.error("the frames of the demo could not be made", exc_info=error)
            text = f"Unexpected error ({type(error).__name__}): {error}"
            self._state = replace(self._state, status="failed", error=text)

    def _report(self, stage: str, done: int, total: int) -> None:
        if self._cancel.is_set():
            raise _StoppedError
        self._state = FramesState(stage, done, total)


class _PageProgress(StageProgress):
    """Reports on the page instead of the terminal; a callback that raises ends the work."""

    def __init__(self, report: Progress) -> None:
        super().__init__(Bars(disable=True))
        self._report = report

    def __call__(self, stage: str, done: int, total: int) -> None:
        self.clock.begin(stage)
        self._report(stage, done, total)


class FramesPanel(ProgressPanel[FramesState]):
    """A line, a bar and a note."""

    def __init__(self, gui: viser.GuiApi, frames: DemoFrames) -> None:
        """Fill the top of the open container."""
        self._head = gui.add_html("", order=-3.0)
        self._bar = gui.add_progress_bar(0.0, order=-2.0)
        self._note = gui.add_html(note_html(escape(NOTE)), order=-1.0)
        super().__init__(frames.state)

    def close(self) -> None:
        """Take all of it away."""
        super().close()
        self._head.visible = self._bar.visible = self._note.visible = False

    def show(self, state: FramesState) -> None:
        """Fill the widgets."""
        self._head.content = head_html(state_in_words(state))
        self._bar.value = 100.0 * state.done / max(state.total, 1)


def state_in_words(state: FramesState) -> str:
    """Describe how far it is: "Rendering the café's frames: 43 of 200"."""
    if state.status == "failed":
        return f"The frames could not be made: {state.error}"
    words = STAGES.get(state.stage, state.stage)
    return f"{words}: {state.done} of {state.total}" if state.total > 1 else f"{words} …"
