"""The recordings, maps and networks that the documentation's commands name, small enough to run all of them.

The embedded café stands in for every scan: 40 frames of 160 x 120 pixels show all its furniture. `simaps demo` renders
as little while a page's commands run.
"""

from pathlib import Path

import cv2
import numpy as np
from scans import quaternion, row, rows, write_depth, write_image
from tiny_embeddings import write_transformers
from tiny_networks import write_yolo

from simaps_viz import PosedFrames, build_map, open_sequence, save_map
from simaps_viz.datasets.convert import write_posed_frames
from simaps_viz.geometry import invert_pose
from simaps_viz.scenes.demo import DemoSettings, ensure_demo

SMALL = DemoSettings(frames=40, width=160, height=120)
STEPS_PER_M = 5000
"""Of depth in TUM RGB-D."""


def write_world(folder: Path, cache: Path) -> Path:
    """Write what the commands read: recordings in ``scans/``, and ``here/``, where they are typed; returns that."""
    here = folder / "here"
    here.mkdir(parents=True)
    sequence = open_sequence(ensure_demo(cache_dir=cache, settings=SMALL))
    write_posed_frames(sequence, folder / "scans" / "breakroom")
    write_tum(sequence, folder / "scans" / "rgbd_dataset_freiburg3_long_office_household")
    write_seven_scenes(sequence, folder / "scans" / "office" / "seq-01")
    write_arkit(sequence, folder / "scans" / "ARKitScenes" / "raw" / "Training" / "47333462")
    simap = build_map(sequence)
    (here / "recordings").mkdir()
    for name in ("cafe.npz", "recordings/cafe-evidence.npz"):
        save_map(simap, here / name)
    write_yolo(here / "yolo11n-seg.onnx", [(4, 4, 28, 28, 0, 0.9)])
    write_transformers(here / "siglip-base-patch16-224", "siglip")
    return here


def write_tum(sequence: PosedFrames, folder: Path) -> None:
    """Write a sequence as a TUM RGB-D folder, ten frames a second."""
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for frame in map(sequence.read, range(len(sequence))):
        time = f"{frame.index / 10:.4f}"
        depth = np.round(frame.depth_m * STEPS_PER_M)
        write_depth(folder / f"depth/{time}.png", np.where(depth < 65535, depth, 0).astype(np.uint16))
        write_image(folder / f"rgb/{time}.png", sequence.color(frame.index))
        T = frame.T_world_camera
        lists["rgb"].append(f"{time} rgb/{time}.png")
        lists["depth"].append(f"{time} depth/{time}.png")
        lists["groundtruth"].append(f"{time} {row(T[:3, 3])} {row(np.array(quaternion(T)))}")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    (folder / "intrinsics.txt").write_text(rows(sequence.intrinsics.matrix()))


def write_seven_scenes(sequence: PosedFrames, folder: Path) -> None:
    """Write a sequence as a folder of 7-Scenes, with its camera beside it: its pictures are smaller than a Kinect's."""
    for frame in map(sequence.read, range(len(sequence))):
        stem = folder / f"frame-{frame.index:06d}"
        depth = np.round(frame.depth_m * 1000)
        write_depth(stem.with_suffix(".depth.png"), np.where(depth > 0, depth, 65535).astype(np.uint16))
        write_image(stem.with_suffix(".color.png"), sequence.color(frame.index))
        stem.with_suffix(".pose.txt").write_text(rows(frame.T_world_camera))
    (folder / "camera-intrinsics.txt").write_text(rows(sequence.intrinsics.matrix()))


def write_arkit(sequence: PosedFrames, folder: Path) -> None:
    """Write a sequence as a room of ARKitScenes, ten frames a second."""
    k, lines = sequence.intrinsics, []
    (folder / "lowres_wide_intrinsics").mkdir(parents=True)
    for frame in map(sequence.read, range(len(sequence))):
        time_s = 100 + frame.index / 10
        stem = f"{folder.name}_{time_s:.3f}"
        write_depth(folder / f"lowres_depth/{stem}.png", np.round(frame.depth_m * 1000).astype(np.uint16))
        write_image(folder / f"lowres_wide/{stem}.png", sequence.color(frame.index))
        camera = f"{k.width} {k.height} {row(np.array([k.fx, k.fy, k.cx, k.cy]))}"
        (folder / f"lowres_wide_intrinsics/{stem}.pincam").write_text(camera)
        T = invert_pose(frame.T_world_camera)
        lines.append(f"{time_s:.6f} {row(cv2.Rodrigues(T[:3, :3])[0])} {row(T[:3, 3])}")
    (folder / "lowres_wide.traj").write_text("\n".join(lines) + "\n")
