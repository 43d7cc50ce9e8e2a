"""`simaps build`: a sequence, or several of one building, to a map file."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import MappingOptions, Networks, WorldFrame
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.build.pipeline import RemoteGatherer
    from simaps_viz.build.to_file import BuildRequest
    from simaps_viz.console.progress import StageProgress
    from simaps_viz.datasets.source import FrameSource
    from simaps_viz.embedding.towers import Embedding
    from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class Build:
    """Build a map from a sequence of posed RGB-D frames, or from several that share a world frame.

    Example: simaps build ../scans/breakroom -o breakroom.npz --record breakroom.rrd
    """

    sequence: tyro.conf.Positional[tuple[Path, ...]]
    """Folder in the posed-frames/1 format, or its manifest (.json); or a recording in another format (docs/FORMATS.md).
    Several are put on one map: their poses have to be in one world frame."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Map file to write (.npz). A name that ends in .json makes a building: a map for each floor that the recording
    goes over, NAME-floor-1.npz and so on beside it, the lowest first, and the stairs between them."""
    mapping: Annotated[MappingOptions, tyro.conf.arg(name="")] = field(default_factory=MappingOptions)
    segmentation: str = "precomputed"
    """Where segments come from: "precomputed" (the ones the sequence has), a network (.onnx: YOLO-seg, Mask2Former,
    MaskFormer, OneFormer, EoMT) or a COCO panoptic table (.json)."""
    segment_every: str = "1"
    """Which frames a network looks at: auto chooses those that show the cells of the map best, at most 30 %; N every
    N-th. The others add free space, obstacles and heights."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    world: Annotated[WorldFrame, tyro.conf.arg(name="")] = field(default_factory=WorldFrame)
    record: Path | None = None
    """Also record the build for rerun (.rrd)."""
    resume: bool = False
    """Resume a build of this map that was killed or stopped (its log, .MAP.building, lies beside the map); the map
    comes out the same. With --record all frames are read again, as the recording shows them."""
    strict: bool = False
    """Stop at a frame that lacks something or cannot be read; otherwise it is left out and counted, unless more than
    half cannot be read."""
    history: bool = False
    """Also write the map's history, MAP.steps, with its state after each frame; the page's time slider reads it."""
    embedding: tuple[Path, ...] = ()
    """Also describe the objects for free words, see simaps describe: folder of a CLIP or SigLIP network in ONNX."""
    scheduler: str | None = None
    """Have the frames read by others (extra "cluster"): local:N starts N processes here, tcp://HOST:PORT is a Dask
    scheduler whose workers find the sequence under the same path. The map comes out the same."""
    view: bool = False
    """Open the page at once: the map grows in it while it is computed, and can be stopped and resumed there. Its
    history is kept, for the page's time slider."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    browser: bool = True
    """Open the page in the browser."""
    json: bool = False
    """Print JSON lines on stdout."""

    def run(self) -> int:
        """Build the map and print what is on it."""
        from simaps_viz.app.workbench import all_counts
        from simaps_viz.build.to_file import BuildRequest, build_to_file, resume_hint
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report
        from simaps_viz.datasets.floors import find_floors
        from simaps_viz.drawing.legend import counted
        from simaps_viz.io.files import check_ending
        from simaps_viz.segmentation.chosen_frames import config_for

        request = BuildRequest(
            self.mapping.method, config_for(self.segment_every, self.mapping.config()), self.output, self.record,
            resume=self.resume, strict=self.strict, history=self.history,
        )  # fmt: skip
        building = self.output.suffix.lower() == ".json"
        if not building:
            check_ending(self.output, ".npz", "a map's name", "a building's in .json")
        elif self.view or self.scheduler is not None:
            option = "--view" if self.view else "--scheduler"
            raise InputError(f"{option}: expected a map's name (.npz), found a building's, {self.output}")
        if self.view:
            self._watch(request)
            return OK
        embedding = None
        if self.embedding:  # opened before anything is built
            from simaps_viz.embedding.describe import describe_to_file
            from simaps_viz.embedding.towers import open_embedding

            embedding = open_embedding(*self.embedding)
        with stage_progress(quiet=self.json) as progress:
            sequence = self._opened(progress, floors=building)
            if building:
                return self._build_floors(sequence, request, embedding, progress)
            with self._gatherer(sequence) as gatherer, resume_hint(self.output):
                simap = build_to_file(sequence, request, progress, json_lines=self.json, gatherer=gatherer)
            if embedding is not None:
                simap = describe_to_file(simap, sequence, embedding, self.output, progress)
        skipped: int = simap.provenance.get("skipped", {}).get("frames", 0)
        notes: list[str] = [*getattr(sequence, "notes", ()), *(embedding.notes if embedding else ())]
        if (floors := len(find_floors(sequence))) > 1:
            notes.append(f"it goes over {floors} floors, and a map holds one: -o NAME.json makes a map for each")
        record = {"event": "done", "map": str(self.output), "record": str(self.record) if self.record else None,
                  "counts": counted(simap), "instances": len(simap.instances), "skipped": skipped,
                  "notes": notes, "seconds": progress.clock.seconds()}  # fmt: skip
        lost = [f"{skipped} of {len(sequence)} frames could not be read and were skipped"] if skipped else []
        report(
            record,
            *(f"{sequence.path}: {text}" for text in (*notes, *lost)),
            f"{self.output}: {all_counts(simap)}",
            f"Look at it: simaps view {self.output}",
            json=self.json,
        )
        return OK

    def _build_floors(
        self, sequence: "FrameSource", request: "BuildRequest", embedding: "Embedding | None", progress: "StageProgress"
    ) -> int:
        """Build a building, and print what is on each floor."""
        from simaps_viz.build.to_file import build_building
        from simaps_viz.colors.classes import plural
        from simaps_viz.console.terminal import report
        from simaps_viz.embedding.describe import describe_to_file

        def finish(simap: "SIMap", part: "FrameSource", path: Path) -> "SIMap":
            return simap if embedding is None else describe_to_file(simap, part, embedding, path, progress)

        building, counts = build_building(sequence, request, progress, json_lines=self.json, finish=finish)
        notes: list[str] = [*getattr(sequence, "notes", ()), *(embedding.notes if embedding else ())]
        found = list(zip(building.floors, counts, strict=True))
        floors = [
            {"number": one.number, "map": str(one.map), "height_m": one.height_m, "counts": count}
            for one, count in found
        ]
        report(
            {"event": "done", "building": str(self.output), "floors": floors, "stairs": len(building.stairs),
             "notes": notes, "seconds": progress.clock.seconds()},
            *(f"{sequence.path}: {text}" for text in notes),
            *(
                f"{one.map}: floor {one.number}, {one.height_m:.2f} m: "
                f"{', '.join(plural(n, label) for label, n in count.items()) or 'no objects'}"
                for one, count in found
            ),
            f"Look at it: simaps view {self.output} --floor {len(floors)}",
            json=self.json,
        )  # fmt: skip
        return OK

    def _watch(self, request: "BuildRequest") -> None:
        from simaps_viz.app.live import watch_build
        from simaps_viz.console.progress import stage_progress

        if self.scheduler is not None or self.json or self.embedding:
            option = "--scheduler" if self.scheduler is not None else "--json" if self.json else "--embedding"
            raise InputError(f"--view: expected a build in this process, for people, found {option}")
        with stage_progress() as progress:
            sequence = self._opened(progress)
        watch_build(sequence, request, port=self.port, browser=self.browser)

    def _opened(self, progress: "StageProgress", *, floors: bool = False) -> "FrameSource":
        """Open the sequences, joined where there are several; ``floors``: of one building, they may be on several."""
        from simaps_viz.build.pipeline import cache_folder
        from simaps_viz.cli.segment import open_segmented
        from simaps_viz.datasets.source import JoinedFrames

        if not self.sequence:
            raise InputError("build: expected at least one sequence, found none")
        opened = [
            open_segmented(
                path, self.segmentation, self.network, cache_folder(), progress,
                quiet=self.json, strict=self.strict, world=self.world, every=self.segment_every,
            )
            for path in self.sequence
        ]  # fmt: skip
        return opened[0] if len(opened) == 1 else JoinedFrames(opened, floors=floors)

    def _gatherer(self, sequence: "FrameSource") -> "AbstractContextManager[RemoteGatherer | None]":
        """Return the workers that read the frames; None where this process does."""
        if self.scheduler is None:
            return nullcontext()
        from simaps_viz.build.pipeline import cache_folder
        from simaps_viz.build.workers import open_workers, reopening

        return open_workers(self.scheduler, reopening(sequence, cache_folder()))
