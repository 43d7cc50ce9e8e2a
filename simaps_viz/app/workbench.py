"""The workbench with everything behind it: from a sequence to a map in the cache, from a map to its page."""

import contextlib
import getpass
import threading
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simaps_viz.build.pipeline import BuildConfig, cache_folder, map_in_cache
from simaps_viz.build.to_file import build_complete, is_complete, open_history
from simaps_viz.console.progress import StageProgress
from simaps_viz.console.terminal import note
from simaps_viz.datasets.floors import SomeFrames, indices_of
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource
from simaps_viz.drawing.legend import counts_text
from simaps_viz.errors import InputError, PlanningError
from simaps_viz.geometry import turned, upright_turns
from simaps_viz.language.commands import Reading, read_command
from simaps_viz.language.grounding import Grounding
from simaps_viz.language.llm import LLMReader
from simaps_viz.language.llm_settings import Exchange, LLMError, LLMServerError, parse_llm_spec
from simaps_viz.mapping.file import load_map
from simaps_viz.mapping.history import MapHistory, cut_as
from simaps_viz.mapping.mending import Mending
from simaps_viz.mapping.simap import joining_at, recommunity, repartition
from simaps_viz.navigation.agent import Agent, Answer, CommandReader, answer, start_pose
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.segmentation.sequences import WithMasks
from simaps_viz.structures import Pose2, SIMap

if TYPE_CHECKING:
    from simaps_viz.evaluation.judging import JudgingSession
    from simaps_viz.evaluation.two_maps import MapMaker
    from simaps_viz.viewer.page.panel import PanelSpec
    from simaps_viz.viewer.page.shared import LanguageModel, Services
    from simaps_viz.viewer.server.access import Access
    from simaps_viz.viewer.server.front_door import FrontDoor
    from simaps_viz.viewer.workbench import Workbench


def cached_build(
    sequence: FrameSource, method: str, config: BuildConfig, progress: StageProgress
) -> tuple[SIMap, Path]:
    """Load a map and its recording from the cache, or build them there; their name depends on all that goes in."""
    output = map_in_cache(cache_folder(), sequence, method, config)
    record = output.with_suffix(".rrd")
    if is_complete(output, record, method):
        return load_map(output), record
    return build_complete(sequence, method, config, output, record, progress), record


def sequence_of(simap: SIMap) -> PosedFrames | WithMasks | SomeFrames | None:
    """Open the sequence a map was built from, with the masks of that build; None if either no longer exists.

    Of the map of a floor, these are the frames of that floor.
    """
    from simaps_viz.app.masks import open_frames  # noqa: PLC0415 - viser is slow to import

    try:
        found = open_frames(simap, cache_folder())[1]
    except InputError:
        return None
    at = None if found is None else indices_of(simap.frame_names, found)
    return found if found is None or at is None else SomeFrames(found, at, simap.T_map_world)


def open_workbench(
    simap: SIMap,
    *,
    recording: Path | None,
    port: int,
    llm: str | None = None,
    judging: "JudgingSession | None" = None,
    mending: Mending | None = None,
    access: "Access | None" = None,
    map_path: Path | None = None,
) -> "Workbench":
    """Serve the page of a map with all its services; use it in a ``with`` block.

    Args:
        simap: the map.
        recording: of its build.
        port: where to serve; the next free one when it is taken.
        llm: MODEL[@ADDRESS] of a language model that reads commands while it is switched on.
        judging: runs for a person to judge; the map must be the true one.
        mending: the edits of this map, which is shown with them.
        access: where to listen, and who may do what; by default this machine, whose people may do all.
        map_path: the map's file, whose history lies beside it; by default that of the recording's name.
    """
    from simaps_viz.viewer.workbench import Workbench  # noqa: PLC0415 - viser is slow to import

    path = recording if map_path is None else map_path
    services = replace(
        services_of(simap, recording, lambda: mending),
        panels=panels_of(simap, mending, maps_of(None if path is None else truth_beside(path))),
        model=language_model(llm),
        judging=judging,
        look_back=look_back(lambda: path),
    )
    simap = simap if mending is None else mending.simap()
    start = start_pose(simap) if len(simap.T_map_camera) else None
    return Workbench(simap, services=services, port=port, access=access, start=start)


