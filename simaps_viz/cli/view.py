"""`simaps view`: the workbench on a map, a sequence or a recorded build."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import MappingOptions, Networks, Serving
from simaps_viz.errors import InputError


@dataclass(frozen=True)
class View:
    """Open the workbench on a map, or on a sequence (which is mapped first).

    Example: simaps view cafe.npz --port 9000
    """

    path: tyro.conf.Positional[Path]
    """Map file (.npz), building file (.json), sequence (folder, manifest or another format's file); or a recorded build
    (.rrd) alone."""
    floor: int | None = None
    """Floor of a building, the lowest is 1."""
    segmentation: str = "precomputed"
    """Masks of a sequence: "precomputed", a network (.onnx) or a COCO panoptic table (.json), as for simaps build."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    mapping: Annotated[MappingOptions, tyro.conf.arg(name="")] = field(default_factory=MappingOptions)
    recording: Path | None = None
    """Recorded build to dock beside the map; by default the .rrd of the map's name."""
    serving: Annotated[Serving, tyro.conf.arg(name="")] = field(default_factory=Serving)
    edits: bool = True
    """Show the map with the edits made by hand (MAP.edits.json), and let people make more."""
    llm: str | None = None
    """A language model for the page's commands: MODEL[@ADDRESS], see simaps query."""

    def run(self) -> int:
        """Open the map, recording or sequence at the path and serve its page until Ctrl-C."""
        from simaps_viz.app import workbench
        from simaps_viz.build.pipeline import cache_folder
        from simaps_viz.cli.recordings import is_recorded_build, view_alone
        from simaps_viz.cli.segment import PRECOMPUTED, open_segmented
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.datasets.open import is_sequence
        from simaps_viz.mapping.building import is_building, map_of
        from simaps_viz.mapping.mending import load_mended, open_mending

        if self.floor is not None or is_building(self.path):
            return replace(self, path=map_of(self.path, self.floor), floor=None).run()
        serving = self.serving.options()
        if is_recorded_build(self.path):
            view_alone(self.path, **replace(self.serving, allow_edit=False, read_only=True).options())
            return OK
        if is_sequence(self.path):
            with stage_progress() as progress:
                sequence = open_segmented(self.path, self.segmentation, self.network, cache_folder(), progress)
                method, config = self.mapping.method, self.mapping.config()
                simap, recording = workbench.cached_build(sequence, method, config, progress)
            map_path = recording.with_suffix(".npz")
            recording = find_recording(self.path, self.recording) or recording
        else:
            if not self.path.exists():
                raise InputError(
                    f"{self.path}: expected a map file (.npz), a sequence or a recorded build (.rrd), found nothing"
                )
            if self.segmentation != PRECOMPUTED:
                raise InputError(f"{self.path}: expected a sequence with --segmentation, found a map")
            simap = load_mended(self.path, edits=False)
            recording = find_recording(self.path, self.recording)
            map_path = self.path
        mending = open_mending(map_path, simap) if self.edits else None
        workbench.serve(simap, recording=recording, llm=self.llm, mending=mending, map_path=map_path, **serving)
        return OK


def find_recording(path: Path, given: Path | None) -> Path | None:
    """Return a map's recording: the one given (which must exist), or the .rrd of the same name beside the map."""
    if given is not None:
        if not given.is_file():
            raise InputError(f"{given}: expected a recording (.rrd), found nothing")
        from simaps_viz.recorder.facts import read_facts

        read_facts(given)  # raises InputError unless it is a recording
        return given
    beside = path.with_suffix(".rrd")
    return beside if beside.is_file() else None
