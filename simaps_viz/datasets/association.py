"""Associate what belongs together: by the frame's name or number, or by time; poses are interpolated."""

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from simaps_viz.datasets.calibration import check_reach, matrix16, number_rows, numbers, pose_rows, rigid, stated_pose
from simaps_viz.datasets.file_frames import present
from simaps_viz.datasets.manifest import few
from simaps_viz.datasets.recording import left_out
from simaps_viz.errors import InputError

K = TypeVar("K", bound=Hashable)
L = TypeVar("L")
P = TypeVar("P")


@dataclass(frozen=True, eq=False)
class Matched(Generic[K]):
    """The frames of a recording that lack nothing."""

    frames: list[K]
    """Their names or numbers, in order."""
    poses: NDArray
    """float64 [n, 4, 4], as stored."""
    notes: tuple[str, ...]
    """On the frames where tracking was lost (an infinite pose)."""
    faults: tuple[str, ...]
    """On the frames that lack an image or a pose, or whose pose is damaged."""

    def members(self, *notes: str, first: tuple[str, ...] = ()) -> dict[str, Any]:
        """Return the members of a `Recording` that are known: poses, notes (between these) and faults."""
        return {"poses": self.poses, "notes": (*first, *self.notes, *notes), "faults": self.faults}

    def of_each(self, *parts: Mapping[K, P]) -> list[list[P]]:
        """Return what each part has of the frames, such as their files."""
        return [[part[frame] for frame in self.frames] for part in parts]


def match_frames(
    where: object,
    images: Mapping[str, Collection[K]],
    poses: Mapping[K, P],
    read_pose: Callable[[P], NDArray],
    *,
    place: Callable[[P], str] = str,
    checked: Callable[[str, NDArray], NDArray] = rigid,
) -> Matched[K]:
    """Match images and poses by the name or number of their frame; one bad item costs one frame.

    Args:
        where: names the recording in an error.
        images: {what they are, e.g. "depth image": the frames that have one}; the first of them says the order.
        poses: what holds the pose of each frame.
        read_pose: returns the pose [4, 4], which may be infinite or NaN; raises InputError for a damaged one.
        place: returns where a pose stands, for an error.
        checked: returns a pose as it is wanted; raises InputError, which names its place, for what is none.

    Raises:
        InputError: No frame has everything, or more than half of the poses are damaged.
    """
    parts: Mapping[str, Collection[K]] = {**images, "pose": poses}
    of_all = dict.fromkeys(frame for part in parts.values() for frame in part)
    candidates = [frame for frame in next(iter(parts.values())) if all(frame in part for part in parts.values())]
    if not candidates:
        found = ", ".join(f"{len(part)} {kind}s ({few(list(part)[:4])})" for kind, part in parts.items())
        raise InputError(f"{where}: expected frames with {', '.join(parts)}, found none that has all among {found}")
    faults = [
        fault
        for kind, part in parts.items()
        if (lacking := [str(frame) for frame in of_all if frame not in part])
        for fault in left_out(len(lacking), len(of_all), f"frames have no {kind} ({few(lacking)})")
    ]
    kept, matrices, damaged, lost = [], [], [], 0
    for frame in candidates:
        try:
            matrix = read_pose(poses[frame])
            if np.isinf(matrix).any() and not np.isnan(matrix).any():
                lost += 1
                continue
            if np.isnan(matrix).any():
                raise InputError(f"{place(poses[frame])}: expected finite numbers, found NaN")
            matrices.append(checked(place(poses[frame]), matrix))
            kept.append(frame)
        except InputError as error:
            damaged.append((frame, error))
    if 2 * len(damaged) > len(candidates) - lost:
        raise damaged[0][1]
    if not kept:
        raise InputError(f"{where}: expected a finite pose in one of {len(candidates)} frames, found none")
    if damaged:
        faults += left_out(len(damaged), len(of_all), f"frames have a damaged pose ({damaged[0][1]})")
    notes = left_out(lost, len(of_all), "frames have no pose, tracking was lost")
    return Matched(kept, np.stack(matrices), notes, tuple(faults))


