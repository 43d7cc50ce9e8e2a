"""The simulated robot: carries out one primitive at a time on a map, and keeps its pose, goals and path.

Around things it drives closed loops.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import KDTree

from simaps_viz.errors import CommandError, InputError, PlanningError
from simaps_viz.geometry import heading_to_yaw, wrap_angle
from simaps_viz.language.grounding import Named, Things
from simaps_viz.language.primitives import SELF, Primitive
from simaps_viz.language.sets import Position, Room, Sets, pair_words
from simaps_viz.navigation.planner import Planner, clear_length
from simaps_viz.structures import Instance, Path, Pose2, SIMap

MAX_LAPS: Final = 20
MAX_OFF_M: Final = 3.0
"""A loop stays this close to what it goes around: one through the next room is not what people mean."""
_MAX_PATCHES = 60


def lap(
    planner: Planner, start_m: tuple[float, float], things_m: Sequence[NDArray], what: str, turns: float = 1.0
) -> list[tuple[float, float]]:
    """Find positions of a closed loop all around things, as close to them as the robot fits.

    Every straight line from one position to the next lies on free cells. With whole turns the last position is the
    first; the winding number of the polygon around each of the things is ``-turns``.

    Args:
        planner: of the map and the robot.
        start_m: where the robot is; the loop starts at its point nearest to it.
        things_m: float64 [n, 2] for each thing, the centres of its cells, map frame. Several things are gone around
            together.
        what: names them in errors, with their article.
        turns: how often to go around, clockwise; negative: counter-clockwise. A fraction ends short of the whole loop.

    Raises:
        CommandError: the number of turns is 0 or more than ``MAX_LAPS``.
        PlanningError: something stands in the way of every such loop.
    """
    if not 0.0 < abs(turns) <= MAX_LAPS:
        raise CommandError(f"a lap takes up to {MAX_LAPS} turns, more than none; {turns:g} were asked for")
    spec = planner.spec
    # Work in a window that holds all cells near enough, with a border of cells that are not free.
    cells = np.concatenate([_rows_and_cols(spec.x0_m, spec.y0_m, spec.cell_size_m, centres) for centres in things_m])
    margin = int(np.ceil(MAX_OFF_M / spec.cell_size_m)) + 1
    low, high = cells.min(axis=0) - margin, cells.max(axis=0) + margin + 1
    inside_low, inside_high = np.maximum(low, 0), np.minimum(high, spec.shape)
    window = np.s_[inside_low[0] : inside_high[0], inside_low[1] : inside_high[1]]
    free = np.zeros(high - low, np.bool_)
    part = np.s_[tuple(slice(a, b) for a, b in zip(inside_low - low, inside_high - low, strict=True))]
    free[part] = planner.reachable(*start_m)[window]
    # What the loop goes around: the things, and the gaps between them.
    core = _joined([_rows_and_cols(spec.x0_m, spec.y0_m, spec.cell_size_m, one) - low for one in things_m], free.shape)
    off_m = np.asarray(ndimage.distance_transform_edt(~core)) * spec.cell_size_m
    free &= ~core & (off_m <= MAX_OFF_M)
    if not free.any():
        raise PlanningError(f"the robot cannot get within {MAX_OFF_M:g} m of {what}")
    # All that touches the things lies inside the loop. If it reaches the outside, nothing goes all around.
    blocked = np.asarray(ndimage.label(~free, np.ones((3, 3)))[0])  # pyright: ignore[reportIndexIssue]
    solid = np.argwhere(core)
    around = blocked == blocked[tuple(solid[0])]
    if around[0, 0]:
        raise PlanningError(f"there is no way all around {what}: something stands against it")
    ring = _outline(around)
    ring = np.roll(ring, -_nearest(ring, start_m, planner, low), axis=0)
    middle = solid[np.argmin(((solid - solid.mean(axis=0)) ** 2).sum(axis=1))]
    corners = _straightened(free, np.vstack([ring, ring[:1]]) + 0.5, middle[::-1] + 0.5)
    points = (corners + low[::-1]) * spec.cell_size_m + (spec.x0_m, spec.y0_m)
    return _repeated(points[::-1] if turns > 0.0 else points, abs(turns))


def _rows_and_cols(x0_m: float, y0_m: float, cell_size_m: float, centres_m: NDArray) -> NDArray:
    return np.floor((centres_m[:, ::-1] - (y0_m, x0_m)) / cell_size_m).astype(np.int64)


def _joined(things: Sequence[NDArray], shape: tuple[int, ...]) -> NDArray:
    """Return the cells of all things, and of the shortest straight lines that join them, bool [rows, cols]."""
    core = np.zeros(shape, np.uint8)
    for cells in things:
        core[cells[:, 0], cells[:, 1]] = 1
    count, labels = cv2.connectedComponents(core)
    if count - 1 > _MAX_PATCHES:
        raise CommandError(f"a lap goes around at most {_MAX_PATCHES} separate things, {count - 1} were asked for")
    patches = [np.argwhere(labels == number) for number in range(1, count)]
    gaps = np.zeros((len(patches), len(patches)))
    ends = {}
    for i, first in enumerate(patches):
        tree = KDTree(first)
        for j in range(i + 1, len(patches)):
            distance, nearest = tree.query(patches[j])
            k = int(np.argmin(distance))
            gaps[i, j], ends[i, j] = distance[k], (first[np.asarray(nearest)[k]], patches[j][k])
    joins = coo_array(minimum_spanning_tree(gaps))
    for i, j in zip(joins.row.tolist(), joins.col.tolist(), strict=True):
        a, b = ends[i, j]
        cv2.line(core, a[::-1].tolist(), b[::-1].tolist(), 1)
    return core.astype(np.bool_)


def _outline(around: NDArray) -> NDArray:
    """Return the ring of cells just outside a patch, int [n, 2] (x, y), counter-clockwise, joined by their sides.

    All of them are free, as the patch holds every cell that is not and touches it by a side or a corner.
    """
    grown = cv2.dilate(around.astype(np.uint8), np.ones((3, 3), np.uint8))
    outlines, _ = cv2.findContours(grown, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    ring = max(outlines, key=len)[:, 0, :].astype(np.int64)
    steps = [ring[0]]
    for x, y in np.roll(ring, -1, axis=0):
        last_x, last_y = steps[-1]
        if x != last_x and y != last_y:  # of the two cells beside a diagonal step, the one inside is free
            beside = [(x, last_y), (last_x, y)]
            steps.append(np.array(next(one for one in beside if grown[one[1], one[0]])))
        steps.append(np.array((x, y)))
    cells = np.array(steps[:-1])
    x, y = cells.T.astype(np.float64)
    area = float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    return cells if area > 0.0 else cells[::-1]


def _nearest(ring: NDArray, start_m: tuple[float, float], planner: Planner, low: NDArray) -> int:
    spec = planner.spec
    x, y = ((ring + 0.5 + low[::-1]) * spec.cell_size_m + (spec.x0_m, spec.y0_m)).T
    return int(np.argmin(np.hypot(x - start_m[0], y - start_m[1])))


def _straightened(free: NDArray, points: NDArray, middle: NDArray) -> NDArray:
    """Drop the points of a closed ring that a clear straight line can skip without passing the middle on the far side.

    Args:
        free: bool [rows, cols].
        points: float64 [n, 2], (x, y) in cells; the last is the first.
        middle: float64 [2], a point in the loop's solid middle, which no clear line can cross.
    """
    bearing = np.unwrap(np.arctan2(*(points - middle).T[::-1]))
    kept, at = [0], 0
    for i in range(2, len(points)):
        turned = bearing[i] - bearing[at]
        clear = abs(turned) < np.pi and clear_length(free, *points[at], *points[i]) >= 1.0
        if not clear:
            at = i - 1
            kept.append(at)
    return points[[*kept, len(points) - 1]]


def _repeated(points: NDArray, turns: float) -> list[tuple[float, float]]:
    """Return a closed polyline so many times over, the last time as far as the fraction of its length says."""
    whole = int(turns + 1e-9)
    found = [points[0], *np.tile(points[1:], (whole, 1))]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    left = (turns - whole) * float(lengths.sum())
    for a, b, length in zip(points, points[1:], lengths, strict=False):
        if left <= 1e-6:
            break
        found.append(a + (b - a) * min(1.0, left / length))
        left -= length
    return [(float(x), float(y)) for x, y in found]


MAX_STRAIGHT_M: Final = 10_000.0
"""A longer drive is refused before its poses are sampled: they would fill the memory."""


@dataclass(frozen=True)
class Motion:
    """How fast the robot is."""

    speed_mps: float = 0.8
    turn_rate_rps: float = 1.8
    """Radians a second."""
    dt_s: float = 0.05
    """Time between two poses."""


def drive(path: Path, start_yaw_rad: float, motion: Motion | None = None) -> NDArray:
    """Sample the drive along a path: at every point turn on the spot, then go straight to the next.

    Args:
        path: polyline, map frame; its first point is where the robot is.
        start_yaw_rad: its heading there.
        motion: speeds and sampling.

    Returns:
        float64 [n, 3], (x, y, yaw) every ``dt_s``, map frame, metres and radians; the first row is the start and the
        last exactly the path's end.
    """
    motion = motion or Motion()
    pose = Pose2(float(path.points_m[0, 0]), float(path.points_m[0, 1]), start_yaw_rad)
    pieces = [np.array([[pose.x_m, pose.y_m, pose.yaw_rad]])]
    for x, y in path.points_m[1:]:
        dx, dy = float(x) - pose.x_m, float(y) - pose.y_m
        if np.hypot(dx, dy) > 1e-9:
            turned = spin(pose, wrap_angle(np.arctan2(dy, dx) - pose.yaw_rad), motion)
            heading = Pose2(pose.x_m, pose.y_m, float(np.arctan2(dy, dx)))
            ahead = straight(heading, float(np.hypot(dx, dy)), motion)
            pieces += [turned[1:], ahead[1:]]
            pose = Pose2(float(x), float(y), heading.yaw_rad)
    return np.concatenate(pieces)


def spin(pose: Pose2, angle_rad: float, motion: Motion | None = None) -> NDArray:
    """Sample a turn on the spot, counter-clockwise positive, float64 [n, 3]; the first row is the start."""
    motion = motion or Motion()
    steps = int(np.ceil(abs(angle_rad) / (motion.turn_rate_rps * motion.dt_s) - 1e-9))
    share = np.linspace(0.0, 1.0, steps + 1) if steps else np.zeros(1)
    poses = np.tile([pose.x_m, pose.y_m, pose.yaw_rad], (len(share), 1))
    yaw = pose.yaw_rad + angle_rad * share
    poses[:, 2] = -((-yaw + np.pi) % (2.0 * np.pi) - np.pi)  # as wrap_angle does it, for all at once
    return poses


def straight(pose: Pose2, distance_m: float, motion: Motion | None = None) -> NDArray:
    """Sample a straight drive along the heading (negative: backwards), float64 [n, 3]; the first row is the start.

    Raises:
        PlanningError: when it is longer than ``MAX_STRAIGHT_M``.
    """
    if abs(distance_m) > MAX_STRAIGHT_M:
        raise PlanningError(f"one straight drive is at most {MAX_STRAIGHT_M:g} m, {abs(distance_m):g} m were asked for")
    motion = motion or Motion()
    steps = int(np.ceil(abs(distance_m) / (motion.speed_mps * motion.dt_s) - 1e-9))
    along = np.linspace(0.0, distance_m, steps + 1) if steps else np.zeros(1)
    poses = np.tile([pose.x_m, pose.y_m, pose.yaw_rad], (len(along), 1))
    poses[:, 0] += along * np.cos(pose.yaw_rad)
    poses[:, 1] += along * np.sin(pose.yaw_rad)
    return poses


CLEARANCE_M: Final = 0.3
"""Gap between the robot's hull and the object that it stops beside, metres."""
INSIDE_M: Final = 1.0
"""How far from its edge the robot stops in a room: where rooms meet in an open doorway, their border is not sharp."""
AVOID_M: Final = (1.0, 0.5)
"""How far the robot keeps from what it is to avoid, where no distance was said; the second where the first leaves no
way."""
_MAX_TURN_DEG = 3600.0
_MAX_CONTOUR = 400


