"""`simaps segment`, and what ``--segmentation`` means: own masks, a network's, or a COCO panoptic table."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import Networks, WorldFrame
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.console.progress import StageProgress
    from simaps_viz.datasets.sequence import PosedFrames
    from simaps_viz.datasets.source import FrameSource

PRECOMPUTED = "precomputed"


@dataclass(frozen=True)
class Segment:
    """Segment the frames of a sequence with a network, and write the masks as files.

    Example: simaps segment ../scans/breakroom yolo.onnx; simaps build ../scans/breakroom/sequence-yolo.json
    """

    sequence: tyro.conf.Positional[Path]
    """Folder in the posed-frames/1 format, or its manifest (.json); with --format coco also a recording in another
    format."""
    segmentation: tyro.conf.Positional[str]
    """Network (.onnx), COCO panoptic table (.json), or "precomputed" to write the sequence's own masks anew."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Manifest to write (.json), or with --format coco the table; the images go to a folder of its name. By default
    beside the sequence, named after the network."""
    format: Literal["posed-frames", "coco", "coco-ids"] = "posed-frames"
    """coco: panoptic table with coloured PNGs; coco-ids: with plain 16-bit id images."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    json: bool = False
    """Print the outcome as one JSON line."""

    def run(self) -> int:
        """Write the masks and print where they are."""
        from simaps_viz.build.pipeline import cache_folder
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report

        with stage_progress(quiet=self.json) as progress:
            written = self._write(cache_folder(), progress)
        words = f"{written['output']}: {written['segments']} segments in {written['frames']} frames"
        hint = [f"Map it: simaps build {written['output']} -o map.npz"] if self.format == "posed-frames" else []
        report(written, words, *hint, json=self.json)
        return OK

    def _write(self, cache: Path, progress: "StageProgress") -> dict[str, Any]:
        """Segment the sequence and write the masks; return a JSON-able summary of the files written."""
        from simaps_viz.datasets.open import open_sequence
        from simaps_viz.segmentation.coco_panoptic import write_coco_panoptic
        from simaps_viz.segmentation.mask_store import check_place, write_masks

        path = open_sequence(self.sequence).path
        stem = "masks" if self.segmentation == PRECOMPUTED else Path(self.segmentation).stem
        name = f"{path.stem}-{stem}.json" if self.format == "posed-frames" else f"panoptic-{stem}.json"
        output = self.output or (path if path.is_dir() else path.parent) / name
        if self.format == "posed-frames":
            check_place(path, output)  # before the network runs for minutes
        masks = open_segmented(self.sequence, self.segmentation, self.network, cache, progress, quiet=self.json)
        if self.format == "posed-frames":
            write_masks(masks, output)
        else:
            write_coco_panoptic(masks, output, plain=self.format == "coco-ids")
        count = sum(len(masks.segmentation(index).segments) for index in range(len(masks)))
        return {"event": "done", "output": str(output), "source": masks.segmentation_source, "frames": len(masks),
                "segments": count, "classes": list(masks.labels[1:])}  # fmt: skip


def open_segmented(
    path: Path,
    segmentation: str,
    options: Networks,
    cache: Path,
    progress: "StageProgress",
    *,
    quiet: bool = False,
    strict: bool = False,
    world: WorldFrame | None = None,
    every: str = "1",
) -> "FrameSource":
    """Open a sequence with the requested masks; a network is first run over it unless its masks are cached.

    Args:
        path: the sequence.
        segmentation: "precomputed", a network (.onnx) or a COCO panoptic table (.json).
        options: how a network is run.
        cache: where its masks are kept.
        progress: called with the progress of the network.
        quiet: do not print which device the network runs on.
        strict: a frame that lacks something is an error, see `open_sequence`.
        world: up and the floor, where they are stated.
        every: which frames a network looks at, see `choose_frames`.

    Raises:
        InputError: the sequence, its masks or the network cannot be read, or it brings no masks and none are named.
    """
    from simaps_viz.datasets.open import open_sequence
    from simaps_viz.segmentation.chosen_frames import check_every

    check_every(every)
    given = Path(segmentation)
    if every != "1" and given.suffix.lower() != ".onnx":
        raise InputError(f"--segment-every: expected --segmentation NETWORK.onnx with it, found {segmentation}")
    sequence = open_sequence(path, strict=strict, **(world or WorldFrame()).stated())
    if segmentation == PRECOMPUTED:
        sequence.segments()  # at once, not after some frames
        return sequence
    if given.suffix.lower() == ".onnx":
        return _by_network(sequence, given, options, cache, progress, quiet=quiet, every=every)
    if given.suffix.lower() == ".json":
        from simaps_viz.segmentation.coco_panoptic import read_coco_panoptic
        from simaps_viz.segmentation.sequences import WithMasks

        masks = read_coco_panoptic(given, sequence.frame_names)
        return WithMasks(sequence, masks, masks.source)
    raise InputError(
        f'--segmentation {segmentation}: expected "precomputed", a network (.onnx) or a COCO panoptic table (.json)'
    )


def _by_network(
    sequence: "PosedFrames",
    network_file: Path,
    options: Networks,
    cache: Path,
    progress: "StageProgress",
    *,
    quiet: bool,
    every: str,
) -> "FrameSource":
    from simaps_viz.console.terminal import note
    from simaps_viz.segmentation.chosen_frames import choose_frames
    from simaps_viz.segmentation.recognise import open_network, origin
    from simaps_viz.segmentation.sequences import segment_sequence

    network, device = open_network(network_file, options.settings())
    if not quiet:
        things, stuff = sum(network.is_thing), len(network.labels) - sum(network.is_thing)
        note(f"{network.name}: {things} things, {stuff} stuff, on {device}")
    by_geometry = {"auto": None, "geometry": True, "none": False}[options.stuff]
    opened = origin(network, network_file, options.settings())
    return segment_sequence(
        sequence, network, cache, stuff=by_geometry, frames=choose_frames(sequence, every, progress),
        progress=progress, origin=opened,
    )  # fmt: skip