def nearest(times: NDArray, wanted: NDArray) -> NDArray:
    """int64 [len(wanted)]: the index of the nearest of ``times`` (ascending, not empty; the earlier on a tie)."""
    right = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
    if len(times) == 1:
        return np.zeros(len(wanted), dtype=np.int64)
    left = right - 1
    return np.where(wanted - times[left] <= times[right] - wanted, left, right).astype(np.int64)


def associate(times_a: NDArray, times_b: NDArray, *, tolerance_s: float) -> NDArray:
    """Pair two series by time; nothing is used twice, and where two want the same the closer one gets it.

    Args:
        times_a: float64 [n], seconds, ascending.
        times_b: float64 [m], seconds, ascending.
        tolerance_s: pairs farther apart are no pairs.

    Returns:
        int64 [k, 2], indices into a and b, ascending in both.
    """
    if not len(times_a) or not len(times_b):
        return np.zeros((0, 2), dtype=np.int64)
    b_of_a = nearest(times_b, times_a)
    off_s = np.abs(times_b[b_of_a] - times_a)
    order = np.lexsort((np.arange(len(times_a)), off_s))
    order = order[off_s[order] <= tolerance_s]
    _, first = np.unique(b_of_a[order], return_index=True)  # the closest a of each b
    chosen = np.sort(order[first])
    return np.stack([chosen, b_of_a[chosen]], axis=1)


def interpolate_poses(
    times: NDArray, poses: NDArray, at: NDArray, *, max_gap_s: float, beyond_s: float = 0.0
) -> tuple[NDArray, NDArray]:
    """Interpolate poses: positions on the straight line, rotations on the shortest arc (slerp).

    Args:
        times: float64 [n], seconds, strictly ascending.
        poses: float64 [n, 4, 4].
        at: float64 [k], seconds.
        max_gap_s: no pose is made up inside a longer gap.
        beyond_s: how far outside the first and last time their poses still hold.

    Returns:
        float64 [k, 4, 4], and bool [k]: where there is a pose; elsewhere the matrix means nothing.
    """
    inside = np.clip(at, times[0], times[-1])
    known = np.abs(at - inside) <= beyond_s + 1e-9
    if len(times) == 1:
        return np.repeat(poses, len(at), axis=0), known
    right = np.clip(np.searchsorted(times, inside), 1, len(times) - 1)
    left = right - 1
    on_time = np.minimum(inside - times[left], times[right] - inside) <= 1e-6
    known &= on_time | (times[right] - times[left] <= max_gap_s)
    share = ((inside - times[left]) / (times[right] - times[left]))[:, None]
    found = np.tile(np.eye(4), (len(at), 1, 1))
    found[:, :3, 3] = (1 - share) * poses[left, :3, 3] + share * poses[right, :3, 3]
    found[:, :3, :3] = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))(inside).as_matrix()
    exact = nearest(times, inside)
    hit = np.abs(times[exact] - inside) <= 1e-6  # no rounding where a pose was recorded
    found[hit] = poses[exact[hit]]
    return found, known


def match_posed_files(
    pose_file: Path,
    file_of: Mapping[str, Callable[[str], Path]],
    *,
    checked: Callable[[str, NDArray], NDArray] | None = None,
) -> tuple[Matched[str], list[list[Path]]]:
    """Match files that are called after their frame with a file of frame names and poses (`calibration.pose_rows`).

    Args:
        pose_file: a line a frame: its name and 16 numbers.
        file_of: {what it is: the file of a frame}.
        checked: as for `match_frames`; None means poses as the format states them, with no camera far away.

    Returns:
        The frames that have everything, and of each kind their files.

    Raises:
        InputError: As for `match_frames`, or the pose file is none, or a camera is far away.
    """
    rows = {name: (f"{place}, frame {name}", found) for name, (place, found) in pose_rows(pose_file).items()}
    files = {kind: present({name: named(name) for name in rows}) for kind, named in file_of.items()}
    matched = match_frames(
        pose_file, files, rows, lambda row: matrix16(*row), place=lambda row: row[0], checked=checked or stated_pose
    )
    if checked is None:
        check_reach([rows[name][0] for name in matched.frames], matched.poses)
    return matched, [[of_kind[name] for name in matched.frames] for of_kind in files.values()]


