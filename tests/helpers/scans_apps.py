"""Writers of what phone apps export as archives or with compressed floats."""

import json
import zipfile
from pathlib import Path

import liblzfse  # pyright: ignore[reportMissingImports]
import numpy as np
import OpenEXR
from scans import (
    COLORS,
    FRAMES,
    GL,
    Y_UP,
    Sample,
    camera,
    look,
    map_pose,
    quaternion,
    steps,
    write_image,
    write_reference,
)

from simaps_viz.structures import Intrinsics


def _record3d(folder: Path) -> tuple[Path, Sample]:
    """Write an unpacked recording: colour three times as large, a camera of its own for each frame (all the same)."""
    k = camera(48, 64, 55.0)
    large = Intrinsics(144, 192, k.fx * 3, k.fy * 3, k.cx * 3 + 1, k.cy * 3 + 1)
    path = folder / "unpacked"
    poses = []
    for i in range(FRAMES):
        depth_m = steps(look(k, map_pose(i))[0]).astype(np.float32) * np.float32(0.001)
        depth_m[depth_m == 0] = np.nan
        write_image(path / f"rgbd/{i}.jpg", COLORS[look(large, map_pose(i))[1]])
        (path / f"rgbd/{i}.depth").write_bytes(liblzfse.compress(depth_m.tobytes()))
        (path / f"rgbd/{i}.conf").write_bytes(liblzfse.compress(bytes(depth_m.size)))
        T = Y_UP.pose(i) @ GL
        poses.append([*quaternion(T), *T[:3, 3].tolist()])
    metadata = {"w": large.width, "h": large.height, "dw": k.width, "dh": k.height, "fps": 60, "poses": poses,
                "K": [large.fx, 0, 0, 0, large.fy, 0, large.cx, large.cy, 1],
                "perFrameIntrinsicCoeffs": [[large.fx, large.fy, large.cx, large.cy]] * FRAMES}  # fmt: skip
    (path / "metadata").write_text(json.dumps(metadata))
    reference = write_reference(folder / "reference", k, Y_UP)
    return path, Sample(path, reference, exact_color=False, lossless=False)


def record3d_folder(folder: Path) -> Sample:
    return _record3d(folder)[1]


def record3d_zip(folder: Path) -> Sample:
    path, sample = _record3d(folder)
    archive = folder / "seats.r3d"
    with zipfile.ZipFile(archive, "w") as file:
        for part in path.rglob("*"):
            if part.is_file():
                file.write(part, part.relative_to(path))
    return Sample(archive, sample.reference, exact_color=False, lossless=False)


def record3d_exr(folder: Path) -> Sample:
    path, sample = _record3d(folder)
    out = folder / "seats" / "EXR_RGBD"
    (out / "depth").mkdir(parents=True)
    metadata = json.loads((path / "metadata").read_text())
    del metadata["perFrameIntrinsicCoeffs"]
    (out / "metadata.json").write_text(json.dumps(metadata))
    for i in range(FRAMES):
        raw = liblzfse.decompress((path / f"rgbd/{i}.depth").read_bytes())
        depth_m = np.frombuffer(raw, np.float32).reshape(metadata["dh"], metadata["dw"])
        OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"R": depth_m.copy()}).write(str(out / f"depth/{i}.exr"))
        (out / "rgb").mkdir(exist_ok=True)
        (out / f"rgb/{i}.jpg").write_bytes((path / f"rgbd/{i}.jpg").read_bytes())
    return Sample(folder / "seats", sample.reference, exact_color=False, lossless=False)
