"""Writers of the formats that are folders of images."""

import json
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scans import (
    COLORS,
    FRAMES,
    GL,
    INTERVAL_S,
    LABELS,
    LEANING,
    START_S,
    Y_UP,
    Z_UP,
    Sample,
    World,
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


def tum(folder: Path) -> Sample:
    """Depth lies 4 ms behind colour, poses every 20 ms in between; the first depth image has no colour."""
    k = Intrinsics(640, 480, 535.4, 539.2, 320.1, 247.6)
    path = folder / "rgbd_dataset_freiburg3_seats"
    rgb_list, depth_list = ["# color images"], ["# depth maps", f"{START_S - 1:.4f} depth/early.png"]
    write_depth(path / "depth/early.png", np.ones((480, 640), np.uint16))
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        depth_s, color_s = START_S + i * INTERVAL_S, START_S + i * INTERVAL_S - 0.004
        write_image(path / f"rgb/{color_s:.6f}.png", COLORS[ids])
        write_depth(path / f"depth/{depth_s:.6f}.png", steps(depth_m, 0.001) * 5)  # 5000 steps a metre
        rgb_list.append(f"{color_s:.6f} rgb/{color_s:.6f}.png")
        depth_list.append(f"{depth_s:.6f} depth/{depth_s:.6f}.png")
    poses = ["# ground truth trajectory", "# timestamp tx ty tz qx qy qz qw"]
    for tick in range(-5, 5 * FRAMES + 1):
        T = Z_UP.pose(tick / 5)
        poses.append(f"{START_S + tick * INTERVAL_S / 5:.4f} {row(T[:3, 3])} {row(np.array(quaternion(T)))}")
    for name, lines in (("rgb", rgb_list), ("depth", depth_list), ("groundtruth", poses)):
        (path / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return Sample(path, write_reference(folder / "reference", k, Z_UP))


def bundle_fusion(folder: Path) -> Sample:
    """As BundleFusion, 12-Scenes and 3RScan have it: JPEG, larger than depth, cameras in info.txt; one pose lost."""
    k = camera()
    large = Intrinsics(128, 96, k.fx * 2, k.fy * 2, k.cx * 2 + 0.5, k.cy * 2 + 0.5)
    path = folder / "office" / "data"
    for i in range(FRAMES + 1):
        index = min(i, FRAMES - 1)
        depth_m, small = look(k, map_pose(index))
        write_depth(path / f"frame-{i:06d}.depth.png", steps(depth_m))
        write_image(path / f"frame-{i:06d}.color.jpg", COLORS[small.repeat(2, axis=0).repeat(2, axis=1)])
        lost = "-1.#INF -1.#INF -1.#INF -1.#INF\r\n" * 4
        (path / f"frame-{i:06d}.pose.txt").write_text(lost if i == FRAMES else rows(LEANING.pose(i)).replace(" ", ","))
    lines = [
        "m_versionNumber = 4",
        "m_sensorName = StructureSensor",
        "m_depthShift = 1000",
        f"m_frames.size = {FRAMES}",
    ]
    for which, c in (("Color", large), ("Depth", k)):
        K, name = np.eye(4), which.lower()
        K[:3, :3] = c.matrix()
        lines += [f"m_{name}Width = {c.width}", f"m_{name}Height = {c.height}",
                  f"m_calibration{which}Intrinsic = {row(K)} "]  # fmt: skip
    (folder / "office" / "info.txt").write_text("\r\n".join(lines))
    return Sample(path, write_reference(folder / "reference", k, LEANING), exact_color=False, lossless=False)


def sun3d(folder: Path) -> Sample:
    """As SUN3D has it: depth's bits rotated, 4 ms after the picture; the second depth image was dropped."""
    k, path, poses = camera(), folder / "harvard" / "lounge", []
    for i in range(FRAMES + 1):
        index = i - (i > 1)
        depth_m, ids = look(k, map_pose(index))
        write_image(path / f"image/{i + 1:07d}-{33_000 * i:012d}.jpg", COLORS[ids])
        if i != 1:
            stored = steps(depth_m)
            write_depth(path / f"depth/{i + 1:07d}-{33_000 * i + 4_000:012d}.png", stored << 3 | stored >> 13)
        poses += [row(line) for line in LEANING.pose(index)[:3]]
    (path / "extrinsics").mkdir()
    (path / "extrinsics/20130512130736.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n")
    (path / "extrinsics/20140808220511.txt").write_text("\n".join(poses))
    (path / "intrinsics.txt").write_text(rows(k.matrix()))
    return Sample(path, write_reference(folder / "reference", k, LEANING), exact_color=False)


def seven_scenes(folder: Path) -> Sample:
    """A Kinect's two cameras 25 mm apart; poses are the depth camera's. The reference is seen by the colour camera."""
    depth_camera = Intrinsics(640, 480, 585.0, 585.0, 320.0, 240.0)
    color_camera = Intrinsics(640, 480, 525.0, 525.0, 320.0, 240.0)
    T_color_depth = np.eye(4)
    T_color_depth[0, 3] = -0.025
    path = folder / "chess" / "seq-01"
    for i in range(FRAMES):
        raw = steps(look(depth_camera, map_pose(i) @ T_color_depth)[0])
        raw[raw == 0] = 65535
        write_depth(path / f"frame-{i:06d}.depth.png", raw)
        write_image(path / f"frame-{i:06d}.color.png", COLORS[look(color_camera, map_pose(i))[1]])
        (path / f"frame-{i:06d}.pose.txt").write_text(rows(LEANING.pose(i) @ T_color_depth))
    return Sample(path, write_reference(folder / "reference", color_camera, LEANING), exact_color=False)


def amazon(folder: Path) -> Sample:
    """As apc-vision-toolbox has it: camera and poses in one cam.info.txt, the matrices below their titles."""
    k, path = camera(), folder / "scene-0000"
    titled = ["# Objects: []", "# Color camera intrinsic matrix", rows(k.matrix()), "",
              "# Depth-to-color camera extrinsic matrix", rows(np.eye(4)), ""]  # fmt: skip
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        write_depth(path / f"frame-{i:06d}.depth.png", steps(depth_m))
        write_image(path / f"frame-{i:06d}.color.png", COLORS[ids])
        titled += [f"# Camera-to-world extrinsic matrix (camera pose) for frame-{i:06d}", rows(Z_UP.pose(i)), ""]
    (path / "cam.info.txt").write_text("\n".join(titled))
    return Sample(path, write_reference(folder / "reference", k, Z_UP))


def scannet(folder: Path) -> Sample:
    """Colour is twice as large; in the second frame tracking was lost."""
    k = camera()
    large = Intrinsics(128, 96, k.fx * 2, k.fy * 2, k.cx * 2 + 0.5, k.cy * 2 + 0.5)
    path = folder / "scene0000_00"
    tracked = [0, 2, 3, 10]  # 10 after 9 is no alphabet's order
    for i in (*tracked, 1):
        index = 1 if i == 10 else i
        depth_m, small = look(k, map_pose(index))
        ids = small.repeat(2, axis=0).repeat(2, axis=1)
        write_depth(path / f"depth/{i}.png", steps(depth_m))
        write_image(path / f"color/{i}.jpg", COLORS[ids])
        write_depth(path / f"instance-filt/{i}.png", ids.astype(np.uint8))
        (path / "pose").mkdir(exist_ok=True)
        (path / f"pose/{i}.txt").write_text(rows(Z_UP.pose(index)) if i != 1 else "-inf -inf -inf -inf\n" * 4)
    (path / "intrinsic").mkdir()
    for name, c in (("depth", k), ("color", large)):
        K = np.eye(4)
        K[:3, :3] = c.matrix()
        (path / f"intrinsic/intrinsic_{name}.txt").write_text(rows(K))
        (path / f"intrinsic/extrinsic_{name}.txt").write_text(rows(np.eye(4)))
    groups = [{"id": i - 1, "objectId": i - 1, "segments": [1], "label": label} for i, label in LABELS.items()]
    (path / "scene0000_00.aggregation.json").write_text(json.dumps({"sceneId": "x", "segGroups": groups}))
    reference = write_reference(folder / "reference", k, Z_UP, indices=(0, 2, 3, 1))
    return Sample(path, reference, exact_color=False, lossless=False)


def replica(folder: Path) -> Sample:
    k, path = camera(), folder / "Replica" / "room0"
    scale = 6553.5
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        write_image(path / f"results/frame{i:06d}.jpg", COLORS[ids])
        write_depth(path / f"results/depth{i:06d}.png", steps(depth_m, 1 / scale))
    (path / "traj.txt").write_text("\n".join(row(Z_UP.pose(i)) for i in range(FRAMES)) + "\n")
    values = {"w": k.width, "h": k.height, "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "scale": scale}
    (folder / "Replica" / "cam_params.json").write_text(json.dumps({"camera": values}))
    reference = write_reference(folder / "reference", k, Z_UP, unit_m=1 / scale)
    return Sample(path, reference, lossless=False)


def nerfstudio(folder: Path) -> Sample:
    k, path = camera(), folder / "capture"
    frames = []
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        write_image(path / f"images/frame_{i:05d}.png", COLORS[ids])
        write_depth(path / f"depths/frame_{i:05d}.png", steps(depth_m))
        frames.append(
            {
                "file_path": f"images/frame_{i:05d}.png",
                "depth_file_path": f"depths/frame_{i:05d}.png",
                "transform_matrix": (LEANING.pose(i) @ GL).tolist(),
            }
        )
    shared = {"camera_model": "OPENCV", "w": k.width, "h": k.height, "fl_x": k.fx, "fl_y": k.fy,
              "cx": k.cx + 0.5, "cy": k.cy + 0.5, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}  # fmt: skip
    (path / "transforms.json").write_text(json.dumps(shared | {"frames": frames[::-1]}))
    return Sample(path, write_reference(folder / "reference", k, LEANING))


def habitat(folder: Path, *, objects: bool = True) -> Sample:
    k = Intrinsics(64, 48, 32.0, 32.0, 31.5, 23.5)
    path = folder / "5LpN3gDmAk7_1"
    for name in ("rgb", "depth", "semantic"):
        (path / name).mkdir(parents=True)
    lines = []
    T_base_camera = GL.copy()
    T_base_camera[1, 3] = 1.5
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        write_image(path / f"rgb/{i:06d}.png", COLORS[ids])
        np.save(path / f"depth/{i:06d}.npy", steps(depth_m).astype(np.float32) * np.float32(0.001))
        classes = np.array([0, 3, 3, 2])[ids]  # Matterport3D's chair and floor
        np.save(path / f"semantic/{i:06d}.npy", ids if objects else classes)
        T_world_base = Y_UP.pose(i) @ invert_pose(T_base_camera)
        lines.append("\t".join(repr(float(x)) for x in [*T_world_base[:3, 3], *quaternion(T_world_base)]))
    (path / "poses.txt").write_text("\n".join(lines))
    if objects:
        text = "".join(f"{i}:{3 if label == 'chair' else 2},{label}\n" for i, label in LABELS.items())
        (path / "obj2cls_dict.txt").write_text("0:0,void\n" + text)
    return Sample(path, write_reference(folder / "reference", k, Y_UP))


def habitat_classes(folder: Path) -> Sample:
    return habitat(folder, objects=False)


def arkit(folder: Path) -> Sample:
    """Ten poses a second, two of them a frame; the first camera file is a millisecond early, as some are."""
    k, path = camera(), folder / "41069021" / "41069021_frames"
    lines = []
    for i in range(FRAMES):
        depth_m, ids = look(k, map_pose(i))
        stem = f"41069021_{START_S + i * INTERVAL_S:.3f}"
        write_image(path / f"lowres_wide/{stem}.png", COLORS[ids])
        write_depth(path / f"lowres_depth/{stem}.png", steps(depth_m))
        early = f"41069021_{START_S + i * INTERVAL_S - (0.001 if i == 0 else 0):.3f}"
        (path / "lowres_wide_intrinsics").mkdir(exist_ok=True)
        (path / f"lowres_wide_intrinsics/{early}.pincam").write_text(
            f"{k.width} {k.height} {row(np.array([k.fx, k.fy, k.cx, k.cy]))}"
        )
    for tick in range(2 * FRAMES):
        T = invert_pose(Z_UP.pose(tick / 2))
        lines.append(f"{START_S + tick * INTERVAL_S / 2:.9f} {row(cv2.Rodrigues(T[:3, :3])[0])} {row(T[:3, 3])}")
    (path / "lowres_wide.traj").write_text("\n".join(lines) + "\n")
    return Sample(folder / "41069021", write_reference(folder / "reference", k, Z_UP))


def polycam(folder: Path) -> Sample:
    """Colour is four times as large; one picture has no depth."""
    k = camera()
    large = Intrinsics(256, 192, k.fx * 4, k.fy * 4, k.cx * 4 + 1.5, k.cy * 4 + 1.5)
    path = folder / "polycam" / "keyframes"
    for i in range(FRAMES + 1):
        stem = str(12345678901 + i)
        if i < FRAMES:
            write_depth(path / f"depth/{stem}.png", steps(look(k, map_pose(i))[0]))
        write_image(path / f"corrected_images/{stem}.jpg", COLORS[look(large, map_pose(i))[1]])
        for name, T in (("corrected_cameras", Y_UP.pose(i) @ GL), ("cameras", np.eye(4))):
            values = {f"t_{r}{c}": float(T[r, c]) for r in range(3) for c in range(4)}
            values |= {"fx": large.fx, "fy": large.fy, "cx": large.cx, "cy": large.cy,
                       "width": large.width, "height": large.height, "blur_score": 90.0}  # fmt: skip
            (path / name).mkdir(exist_ok=True)
            (path / f"{name}/{stem}.json").write_text(json.dumps(values))
    reference = write_reference(folder / "reference", k, Y_UP)
    return Sample(folder / "polycam", reference, exact_color=False, lossless=False)


def float32_pose(world: World, index: float) -> NDArray:
    """Return the pose as a file of 32-bit floats has it."""
    return world.pose(index).astype(np.float32).astype(np.float64)


def sens(folder: Path) -> Sample:
    """Colour is twice as large; in the third frame tracking was lost."""
    k = Intrinsics(64, 48, 58.0, 59.0, 32.5, 23.0)
    large = Intrinsics(128, 96, 116.0, 118.0, 65.5, 46.5)
    path = folder / "scene0001_00.sens"
    K = [np.eye(4, dtype="<f4") for _ in range(4)]
    K[0][:3, :3], K[2][:3, :3] = large.matrix(), k.matrix()
    data = struct.pack("<IQ", 4, 15) + b"StructureSensor" + b"".join(m.tobytes() for m in K)
    data += struct.pack("<iiIIIIfQ", 2, 1, large.width, large.height, k.width, k.height, 1000.0, FRAMES + 1)
    for i in (0, 1, None, 2, 3):
        T = np.full((4, 4), -np.inf) if i is None else Z_UP.pose(i)
        depth = zlib.compress(steps(look(k, map_pose(i or 0))[0]).astype("<u2").tobytes())
        best = [cv2.IMWRITE_JPEG_QUALITY, 100, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        color = cv2.imencode(".jpg", COLORS[look(large, map_pose(i or 0))[1]][..., ::-1].copy(), best)[1].tobytes()
        data += T.astype("<f4").tobytes() + struct.pack("<QQQQ", 7, 8, len(color), len(depth)) + color + depth
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    reference = write_reference(folder / "reference", k, Z_UP, pose=lambda index: float32_pose(Z_UP, index))
    return Sample(path, reference, exact_color=False, lossless=False)
