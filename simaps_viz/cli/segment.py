"""What ``--segmentation`` means: the sequence's own masks, a network's, or those of a COCO panoptic file."""

from pathlib import Path
from typing import Any

from simaps_viz.cli.options import Networks, Segment
from simaps_viz.console.progress import StageProgress
from simaps_viz.console.terminal import console
from simaps_viz.datasets.posed_frames import PosedFrames, open_sequence
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError

PRECOMPUTED = "precomputed"


def open_segmented(
    path: Path,
    segmentation: str,
    options: Networks,
    cache: Path,
    progress: StageProgress,
    *,
    quiet: bool = False,
    whole: bool = True,
) -> FrameSource:
    """Open a sequence with the masks that are asked for; a network is run over it first, where it has not been.

    Args:
        path: the sequence.
        segmentation: "precomputed", a network (.onnx) or a COCO panoptic table (.json).
        options: how a network is run.
        cache: where its masks are kept.
        progress: told how far it is.
        quiet: do not say what the network runs on.
        whole: every frame has to be there, see `open_sequence`; a network wants them all.

    Raises:
        InputError: anything is not as it should be.
    """
    sequence = open_sequence(path, whole=whole or segmentation.lower().endswith(".onnx"))
    if segmentation == PRECOMPUTED:
        return sequence
    given = Path(segmentation)
    if given.suffix.lower() == ".onnx":
        return _by_network(sequence, given, options, cache, progress, quiet=quiet)
    if given.suffix.lower() == ".json":
        from simaps_viz.segmentation.coco_panoptic import read_coco_panoptic  # noqa: PLC0415 - only needed here
        from simaps_viz.segmentation.sequences import WithMasks  # noqa: PLC0415 - as above

        masks = read_coco_panoptic(given, sequence.frame_names)
        return WithMasks(sequence, masks, masks.source)
    raise InputError(
        f'--segmentation {segmentation}: expected "precomputed", a network (.onnx) or a COCO panoptic table (.json)'
    )


def _by_network(
    sequence: PosedFrames, network_file: Path, options: Networks, cache: Path, progress: StageProgress, *, quiet: bool
) -> FrameSource:
    from simaps_viz.segmentation.recognise import open_network, origin  # noqa: PLC0415 - onnxruntime is slow to import
    from simaps_viz.segmentation.sequences import segment_sequence  # noqa: PLC0415 - as above

    network, device = open_network(network_file, options.settings())
    if not quiet:
        things, stuff = sum(network.is_thing), len(network.labels) - sum(network.is_thing)
        console.print(f"{network.name}: {things} things, {stuff} stuff, on {device}", markup=False, soft_wrap=True)
    by_geometry = {"auto": None, "geometry": True, "none": False}[options.stuff]
    opened = origin(network, network_file, options.settings())
    return segment_sequence(sequence, network, cache, stuff=by_geometry, progress=progress, origin=opened)


def write_segmented(command: Segment, cache: Path, progress: StageProgress) -> dict[str, Any]:
    """Segment a sequence and write the masks; returns what was written, JSON-able.

    Raises:
        InputError: anything is not as it should be, or cannot be written.
    """
    from simaps_viz.segmentation.coco_panoptic import write_coco_panoptic  # noqa: PLC0415 - only needed here
    from simaps_viz.segmentation.mask_files import check_place, write_masks  # noqa: PLC0415 - as above

    path = open_sequence(command.sequence).path
    stem = "masks" if command.segmentation == PRECOMPUTED else Path(command.segmentation).stem
    name = f"{path.stem}-{stem}.json" if command.format == "posed-frames" else f"panoptic-{stem}.json"
    output = command.output or (path if path.is_dir() else path.parent) / name
    if command.format == "posed-frames":
        check_place(path, output)
    masks = open_segmented(command.sequence, command.segmentation, command.network, cache, progress, quiet=command.json)
    if command.format == "posed-frames":
        write_masks(masks, output)
    else:
        write_coco_panoptic(masks, output, plain=command.format == "coco-ids")
    count = sum(len(masks.segmentation(index).segments) for index in range(len(masks)))
    return {"event": "done", "output": str(output), "source": masks.segmentation_source, "frames": len(masks),
            "segments": count, "classes": list(masks.labels[1:])}  # fmt: skip
