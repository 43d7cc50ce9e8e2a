"""Read Redwood's recordings and those of Open3D's reconstruction system: pictures and poses in a ``.log`` file."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import read_lines
from simaps_viz.datasets.calibration import Lens, matrix_lens, numbers, rigid, words
from simaps_viz.datasets.file_frames import FileFrames, depth_png, json_number, numbered
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.manifest import few, is_finite_number, read_json, shown
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, left_out
from simaps_viz.errors import InputError

FACTS = FormatFacts(
    title="Redwood, Open3D",
    recognised_by="`trajectory.log` or `scene/trajectory.log` or another `*.log`, `depth/*.png`, "
    "`color/` or `image/` or `rgb/`",
    pose="camera to world: three numbers, then 4x4",
)
COLORS = ("color", "image", "rgb")
LOGS = ("trajectory.log", "scene/trajectory.log")
CAMERAS = ("intrinsic.json", "camera_intrinsic.json", "camera_primesense.json")
"""As Open3D's recorders write them, or people give them to it."""
PRIMESENSE = (640, 480), np.array([[525.0, 0, 319.5], [0, 525.0, 239.5], [0, 0, 1]])
"""Open3D's camera where none is given: that of Redwood's recordings."""


def _recognise(path: Path) -> bool:
    return (path / "depth").is_dir() and _colors(path) is not None and _log(path) is not None


def _open(path: Path) -> Recording:
    log, colors = _log(path), _colors(path)
    assert log is not None and colors is not None
    color_files = [f for f in numbered(colors, "*.*") if f.suffix.lower() in (".jpg", ".jpeg", ".png")]
    pairs = _paired(path, color_files, numbered(path / "depth", "*.png"))
    poses, damaged = _poses(log)
    if max(poses) >= len(pairs):
        raise InputError(f"{log}: expected a pose per picture, found one of number {max(poses)} for {len(pairs)}")
    posed = {number: T for number, T in poses.items() if np.isfinite(T).all()}
    if not posed:
        raise InputError(f"{log}: expected poses of finite numbers, found none in {len(poses)}")
    color_files, depth_files = ([pairs[number][i] for number in posed] for i in (0, 1))
    width, height = image_size(depth_files[0])
    lens, unit_m, notes = _camera(path, (width, height))
    color_lens = lens.scaled(*image_size(color_files[0]))
    files = FileFrames(color_files, depth_files, [color_lens], [lens], depth_png(unit_m))
    return files.recording(
        FACTS,
        path,
        poses=np.stack(list(posed.values())),
        depth_unit_m=unit_m,
        notes=(*notes, *left_out(len(pairs) - len(posed), len(pairs), f"pictures have no pose in {log.name}")),
        faults=damaged,
    )


READER = Reader(FACTS, _recognise, _open)


def _colors(path: Path) -> Path | None:
    return next((path / name for name in COLORS if (path / name).is_dir()), None)


def _log(path: Path) -> Path | None:
    others = sorted(file for file in path.glob("*.log") if "odometry" not in file.name) + sorted(
        path.glob("*-traj.txt")
    )
    return next((file for file in (*(path / name for name in LOGS), *others) if file.is_file()), None)


def _paired(path: Path, color_files: list[Path], depth_files: list[Path]) -> list[tuple[Path, Path]]:
    """Pair colour and depth by their names, or by their order where they have other names but are as many."""
    by_name = {file.stem: file for file in color_files}
    pairs = [(by_name[file.stem], file) for file in depth_files if file.stem in by_name]
    if not pairs and len(color_files) == len(depth_files):
        pairs = list(zip(color_files, depth_files, strict=True))
    if not pairs:
        found = f"{len(color_files)} and {len(depth_files)}"
        raise InputError(f"{path}: expected colour and depth images of the same names or number, found {found}")
    return pairs


