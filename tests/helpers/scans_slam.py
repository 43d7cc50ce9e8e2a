"""Writers of what SLAM programs and phone apps leave on disk: databases, videos, lists beside trajectories."""

import csv
import json
import sqlite3
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from scans import (
    COLORS,
    FRAMES,
    GL,
    INTERVAL_S,
    LEANING,
    START_S,
    Y_UP,
    Z_UP,
    Sample,
    camera,
    look,
    map_pose,
    quaternion,
    row,
    rows,
    steps,
    write_depth,
    write_image,
    write_reference,
)

from simaps_viz.geometry import invert_pose
from simaps_viz.structures import Intrinsics

T_BASE_CAMERA = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0.0], [0, -1, 0, 0.9], [0, 0, 0, 1.0]])


def rtabmap_calibration(k: Intrinsics, *, kind: int = 0, cameras: int = 1) -> bytes:
    """Pack as CameraModel::serialize does; distortion is stored, though the pictures are rectified."""
    P = np.hstack([k.matrix(), np.zeros((3, 1))])
    one = struct.pack("<11i", 0, 21, 1, kind, k.width, k.height, 9, 5, 9, 12, 12)
    for values in (k.matrix() * 1.1, [-0.05, 0.06, 0, 0, -0.02], np.eye(3), P):
        one += np.asarray(values, "<f8").tobytes()
    return (one + T_BASE_CAMERA[:3].astype("<f4").tobytes()) * cameras


def zipped(values: np.ndarray, kind: int) -> bytes:
    """Pack numbers as rtabmap::compressData2 does: zlib, then rows, columns and OpenCV's type."""
    return zlib.compress(values.tobytes()) + struct.pack("<3i", 1, values.size, kind)


def rtabmap(folder: Path, *, optimised: bool = True) -> Sample:
    """The graph was optimised, which moved all poses by half a metre; one node is in another session's map."""
    k, path = camera(), folder / "rtabmap.db"
    folder.mkdir(parents=True, exist_ok=True)
    drift = np.eye(4)
    drift[0, 3] = 0.5 if optimised else 0.0
    bases = [Z_UP.pose(i) @ invert_pose(T_BASE_CAMERA) for i in (*range(FRAMES), 0)]
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE Node (id INTEGER, map_id INTEGER, weight INTEGER, stamp FLOAT, pose BLOB)")
        database.execute("CREATE TABLE Data (id INTEGER, image BLOB, depth BLOB, calibration BLOB)")
        columns = "version TEXT, opt_ids BLOB, opt_poses BLOB" if optimised else "version TEXT"
        database.execute(f"CREATE TABLE Admin ({columns})")
        for i in range(FRAMES + optimised):
            depth_m, ids = look(k, map_pose(i if i < FRAMES else 0))
            color = cv2.imencode(".png", np.ascontiguousarray(COLORS[ids][..., ::-1]))[1].tobytes()
            depth = cv2.imencode(".png", steps(depth_m))[1].tobytes()
            if i == 1:  # floats, in the four bytes of a pixel, as rtabmap::compressImage has them
                metres = (steps(depth_m) * np.float32(0.001)).astype("<f4")
                depth = cv2.imencode(".png", metres.view(np.uint8).reshape(*metres.shape, 4))[1].tobytes()
            stored = (drift @ bases[i])[:3].astype("<f4").tobytes()
            database.execute("INSERT INTO Node VALUES (?, 0, 0, ?, ?)", (i + 1, START_S + i, stored))
            database.execute("INSERT INTO Data VALUES (?, ?, ?, ?)", (i + 1, color, depth, rtabmap_calibration(k)))
        database.execute("INSERT INTO Node VALUES (99, 0, -1, ?, ?)", (START_S, bytes(48)))  # without pictures
        database.execute("INSERT INTO Data VALUES (99, NULL, NULL, NULL)")
        if optimised:
            ids = np.arange(1, FRAMES + 1, dtype="<i4")
            poses = np.stack([T[:3] for T in bases[:FRAMES]]).astype("<f4")
            database.execute("INSERT INTO Admin VALUES ('0.21.1', ?, ?)", (zipped(ids, 4), zipped(poses, 5)))
    database.close()

    def pose(index: float) -> np.ndarray:
        base = bases[int(index)].astype(np.float32).astype(np.float64)
        return base @ T_BASE_CAMERA.astype(np.float32).astype(np.float64)

    return Sample(path, write_reference(folder / "reference", k, Z_UP, pose=pose))


