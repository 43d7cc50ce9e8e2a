"""`simaps build`: a sequence, or several of one building, to a map file."""

import dataclasses
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from simaps_viz.app import workbench
from simaps_viz.build.pipeline import Elsewhere
from simaps_viz.build.to_file import BuildRequest, build_to_file, going_on
from simaps_viz.build.workers import open_workers, reopening
from simaps_viz.cli.options import Mapping, Networks
from simaps_viz.cli.segment import open_segmented
from simaps_viz.console.progress import StageProgress, stage_progress
from simaps_viz.console.terminal import console, emit
from simaps_viz.datasets.joined import join
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.io.files import check_ending


@dataclass(frozen=True)
class Build:
    """Build a map from a sequence of posed RGB-D frames, or from several that share a world frame.

    Example: simaps build ../scans/breakroom -o breakroom.npz --record breakroom.rrd
    """

    sequence: tyro.conf.Positional[tuple[Path, ...]]
    """Folder in the posed-frames/1 format, or its manifest (.json); or a recording in another format (docs/FORMATS.md).
    Several are put on one map: their poses have to be in one world frame."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Map file to write (.npz)."""
    mapping: Annotated[Mapping, tyro.conf.arg(name="")] = dataclasses.field(default_factory=Mapping)
    segmentation: str = "precomputed"
    """Where segments come from: "precomputed" (the ones the sequence has), a network (.onnx: YOLO-seg, Mask2Former,
    MaskFormer, OneFormer, EoMT) or a COCO panoptic table (.json)."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = dataclasses.field(default_factory=Networks)
    record: Path | None = None
    """Also record the build for rerun (.rrd)."""
    resume: bool = False
    """Go on with a build of this map that was killed or stopped (its log, .MAP.building, lies beside the map); the map
    comes out the same. With --record all frames are read again, as the recording shows them."""
    strict: bool = False
    """Stop at a frame that cannot be read; otherwise it is skipped and counted, unless more than half are."""
    history: bool = False
    """Keep what the map was after each frame, MAP.steps, for the page's time slider."""
    scheduler: str | None = None
    """Have the frames read by others (extra "cluster"): local:N starts N processes here, tcp://HOST:PORT is a Dask
    scheduler whose workers find the sequence under the same path. The map comes out the same."""
    view: bool = False
    """Open the page at once: the map grows in it while it is computed, and can be stopped and gone on with there. Its
    history is kept, for the page's time slider."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    browser: bool = True
    """Open the page in the browser."""
    json: bool = False
    """Print JSON lines on stdout."""


def build(command: Build) -> None:
    """Build the map and say what is on it."""
    request = BuildRequest(
        command.mapping.method, command.mapping.config(), command.output, command.record,
        resume=command.resume, strict=command.strict, history=command.history,
    )  # fmt: skip
    check_ending(command.output, ".npz", "a map's name")
    if command.view:
        _watch(command, request)
        return
    with stage_progress(quiet=command.json) as progress:
        sequence = _opened(command, progress)
        with _elsewhere(command, sequence) as elsewhere, going_on(command.output):
            simap = build_to_file(sequence, request, progress, json_lines=command.json, elsewhere=elsewhere)
    skipped: int = simap.provenance.get("skipped", {}).get("frames", 0)
    notes: list[str] = list(getattr(sequence, "notes", ()))
    if command.json:
        emit({"event": "done", "map": str(command.output), "record": str(command.record) if command.record else None,
              "counts": simap.counts(), "instances": len(simap.instances), "skipped": skipped,
              "notes": notes, "seconds": progress.clock.seconds()})  # fmt: skip
    else:
        if skipped:
            notes.append(f"{skipped} of {len(sequence)} frames could not be read and were skipped")
        for note in notes:
            console.print(f"{sequence.path}: {note}", markup=False, soft_wrap=True)
        console.print(f"{command.output}: {workbench.counts_in_words(simap.counts())}", markup=False)
        console.print(f"Look at it: simaps view {command.output}", markup=False)


def _watch(command: Build, request: BuildRequest) -> None:
    from simaps_viz.app.live import LiveSettings, watch_build  # noqa: PLC0415 - viser and rerun are slow to import

    if command.scheduler is not None or command.json:
        option = "--scheduler" if command.scheduler is not None else "--json"
        raise InputError(f"--view: expected a build in this process, for people, found {option}")
    with stage_progress() as progress:
        sequence = _opened(command, progress)
    watch_build(sequence, LiveSettings(request, port=command.port), browser=command.browser)


def _opened(command: Build, progress: StageProgress) -> FrameSource:
    if not command.sequence:
        raise InputError("build: expected at least one sequence, found none")
    opened = [
        open_segmented(
            path, command.segmentation, command.network, workbench.cache_folder(), progress,
            quiet=command.json, whole=command.strict,
        )
        for path in command.sequence
    ]  # fmt: skip
    return opened[0] if len(opened) == 1 else join(opened)


def _elsewhere(command: Build, sequence: FrameSource) -> AbstractContextManager[Elsewhere | None]:
    """Return who reads the frames, None: this process."""
    if command.scheduler is None:
        return nullcontext()
    return open_workers(command.scheduler, reopening(sequence, workbench.cache_folder()))
