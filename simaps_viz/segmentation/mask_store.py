"""Store the masks of a sequence: frame by frame while a network runs, and as a manifest with its files at the end.

An interrupted run resumes where it stopped.

A folder for each sequence, network and setting: ``about.json`` says which, one PNG a frame holds the ids, and
``segments.jsonl`` gets one line when a frame is done, so a frame without a line is not.
"""

import hashlib
import json
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from simaps_viz.datasets.images import encode_ids, read_ids
from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole
from simaps_viz.structures import Segment, Segmentation

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
            image = folder / f"{name}.png"
            image.parent.mkdir(parents=True, exist_ok=True)
            write_whole(image, encode_ids(found.ids).tobytes(), "the masks", durable=False)
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


_ABOUT, _LINES = "about.json", "segments.jsonl"
_FAST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
if hasattr(cv2, "IMWRITE_PNG_FILTER"):  # not in OpenCV 4.10
    _FAST_PNG += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
"""Ids are flat patches: runs without filter take a third of the time, and less room."""


@dataclass(frozen=True)
class About:
    """What a store was made from."""

    sequence: str
    """Path of the manifest."""
    source: str
    """In words: which network; also what a map's provenance says."""
    key: str
    """All that the masks depend on but the frames' files: network, settings, where the map frame lies."""
    origin: Mapping[str, Any] = field(default_factory=dict)
    """Where the network's file is and how it was opened, JSON-able, to open it again; names no folder."""
    frames: Sequence[int] | None = None
    """Those that the network was to look at; None: all."""

    def folder(self, root: Path) -> Path:
        """Return the folder that belongs to this below ``root``."""
        digest = hashlib.sha256(json.dumps([self.sequence, self.source, self.key]).encode()).hexdigest()
        return root / "masks" / digest[:20]


class MaskStore:
    """Masks of one sequence by one network. Frames are named by their position; several threads may use it."""

    def __init__(self, root: Path, about: About) -> None:
        """Open the store, or make it.

        Raises:
            InputError: the folder cannot be written.
        """
        self.about, self.folder = about, about.folder(root)
        self._lock = threading.Lock()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            text = json.dumps(asdict(about), indent=1).encode()
            path = self.folder / _ABOUT
            if not path.is_file() or (about.origin and path.read_bytes() != text):
                write_whole(path, text, "what the masks are of", durable=False)
            self._rows = _read_lines(self.folder / _LINES)
        except OSError as error:
            raise InputError(f"{self.folder}: expected to keep masks there, found {error.strerror or error}") from error

    def holds(self, index: int, stamp: Sequence[Any]) -> bool:
        """Return whether a frame is done, and of files of the same stamp (see `file_stamp`)."""
        row = self._rows.get(index)
        return row is not None and row["stamp"] == list(stamp) and self._image(index).is_file()

    def put(self, index: int, stamp: Sequence[Any], found: Segmentation) -> None:
        """Keep a frame's masks; the line that says so comes last.

        It does not wait for the disk, which would take longer than a network does: masks that a power cut takes are
        made again.
        """
        row = {"frame": index, "stamp": list(stamp), "segments": [_row(s) for s in found.segments]}
        data = encode_ids(found.ids, _FAST_PNG).tobytes()
        try:
            write_whole(self._image(index), data, "the masks", durable=False)
            with self._lock, (self.folder / _LINES).open("a", encoding="utf-8") as file:
                file.write("\n" * self._torn() + json.dumps(row) + "\n")
        except OSError as error:
            raise InputError(f"{self.folder}: expected to keep masks there, found {error.strerror or error}") from error
        self._rows[index] = row

    def get(self, index: int) -> Segmentation | None:
        """Read a frame's masks; None when nobody was to look at it.

        Raises:
            InputError: they are damaged or not there.
        """
        if self.about.frames is not None and index not in self.about.frames:
            return None
        if index not in self._rows:
            raise InputError(f"{self.folder}: expected masks of frame {index}, found none; segment the sequence again")
        segments = tuple(Segment(**row) for row in self._rows[index]["segments"])
        return Segmentation(read_ids(self._image(index)).astype(np.int32), segments)

    def classes(self) -> dict[str, bool]:
        """Return {class name: is it a thing} of all segments, by name."""
        found = {row["label"]: row["is_thing"] for line in self._rows.values() for row in line["segments"]}
        return dict(sorted(found.items()))

    def _image(self, index: int) -> Path:
        return self.folder / f"{index:06d}.png"

    def _torn(self) -> bool:
        """Return whether the last line was cut off by a crash."""
        path = self.folder / _LINES
        if not path.is_file() or path.stat().st_size == 0:
            return False
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) != b"\n"


def find_store(root: Path, *, sequence: str, source: str) -> MaskStore | None:
    """Find the store that a map's provenance means; None when it has been deleted."""
    for path in sorted((root / "masks").glob(f"*/{_ABOUT}"), key=lambda p: -p.stat().st_mtime):
        try:
            about = About(**json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError, RecursionError):
            continue
        if (about.sequence, about.source) == (sequence, source):
            return MaskStore(root, about)
    return None


def file_stamp(*paths: Path) -> list[int]:
    """Return size and time of change of files: masks of a picture that was replaced are made anew."""
    stats = [path.stat() for path in paths]
    return [number for s in stats for number in (s.st_size, s.st_mtime_ns)]


def _row(segment: Segment) -> dict[str, Any]:
    return {"id": segment.id, "label": segment.label, "score": segment.score, "is_thing": segment.is_thing}


def _read_lines(path: Path) -> dict[int, Mapping[str, Any]]:
    """Read the finished frames; a line that a crash cut off is not one."""
    rows: dict[int, Mapping[str, Any]] = {}
    if not path.is_file():
        return rows
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            row = json.loads(line)
            [Segment(**segment) for segment in row["segments"]]
            rows[int(row["frame"])] = {"stamp": list(row["stamp"]), "segments": row["segments"]}
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
            continue
    return rows
