"""COCO panoptic files: a JSON table, and a PNG for each picture whose pixels name segments.

The PNGs are coloured, ``id = R + 256 G + 65536 B`` (cocodataset.org, "Panoptic Segmentation"), or plain id images of 8
or 16 bits; both are read, and either is written. Ids mean something in their picture only.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.images import read_color, read_ids
from simaps_viz.datasets.manifest import read_json, shown
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole
from simaps_viz.structures import Segment, Segmentation

SOURCE = "COCO panoptic "
"""What the source of such masks begins with; the table's path follows."""


@dataclass(frozen=True, eq=False)
class CocoPanoptic:
    """The masks of a COCO panoptic file, by frame."""

    path: Path
    source: str
    frames: tuple[str, ...]
    images: Mapping[str, Path]
    """The PNG of each frame."""
    segments: Mapping[str, Mapping[int, Segment]]
    """By the id in the PNG; the segment's own id counts from 1."""

    def classes(self) -> dict[str, bool]:
        """Return {class name: is it a thing} of all segments, by name."""
        found = {s.label: s.is_thing for by_id in self.segments.values() for s in by_id.values()}
        return dict(sorted(found.items()))

    def get(self, index: int) -> Segmentation:
        """Read a frame's masks.

        Raises:
            InputError: the image is missing or damaged, or holds an id that the table does not list.
        """
        name = self.frames[index]
        path, by_id = self.images[name], self.segments[name]
        raw = read_panoptic_png(path)
        present, where = np.unique(raw, return_inverse=True)
        unknown = [int(i) for i in present if i and int(i) not in by_id]
        if unknown:
            raise InputError(f"{path}: expected only ids that {self.path.name} lists, found {unknown[0]}")
        numbers = np.array([by_id[int(i)].id if i else 0 for i in present], dtype=np.int32)
        used = set(numbers[numbers > 0].tolist())
        ids = numbers[where].reshape(raw.shape)
        return Segmentation(ids, tuple(s for s in by_id.values() if s.id in used))


def read_coco_panoptic(path: Path, frames: Sequence[str]) -> CocoPanoptic:
    """Read a COCO panoptic table.

    The PNGs lie in a folder of the table's name beside it, or beside it. A frame belongs to the picture whose file has
    its name. Crowds (``iscrowd``) are groups that nobody told apart; their pixels count as nothing.

    Args:
        path: the table (.json).
        frames: names of the frames that are wanted.

    Raises:
        InputError: the table has another shape, or a frame has no entry.
    """
    table = read_json(path)
    categories = _categories(path, table)
    files = {_key(row.get("id")): row.get("file_name") for row in _rows(path, table, "images")}
    folder = path.with_suffix("") if path.with_suffix("").is_dir() else path.parent
    images: dict[str, Path] = {}
    segments: dict[str, dict[int, Segment]] = {}
    for row in _rows(path, table, "annotations"):
        file_name = row.get("file_name")
        if not isinstance(file_name, str):
            raise InputError(f"{path}: annotations: expected file_name of each, found {shown(row)}")
        picture = files.get(_key(row.get("image_id")), file_name)
        if not isinstance(picture, str) or not PurePosixPath(picture).name or not picture.isprintable():
            raise InputError(f"{path}: images: expected file_name of each, found {shown(picture)}")
        if not file_name.isprintable() or Path(file_name).is_absolute():
            raise InputError(f"{path}: annotations: expected file names beside the table, found {shown(file_name)}")
        name = PurePosixPath(picture).with_suffix("").as_posix()
        images[name] = folder / file_name
        segments[name] = _segments(f"{path}: {file_name}", row.get("segments_info"), categories)
    missing = [frame for frame in frames if frame not in images]
    if missing:
        raise InputError(
            f"{path}: expected a picture named after each of {len(frames)} frames, found none for {len(missing)}: "
            f"{', '.join(missing[:3])}{', ...' if len(missing) > 3 else ''}"
        )
    return CocoPanoptic(path, f"{SOURCE}{path.resolve()}", tuple(frames), images, segments)


def read_panoptic_png(path: Path) -> NDArray:
    """Read the ids of a picture, int64 [H, W], 0 = nothing: coloured, or plain with one channel."""
    try:
        color = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        color = None
    if color is not None and color.ndim == 3 and color.dtype == np.uint8:
        r, g, b = np.moveaxis(read_color(path).astype(np.int64), -1, 0)
        return r + 256 * g + 65536 * b
    return read_ids(path).astype(np.int64)