@dataclass(frozen=True)
class Goal:
    """The goal of one motion."""

    primitive: str
    label: str | None
    """Class of the object, None when there is none."""
    instance: int | None
    point_m: tuple[float, float]
    """Where the robot drives to; for turns towards an object, the object's centroid. Map frame."""
    other_label: str | None = None
    """The second object of move_in_between."""
    other_instance: int | None = None
    words: str = ""
    """What the set was that the object is the first of, such as "leftmost chair"; empty for a name and a rank."""
    among: tuple[int, ...] = ()
    """Ids of the objects that it was chosen of, in the order that was asked for, such as from the left; empty for a
    name and a rank, which counts from the closest."""
    away_m: tuple[float, ...] = ()
    """How far each of those is from the thing that the nearest to it, or the farthest from it, was asked for; empty for
    another order."""
    ranking: str = ""
    """How many those are, and how they were ordered, in words: "3 chairs, the leftmost first"; empty for the first."""

    def to_json(self) -> dict[str, Any]:
        """Return primitive, label, instance and point; for move_in_between other_label and other_instance as well."""
        known = {"primitive": self.primitive, "label": self.label, "instance": self.instance}
        goal = {**known, "point": [round(v, 6) for v in self.point_m]}
        if self.other_label is not None:
            goal |= {"other_label": self.other_label, "other_instance": self.other_instance}
        return goal


