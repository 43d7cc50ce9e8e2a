"""Writes a sequence's new masks as files beside it, with a manifest that names them: a precomputed segmentation."""

import json
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole

_FILES = ("color", "depth", "intrinsics", "poses")


def check_place(sequence: Path, manifest: Path) -> None:
    """Raise InputError unless masks of a sequence can be written as this manifest; said before a network runs.

    Args:
        sequence: its own manifest; a path of another format is refused.
        manifest: the file to write (.json), not the sequence's own.
    """
    if sequence.suffix != ".json" or sequence.is_dir():
        raise InputError(
            f"{sequence}: expected a posed-frames sequence to write masks for, found another format; simaps "
            "convert makes one of it"
        )
    if manifest.suffix != ".json":
        raise InputError(f"{manifest}: expected a manifest's name (.json) to write masks for")
    if manifest.resolve() == sequence.resolve():
        raise InputError(f"{manifest}: expected another name than the sequence's own manifest")


def write_masks(masks: FrameSource, manifest: Path) -> None:
    """Write the masks of a sequence and a manifest in the posed-frames format that uses them.

    The images go to a folder named after the manifest, beside it; the manifest comes last, and points at the colour
    and depth images where they are.

    Args:
        masks: the sequence with its new masks; ``path`` is the manifest it was opened from.
        manifest: the file to write (.json).

    Raises:
        InputError: the sequence has another format, its own manifest would be overwritten, or files cannot be written.
    """
    check_place(masks.path, manifest)
    folder = manifest.with_suffix("")
    table: dict[str, list[dict[str, Any]]] = {}
    try:
        for index, name in enumerate(masks.frame_names):
            found = masks.segmentation(index)
            narrow = found.ids.astype(np.uint8 if found.ids.max(initial=0) < 256 else np.uint16)
            image = folder / f"{name}.png"
            image.parent.mkdir(parents=True, exist_ok=True)
            write_whole(image, cv2.imencode(".png", narrow)[1].tobytes(), "the masks", durable=False)
            area = np.bincount(found.ids.reshape(-1), minlength=1)
            table[name] = [
                {"id": s.id, "label": s.label, "score": s.score, "isthing": s.is_thing, "area": int(area[s.id])}
                for s in found.segments
                if s.id < len(area)
            ]
        rows = json.dumps(table, separators=(",", ":")) + "\n"
        write_whole(folder / "segments.json", rows.encode(), "the segments", durable=False)
        keys = json.dumps(_manifest(masks, manifest), indent=1, ensure_ascii=False) + "\n"
        write_whole(manifest, keys.encode(), "the manifest", durable=False)
    except OSError as error:
        raise InputError(f"{manifest}: expected to write masks there, found {error.strerror or error}") from error


def _manifest(masks: FrameSource, manifest: Path) -> dict[str, Any]:
    keys = dict(read_json(masks.path))
    back = os.path.relpath(masks.path.resolve().parent, manifest.resolve().parent)
    if back != ".":
        keys |= {key: f"{Path(back).as_posix()}/{keys[key]}" for key in _FILES}
    keys["segmentation"] = {
        "ids": f"{manifest.stem}/{{frame}}.png",
        "segments": f"{manifest.stem}/segments.json",
        "source": masks.segmentation_source,
        "ground_truth": False,
    }
    return keys
