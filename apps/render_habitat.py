#!/usr/bin/env python3
"""Render a Matterport3D or HM3D scene along published poses, with exact ids, as a folder that simaps reads.

This file is all you need: copy it to where Habitat-Sim runs (Python 3.9, NumPy, Pillow). It is written to the published
interface of habitat_sim 0.2 and 0.3, and tested with a fake module of that interface only: it never ran in a real one.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

EPILOG = """\
poses, in Habitat's frame: metres, y up, cameras looking along -z
  7 numbers a line   x y z and a quaternion x y z w of the robot's base, as VLMaps' SCENE_N/poses.txt has them; the
                     camera looks level from --camera-height above it
  16 numbers a line  the camera's 4x4 matrix, as HOV-SG's hovsg/data/hm3dsem/metadata/poses/SCENE.txt has it
  a folder           one such file a frame (pose/*.txt)

examples, with the cameras of both projects (1080x720, 90 degrees, 1.5 m)
  python render_habitat.py mp3d/5LpN3gDmAk7/5LpN3gDmAk7.glb --poses 5LpN3gDmAk7_1/poses.txt --out 5LpN3gDmAk7
  python render_habitat.py hm3d/val/00843-DYehNKdT76V/DYehNKdT76V.basis.glb --poses poses/00843-DYehNKdT76V.txt
      --dataset-config hm3d/hm3d_annotated_basis.scene_dataset_config.json --levels -0.05 3.05 5.93 --out 00843
then, where simaps is installed
  simaps check 00843; simaps build 00843/level-1.json -o 00843-1.npz
  simaps evaluate 00843/level-1.json --errors none,light

written
  color/, depth/     JPEG; 16-bit PNG, millimetres, 0 = no surface
  ids/               16-bit PNG, Habitat's semantic id + 1, 0 = nothing annotated
  poses.txt, intrinsics.txt, sequence.json    posed-frames/1
  scene.json         objects, regions and levels, with their boxes in Habitat's frame
  level-N.json       the frames of one storey, where there are several: a map shows one storey
Stopped with Ctrl-C or killed, the same command resumes with the first frame that is missing.
"""
INSTALL = "conda create -n habitat python=3.9 habitat-sim headless -c conda-forge -c aihabitat"
NAMELESS = ("", "none", "unknown", "unlabeled", "undefined", "void")
"""Categories of what nobody annotated."""
MAX_ID = 65535
ON_LEVEL_M = 0.5
"""A robot this far below a level's floor, on its stairs, is already on it."""
HABITAT_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


class InputError(Exception):
    """What the user has to put right: names the file, what was expected and what was found."""


def read_poses(path: Path, camera_height_m: float) -> tuple[list[str], np.ndarray]:
    """Return the frames' names and ``T_world_camera`` float64 [n, 4, 4], cameras looking along -z as in Habitat."""
    files = sorted(path.glob("*.txt")) if path.is_dir() else [path]
    if not files:
        raise InputError(f"{path}: expected *.txt, one pose each, found none")
    names, poses = [], []
    for file in files:
        try:
            lines = [line for line in file.read_text().replace(",", " ").splitlines() if line.strip()]
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{file}: expected a text file of poses, found {error}") from error
        if path.is_dir() and len(lines) != 1:
            raise InputError(f"{file}: expected one line with a pose, found {len(lines)} lines")
        for number, line in enumerate(lines, 1):
            names.append(file.stem if path.is_dir() else f"{number - 1:06d}")
            poses.append(_pose(f"{file}, line {number}", line, camera_height_m))
    if not poses:
        raise InputError(f"{path}: expected a pose on each line, found no line")
    return names, np.array(poses)


def _pose(where: str, line: str, camera_height_m: float) -> np.ndarray:
    try:
        row = np.array([float(word) for word in line.split()])
    except ValueError as error:
        raise InputError(f"{where}: expected numbers, found {line[:60]!r}") from error
    if len(row) not in (7, 16) or not np.isfinite(row).all():
        expected = "7 (x y z, quaternion x y z w) or 16 (4x4) finite numbers"
        raise InputError(f"{where}: expected {expected}, found {len(row)}: {line[:60]!r}")
    pose = np.eye(4)
    if len(row) == 16:
        pose = row.reshape(4, 4)
    elif not 0.99 < np.linalg.norm(row[3:]) < 1.01:
        raise InputError(f"{where}: expected a quaternion of length 1, found {np.linalg.norm(row[3:]):.4g}")
    else:
        (x, y, z), w = row[3:6] / np.linalg.norm(row[3:]), row[6] / np.linalg.norm(row[3:])
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        pose[:3, :3] = np.eye(3) + 2 * w * cross + 2 * cross @ cross
        pose[:3, 3] = row[:3] + camera_height_m * pose[:3, 1]
    rotation = pose[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 0.01 or np.linalg.det(rotation) < 0 or pose[3, 3] != 1:
        raise InputError(f"{where}: expected a rotation and 0 0 0 1 in the matrix, found {pose.round(3).tolist()}")
    return pose


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return a rotation [3, 3] as a unit quaternion x y z w, float64 [4]."""
    # The eigenvector of the largest eigenvalue, well defined for all angles and for rounded matrices (Bar-Itzhack).
    k = np.zeros((4, 4))
    k[:3, :3] = rotation + rotation.T - np.trace(rotation) * np.eye(3)
    k[3, :3] = k[:3, 3] = [rotation[i - 1, i - 2] - rotation[i - 2, i - 1] for i in range(3)]
    k[3, 3] = np.trace(rotation)
    return np.linalg.eigh(k)[1][:, -1]


class Renderer:
    """A scene in Habitat-Sim with a camera that is put where a pose says."""

    def __init__(self, options: argparse.Namespace) -> None:
        try:
            habitat_sim = importlib.import_module("habitat_sim")
        except ImportError as error:
            raise InputError(f"expected to run where habitat_sim is installed, found {error}; {INSTALL}") from error
        self._module = habitat_sim
        config = habitat_sim.SimulatorConfiguration()
        config.scene_id = str(options.scene)
        config.gpu_device_id = options.gpu
        config.enable_physics = False
        if options.dataset_config:
            config.scene_dataset_config_file = str(options.dataset_config)
        agent = habitat_sim.agent.AgentConfiguration()
        kinds = habitat_sim.SensorType
        agent.sensor_specifications = [
            self._sensor(name, kind, options)
            for name, kind in (("color", kinds.COLOR), ("depth", kinds.DEPTH), ("ids", kinds.SEMANTIC))
        ]
        self.simulator = habitat_sim.Simulator(habitat_sim.Configuration(config, [agent]))
        self._agent = self.simulator.initialize_agent(0)

    def _sensor(self, name: str, kind: Any, options: argparse.Namespace) -> Any:
        spec = self._module.CameraSensorSpec()
        spec.uuid, spec.sensor_type = name, kind
        spec.sensor_subtype = self._module.SensorSubType.PINHOLE
        spec.resolution = [options.size[1], options.size[0]]
        spec.hfov = options.hfov
        spec.position = [0.0, 0.0, 0.0]  # the agent itself is put where the camera stands
        spec.orientation = [0.0, 0.0, 0.0]
        return spec

    def render(self, pose: np.ndarray) -> dict[str, np.ndarray]:
        """Return colour, depth in metres and semantic ids, as Habitat has them, seen from a camera pose."""
        state = self._module.AgentState()
        state.position, state.rotation = pose[:3, 3], quaternion(pose[:3, :3])
        self._agent.set_state(state)
        return self.simulator.get_sensor_observations()


Floors = list[tuple[float, str]]
"""Height of the floor, metres, and id of each level, ascending."""


def describe(scene: Any, floors: Floors) -> dict[str, Any]:
    """Return what scene.json says; objects lie on levels of ``floors`` where the scene itself has none."""

    def entry(thing: Any, region: Any) -> dict[str, Any]:
        # A box has center and sizes in older versions, and is a Range3D with center() and size() in later ones.
        box, found = thing.aabb, {}
        center = np.array(box.center() if callable(box.center) else box.center, float)
        half = np.array(box.size() if hasattr(box, "size") else box.sizes, float) / 2
        if np.isfinite([center, half]).all():
            found = {"aabb_min": (center - half).round(4).tolist(), "aabb_max": (center + half).round(4).tolist()}
        level = getattr(region, "level", None)
        if level is not None:
            return {"level": level.id, **found}
        return {"level": level_at(floors, center[1]), **found} if floors and found else found

    instances = []
    for thing in filter(None, scene.objects):
        name = "" if thing.category is None else thing.category.name().strip()
        if name.lower() not in NAMELESS:
            if thing.semantic_id >= MAX_ID:
                raise InputError(f"object {thing.id}: expected a semantic id under {MAX_ID}, found {thing.semantic_id}")
            region = None if thing.region is None else thing.region.id
            named = {"id": thing.semantic_id + 1, "label": name, "habitat_id": thing.id, "region": region}
            instances.append({**named, **entry(thing, thing.region)})
    if not instances:
        raise InputError(
            "expected a scene with annotated objects, found none: beside it have to lie Matterport3D's .house and "
            "_semantic.ply, or HM3D's .semantic.glb and .semantic.txt, which also needs --dataset-config "
            "hm3d_annotated_basis.scene_dataset_config.json"
        )
    named = [{"id": one.id, "label": "" if one.category is None else one.category.name()} for one in scene.regions]
    regions = [{**name, **entry(one, one)} for name, one in zip(named, scene.regions)]  # noqa: B905 - Python 3.9
    levels = [{"id": one.id, **entry(one, None)} for one in scene.levels]
    levels = levels or [{"id": number, "floor_height_m": height} for height, number in floors]
    return {"up": [0, 1, 0], "instances": instances, "regions": regions, "levels": levels}


def level_at(floors: Floors, height_m: float) -> str:
    """Return the highest level whose floor is no higher than this; the lowest one where all are; "" without any."""
    return ([number for _, number in floors[:1]] + [number for floor, number in floors if floor <= height_m] or [""])[
        -1
    ]


def save(path: Path, data: Any) -> None:
    """Write an image [H, W] or [H, W, 3], a text or JSON, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    if isinstance(data, np.ndarray):
        Image.fromarray(data).save(part, quality=95)
    else:
        part.write_text(data if isinstance(data, str) else json.dumps(data, indent=1) + "\n", encoding="utf-8")
    os.replace(part, path)


def render_all(options: argparse.Namespace, say: Callable[[str, bool], None]) -> int:
    """Render what is missing and write the manifests; returns the number of frames rendered."""
    names, poses = read_poses(options.poses, options.camera_height)
    for file in (options.scene, *([options.dataset_config] if options.dataset_config else [])):
        if not file.is_file():
            raise InputError(f"{file}: expected a file, found nothing")
    width, height = options.size
    settings = {
        "scene": options.scene.name, "width": width, "height": height, "hfov_deg": options.hfov,
        "poses": hashlib.sha256(poses.tobytes()).hexdigest()[:16],
    }  # fmt: skip
    record = options.out / "render.json"
    found = json.loads(record.read_text()) if record.is_file() else settings
    if found != settings:
        raise InputError(f"{record}: expected a folder of these settings, {settings}, found {found}; use another --out")
    renderer = Renderer(options)
    try:
        floors = [(height, str(i)) for i, height in enumerate(sorted(options.levels)[:-1])]  # the last is the top
        scene = describe(renderer.simulator.semantic_scene, floors)
        floors = sorted((one["aabb_min"][1], one["id"]) for one in scene["levels"] if "aabb_min" in one) or floors
        save(record, settings)
        save(options.out / "scene.json", scene)
        known = np.zeros(max(one["id"] for one in scene["instances"]) + 1, np.uint16)
        known[[one["id"] - 1 for one in scene["instances"]]] = [one["id"] for one in scene["instances"]]
        rendered = _render_missing(renderer, names, poses, known, options.out, say)
    finally:
        renderer.simulator.close()
    fx = width / 2 / np.tan(np.radians(options.hfov) / 2)
    K = [[fx, 0, (width - 1) / 2], [0, fx, (height - 1) / 2], [0, 0, 1]]
    save(options.out / "intrinsics.txt", "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in K))
    _manifests(options, names, poses, floors, say)
    return rendered


def _render_missing(
    renderer: Renderer,
    names: list[str],
    poses: np.ndarray,
    known: np.ndarray,
    out: Path,
    say: Callable[[str, bool], None],
) -> int:
    """Render the frames of which a picture is missing; colour, written last, marks a complete frame."""
    missing = [i for i, name in enumerate(names) if not (out / "color" / f"{name}.jpg").is_file()]
    named, began = 0, time.monotonic()
    for done, i in enumerate(missing, 1):
        seen = renderer.render(poses[i])
        depth_mm = np.rint(np.nan_to_num(seen["depth"], nan=0, posinf=0) * 1000.0)
        depth_mm[(depth_mm < 0) | (depth_mm > 65535)] = 0
        semantic = np.asarray(seen["ids"]).astype(np.int64)
        ids = np.where((semantic >= 0) & (semantic < len(known)), known[np.clip(semantic, 0, len(known) - 1)], 0)
        ids[depth_mm == 0] = 0  # no surface there, though Habitat says 0, which can be an object
        named += np.count_nonzero(ids)
        save(out / "depth" / f"{names[i]}.png", depth_mm.astype(np.uint16))
        save(out / "ids" / f"{names[i]}.png", ids.astype(np.uint16))
        save(out / "color" / f"{names[i]}.jpg", np.ascontiguousarray(seen["color"][..., :3]))
        rate = done / max(time.monotonic() - began, 1e-9)
        frames = f"{len(names) - len(missing) + done} of {len(names)} frames"
        say(f"{frames}, {rate:.1f} a second, {(len(missing) - done) / rate:.0f} s left", done == len(missing))
    if missing and not named:
        raise InputError("expected pictures that show annotated objects, found none in any frame: is this scene's "
                         "semantic mesh beside it, and are the poses this scene's?")  # fmt: skip
    return len(missing)


def _manifests(
    options: argparse.Namespace,
    names: list[str],
    poses: np.ndarray,
    floors: Floors,
    say: Callable[[str, bool], None],
) -> None:
    """Write poses and manifest of all frames, and of the frames of each level where they stand on several."""
    base_m = poses[:, 1, 3] - options.camera_height
    on = np.array([level_at(floors, height + ON_LEVEL_M) for height in base_m])
    several = sorted(set(on)) if len(set(on)) > 1 else []
    if np.ptp(base_m) > ON_LEVEL_M and not floors:
        say(f"the robot stands at heights from {base_m.min():.2f} to {base_m.max():.2f} m; a map shows one storey, and "
            "--levels says where they end", True)  # fmt: skip
    for name, kept in [("sequence", np.full(len(names), True)), *((f"level-{i}", on == i) for i in several)]:
        rows = (
            f"{names[i]} " + " ".join(f"{v:.9g}" for v in (poses[i] @ HABITAT_FROM_OPENCV).ravel()) + "\n"
            for i in np.flatnonzero(kept)
        )
        listed = "poses.txt" if name == "sequence" else f"poses-{name}.txt"
        save(options.out / listed, "".join(rows))
        save(options.out / f"{name}.json", {
            "name": options.out.resolve().name + (f", {name}" if name != "sequence" else ""),
            "format": "posed-frames/1", "color": "color/{frame}.jpg", "depth": "depth/{frame}.png",
            "depth_unit_m": 0.001, "intrinsics": "intrinsics.txt", "poses": listed, "up": [0, 1, 0],
            "description": f"{options.scene.name} rendered by Habitat-Sim", "simulated": True,
            "segmentation": {"ids": "ids/{frame}.png", "instances": "scene.json", "source": "Habitat-Sim"},
        })  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(
        description=__doc__, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("scene", type=Path, help="the scene's .glb (Matterport3D) or .basis.glb (HM3D)")
    made.add_argument("--poses", type=Path, required=True, help="a file of poses, or a folder with one file a frame")
    made.add_argument("--out", type=Path, required=True, help="the folder to write")
    made.add_argument("--dataset-config", type=Path, help="scene_dataset_config.json; HM3D's objects need it")
    made.add_argument("--size", type=int, nargs=2, default=(1080, 720), metavar=("W", "H"), help="pixels (1080 720)")
    made.add_argument("--hfov", type=float, default=90.0, help="horizontal field of view, degrees (default 90)")
    made.add_argument("--camera-height", type=float, default=1.5, help="camera over the base, metres (default 1.5)")
    made.add_argument("--levels", type=float, nargs="+", default=[], help="HM3D, whose scenes name none: heights where "
                      "storeys begin, and the top of the last, as in HOV-SG's Per_Scene_Floor_Sep.csv")  # fmt: skip
    made.add_argument("--gpu", type=int, default=0, help="number of the GPU (default 0)")
    return made


def main(words: list[str] | None = None) -> int:
    """Render as asked for; the exit status is 0, 2 for what has to be put right, 130 after Ctrl-C."""
    options = parser().parse_args(words)

    def say(text: str, end: bool) -> None:
        if end or sys.stderr.isatty():
            print(f"\r{text:<78}", end="\n" if end else "", file=sys.stderr, flush=True)

    try:
        rendered = render_all(options, say)
    except InputError as error:
        print(f"render_habitat: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"render_habitat: {error.filename}: could not be written: {error.strerror}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nrender_habitat: stopped; the same command resumes", file=sys.stderr)
        return 130
    print(f"{rendered} frames rendered; next: simaps check {options.out}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
