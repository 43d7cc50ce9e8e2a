"""Read Replica rooms as rendered for NICE-SLAM: clean depth, a smooth camera path, no labels."""

from pathlib import Path

from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import Lens, number_rows, pinhole
from simaps_viz.datasets.file_frames import FileFrames, by_line, depth_png, json_number, numbered
from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording
from simaps_viz.errors import InputError

FACTS = FormatFacts(
    title="Replica (NICE-SLAM)",
    recognised_by="`results/depth*.png`, `results/frame*.jpg`, `traj.txt`",
    depth_unit_m=1 / 6553.5,
    pose="camera to world: 16 numbers a line",
    up=(0.0, 0.0, 1.0),
)

CAMERA = (1200, 680, 600.0, 600.0, 599.5, 339.5)
"""Width, height, fx, fy, cx, cy where ``cam_params.json`` is not there."""


class ReplicaReader(Reader):
    """The reader of Replica (NICE-SLAM) recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder is in this format, from names alone."""
        return (path / "traj.txt").is_file() and (path / "results").is_dir()

    def open(self, path: Path) -> Recording:
        """Open a recording; raises InputError for anything that is not as the format wants it."""
        depth_files = numbered(path / "results", "depth*.png")
        color_files = numbered(path / "results", "frame*.jpg") or numbered(path / "results", "frame*.png")
        if not depth_files:
            raise InputError(f"{path / 'results'}: expected depth*.png, found none")
        rows = dict(enumerate(number_rows(path / "traj.txt", 16)))
        depth, color = by_line(depth_files, len(rows)), by_line(color_files, len(rows))
        matched = match_frames(
            path,
            {"depth image": depth, "colour image": color},
            rows,
            lambda r: r[1].reshape(4, 4),
            place=lambda r: r[0],
        )
        depth_files, color_files = [depth[i] for i in matched.frames], [color[i] for i in matched.frames]
        lens, unit_m = _camera(path)
        files = FileFrames(color_files, depth_files, [lens], [lens], depth_png(unit_m))
        return files.recording(
            FACTS,
            path,
            frame_names=tuple(file.stem.removeprefix("depth") for file in depth_files),
            poses=matched.poses,
            notes=matched.notes,
            faults=matched.faults,
            depth_unit_m=unit_m,
            simulated=True,
        )


def _camera(path: Path) -> tuple[Lens, float]:
    """Read ``cam_params.json``, which lies beside the rooms, or take the one that all of them have."""
    file = next((f for f in (path / "cam_params.json", path.parent / "cam_params.json") if f.is_file()), None)
    if file is None:
        return Lens(pinhole(str(path), *CAMERA)), FACTS.depth_unit_m
    content = read_json(file)
    values = content.get("camera") if isinstance(content, dict) else None
    where = f"{file}: camera"
    numbers = {key: json_number(where, values, key) for key in ("w", "h", "fx", "fy", "cx", "cy", "scale")}
    scale = numbers.pop("scale")
    if scale <= 0:
        raise InputError(f"{where}: scale: expected steps a metre, more than 0, found {scale:g}")
    width, height = int(numbers.pop("w")), int(numbers.pop("h"))
    return Lens(pinhole(where, width, height, **numbers)), 1 / scale
