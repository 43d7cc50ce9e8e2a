"""How often `simaps check` is wrong: false alarms on clean recordings, and misses on copies with known faults.

Clean are windows of 40 frames, with strides from 1 to 10, and whole recordings with those strides, of the sequences in
../shared/data (left out where they are not there), of the embedded places, of simulated recordings (`walks.py`), and of
further recordings named on the command line. The faults are those that people make, each in a copy of the whole. Prints
the tables of docs/RELIABILITY.md.

    python apps/checks/false_alarms.py [--quick] [--only NAME] [RECORDING ...]
"""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1]))

from checks.walks import HANDS, recorded

from simaps_viz.checking.faults import DRIFT_GAP, FEWEST_REVISITS
from simaps_viz.checking.recording import (
    OPENGL,
    ROS,
    Recording,
    load_views,
    neighbour_pairs,
    open_recording,
    revisit_pairs,
)
from simaps_viz.checking.run import Diagnosis, diagnose
from simaps_viz.scenes.demo import ensure_demo
from simaps_viz.scenes.places import PLACES

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
CACHE = Path.home() / ".cache" / "simaps-checks"
WINDOW, STRIDES, STARTS = 40, range(1, 11), 2
"""Frames of a window, strides, and windows a stride."""


def part(recording: Recording, indices: NDArray) -> Recording:
    """Return a recording of some of the frames."""
    return replace(
        recording,
        names=tuple(recording.names[i] for i in indices),
        matrices=recording.matrices[indices],
        depth_steps=lambda i: recording.depth_steps(int(indices[i])),
        color=lambda i: recording.color(int(indices[i])),
        depth_file=lambda i: recording.depth_file(int(indices[i])),
    )


def clean_parts(recording: Recording, starts: int) -> Iterator[tuple[str, Recording]]:
    """Yield windows and the whole of a recording with every stride, and their names."""
    count = len(recording)
    for stride in STRIDES:
        room = count - WINDOW * stride
        if room >= 0:
            for start in sorted({int(s) for s in np.linspace(0, room, starts)}):
                yield f"window, stride {stride}, from {start}", part(recording, start + stride * np.arange(WINDOW))
        if count // stride >= WINDOW:
            yield f"whole, stride {stride}", part(recording, np.arange(0, count, stride))


def _turn(matrix: ArrayLike) -> NDArray:
    out = np.eye(4)
    out[:3, :3] = matrix
    return out


def _poses(change: Callable[[NDArray], NDArray]) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, matrices=change(r.matrices))


def _camera(*factors: float) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, camera=r.camera * np.array(factors))


def _unit(factor: float) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, unit_m=r.unit_m * factor)


def _shifted(by: int) -> Callable[[Recording], Recording]:
    def spoil(r: Recording) -> Recording:
        frames = np.arange(max(0, -by), len(r) - max(0, by))
        return replace(part(r, frames), matrices=r.matrices[frames + by])

    return spoil


def _dropped(r: Recording) -> Recording:
    at = len(r) // 3
    kept = np.delete(np.arange(len(r)), at)
    return replace(part(r, kept), matrices=r.matrices[:-1])


def _drifting(r: Recording) -> Recording:
    up = np.array(r.up if r.up is not None else (0, 0, 1), float)
    side = np.cross(up, [0.3, 0.5, 0.8])
    out = r.matrices.copy()
    for i, share in enumerate(np.linspace(0, 1, len(r))):
        out[i] = _turn(Rotation.from_rotvec(np.deg2rad(9) * share * up).as_matrix()) @ out[i]
        out[i, :3, 3] += 0.64 * share * side / np.linalg.norm(side)
    return replace(r, matrices=out)


def _tilted(r: Recording) -> Recording:
    up = np.array(r.up, float)
    side = np.cross(up, [0.3, 0.5, 0.8])
    tilted = up * np.cos(np.deg2rad(10)) + side / np.linalg.norm(side) * np.sin(np.deg2rad(10))
    return replace(r, up=tuple(tilted.tolist()))


def _moved_depth(r: Recording) -> Recording:
    by = round(0.055 * r.depth_size[0])
    return replace(r, depth_steps=lambda i: np.roll(r.depth_steps(i), by, axis=1))


