"""What a command should come to, worked out from a map's cells alone: no code of the language or the planner."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from simaps_viz.structures import Pose2, SIMap

COMPASS = {"north": (0.0, 1.0), "south": (0.0, -1.0), "east": (1.0, 0.0), "west": (-1.0, 0.0)}


@dataclass(frozen=True)
class World:
    """One map, seen from where a command is given."""

    simap: SIMap
    pose: Pose2

    def cells(self, number: int) -> NDArray:
        spec = self.simap.spec
        row, col = np.nonzero(self.simap.instance == number)
        return np.column_stack([spec.x0_m + (col + 0.5) * 0.05, spec.y0_m + (row + 0.5) * 0.05])

    def middle(self, number: int) -> NDArray:
        return self.cells(number).mean(axis=0)

    def ids(self, *labels: str) -> list[int]:
        found = []
        for label in labels:
            index = self.simap.grid.labels.index(label)
            found += np.unique(self.simap.instance[(self.simap.grid.label == index)]).tolist()
        return [number for number in found if number]

    def ranked(self, *labels: str) -> list[int]:
        """All of some classes, the closest first, by the nearest cell."""
        here = (self.pose.x_m, self.pose.y_m)
        far = {n: round(float(np.hypot(*(self.cells(n) - here).T).min()), 6) for n in self.ids(*labels)}
        return sorted(far, key=lambda n: (far[n], n))

    def nth(self, label: str, n: int = 1) -> int:
        ranked = self.ranked(label)
        return ranked[n - 1 if n > 0 else n]

    def side(self, label: str, side: str, n: int = 1) -> int:
        yaw = self.pose.yaw_rad
        left = (-np.sin(yaw), np.cos(yaw))
        way = {**COMPASS, "left": left, "right": (-left[0], -left[1])}[side]
        return sorted(self.ids(label), key=lambda i: -float(self.middle(i) @ way))[n - 1]

    def near(self, label: str, other: int, n: int = 1) -> int:
        """The n-th of a class by the smallest gap between its cells and another thing's."""

        def gap(number: int) -> float:
            a, b = self.cells(number), self.cells(other)
            return float(np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1)).min())

        return sorted((i for i in self.ids(label) if i != other), key=lambda i: (round(gap(i), 6), i))[n - 1]

    def next_to(self, label: str, other: str) -> int:
        """The one of a class with the smallest gap to any of another class."""
        pairs = [(n, o) for o in self.ids(other) for n in [self.near(label, o)]]
        gaps = {n: KDTree(self.cells(o)).query(self.cells(n))[0].min() for n, o in pairs}
        return min(gaps, key=lambda n: gaps[n])

    def far_from(self, label: str, other: int) -> int:
        there = self.middle(other)
        return max(self.ids(label), key=lambda i: float(np.hypot(*(self.middle(i) - there))))

    def around(self, label: str, other: int, within_m: float) -> list[int]:
        """All of a class whose middle is that near another thing's, the closest to the viewer first."""
        there = self.middle(other)
        return [i for i in self.ranked(label) if float(np.hypot(*(self.middle(i) - there))) <= within_m]

    def on_side(self, label: str, side: str) -> list[int]:
        """All of a class whose middle lies to the left or right of the pose (20 to 160 degrees off), closest first."""

        def bearing(number: int) -> float:
            x, y = self.middle(number) - (self.pose.x_m, self.pose.y_m)
            turn = float(np.rad2deg(np.arctan2(y, x) - self.pose.yaw_rad)) % 360.0
            return turn if side == "left" else 360.0 - turn

        return [number for number in self.ranked(label) if 20.0 <= bearing(number) <= 160.0]

    def beside(self, label: str, other: int, side: str) -> int:
        """The one of a class that lies on a side of another thing and is nearest to it; sides are the viewer's."""
        there = self.middle(other)
        ahead = there - (self.pose.x_m, self.pose.y_m)
        way = {
            **COMPASS,
            "left": (-ahead[1], ahead[0]),
            "right": (ahead[1], -ahead[0]),
            "front": -ahead,
            "behind": ahead,
        }[side]
        fitting = [i for i in self.ids(label) if float((self.middle(i) - there) @ np.array(way)) > 0.0]
        return min(fitting, key=lambda i: float(np.hypot(*(self.middle(i) - there))))


@dataclass(frozen=True)
class End:
    """How a command should end."""

    goals: list[int] | None = None
    """Instances of the goals that have one, in order."""
    heading_deg: float | None = None
    position: tuple[float, float] | None = None
    near_m: float = 0.06
    """How far from ``position`` will do."""
    side_of: tuple[int, NDArray] | None = None
    """The robot ends on that side (a vector) of an instance, within 45 degrees of it."""
    path_m: float | None = None
    refused: tuple[str, ...] = ()
    """Refused, with all these words in the reason."""
    told: object = None
    """The value of the answer to a question; the robot stays."""


Expected = Callable[[World], End]


def problem(world: World, expected: End, done) -> str | None:
    """Describe what is wrong with an answer, or None."""
    if expected.refused:
        missing = [word for word in expected.refused if word not in (done.reason or "")]
        return None if done.status == "refused" and not missing else f"{done.status}: {done.reason}"
    if done.status != "ok":
        return f"{done.status}: {done.reason}"
    if expected.told is not None and (done.answer is None or done.answer["value"] != expected.told):
        return f"answered {done.answer}, expected {expected.told}"
    goals = [goal.instance for goal in done.goals if goal.instance is not None]
    if expected.goals is not None and goals != expected.goals:
        return f"goals {goals}, expected {expected.goals}"
    end = done.final_pose
    if expected.heading_deg is not None:
        off = abs((end.heading_deg - expected.heading_deg + 180.0) % 360.0 - 180.0)
        if off > 0.01:
            return f"heading {end.heading_deg:.1f}, expected {expected.heading_deg:.1f}"
    if expected.position is not None:
        off = float(np.hypot(end.x_m - expected.position[0], end.y_m - expected.position[1]))
        if off > expected.near_m:
            return (
                f"at ({end.x_m:.2f}, {end.y_m:.2f}), expected ({expected.position[0]:.2f}, {expected.position[1]:.2f})"
            )
    if expected.side_of is not None:
        number, way = expected.side_of
        offset = np.array([end.x_m, end.y_m]) - world.middle(number)
        way = np.array(way) / np.linalg.norm(way)
        if offset @ way < abs(offset[0] * way[1] - offset[1] * way[0]) - 1e-6:
            return f"ends {offset.round(2)} from {number}, expected to the side {way.round(2)}"
    if expected.path_m is not None and abs(done.path_length_m - expected.path_m) > 0.05:
        return f"drove {done.path_length_m:.2f} m, expected {expected.path_m:.2f}"
    return None
