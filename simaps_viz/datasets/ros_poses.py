"""Where a camera stood, from a recording's transforms (tf): a chain of moving and fixed links to the world."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import interpolate_poses
from simaps_viz.errors import InputError

LONGEST_GAP_S = 0.5
"""No pose is made up where a transform was silent for longer."""


@dataclass(eq=False)
class Link:
    """How one frame lies in its parent over time."""

    parent: str
    fixed: bool
    times_s: list[float] = field(default_factory=list)
    poses: list[NDArray] = field(default_factory=list)

    def at(self, times_s: NDArray) -> tuple[NDArray, NDArray]:
        """Give T_parent_child [n, 4, 4] and where it is known, bool [n]."""
        if self.fixed:
            return np.repeat(self.poses[-1][None], len(times_s), axis=0), np.ones(len(times_s), dtype=bool)
        times, first = np.unique(self.times_s, return_index=True)
        poses = np.stack([self.poses[i] for i in first])
        return interpolate_poses(times, poses, times_s, longest_gap_s=LONGEST_GAP_S, beyond_s=LONGEST_GAP_S / 10)


class Transforms:
    """The tree of frames."""

    def __init__(self) -> None:
        self.links: dict[str, Link] = {}

    def add(self, parent: str, child: str, time_s: float, T_parent_child: NDArray, *, fixed: bool) -> None:
        """Add what a transform message says; a frame keeps the parent that it had first."""
        child, parent = child.lstrip("/"), parent.lstrip("/")
        link = self.links.setdefault(child, Link(parent, fixed))
        if link.parent == parent:
            link.times_s.append(time_s)
            link.poses.append(T_parent_child)

    def chain(self, frame: str) -> list[str]:
        """Give the frames from this one up to the world's, both included.

        Raises:
            InputError: The frames go round in a circle.
        """
        found = [frame.lstrip("/")]
        while found[-1] in self.links:
            parent = self.links[found[-1]].parent
            if parent in found:
                raise InputError(f"transforms: expected a tree, found a circle at frame {parent!r}")
            found.append(parent)
        return found

    def moves(self, frame: str) -> bool:
        """Tell whether a frame moves in its world."""
        return any(not self.links[name].fixed for name in self.chain(frame)[:-1])

    def poses(self, frame: str, times_s: NDArray) -> tuple[NDArray, NDArray]:
        """Give T_world_frame [n, 4, 4] and where it is known, bool [n]."""
        return self.compose(self.chain(frame)[:-1], times_s)

    def compose(self, frames: Iterable[str], times_s: NDArray) -> tuple[NDArray, NDArray]:
        """Multiply the links of frames, innermost first."""
        T, known = np.repeat(np.eye(4)[None], len(times_s), axis=0), np.ones(len(times_s), dtype=bool)
        for name in frames:
            T_parent_child, here = self.links[name].at(times_s)
            T, known = T_parent_child @ T, known & here
        return T, known
