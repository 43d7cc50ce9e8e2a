"""Write any sequence as a posed-frames/1 folder, frame by frame; a failed conversion leaves no folder."""

import json
import os
import secrets
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.file_frames import MAX_STEP
from simaps_viz.datasets.images import MAX_ID, encode_ids
from simaps_viz.datasets.manifest import CAMERA_AXES, FORMAT, POSE
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import Unreadable
from simaps_viz.errors import InputError
from simaps_viz.structures import Segmentation

JPEG_QUALITY = 95
"""Quality of colour images that had to be decoded or seen through another camera; others are copied as they are."""


def write_posed_frames(
    sequence: PosedFrames,
    folder: Path,
    *,
    every: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
    unreadable: Callable[[Unreadable], None] | None = None,
) -> Path:
    """Write a sequence as a posed-frames/1 folder and return the path of its manifest.

    One frame is in memory at a time. Up and the floor's height are written as they were found.

    Args:
        sequence: any that was opened.
        folder: made; must not be there yet, or be empty.
        every: take the first of every so many frames.
        progress: called with (frames done, number of frames).
        unreadable: called with each frame that cannot be read and is left out; None = it is an error.

    Raises:
        InputError: The folder cannot be written, ``every`` is under 1, or a frame, or more than half of them where they
            may be left out, is not what it has to be; then nothing is left behind.
    """
    if every < 1:
        raise InputError(f"--every: expected a whole number from 1, found {every}")
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: expected a new or empty folder to write to, found something there")
    partial = folder.parent / f".{folder.name}-{secrets.token_urlsafe(6)}"
    try:
        partial.mkdir(parents=True)  # with the rights any new folder gets
        _Writer(sequence, partial).write(range(0, len(sequence), every), progress, unreadable)
        os.replace(partial, folder)
    except OSError as error:
        raise InputError(f"{folder}: expected a folder that can be written, found {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder / "sequence.json"


class _Writer:
    def __init__(self, sequence: PosedFrames, folder: Path) -> None:
        self.sequence, self.folder = sequence, folder
        self.unit_m = sequence.depth_unit_m
        first = sequence.color_file(0)
        self.color_suffix = first.suffix if first else ".jpg"
        self.world = sequence.world_segments()
        self.has_segments = len(sequence.labels) > 1
        self.table: dict[str, list[dict[str, Any]]] = {}

    def write(
        self,
        indices: range,
        progress: Callable[[int, int], None],
        unreadable: Callable[[Unreadable], None] | None,
    ) -> None:
        for name in ("color", "depth", *(("ids",) if self.has_segments else ())):
            (self.folder / name).mkdir()
        lines, lost = [], []
        for done, index in enumerate(indices, start=1):
            name = self.sequence.frame_names[index]
            try:
                self._write_frame(index, name)
            except InputError as error:
                for written in (f"color/{name}{self.color_suffix}", f"depth/{name}.png", f"ids/{name}.png"):
                    (self.folder / written).unlink(missing_ok=True)
                lost.append(Unreadable(index, error))
                if unreadable is None or 2 * len(lost) > len(indices):
                    raise lost[0].error from None
                unreadable(lost[-1])
            else:
                lines.append(f"{name} " + " ".join(repr(float(x)) for x in self.sequence.poses[index].ravel()))
            progress(done, len(indices))
        k = self.sequence.intrinsics
        rows = ((k.fx, 0.0, k.cx), (0.0, k.fy, k.cy), (0.0, 0.0, 1.0))
        self._write_text("intrinsics.txt", "\n".join(" ".join(repr(float(x)) for x in row) for row in rows))
        self._write_text("poses.txt", "\n".join(lines))
        if self.has_segments:
            self._write_table()
        self._write_text("sequence.json", json.dumps(self._keys(), indent=1, ensure_ascii=False))

    def _keys(self) -> dict[str, Any]:
        s = self.sequence
        up, floor_height_m = s.T_map_world[2, :3], -s.T_map_world[2, 3]
        keys: dict[str, Any] = {
            "name": s.name,
            "description": s.description,
            "format": FORMAT,
            "color": f"color/{{frame}}{self.color_suffix}",
            "depth": "depth/{frame}.png",
            "depth_unit_m": self.unit_m,
            "intrinsics": "intrinsics.txt",
            "poses": "poses.txt",
            "pose": POSE,
            "camera_axes": CAMERA_AXES,
            "up": [float(x) for x in up],
            "floor_height_m": float(floor_height_m),
            "simulated": s.simulated,
        }
        if self.has_segments:
            table = {"instances": "scene.json"} if self.world else {"segments": "segments.json"}
            keys["segmentation"] = {"ids": "ids/{frame}.png", **table, "source": s.segmentation_source,
                                    "ground_truth": s.ground_truth}  # fmt: skip
        return keys

    def _write_frame(self, index: int, name: str) -> None:
        steps = self._steps(index)
        if self.has_segments:
            self._write_segments(index, name)
        self._write_color(index, name)
        self._write_image(f"depth/{name}.png", steps)

    def _write_color(self, index: int, name: str) -> None:
        file = self.sequence.color_file(index)
        target = f"color/{name}{self.color_suffix}"
        if file is not None and file.suffix == self.color_suffix:
            self.sequence.color(index)  # a damaged one must not be copied
            shutil.copyfile(file, self.folder / target)
            return
        bgr = cv2.cvtColor(self.sequence.color(index), cv2.COLOR_RGB2BGR)
        self._write_image(target, bgr)

    def _steps(self, index: int) -> NDArray:
        """Return depth as uint16 steps; what is farther than they reach becomes 0, no reading."""
        steps = np.rint(self.sequence.read(index).depth_m.astype(np.float64) / self.unit_m)
        steps[steps > MAX_STEP] = 0
        return steps.astype(np.uint16)

    def _write_segments(self, index: int, name: str) -> None:
        segmentation = self.sequence.segmentation(index)
        highest = int(segmentation.ids.max())
        if highest > MAX_ID:
            raise InputError(f"{self.sequence.path}: frame {name}: expected ids up to {MAX_ID}, found {highest}")
        (self.folder / f"ids/{name}.png").write_bytes(encode_ids(segmentation.ids).tobytes())
        if self.world is None:
            self.table[name] = _entries(segmentation)

    def _write_table(self) -> None:
        if self.world is None:
            self._write_text("segments.json", json.dumps(self.table, ensure_ascii=False))
            return
        instances = [{"id": s.id, "label": s.label, "isthing": s.is_thing} for s in self.world]
        self._write_text("scene.json", json.dumps({"instances": instances}, ensure_ascii=False))

    def _write_image(self, name: str, image: NDArray) -> None:
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if name.endswith((".jpg", ".jpeg")) else []
        done, data = cv2.imencode(Path(name).suffix, image, options)
        if not done:
            raise OSError(f"{name} cannot be written")
        (self.folder / name).write_bytes(data.tobytes())  # OpenCV itself would not say why it cannot

    def _write_text(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text + "\n", encoding="utf-8")


def _entries(segmentation: Segmentation) -> list[dict[str, Any]]:
    areas = np.bincount(segmentation.ids.ravel())
    return [
        {
            "id": s.id,
            "label": s.label,
            "score": s.score,
            "isthing": s.is_thing,
            "area": int(areas[s.id]) if s.id < len(areas) else 0,
        }
        for s in segmentation.segments
    ]