FAULTS: dict[str, tuple[Callable[[Recording], Recording], set[str]]] = {
    "inverted": (_poses(np.linalg.inv), {"inverted_poses"}),
    "y and z flipped": (_poses(lambda T: T @ _turn(OPENGL)), {"camera_axes"}),
    "inverted, y and z flipped": (
        _poses(lambda T: np.linalg.inv(T @ _turn(OPENGL))), {"inverted_poses", "camera_axes"},
    ),
    "ROS axes": (_poses(lambda T: T @ _turn(np.transpose(ROS))), {"camera_axes"}),
    "y negated": (_poses(lambda T: T @ np.diag([1.0, -1, 1, 1])), {"camera_axes"}),
    "unit times 1000": (_unit(1000), {"depth_unit"}),
    "unit 1/5 of what it is": (_unit(0.2), {"depth_unit"}),
    "values divided by 10": (
        lambda r: replace(r, depth_steps=lambda i: r.depth_steps(i) // np.uint16(10)), {"depth_unit"},
    ),
    "focal length times 1.15": (_camera(1.15, 1.15, 1, 1), {"intrinsics"}),
    "principal point times 1.15": (_camera(1, 1, 1.15, 1.15), {"intrinsics"}),
    "matrix of a larger image": (_camera(2, 2, 2, 2), {"intrinsics"}),
    "shifted by one": (_shifted(1), {"frame_shift"}),
    "shifted by one, back": (_shifted(-1), {"frame_shift"}),
    "one dropped": (_dropped, {"dropped_frame"}),
    "mirrored world": (_poses(lambda T: _turn([[1, 0, 0], [0, 0, 1], [0, 1, 0]]) @ T), {"mirrored_world"}),
    "inverted, unit and focal length": (
        lambda r: _camera(1.15, 1.15, 1, 1)(_unit(1000)(_poses(np.linalg.inv)(r))),
        {"inverted_poses", "depth_unit", "intrinsics"},
    ),
    "gravity 10° off": (_tilted, {"gravity"}),
    "floor 0.3 m off": (lambda r: replace(r, floor_height_m=(r.floor_height_m or 0.0) + 0.3), {"floor_height"}),
    "depth moved by 5.5 % of the width": (_moved_depth, {"unregistered_depth"}),
    "poses in reverse": (_poses(lambda T: T[::-1].copy()), {"disagreement"}),
    "drift": (_drifting, {"drift"}),
}  # fmt: skip
"""What is done to a recording, and the kinds of errors that a right diagnosis has."""


def seen_again(recording: Recording) -> bool:
    """Return whether places are seen again late enough to show drift."""
    views = load_views(recording, np.unique(neighbour_pairs(recording.matrices)), lambda *_: None)
    return len(revisit_pairs(views, recording.matrices, round(DRIFT_GAP * len(recording)))) >= FEWEST_REVISITS


def errors(diagnosis: Diagnosis) -> set[str]:
    """Return the kinds of the errors found."""
    return {finding.kind for finding in diagnosis.findings if finding.severity == "error"}


def sources(more: Sequence[Path], only: str) -> Iterator[tuple[str, Recording]]:
    """Yield the recordings and their names."""
    paths = [("break room", SHARED / "hololens-breakroom"), ("house (rendered)", SHARED / "aws-small-house" / "rgbd")]
    paths = [(name, path) for name, path in paths if path.is_dir() and only in name]
    for place in PLACES:
        name = f"{PLACES[place].name} (simulated)"
        paths += [(name, ensure_demo(place, level="none"))] if only in name else []
    paths += [(path.name, path) for path in more]
    for name, path in paths:
        recording = open_recording(path)
        yield name, replace(recording, depth_steps=lru_cache(500)(recording.depth_steps))
    for hand in HANDS:
        if only in hand.name:
            yield f"{hand.name} (simulated)", recorded(hand, CACHE)


@dataclass(frozen=True)
class Checked:
    """How often `simaps check` is wrong."""

    recordings: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Further recordings that are clean."""
    quick: bool = False
    """One window a stride."""
    only: str = ""
    """Recordings whose name holds this."""
    clean: bool = True
    """Sound windows and wholes."""
    faults: bool = True
    """Copies with known faults."""


def main(args: Checked) -> None:
    clean_rows, fault_rows, started = [], {name: [0, 0] for name in FAULTS}, time.monotonic()
    for name, recording in sources(args.recordings, args.only):
        tried = alarms = warned = 0
        for what, piece in clean_parts(recording, 1 if args.quick else STARTS) if args.clean else ():
            found = diagnose(piece)
            tried, alarms = tried + 1, alarms + (not found.ok)
            warned += found.ok and any(finding.severity == "warning" for finding in found.findings)
            for finding in found.findings:
                if finding.severity != "note":
                    print(f"{name}, {what}: {finding.severity} {finding.message}", file=sys.stderr, flush=True)
        clean_rows.append((name, tried, alarms, warned))
        print(f"{clean_rows[-1]} {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
        for fault, (spoil, expected) in (FAULTS if args.faults else {}).items():
            if expected & {"gravity", "floor_height"} and (recording.up is None or recording.floor_height_m is None):
                continue
            if "drift" in expected and not seen_again(recording):
                continue
            found = errors(diagnose(spoil(recording)))
            fault_rows[fault][0] += 1
            fault_rows[fault][1] += found == expected
            if found != expected:
                print(f"{name}, {fault}: found {sorted(found)}", file=sys.stderr, flush=True)
    total = [sum(row[i] for row in clean_rows) for i in (1, 2, 3)]
    print("| clean recording | checks | false alarms | with a warning |\n| --- | --- | --- | --- |")
    for row in (*clean_rows, ("all", *total)):
        print("| " + " | ".join(map(str, row)) + " |")
    if args.faults:
        rights = [sum(row[i] for row in fault_rows.values()) for i in (0, 1)]
        print("\n| fault | copies | diagnosed right |\n| --- | --- | --- |")
        for fault, (tried, right) in (*fault_rows.items(), ("all", rights)):
            print(f"| {fault} | {tried} | {right} |")


if __name__ == "__main__":
    main(tyro.cli(Checked))