def serve(simap: SIMap, *, browser: bool, **options: Any) -> None:
    """Show the workbench until Ctrl-C; ``options`` are those of `open_workbench`, see `Serving.options`."""
    with open_workbench(simap, **options) as page:
        tell_where(page, browser=browser)
        page.wait()


def tell_where(page: "Workbench | FrontDoor", what: str = "Workbench", *, browser: bool = False) -> None:
    """Print where a page is served; ``browser``: also open it in the browser."""
    note(f"{what}: {page.entrance}  (Ctrl-C to stop)")
    if page.access.owner_token:
        note(f"Only from this address can anything be changed: {page.owner_entrance}")
    if page.access.is_open:
        all_edit = ", and may change it" * (not page.access.owner_token and not page.access.read_only)
        note(f"Open to the network, not encrypted; whoever has an address has the map{all_edit}.")
    if browser:
        webbrowser.open(page.owner_entrance)


def look_back(path: Callable[[], Path | None]) -> Callable[[SIMap, int], SIMap | None]:
    """Return a function that shows a map as it was after a frame, from the history beside the map's file.

    The history is opened on the first call. The returned map has the objects of the map it is called with, including
    its K and its edits, as far as they had been observed by then; None where there is no history.

    Args:
        path: of the map or its recording; None as long as there is none.
    """
    lock = threading.Lock()
    opened: list[MapHistory | None] = []

    def look(simap: SIMap, frame: int) -> SIMap | None:
        beside = path()
        if beside is None:
            return None
        with lock:
            if not opened:
                opened.append(open_history(beside, simap))
        then = None if opened[0] is None else opened[0].look_at(frame)
        return cut_as(then, simap) if then is not None and then.spec == simap.spec else None

    return look


def services_of(
    simap: SIMap, recording: Path | None = None, mending: Callable[[], Mending | None] = lambda: None
) -> "Services":
    """Return the services of the page of a map; panels are added later.

    Args:
        simap: the map shown; only its origin is used.
        recording: of its build.
        mending: returns the edits, once there are any.
    """
    from simaps_viz.recorder.facts import read_levels  # noqa: PLC0415 - rerun is slow to import
    from simaps_viz.viewer.page.shared import Services  # noqa: PLC0415 - viser is slow to import

    opened: list[PosedFrames | WithMasks | SomeFrames] = []

    def view(index: int) -> tuple[np.ndarray, np.ndarray] | None:
        if not opened:  # the frames may come while the page is open
            opened.extend(filter(None, [sequence_of(simap)]))
        if not opened:
            return None
        turns = upright_turns(simap.T_map_camera[index])
        return turned(opened[0].color(index), turns), turned(opened[0].segmentation(index).ids, turns)

    def find_again(m: SIMap, resolution: float, percent: float) -> SIMap:
        edits = mending()
        find = recommunity if edits is None or not edits.covers(m) else edits.recommunity
        return find(m, resolution=resolution, **joining_at(m, percent))

    return Services(
        repartition=lambda m, percent: repartition(m, **joining_at(m, percent)),
        recommunity=find_again,
        ask=answer,
        candidates=lambda m, label, pose: Grounding(m, pose).candidates(label),
        view=view,
        recordings=() if recording is None else (recording,),
        recorded_levels=None if recording is None else read_levels(recording),
    )


def truth_beside(path: Path) -> Path:
    """Return where the truth of a map lies, if anywhere: cafe-truth.npz beside cafe.npz."""
    return path.with_name(f"{path.stem}-truth.npz")


def maps_of(truth: Path | None = None) -> "MapMaker":
    """Return what makes the maps that a page compares; `panels_of` tells it the frames. ``truth``: a map file."""
    from simaps_viz.evaluation.two_maps import MapMaker  # noqa: PLC0415 - only needed by the page

    return MapMaker(None, cache_folder(), truth)


