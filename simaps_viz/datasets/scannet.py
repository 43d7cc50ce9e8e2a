"""Reads ScanNet scans whose .sens file has been extracted: colour, depth, poses, and instances where they are there."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import is_thing
from simaps_viz.datasets.file_frames import FileFrames, check_size, depth_png, image_size, numbered
from simaps_viz.datasets.images import read_ids
from simaps_viz.datasets.lens import Lens, pinhole, see_through
from simaps_viz.datasets.manifest import read_json, shown
from simaps_viz.datasets.recording import FormatFacts, Recording, Segments
from simaps_viz.datasets.rows import matrix4, rigid
from simaps_viz.datasets.segment_tables import WorldSegments
from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics, Segment

FACTS = FormatFacts(
    title="ScanNet (extracted)",
    recognised_by="`color/*.jpg`, `depth/*.png`, `pose/*.txt`, `intrinsic/intrinsic_depth.txt` (also in `frames/`) "
    "or `intrinsics_depth.txt`",
    depth="16-bit PNG",
    depth_unit_m=0.001,
    invalid="0",
    pose="camera to world: 4x4; -inf where tracking was lost, left out",
    camera_axes="OpenCV",
    up=(0.0, 0.0, 1.0),
    segmentation="`instance-filt/*.png` or `instance/*.png` (objectId + 1) named by `*.aggregation.json`: the truth",
)


def recognise(path: Path) -> bool:
    """Determine from names alone whether a folder is in this format."""
    return _camera_file(_frames_folder(path), "depth").is_file()


def open_recording(path: Path) -> Recording:
    """Open a scan; raises InputError for anything that is not as the format wants it."""
    folder = _frames_folder(path)
    depth_files = numbered(folder / "depth", "*.png")
    if not depth_files:
        raise InputError(f"{folder / 'depth'}: expected *.png, found none")
    matrices = [matrix4(folder / "pose" / f"{file.stem}.txt") for file in depth_files]
    kept, poses, notes = tracked_poses([str(folder / "pose" / f"{f.stem}.txt") for f in depth_files], matrices)
    depth_files = [depth_files[i] for i in kept]
    color_files = [_color_file(folder / "color", file.stem) for file in depth_files]
    read = depth_png(FACTS.depth_unit_m)
    height, width = read(depth_files[0]).shape
    depth_lens = _lens(_camera_file(folder, "depth"), width, height)
    color_lens = _lens(_camera_file(folder, "color"), *image_size(color_files[0]))
    files = FileFrames(color_files, depth_files, [color_lens], [depth_lens], depth_lens.intrinsics, read)
    names = tuple(file.stem for file in depth_files)
    return Recording(
        facts=FACTS,
        path=path,
        name=path.resolve().name,
        frame_names=names,
        poses=poses,
        intrinsics=depth_lens.intrinsics,
        depth=files.depth,
        color=files.color,
        color_file=files.color_file,
        stored=files.stored,
        segments=_segments(path, folder, names, color_lens, depth_lens.intrinsics),
        notes=notes,
    )


def tracked_poses(where: list[str], matrices: list[NDArray]) -> tuple[list[int], NDArray, tuple[str, ...]]:
    """Drop the frames whose pose is infinite: there tracking was lost.

    Args:
        where: of each pose, for messages.
        matrices: [4, 4] each.

    Returns:
        Indices of the frames that are left, their poses [n, 4, 4], and a note on the others.
    """
    kept = [i for i, matrix in enumerate(matrices) if np.isfinite(matrix).all()]
    if not kept:
        raise InputError(f"{where[0]}: expected a finite pose in one of {len(matrices)} frames, found none")
    lost = len(matrices) - len(kept)
    notes = (f"{lost} of {len(matrices)} frames have no pose, tracking was lost: left out",) if lost else ()
    return kept, np.stack([rigid(where[i], matrices[i]) for i in kept]), notes


def _frames_folder(path: Path) -> Path:
    return path / "frames" if (path / "frames" / "intrinsic").is_dir() else path


def _camera_file(folder: Path, which: str) -> Path:
    """Name a camera's file; the smaller copy of the dataset (scannet_frames_25k) has no folder for it."""
    alone = folder / f"intrinsics_{which}.txt"
    return alone if alone.is_file() else folder / "intrinsic" / f"intrinsic_{which}.txt"


def _color_file(folder: Path, stem: str) -> Path:
    png = folder / f"{stem}.png"
    return png if png.is_file() else folder / f"{stem}.jpg"


def _lens(path: Path, width: int, height: int) -> Lens:
    K = matrix4(path)
    return Lens(pinhole(str(path), width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2]))


def _segments(
    path: Path, folder: Path, names: tuple[str, ...], color_lens: Lens, target: Intrinsics
) -> Segments | None:
    """Read which objects there are; instance images have the size of the colour images, or of the depth images."""
    places = [base / name for base in (path, folder) for name in ("instance-filt", "instance")]
    images = next((place for place in places if place.is_dir()), None)
    tables = [f for f in sorted(path.glob("*.aggregation.json")) if not f.name.endswith("_vh_clean.aggregation.json")]
    if images is None or not tables:
        return None
    table = WorldSegments(tables[0], _objects(tables[0]))

    def read(index: int) -> Any:
        file = images / f"{names[index]}.png"
        ids = read_ids(file)
        if ids.shape != (target.height, target.width):
            check_size(file, ids, color_lens.intrinsics)
            ids = see_through(ids, color_lens, target, exact=True)
        return table.segmentation(names[index], file, ids)

    return Segments(table.classes(), read, f"ScanNet annotation ({images.name})", table.by_id, ground_truth=True)


def _objects(path: Path) -> dict[int, Segment]:
    """Read ``segGroups``: what each object id is called; images hold the id plus one."""
    content = read_json(path)
    groups = content.get("segGroups") if isinstance(content, dict) else None
    if not isinstance(groups, list) or not groups:
        raise InputError(f'{path}: expected an object with a list "segGroups", found {shown(content)}')
    objects: dict[int, Segment] = {}
    for group in groups:
        number, label = (group.get("objectId"), group.get("label")) if isinstance(group, dict) else (None, None)
        if not isinstance(number, int) or number < 0 or not isinstance(label, str) or not label.strip():
            raise InputError(f"{path}: segGroups: expected objectId and label, found {shown(group)}")
        objects[number + 1] = Segment(number + 1, label.strip(), 1.0, is_thing(label.strip()))
    return objects