def read_lines(lines: Sequence[L], read: Callable[[L], P], *, what: str = "poses") -> tuple[list[P], tuple[str, ...]]:
    """Read each entry of a list, and leave out those that are cut off or damaged.

    Args:
        lines: the entries as written.
        read: returns what one of them says; raises InputError, which names its place, where that is nothing.
        what: they are, for the note.

    Returns:
        What the others say, and a note on those that were left out, with the first one's error.

    Raises:
        InputError: More than half of them are damaged.
    """
    found, damaged = [], []
    for line in lines:
        try:
            found.append(read(line))
        except InputError as error:
            damaged.append(error)
    if 2 * len(damaged) > len(lines):
        raise damaged[0]
    return found, left_out(len(damaged), len(lines), f"{what} are damaged ({damaged[0]})") if damaged else ()


def read_trajectory(
    path: Path, columns: int, pose_of: Callable[[str, NDArray], NDArray]
) -> tuple[tuple[NDArray, NDArray], tuple[str, ...]]:
    """Read a file of a time and a pose a line; lines that are cut off or damaged are left out.

    Args:
        path: the file.
        columns: numbers of a line; the first is the time, seconds.
        pose_of: returns T_world_camera [4, 4] of a line's numbers; raises InputError, which names the line.

    Returns:
        Times, strictly ascending, and poses [n, 4, 4]; and a note on what was left out.

    Raises:
        InputError: More than half of the lines are damaged, such as by another number of columns.
    """

    def read(line: tuple[str, list[str]]) -> tuple[float, NDArray]:
        where, found = line
        row = numbers(where, found, count=columns)
        pose = pose_of(where, row)
        if not (np.isfinite(row[0]) and np.isfinite(pose).all()):
            raise InputError(f"{where}: expected finite numbers, found NaN or infinity")
        return float(row[0]), pose

    posed, notes = read_lines(number_rows(path, columns), read)
    ascending, first = np.unique([time for time, _ in posed], return_index=True)
    return (ascending, np.stack([pose for _, pose in posed])[first]), notes


def posed_pairs(
    where: Path,
    depth_times: NDArray,
    color_times: NDArray,
    trajectory: tuple[NDArray, NDArray],
    *,
    tolerance_s: float,
    max_gap_s: float,
) -> tuple[NDArray, NDArray]:
    """Pair depth with colour images and interpolate the pose of each pair at the time of its depth image.

    Args:
        where: names the recording in an error.
        depth_times: float64 [n], seconds, ascending.
        color_times: float64 [m], seconds, ascending.
        trajectory: times, strictly ascending, and poses [k, 4, 4].
        tolerance_s: how far colour may be from depth, and depth from the trajectory's ends.
        max_gap_s: as in `interpolate_poses`.

    Returns:
        int64 [p, 2], indices of depth and colour images, and float64 [p, 4, 4], of those pairs that have a pose.

    Raises:
        InputError: There is no such pair.
    """
    pairs = associate(depth_times, color_times, tolerance_s=tolerance_s)
    poses, known = interpolate_poses(*trajectory, depth_times[pairs[:, 0]], max_gap_s=max_gap_s, beyond_s=tolerance_s)
    if not known.any():
        raise InputError(
            f"{where}: expected depth, colour and pose of about the same time, found none among {len(depth_times)} "
            f"depth images, {len(color_times)} colour images and {len(trajectory[0])} poses"
        )
    return pairs[known], poses[known]