class Robot:
    """A kinematic robot on a map; simulated, it always does exactly what it plans.

    Args:
        simap: the map.
        planner: plans over the map's grid.
        pose: where the command is given. Ranks, sides and what is in view are those of the robot's pose at the moment.
        motion: speeds and sampling of the drive.
        max_path_m: driving further than this fails.
        max_planned_cells: planning fails once the map's cells, times the paths planned, are more than this.
    """

    def __init__(
        self,
        simap: SIMap,
        planner: Planner,
        pose: Pose2,
        *,
        motion: Motion | None = None,
        max_path_m: float = np.inf,
        max_planned_cells: float = np.inf,
    ) -> None:
        if not np.isfinite([pose.x_m, pose.y_m, pose.yaw_rad]).all():
            raise InputError(f"pose: expected three finite numbers, found {pose.x_m}, {pose.y_m}, {pose.yaw_rad}")
        self.simap, self.planner = simap, planner
        self.grounding = Sets(
            simap, pose, lap=self._lap, route=self._route, keep_off=self._keep_off, radius_m=planner.robot.radius_m
        )
        self.goals: list[Goal] = []
        self.path_m: list[tuple[float, float]] = [(pose.x_m, pose.y_m)]
        self.path_length_m = 0.0
        self._motion = motion or Motion()
        self._max_path_m, self._max_planned_cells = max_path_m, max_planned_cells
        self._planned_cells = 0
        self._planners = (planner,)
        self._avoided: dict[int, str] = {}
        self._words, self._among, self._away_m, self._ranking = "", ((), ()), (), ""
        self._poses: list[NDArray] = []

    @property
    def pose(self) -> Pose2:
        """Where the robot is."""
        return self.grounding.viewer

    @property
    def answer(self) -> Mapping[str, Any] | None:
        """The answer to a question, see `simaps_viz.navigation.agent.Answer`; None when nothing was asked."""
        return self.grounding.answer

    def call(self, primitive: Primitive, arguments: Mapping[str, Any]) -> Any:
        """Carry out a primitive or function with checked arguments; returns what it found, else None.

        Raises:
            CommandError: when the map lacks what is asked for.
            PlanningError: when the robot cannot get there.
        """
        if primitive.kind == "function":
            return self.grounding.call(primitive, arguments)
        arguments = {name: self._certain(value) for name, value in arguments.items()}
        sets = [value for value in arguments.values() if isinstance(value, Things)]
        self._words = next((value.one for value in sets if value.before or value.after), "")
        among = tuple(i.id for value in sets[:1] for i in value.items if isinstance(i, Instance))
        self._among, self.grounding.among = (self.grounding.among, among), ()
        self._away_m, self.grounding.away_m = self.grounding.away_m, ()
        self._ranking, self.grounding.ranking = self.grounding.ranking, ""
        return getattr(self, f"_{primitive.name}")(**arguments)

    def take_poses(self) -> NDArray:
        """Return the poses driven since the last call, float64 [n, 3] (x, y, yaw), and forget them."""
        poses = np.concatenate(self._poses) if self._poses else np.zeros((0, 3))
        self._poses.clear()
        return poses

    def _move_to(self, pos: list[float]) -> None:
        x, y = float(pos[0]), float(pos[1])
        near, side = (pos.thing, pos.side) if isinstance(pos, Position) else (None, "")
        cell = self.simap.spec.cell_of(x, y)
        if not self.simap.spec.contains(*cell):
            if near is not None:
                raise PlanningError(f"what lies {side or 'by'} the {near.label} is not on the map")
            xmin, ymin, xmax, ymax = self.simap.spec.extent_m
            raise CommandError(
                f"({x:g}, {y:g}) lies outside the map, which has x {xmin:g} to {xmax:g} and y {ymin:g} to {ymax:g} m"
            )
        # On free floor the position itself is the goal, even where an object such as a rug lies.
        there = None if self.planner.free[cell] else self.simap.at(x, y)
        if near is not None and side:
            self._go_beside("move_to", near, np.array([x, y]), f"{side} the {near.label}")
            return
        targets = np.array([[x, y]]) if there is None else self.grounding.cells_of(there)
        path = self._plan_near(
            targets, f"to ({x:g}, {y:g})", see_through=self._see_through(*([there] if there else []))
        )
        self._go("move_to", path, near or there)

    def _move_forward(self, meters: float) -> None:
        if meters == 0.0:
            return
        end = straight(self.pose, meters, self._motion)[-1]
        planner = self._planners[-1]
        clear_m = planner.clear_ahead_m(self._here, (end[0], end[1]))
        if clear_m < abs(meters) - 1e-6:
            way = "ahead" if meters > 0 else "behind"
            toward = np.sign(meters) * (clear_m + 0.5 * self.simap.spec.cell_size_m)
            stop = (
                self.pose.x_m + toward * float(np.cos(self.pose.yaw_rad)),
                self.pose.y_m + toward * float(np.sin(self.pose.yaw_rad)),
            )
            what = planner.obstacle_near(stop)
            raise PlanningError(
                f"the way {way} is free for {clear_m:.2f} m, then {what}; {abs(meters):g} m were asked for"
            )
        self._add_path(np.array([self._here, end[:2]]), straight(self.pose, meters, self._motion), "move_forward")

    def _turn(self, angle_deg: float) -> None:
        if abs(angle_deg) > _MAX_TURN_DEG:
            raise CommandError(f"a turn is at most {_MAX_TURN_DEG:g} degrees, {angle_deg:g} were asked for")
        self._spin(-np.deg2rad(angle_deg))

    def _turn_absolute(self, angle_deg: float) -> None:
        self._spin(wrap_angle(heading_to_yaw(angle_deg) - self.pose.yaw_rad))

    def _face(self, name: Named, instance: int | Named) -> None:
        self._turn_to("face", name, instance, 0.0)

    def _with_object_on_left(self, name: Named, instance: int | Named) -> None:
        self._turn_to("with_object_on_left", name, instance, -np.pi / 2.0)

    def _with_object_on_right(self, name: Named, instance: int | Named) -> None:
        self._turn_to("with_object_on_right", name, instance, np.pi / 2.0)

    def _move_to_object(self, name: Named, instance: int | Named) -> None:
        room = self.grounding.room_of(name)
        if room is not None:
            self._enter("move_to_object", room)
        else:
            self._approach("move_to_object", self.grounding.pick(name, instance))

    def _move_to_nth_closest(self, name: Named, n: int) -> None:
        self._approach("move_to_nth_closest", self.grounding.pick(name, n))

    def _move_to_left(self, name: Named, instance: int | Named) -> None:
        self._go_to_side("move_to_left", name, instance, "left", "to the left of")

    def _move_to_right(self, name: Named, instance: int | Named) -> None:
        self._go_to_side("move_to_right", name, instance, "right", "to the right of")

    def _move_north(self, name: Named, instance: int | Named) -> None:
        self._go_to_side("move_north", name, instance, "north", "north of")

    def _move_south(self, name: Named, instance: int | Named) -> None:
        self._go_to_side("move_south", name, instance, "south", "south of")

    def _move_east(self, name: Named, instance: int | Named) -> None:
        self._go_to_side("move_east", name, instance, "east", "east of")

    def _move_west(self, name: Named, instance: int | Named) -> None:
        self._go_to_side("move_west", name, instance, "west", "west of")

    def _move_in_between(
        self, name_a: Named, name_b: Named, instance_a: int | Named, instance_b: int | Named | None
    ) -> None:
        first = self.grounding.pick(name_a, instance_a)
        second = name_b if instance_b is None else self.grounding.pick(name_b, instance_b)
        a, b = self.grounding.pair(first, second)
        start, end = np.array(a.centroid_m[:2]), np.array(b.centroid_m[:2])
        x, y = _cell_centres(self.simap)
        along = ((x - start[0]) * (end - start)[0] + (y - start[1]) * (end - start)[1]) / (
            (end - start) @ (end - start)
        )
        path = self._plan_near(
            self._gap_middle(a, b)[None],
            f"between {pair_words(a, b)}",
            allowed=(along >= 0.0) & (along <= 1.0),
            see_through=self._see_through(a, b),
        )
        self._go("move_in_between", path, a, b)

    def _get_pos(self, name: Named, instance: int | Named) -> list[float]:
        if name == SELF:
            return [self.pose.x_m, self.pose.y_m]
        return [float(v) for v in self.grounding.pick(name, instance).centroid_m[:2]]

    def _get_contour(self, name: Named, instance: int | Named) -> list[list[float]]:
        mask = (self.simap.instance == self.grounding.pick(name, instance).id).astype(np.uint8)
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        longest = max(outlines, key=len)[:, 0, :]
        every = max(1, -(-len(longest) // _MAX_CONTOUR))
        return [list(self.simap.spec.centre_of(int(row), int(col))) for col, row in longest[::every]]

    def _instances(self, name: Named) -> Things:
        found = self.grounding.set_of(name)
        return found.of(self.grounding.instances(name))

    def _nth_from(self, name: Named, side: str, n: int) -> Instance:
        return self.grounding.nth_from(name, side, n)

    def _closest_to(self, name: Named, other: Named, instance: int | Named) -> Instance:
        return self.grounding.closest_to(name, other, instance)

    def _between(self, name: Named, other_a: Named, other_b: Named) -> Instance:
        return self.grounding.between(name, other_a, other_b)

    def _in_view(self, name: Named) -> Things:
        return self.grounding.in_view(name)

    def _lap(self, things: Sequence[Instance], turns: float) -> list[list[float]]:
        """Return the positions of a loop around things, see `lap`."""
        one = things[0] if len(things) == 1 else None
        what = f"these {len(things)} things" if one is None else self._called(one)
        cells = [self.grounding.cells_of(thing) for thing in things]
        points = self._plan(lambda planner: lap(planner, self._here, cells, what, turns))
        return [Position(point, one) for point in points]

    def _route(self, stops: Sequence[Any]) -> Path:
        """Return the way from the first of some things or rooms to the last, or from here to the only one."""
        scout = Robot(self.simap, self.planner, self.pose, max_planned_cells=self._max_planned_cells)
        scout._planned_cells, scout._planners, scout._avoided = self._planned_cells, self._planners, self._avoided
        begin = 0
        for stop in stops:
            begin = len(scout.path_m) - 1
            scout._move_to_object(stop, 1)
        self._planned_cells = scout._planned_cells
        return Path(np.array(scout.path_m[begin if len(stops) > 1 else 0 :]))

    def _keep_off(self, cells: NDArray, things: Sequence[Instance], the: str, metres: float | None) -> None:
        """Keep what is driven from now on that far from cells, bool [rows, cols], or as far as leaves a way."""
        self._count_planning()
        spec = self.simap.spec
        off_m = np.asarray(ndimage.distance_transform_edt(~cells)) * spec.cell_size_m
        here_m = float(off_m[self.planner.start_cell(*self._here)])
        if here_m == 0.0 or here_m < (metres or 0.0):
            at = f"{here_m:.1f} m from" if here_m else "in" if metres == 0.0 else "at"
            raise CommandError(f"The robot already stands {at} {the}, which it is to keep away from.")
        wanted = AVOID_M if metres is None else (metres, metres)
        pairs = zip((self._planners[0], self._planners[-1]), wanted, strict=True)
        # Half a cell more: what is pulled straight cuts corners within its cells.
        found = [one.keeping_off(off_m < min(most + 0.5 * spec.cell_size_m, here_m)) for one, most in pairs]
        self._planners = tuple(found) if metres is None or len(self._planners) > 1 else (found[0],)
        self._avoided |= {thing.id: the for thing in things}

    @property
    def _here(self) -> tuple[float, float]:
        return self.pose.x_m, self.pose.y_m

    def _see_through(self, *targets: Instance) -> NDArray:
        """Return the cells that hide nothing, bool [rows, cols]: the objects' own, and all that are not opaque."""
        return ~self.grounding.opaque | np.isin(self.simap.instance, [target.id for target in targets])

    def _enter(self, primitive: str, room: Room) -> None:
        """Drive into a room, ``INSIDE_M`` past its edge where it is wide enough; a robot half as far inside stays."""
        cells = self.simap.room_cells == room.id
        window = ndimage.find_objects(cells.astype(np.int8))[0]
        depth_m = np.zeros(cells.shape)
        depth_m[window] = np.asarray(ndimage.distance_transform_edt(np.pad(cells[window], 1)))[1:-1, 1:-1]
        depth_m *= self.simap.spec.cell_size_m
        words = f"into {room.name}" if room.name[-1:].isdigit() else f"into the {room.name}"

        def enter(planner: Planner) -> Path:
            usable = np.where(planner.reachable(*self._here), depth_m, 0.0)
            inside = (depth_m > 0.0) & (depth_m >= min(INSIDE_M, 0.8 * float(usable.max())))
            here = planner.start_cell(*self._here)
            inside[here] |= depth_m[here] >= INSIDE_M / 2.0
            return planner.plan_into(self._here, inside, words)

        path = self._plan(enter)
        self._add_path(path.points_m, drive(path, self.pose.yaw_rad, self._motion), primitive, (room.name, None))

    def _approach(self, primitive: str, target: Instance) -> None:
        if target.id in self._avoided:
            raise CommandError(f"The robot is to keep away from {self._avoided[target.id]}, and cannot go there too.")
        cells = self.grounding.cells_of(target)
        path = self._plan_near(cells, f"to {target.name}", see_through=self._see_through(target))
        self._go(primitive, path, target)

    def _plan_near(self, targets_m: NDArray, what: str, **wishes: Any) -> Path:
        """Plan from the robot's position, see `Planner.plan_near`."""
        return self._plan(lambda planner: planner.plan_near(self._here, targets_m, what, **wishes))

    def _plan(self, plan: Callable[[Planner], Any]) -> Any:
        """Plan on cells that are far from what is to be avoided, or nearer to it where there is no other way."""
        self._count_planning()
        for planner in self._planners[:-1]:
            with suppress(PlanningError):
                return plan(planner)
        try:
            return plan(self._planners[-1])
        except PlanningError as error:
            if self._planners[-1].kept_off is None:
                raise
            raise PlanningError(f"{error}, if it keeps away from what it is to avoid") from None

    def _count_planning(self) -> None:
        """Count the work of planning, in cells of the map, so that its limit is the same on every machine."""
        self._planned_cells += self.simap.instance.size
        if self._planned_cells > self._max_planned_cells:
            raise PlanningError(f"stopped: the program would plan over more than {self._max_planned_cells:g} cells")

    def _certain(self, value: Any) -> Any:
        """Return the nearest certain one for what is only called the nearest of its name, where that is doubtful."""
        if not isinstance(value, Things) or not value.surer or value.after:
            return value
        return self.grounding.surer(value) if value.items[0].id in self.simap.doubtful else value

    def _called(self, thing: Instance) -> str:
        """Return what a thing is called in an error: by its number where it has its like."""
        alone = sum(other.label == thing.label for other in self.simap.objects) < 2
        return f"the {thing.label}" if alone else thing.name

    def _go_to_side(self, primitive: str, name: Named, instance: int | Named, where: str, words: str) -> None:
        """Drive to the point beside an object, on a side of it; left and right are as the robot sees them now."""
        target = self.grounding.pick(name, instance)
        centroid = np.array(target.centroid_m[:2])
        side = self.grounding.way_of(where, centroid)
        beyond_m = self._extent_m(target, side) + self.planner.robot.radius_m + CLEARANCE_M
        seen = " as seen from the robot" if where in ("left", "right") else ""
        self._go_beside(primitive, target, centroid + side * beyond_m, f"{words} {self._called(target)}{seen}")

    def _go_beside(self, primitive: str, target: Instance, point_m: NDArray, what: str) -> None:
        """Drive to a point, or near it: on that side of an object still, and where the object is seen from."""
        centroid = np.array(target.centroid_m[:2])
        away_m = float(np.hypot(*(point_m - centroid)))
        side = (point_m - centroid) / away_m
        x, y = _cell_centres(self.simap)
        along = (x - centroid[0]) * side[0] + (y - centroid[1]) * side[1]
        across = np.abs((y - centroid[1]) * side[0] - (x - centroid[0]) * side[1])
        path = self._plan_near(
            point_m[None],
            what,
            allowed=(along >= min(self._extent_m(target, side), away_m)) & (across <= along),
            see_through=self._see_through(target),
            watch_m=centroid,
            must_see=True,
        )
        self._go(primitive, path, target)

    def _extent_m(self, target: Instance, side: NDArray) -> float:
        """Return how far an object reaches from its centroid to a side (unit vector [2], map frame), metres."""
        offsets = self.grounding.cells_of(target) - target.centroid_m[:2]
        return float((offsets @ side).max()) + self.simap.spec.cell_size_m / 2.0

    def _gap_middle(self, a: Instance, b: Instance) -> NDArray:
        """Return the middle of the part of the line between two centroids that lies in neither object."""
        start, end = np.array(a.centroid_m[:2]), np.array(b.centroid_m[:2])
        share = np.linspace(0.0, 1.0, 2001)
        points = start + share[:, None] * (end - start)
        ids = self.simap.instance[self.simap.spec.cells_of(points)]
        leave = share[ids == a.id].max(initial=0.0)
        enter = share[(ids == b.id) & (share > leave)].min(initial=1.0)
        return start + (leave + enter) / 2.0 * (end - start)

    def _turn_to(self, primitive: str, name: Named, instance: int | Named, offset_rad: float) -> None:
        """Turn so that the object's centroid, or the room's middle, lies at ``-offset_rad`` from straight ahead."""
        room = self.grounding.room_of(name)
        if room is None:
            thing = self.grounding.pick(name, instance)
            about = (thing.label, thing.id)
            goal = Goal(primitive, *about, thing.centroid_m[:2], None, None, self._words, *self._chosen_of(thing.id))
        else:
            goal = Goal(primitive, room.name, None, room.centre_m)
        x, y = goal.point_m
        bearing = float(np.arctan2(y - self.pose.y_m, x - self.pose.x_m))
        self.goals.append(goal)
        self._spin(wrap_angle(bearing + offset_rad - self.pose.yaw_rad))

    def _spin(self, angle_rad: float) -> None:
        poses = spin(self.pose, float(angle_rad), self._motion)
        self._poses.append(poses)
        self.grounding.viewer = Pose2(*self._here, float(poses[-1, 2]))

    def _go(self, primitive: str, path: Path, target: Instance | None, other: Instance | None = None) -> None:
        about = (target.label, target.id) if target else (None, None)
        self._add_path(path.points_m, drive(path, self.pose.yaw_rad, self._motion), primitive, about, other)

    def _add_path(
        self,
        points_m: NDArray,
        poses: NDArray,
        primitive: str,
        about: tuple[str | None, int | None] = (None, None),
        other: Instance | None = None,
    ) -> None:
        length_m = Path(points_m).length_m
        if self.path_length_m + length_m > self._max_path_m:
            raise PlanningError(f"stopped: the program would drive more than {self._max_path_m:g} m")
        self.path_length_m += length_m
        end = (float(points_m[-1, 0]), float(points_m[-1, 1]))
        self.path_m += [(float(x), float(y)) for x, y in points_m[1:]]
        self.grounding.viewer = Pose2(*end, float(poses[-1, 2]))
        self._poses.append(poses)
        beyond = (other.label, other.id) if other else (None, None)
        self.goals.append(Goal(primitive, *about, end, *beyond, self._words, *self._chosen_of(about[1])))

    def _chosen_of(self, number: int | None) -> tuple[tuple[int, ...], tuple[float, ...], str]:
        chosen = zip(self._among, (self._away_m, ()), (self._ranking, ""), strict=True)
        return next((one for one in chosen if number in one[0]), ((), (), ""))


def _cell_centres(simap: SIMap) -> tuple[NDArray, NDArray]:
    """Return x [1, cols] and y [rows, 1] of the cells' centres, metres."""
    spec = simap.spec
    x = spec.x0_m + (np.arange(spec.cols) + 0.5) * spec.cell_size_m
    y = spec.y0_m + (np.arange(spec.rows) + 0.5) * spec.cell_size_m
    return x[None, :], y[:, None]
