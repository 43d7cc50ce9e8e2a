"""Brings together what was recorded at different times: pictures by the nearest time, poses by interpolation."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp


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
    times: NDArray, poses: NDArray, at: NDArray, *, longest_gap_s: float, beyond_s: float = 0.0
) -> tuple[NDArray, NDArray]:
    """Interpolate poses: positions on the straight line, rotations on the shortest arc (slerp).

    Args:
        times: float64 [n], seconds, strictly ascending.
        poses: float64 [n, 4, 4].
        at: float64 [k], seconds.
        longest_gap_s: no pose is made up inside a longer gap.
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
    known &= on_time | (times[right] - times[left] <= longest_gap_s)
    share = ((inside - times[left]) / (times[right] - times[left]))[:, None]
    found = np.tile(np.eye(4), (len(at), 1, 1))
    found[:, :3, 3] = (1 - share) * poses[left, :3, 3] + share * poses[right, :3, 3]
    found[:, :3, :3] = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))(inside).as_matrix()
    exact = nearest(times, inside)
    hit = np.abs(times[exact] - inside) <= 1e-6  # no rounding where a pose was recorded
    found[hit] = poses[exact[hit]]
    return found, known