def panels_of(
    simap: SIMap, mending: Mending | None, maps: "MapMaker", first: "tuple[PanelSpec, ...] | None" = None
) -> "tuple[PanelSpec, ...]":
    """Return the panels of a page in addition to those that every page has.

    Args:
        simap: the map.
        mending: its edits.
        maps: makes the maps to compare with.
        first: the `panels_without_frames` that the page has already.
    """
    from simaps_viz.app.masks import segmentation_services  # noqa: PLC0415 - viser is slow to import
    from simaps_viz.viewer.panels.compare import compare_panel, method_panel  # noqa: PLC0415 - as above
    from simaps_viz.viewer.panels.masks import masks_panel  # noqa: PLC0415 - as above

    maps.sequence = sequence_of(simap)
    masks = masks_panel(segmentation_services(simap, cache_folder()))
    first = first or panels_without_frames(maps)
    return *first, method_panel(maps), compare_panel(maps), masks, *mending_panels(mending)


def panels_without_frames(maps: "MapMaker") -> "tuple[PanelSpec, ...]":
    """Return those of the panels that need no frames; a page has them before the others."""
    from simaps_viz.recorder.library import RecordingLibrary  # noqa: PLC0415 - rerun is slow to import
    from simaps_viz.viewer.panels.errors import errors_panel  # noqa: PLC0415 - viser is slow to import
    from simaps_viz.viewer.panels.recordings import recordings_panel  # noqa: PLC0415 - as above
    from simaps_viz.viewer.panels.share import SHARE  # noqa: PLC0415 - as above

    return errors_panel(maps), SHARE, recordings_panel(RecordingLibrary())


def mending_panels(mending: Mending | None) -> "tuple[PanelSpec, ...]":
    """Return the panel for editing the map; none where the map cannot be edited."""
    from simaps_viz.viewer.panels.mend import mend_panel  # noqa: PLC0415 - viser is slow to import

    return () if mending is None else (mend_panel(mending, login()),)


def login() -> str:
    """Return the name the person is logged in by, or "somebody"."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # no such user on this machine
        return "somebody"


def reader(llm: str | None, simap: SIMap, pose: Pose2) -> CommandReader:
    """Return a reader of commands: the offline grammar, or a language model named as MODEL[@ADDRESS].

    When the model's server cannot be reached, the grammar reads the command, and a note reports it.
    """
    if llm is None:
        return read_command
    return _reading(LLMReader(parse_llm_spec(llm)), simap, pose)


def _reading(
    model: LLMReader,
    simap: SIMap,
    pose: Pose2,
    *,
    robot: RobotShape | None = None,
    cancel: threading.Event | None = None,
    tell: Callable[[Sequence[Exchange]], None] = lambda exchanges: None,
) -> CommandReader:
    """Return a reader of commands by a model; ``tell`` is called with each exchange, including failed ones."""

    def check(program: str) -> None:
        with contextlib.suppress(PlanningError):  # no fault of what the model wrote
            Agent(simap, pose, robot).rehearse(program)

    def read(text: str, counts: Mapping[str, int]) -> Reading:
        try:
            rooms = tuple(room.name for room in simap.rooms)
            reading = model.read(text, counts, rooms=rooms, check=check, cancel=cancel)
        except LLMError as error:
            tell(error.exchanges)
            if not isinstance(error, LLMServerError):
                raise
            offline = read_command(text, counts)
            return replace(offline, notes=(f"read offline: {error}", *offline.notes))
        tell(reading.exchanges)
        return reading

    return read


def language_model(llm: str | None) -> "LanguageModel | None":
    """Return the model named MODEL[@ADDRESS] for a page's commands; None without a name."""
    if llm is None:
        return None
    from simaps_viz.viewer.page.shared import LanguageModel  # noqa: PLC0415 - viser is slow to import

    model = LLMReader(parse_llm_spec(llm))

    def ask(
        simap: SIMap,
        command: str,
        pose: Pose2,
        cancel: threading.Event,
        tell: Callable[[Sequence[Exchange]], None],
        robot: RobotShape | None = None,
    ) -> Answer:
        read = _reading(model, simap, pose, robot=robot, cancel=cancel, tell=tell)
        return answer(simap, command, pose, robot=robot, reader=read)

    return LanguageModel(str(model.settings), ask)


def all_counts(simap: SIMap) -> str:
    """Describe what is on the map in a terminal, with all classes, as the page counts."""
    return counts_text(simap, most=len(simap.grid.labels))