def _poses(log: Path) -> tuple[dict[int, NDArray], tuple[str, ...]]:
    """Return {number of the picture: pose [4, 4]}, which may not be finite, and a note on damaged poses.

    The first of the three numbers before a matrix is the picture's. Where those are no picture's numbers (all the
    same, as some programs write), poses are in the pictures' order.
    """
    blocks = _blocks(words(log))
    if not blocks:
        raise InputError(f"{log}: expected five lines a pose, found none")

    def read(block: tuple[int, list[tuple[int, list[str]]]]) -> tuple[int, float, NDArray]:
        place, lines = block
        (line, head), *rows = lines
        where = f"{log}, line {line}"
        if len(head) > 3 or [len(row) for _, row in rows] != [4, 4, 4, 4]:
            raise InputError(f"{where}: expected three numbers and a 4x4 matrix, found something else")
        number = float(numbers(where, head, finite=True)[0])
        T = np.array([numbers(f"{log}, line {n}", row) for n, row in rows])
        return place, number, rigid(where, T) if np.isfinite(T).all() else T

    poses, damaged = read_lines(blocks, read)
    named = Counter(number for _, number, _ in poses)
    own = 2 * len(named) > len(poses) and all(n.is_integer() and n >= 0 for n in named)
    if own:  # which of two that name the same picture is wrong cannot be told
        twice = [number for number, count in named.items() if count > 1]
        poses = [pose for pose in poses if named[pose[1]] == 1]
        which = f"poses name a picture that another one names, too ({few([int(n) for n in twice])})"
        damaged += left_out(len(blocks) - len(poses) if twice else 0, len(blocks), which)
    by_number = {int(number) if own else place: T for place, number, T in poses}
    return dict(sorted(by_number.items())), damaged


def _complete(lines: list[tuple[int, list[str]]], start: int) -> bool:
    """Whether a pose starts here: up to three numbers, then rows of four numbers, none missing and none too many."""
    if start == len(lines) or len(lines[start][1]) > 3:
        return False
    end = next((i for i in range(start + 1, len(lines)) if len(lines[i][1]) != 4), len(lines))
    return end > start + 1 and (end - start - 1) % 4 == 0  # the line before the next matrix may be missing


def _blocks(lines: list[tuple[int, list[str]]]) -> list[tuple[int, list[tuple[int, list[str]]]]]:
    """Split a log into (place, lines) of each pose; one that lacks a line ends where the next complete one begins."""
    blocks, start, place = [], 0, 0
    while start < len(lines):
        if _complete(lines, start):
            end = start + 5
        else:
            end = next((i for i in range(start + 1, len(lines)) if _complete(lines, i)), len(lines))
        blocks.append((place, lines[start:end]))
        place += max(1, round((end - start) / 5))
        start = end
    return blocks


def _camera(path: Path, size: tuple[int, int]) -> tuple[Lens, float, tuple[str, ...]]:
    """Return the camera, the length of a depth step in metres, and a note where Open3D's default had to be taken."""
    for file in (folder / name for folder in (path, path.parent) for name in CAMERAS):
        if file.is_file():
            content = read_json(file)
            values = content.get("intrinsic_matrix") if isinstance(content, dict) else None
            if not isinstance(values, list) or len(values) != 9 or not all(map(is_finite_number, values)):
                raise InputError(f"{file}: intrinsic_matrix: expected nine numbers, found {shown(values)}")
            width, height = (int(json_number(str(file), content, key)) for key in ("width", "height"))
            scale = json_number(str(file), {"depth_scale": 1 / FACTS.depth_unit_m} | content, "depth_scale")
            if scale <= 0:
                raise InputError(f"{file}: depth_scale: expected a number over 0, found {json.dumps(scale)}")
            lens = matrix_lens(str(file), width, height, np.array(values, dtype=np.float64).reshape(3, 3).T)
            return lens.scaled(*size), 1 / scale, ()
    default, K = PRIMESENSE
    if size != default:
        raise InputError(
            f"{path}: expected {' or '.join(CAMERAS)} with the camera of {size[0]}x{size[1]} pixels, found none"
        )
    note = f"nothing names the camera ({CAMERAS[0]}): taken as Open3D's default, a PrimeSense of 525 pixels"
    return matrix_lens(str(path), *default, K), FACTS.depth_unit_m, (note,)
