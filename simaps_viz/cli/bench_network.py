"""`simaps bench-network`: how fast a network and the mapping behind it run on a recording, on this machine."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import Networks
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.segmentation.protocol import Network
    from simaps_viz.structures import Segmentation


@dataclass(frozen=True)
class BenchNetwork:
    """Run a network over some frames of a recording, map them, and print frames a second and where the time goes.

    Nothing is kept: masks that were made before are not used.

    Example: simaps bench-network yolo.onnx ../scans/breakroom --providers cpu
    """

    segmentation: tyro.conf.Positional[Path]
    """Network (.onnx)."""
    sequence: tyro.conf.Positional[Path]
    """Recording in any format that is read (docs/FORMATS.md)."""
    frames: int = 50
    """How many frames, evenly spread."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    json: bool = False
    """Print the outcome as one JSON line."""

    def run(self) -> int:
        """Measure, and print a line for the whole and one for each part."""
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report

        if self.frames < 1:
            raise InputError(f"--frames: expected at least 1, found {self.frames}")
        with stage_progress(quiet=self.json) as progress:
            found = self._measure(progress)
        parts = ", ".join(f"{name.replace('_', ' ')} {found['ms_a_frame'][name]:.1f}" for name in _NETWORK)
        report(
            found,
            f"{found['network']} on {found['device']}, {found['frames']} frames of {found['sequence']}: "
            f"{found['frames_per_s']:.2f} frames/s end to end",
            f"network, ms a frame: {parts}",
            f"mapping, ms a frame: reading {found['ms_a_frame']['reading']:.1f}, "
            f"on the map {found['ms_a_frame']['mapping']:.1f}; "
            f"finding the objects of all frames, once: {1000 * found['objects_s']:.0f} ms",
            f"mapping is {100 * found['mapping_share']:.1f} % of the time",
            json=self.json,
        )
        return OK

    def _measure(self, progress: Any) -> dict[str, Any]:
        """Segment and map the frames one behind the other, as a build does; return what it took, JSON-able."""
        from simaps_viz.build.pipeline import BuildConfig, facts_of
        from simaps_viz.datasets.open import open_sequence
        from simaps_viz.geometry import spread
        from simaps_viz.mapping.finalize import empty_accumulator, map_so_far
        from simaps_viz.segmentation.recognise import open_network
        from simaps_viz.segmentation.sequences import needs_stuff, segmented

        sequence, config = open_sequence(self.sequence), BuildConfig()
        network, device = open_network(self.segmentation, self.network.settings())
        by_geometry = needs_stuff(network) if self.network.stuff == "auto" else self.network.stuff == "geometry"
        indices = spread(len(sequence), self.frames)

        def build(network: "Network", indices: list[int]) -> dict[str, float]:
            accumulator = empty_accumulator(sequence, config)
            seconds = {"reading": 0.0, "mapping": 0.0}
            frames = segmented(sequence, network, indices, by_geometry=by_geometry)
            for done, (index, masks) in enumerate(frames, start=1):
                start_s = time.perf_counter()
                frame = sequence.read(index)
                read_s = time.perf_counter()
                for segment in masks.segments:
                    accumulator.learn(segment.label, is_thing=segment.is_thing)
                accumulator.add_frame(frame, masks, sequence.T_map_world @ frame.T_world_camera)
                seconds["mapping"] += time.perf_counter() - read_s
                seconds["reading"] += read_s - start_s
                progress("segmenting and mapping", done, len(indices))
            start_s = time.perf_counter()
            map_so_far(accumulator, facts_of(sequence), config)
            return seconds | {"objects": time.perf_counter() - start_s}

        build(network, indices[:1])  # networks and kernels are compiled when they first run
        timed, start_s = _Timed(network), time.perf_counter()
        mapping = build(timed, indices)
        total_s, objects_s = time.perf_counter() - start_s, mapping.pop("objects")
        return {
            "event": "done", "network": network.name, "device": device, "sequence": sequence.name,
            "frames": len(indices), "seconds": round(total_s, 3), "frames_per_s": round(len(indices) / total_s, 3),
            "ms_a_frame": {
                part: round(1000 * spent_s / len(indices), 2) for part, spent_s in (timed.seconds | mapping).items()
            },
            "objects_s": round(objects_s, 4), "mapping_share": round((mapping["mapping"] + objects_s) / total_s, 4),
        }  # fmt: skip


_NETWORK = ("preparing", "running", "reading_its_output")


class _Timed:
    """A network that notes how long its three steps take; each runs in one thread."""

    def __init__(self, network: "Network") -> None:
        self._network = network
        self.name, self.key, self.labels, self.is_thing = network.name, network.key, network.labels, network.is_thing
        self.seconds: dict[str, float] = dict.fromkeys(_NETWORK, 0.0)

    def prepare(self, color: Any) -> Any:
        return self._timed("preparing", self._network.prepare, color)

    def infer(self, prepared: Any) -> Any:
        return self._timed("running", self._network.infer, prepared)

    def decode(self, outputs: Any, height: int, width: int) -> "Segmentation":
        return self._timed("reading_its_output", self._network.decode, outputs, height, width)

    def _timed(self, part: str, step: Any, *given: Any) -> Any:
        start_s = time.perf_counter()
        result = step(*given)
        self.seconds[part] += time.perf_counter() - start_s
        return result