def write_coco_panoptic(masks: FrameSource, path: Path, *, plain: bool = False) -> None:
    """Write the masks of a sequence as a COCO panoptic table with its PNGs; the table comes last.

    Scores are kept under ``score``, as COCO's results do.

    Args:
        masks: the sequence.
        path: the table (.json); the PNGs go to a folder of its name.
        plain: write 16-bit id images instead of coloured ones.

    Raises:
        InputError: it cannot be written.
    """
    things = dict(zip(masks.labels[1:], masks.is_thing[1:], strict=True))
    numbers = {label: i for i, label in enumerate(things, start=1)}
    images, annotations = [], []
    try:
        for index, name in enumerate(masks.frame_names):
            found = masks.segmentation(index)
            height, width = found.ids.shape
            target = path.with_suffix("") / f"{name}.png"
            target.parent.mkdir(parents=True, exist_ok=True)
            image = cv2.imencode(".png", _pixels(found.ids, plain=plain))[1].tobytes()
            write_whole(target, image, "the masks", durable=False)
            images.append({"id": index + 1, "file_name": f"{name}.jpg", "width": width, "height": height})
            rows = [_info(found.ids, s, numbers[s.label]) for s in found.segments]
            annotations.append(
                {"image_id": index + 1, "file_name": f"{name}.png", "segments_info": [r for r in rows if r["area"]]}
            )
        categories = [{"id": numbers[label], "name": label, "isthing": int(thing)} for label, thing in things.items()]
        table = {"images": images, "annotations": annotations, "categories": categories}
        write_whole(path, (json.dumps(table, indent=1) + "\n").encode(), "the table of the masks", durable=False)
    except OSError as error:
        raise InputError(f"{path}: expected to write masks there, found {error.strerror or error}") from error


def _pixels(ids: NDArray, *, plain: bool) -> NDArray:
    if plain:
        return ids.astype(np.uint16)
    return np.stack([ids >> 16, (ids >> 8) & 255, ids & 255], axis=-1).astype(np.uint8)  # OpenCV writes B, G, R


def _info(ids: NDArray, segment: Segment, category: int) -> dict[str, Any]:
    mask = (ids == segment.id).astype(np.uint8)
    return {
        "id": segment.id,
        "category_id": category,
        "area": int(mask.sum()),
        "bbox": [int(v) for v in cv2.boundingRect(mask)],
        "iscrowd": 0,
        "score": segment.score,
    }


def _rows(path: Path, table: Any, key: str) -> list[dict[str, Any]]:
    rows = table.get(key) if isinstance(table, dict) else None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f'{path}: expected COCO panoptic: an object with a list "{key}", found {shown(rows or table)}')
    return rows


def _key(value: Any) -> str:
    """Return an id, which is a number or text, as something to look up by."""
    return shown(value)


def _categories(path: Path, table: Any) -> dict[int, tuple[str, bool]]:
    found = {}
    for row in _rows(path, table, "categories"):
        number, name, thing = row.get("id"), row.get("name"), row.get("isthing", 1)
        if not isinstance(number, int) or not isinstance(name, str) or name in ("", "none") or thing not in (0, 1):
            raise InputError(f"{path}: categories: expected id, name and isthing (0 or 1), found {shown(row)}")
        found[number] = (name, bool(thing))
    return found


def _segments(where: str, rows: Any, categories: Mapping[int, tuple[str, bool]]) -> dict[int, Segment]:
    if not isinstance(rows, list):
        raise InputError(f"{where}: expected a list segments_info, found {shown(rows)}")
    found: dict[int, Segment] = {}
    for row in rows:
        number, category = (row.get("id"), row.get("category_id")) if isinstance(row, dict) else (None, None)
        known = isinstance(category, int) and category in categories
        if not isinstance(number, int) or not 0 < number < 1 << 24 or number in found or not known:
            raise InputError(f"{where}: expected segments with an id of their own and a known category_id, "
                             f"found {shown(row)}")  # fmt: skip
        name, thing = categories[row["category_id"]]
        score = row.get("score", 1.0)
        if not isinstance(score, int | float) or not 0 <= score <= 1:
            raise InputError(f"{where}: id {number}: expected score from 0 to 1, found {shown(score)}")
        crowd = bool(row.get("iscrowd"))
        found[number] = Segment(0 if crowd else len(found) + 1, name, float(score), thing)
    return found
