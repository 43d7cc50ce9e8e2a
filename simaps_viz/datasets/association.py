"""Associate what was recorded at different times: images by the nearest time, poses by interpolation."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from simaps_viz.errors import InputError


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