def stray_scanner(folder: Path) -> Sample:
    """Colour is a video three times as large; one pose more than pictures; columns of later versions, two empty."""
    k = camera()
    large = Intrinsics(192, 144, k.fx * 3, k.fy * 3, k.cx * 3 + 1, k.cy * 3 + 1)
    path = folder / "71de12f9"
    (path / "depth").mkdir(parents=True)
    video = cv2.VideoWriter(str(path / "rgb.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 60, (large.width, large.height))
    lines = [
        [
            "timestamp",
            " frame",
            " x",
            " y",
            " z",
            " qx",
            " qy",
            " qz",
            " qw",
            " fx",
            " fy",
            " cx",
            " cy",
            " distortion_center_x",
            " distortion_center_y",
        ]
    ]
    for i in range(FRAMES + 1):
        T = Y_UP.pose(i)
        numbers = [*T[:3, 3], *quaternion(T), large.fx, large.fy, large.cx, large.cy]
        lines.append([f"{START_S + i * INTERVAL_S}", f" {i:06d}", *(f" {float(x)!r}" for x in numbers), " ", " "])
        if i < FRAMES:
            write_depth(path / f"depth/{i:06d}.png", steps(look(k, map_pose(i))[0]))
            video.write(np.ascontiguousarray(COLORS[look(large, map_pose(i))[1]][..., ::-1]))
    video.release()
    with (path / "odometry.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)
    last = large.matrix() * [[1.1], [1.1], [1.0]]  # of the last picture only
    (path / "camera_matrix.csv").write_text("\n".join(", ".join(map(repr, map(float, r))) for r in last))
    return Sample(path, write_reference(folder / "reference", k, Y_UP), exact_color=False, lossless=False)


def slam_folder(folder: Path) -> Sample:
    """Colour 4 ms after depth and first in a line; the tracker stamps poses with colour's time, and lost the second."""
    k, path = camera(), folder / "office"
    listed, poses = [], []
    for i in range(FRAMES + 1):
        index = i - (i > 1)
        depth_m, ids = look(k, map_pose(index))
        depth_s, color_s = START_S + i, START_S + i + 0.004
        write_image(path / f"rgb/{color_s:.6f}.png", COLORS[ids])
        write_depth(path / f"depth/{depth_s:.6f}.png", steps(depth_m))
        listed.append(f"{color_s:.6f} rgb/{color_s:.6f}.png {depth_s:.6f} depth/{depth_s:.6f}.png")
        T = LEANING.pose(index)
        if i != 1:
            poses.append(f"{color_s:.7f} {row(T[:3, 3])} {row(np.array(quaternion(T)))}")
    (path / "associations.txt").write_text("\n".join(listed))
    (path / "CameraTrajectory.txt").write_text("\n".join(poses))
    settings = f"""%YAML:1.0
Camera.type: "PinHole"
Camera.fx: {k.fx!r}
Camera.fy: {k.fy!r}
Camera.cx: {k.cx!r}
Camera.cy: {k.cy!r}
Camera.k1: 0.0
Camera.width: {k.width}
Camera.height: {k.height}
DepthMapFactor: 1000.0 # RealSense
"""
    (path / "office.yaml").write_text(settings)
    return Sample(path, write_reference(folder / "reference", k, LEANING))


def pose_lines(folder: Path) -> Sample:
    """As slambook's examples: pictures from number 1, depth as PGM, a pose.txt without times; and their camera."""
    k, path = camera(), folder / "joinMap"
    (path / "depth").mkdir(parents=True)
    lines = []
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        write_image(path / f"color/{i + 1}.png", COLORS[ids])
        cv2.imwrite(str(path / f"depth/{i + 1}.pgm"), steps(depth_m))
        T = LEANING.pose(i)
        lines.append(f"{row(T[:3, 3])} {row(np.array(quaternion(T)))}")
    (path / "pose.txt").write_text("\n".join(lines))
    (path / "intrinsics.txt").write_text(rows(k.matrix()))
    return Sample(path, write_reference(folder / "reference", k, LEANING))


def matrix_lines(folder: Path) -> Sample:
    """As DeepVideoMVS's sample of a HoloLens: pictures from number 3, a poses.txt of matrices, the camera in K.txt."""
    k, path = camera(), folder / "hololens"
    (path / "depth").mkdir(parents=True)
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        write_image(path / f"images/{i + 3:05d}.png", COLORS[ids])
        cv2.imwrite(str(path / f"depth/{i + 3:05d}.png"), steps(depth_m))
    (path / "poses.txt").write_text("\n".join(row(LEANING.pose(i).ravel()) for i in range(FRAMES)))
    (path / "K.txt").write_text(rows(k.matrix()))
    return Sample(path, write_reference(folder / "reference", k, LEANING))


def redwood(folder: Path) -> Sample:
    """As Open3D's reconstruction system leaves it; the second pose was not found."""
    k, path = camera(), folder / "bedroom"
    lines = []
    for i in range(FRAMES + 1):
        index = i - (i > 1)
        depth_m, ids = look(k, map_pose(index))
        write_image(path / f"color/{i:06d}.png", COLORS[ids])
        write_depth(path / f"depth/{i:06d}.png", steps(depth_m))
        if i != 1:
            lines.append(f"{i} {i} {i + 1}\n{rows(LEANING.pose(index))}")
    (path / "scene").mkdir()
    (path / "scene/trajectory.log").write_text("".join(lines))
    intrinsic = {"width": k.width, "height": k.height, "intrinsic_matrix": k.matrix().T.ravel().tolist(),
                 "depth_scale": 1000.0}  # fmt: skip
    (path / "intrinsic.json").write_text(json.dumps(intrinsic))
    return Sample(path, write_reference(folder / "reference", k, LEANING))


def instant_ngp(folder: Path) -> Sample:
    """Depth in steps of 10 m / 65535, as nerfcapture2nerf.py writes it; names without a suffix, one without depth."""
    k, path = camera(), folder / "capture"
    unit_m = 10.0 / 65535
    frames = []
    for i in range(FRAMES + 1):
        depth_m, ids = look(k, map_pose(i))
        write_image(path / f"images/{i}.png", COLORS[ids])
        write_depth(path / f"images/{i}.depth.png", steps(depth_m, unit_m))
        own = {"fl_x": k.fx, "fl_y": k.fy, "cx": k.cx + 0.5, "cy": k.cy + 0.5, "w": k.width, "h": k.height}
        depth = {"depth_path": f"images/{i}.depth.png"} if i < FRAMES else {}
        frames.append({"file_path": f"images/{i}", "transform_matrix": (LEANING.pose(i) @ GL).tolist()} | own | depth)
    shared = {"fl_x": 1.0, "fl_y": 1.0, "cx": 320, "cy": 240, "w": 0, "h": 0, "integer_depth_scale": unit_m}
    (path / "transforms.json").write_text(json.dumps(shared | {"frames": frames}))
    return Sample(path, write_reference(folder / "reference", k, LEANING, unit_m=unit_m))


def colmap(folder: Path, *, text: bool = False, unit_m: float = 0.5) -> Sample:
    """COLMAP's unit is half a metre; depth sees its points; colour is twice as large, one picture without depth."""
    k, path = camera(), folder / "room"
    large = Intrinsics(128, 96, k.fx * 2, k.fy * 2, k.cx * 2 + 0.5, k.cy * 2 + 0.5)
    (path / "sparse/0").mkdir(parents=True)
    rng = np.random.default_rng(0)
    points, pictures = [], []
    for i in range(FRAMES + 1):
        depth_m, _ = look(k, map_pose(i))
        write_image(path / f"images/IMG_{i}.png", COLORS[look(large, map_pose(i))[1]])
        if i < FRAMES:
            write_depth(path / f"depth/IMG_{i}.png", steps(depth_m))
        stored_m = steps(depth_m) * np.float32(0.001)  # as the sensor has it, so that the scale is exact
        v, u = np.nonzero(depth_m)
        chosen = rng.choice(len(v), 60, replace=False)
        rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(len(u))], axis=1)[chosen]
        T = LEANING.pose(i)
        at = (rays * stored_m[v, u][chosen, None]) @ T[:3, :3].T + T[:3, 3]
        first = len(points)
        points += list(at / unit_m)
        pixels = np.stack([u, v], axis=1)[chosen] * 2.0 + 1.0
        pictures.append((f"IMG_{i}.png", invert_pose(T), pixels, np.arange(first, first + 60) + 1))
    values = (large.fx, large.fy, large.cx + 0.5, large.cy + 0.5)
    write = _colmap_text if text else _colmap_binary
    write(path / "sparse/0", large, values, pictures[::-1], points, unit_m)
    reference = write_reference(folder / "reference", k, LEANING)
    return Sample(path, reference, exact_color=False)


def _colmap_binary(folder: Path, k: Intrinsics, values, pictures, points, unit_m: float) -> None:
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 7, 1, k.width, k.height, *values))
    data = struct.pack("<Q", len(pictures))
    for number, (name, T, pixels, ids) in enumerate(pictures):
        x, y, z, w = quaternion(T)
        data += struct.pack("<i7di", number, w, x, y, z, *(T[:3, 3] / unit_m), 7) + name.encode() + b"\0"
        data += struct.pack("<Q", len(ids) + 1) + struct.pack("<ddq", 1.0, 1.0, -1)
        data += b"".join(struct.pack("<ddq", *pixel, i) for pixel, i in zip(pixels, ids, strict=True))
    (folder / "images.bin").write_bytes(data)
    data = struct.pack("<Q", len(points))
    for number, point in enumerate(points, 1):
        data += struct.pack("<Q3d3BdQ", number, *point, 9, 9, 9, 0.5, 2) + struct.pack("<4i", 1, 2, 3, 4)
    (folder / "points3D.bin").write_bytes(data)


def _colmap_text(folder: Path, k: Intrinsics, values, pictures, points, unit_m: float) -> None:
    head = "# Camera list with one line of data per camera:\n"
    (folder / "cameras.txt").write_text(f"{head}7 PINHOLE {k.width} {k.height} {row(np.array(values))}\n")
    lines = ["# Image list with two lines of data per image:"]
    for number, (name, T, pixels, ids) in enumerate(pictures):
        x, y, z, w = quaternion(T)
        lines.append(f"{number} {row(np.array([w, x, y, z]))} {row(T[:3, 3] / unit_m)} 7 {name}")
        seen = " ".join(f"{row(pixel)} {i}" for pixel, i in zip(pixels, ids, strict=True))
        lines.append("" if name == "IMG_1.png" else seen)  # a picture whose points were lost has an empty line
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    lines = [f"{i} {row(point)} 9 9 9 0.5 1 2" for i, point in enumerate(points, 1)]
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n")
