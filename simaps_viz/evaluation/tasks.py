"""Commands generated from the true world, each with its start, its family and its true meaning.

Which true object a phrase means follows from the meanings written down in ``language.primitives``, asked of the true
world. Each of these functions returns None where people could disagree: where the answer is close, or where another
sensible reading of the same words (nearest edge or middle, left by offset or by bearing, ...) means something else.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import plain
from simaps_viz.errors import CommandError, InputError
from simaps_viz.evaluation.world import TrueObject, World
from simaps_viz.language import words as known_words
from simaps_viz.language.commands import read_command
from simaps_viz.language.words import Vocabulary
from simaps_viz.navigation.robot import CLEARANCE_M
from simaps_viz.structures import Pose2

MARGIN_M: Final = 0.3
"""What is meant is at least this much nearer (or further to a side) than what comes before and after it."""
MIN_CELLS: Final = 12
"""A class with an object of which less is seen from above is not asked for: 12 cells of 5 cm are a book."""
REACH_M: Final = 0.8
"""What is asked for can be approached this closely with elbow room, so that 1 m is no accident."""
CLEARLY_SEEN: Final = 0.3
"""An object is clearly in view when this share of its cells is."""
FIELD_OF_VIEW_RAD: Final = np.pi / 2.0
"""As documented of ``in_view``."""
_ALONE_M: Final = 0.1
_COMPASS: Final = {"north": (0.0, 1.0), "south": (0.0, -1.0), "east": (1.0, 0.0), "west": (-1.0, 0.0)}


@dataclass(frozen=True)
class TrueGoal:
    """Where one part of a command should end."""

    kind: Literal["object", "beside", "between"]
    label: str
    object: int
    """World-wide id of the object that is meant."""
    other: int | None = None
    """The second object of "between"."""
    side: str | None = None
    """Compass word of "beside"."""
    point_m: tuple[float, float] | None = None
    """The documented point, for "beside" and "between"; map frame."""


def ranked(values: Sequence[float] | NDArray, n: int, *others: Sequence[float] | NDArray) -> int | None:
    """Return the index of the n-th smallest value, if it is clear of its neighbours and all readings agree.

    Args:
        values: the documented reading, metres.
        n: 1 is the smallest.
        others: other readings of the same words; the index must be n-th smallest in each.
    """
    order = np.argsort(values, kind="stable")
    if not 1 <= n <= len(order):
        return None
    gaps = np.diff(np.asarray(values, np.float64)[order])
    if (n >= 2 and gaps[n - 2] < MARGIN_M) or (n < len(order) and gaps[n - 1] < MARGIN_M):
        return None
    meant = int(order[n - 1])
    return meant if all(int(np.argsort(v, kind="stable")[n - 1]) == meant for v in others) else None


def nth_closest(objects: Sequence[TrueObject], here_m: NDArray, n: int) -> TrueObject | None:
    """Return the n-th closest to a point, float [2], map frame: by the centre of the nearest cell and by the middle."""
    edges = [o.distance_m(here_m) for o in objects]
    middles = [float(np.linalg.norm(o.centroid_m - here_m)) for o in objects]
    meant = ranked(edges, n, middles)
    return None if meant is None else objects[meant]


def nth_from(objects: Sequence[TrueObject], side: str, n: int, viewer: Pose2) -> TrueObject | None:
    """The n-th counted from a side: by middles, and by edges; left and right also by bearing, all being ahead."""
    here = np.array([viewer.x_m, viewer.y_m])
    ahead = np.array([np.cos(viewer.yaw_rad), np.sin(viewer.yaw_rad)])
    left = np.array([-ahead[1], ahead[0]])
    direction = np.array(_COMPASS[side]) if side in _COMPASS else left if side == "left" else -left
    others = [[-float((o.cells_m @ direction).max()) for o in objects]]
    if side not in _COMPASS:
        offsets = [o.cells_m - here for o in objects]
        if any(float((cells @ ahead).min()) <= 0.0 for cells in offsets):
            return None
        others.append([-float(np.arctan2((c @ direction).mean(), (c @ ahead).mean())) for c in offsets])
    meant = ranked([-float(o.centroid_m @ direction) for o in objects], n, *others)
    return None if meant is None else objects[meant]


def nearest_to(objects: Sequence[TrueObject], targets: Sequence[TrueObject], here_m: NDArray) -> TrueObject | None:
    """Return the object nearest to the closest of the targets; also when "the target" is taken as any of them."""
    target = nth_closest(targets, here_m, 1)
    if target is None or len(objects) < 2:
        return None
    gaps = np.array([[float(t.tree.query(o.cells_m)[0].min()) for o in objects] for t in targets])
    middles = [float(np.linalg.norm(o.centroid_m - target.centroid_m)) for o in objects]
    meant = ranked(gaps[list(targets).index(target)], 1, middles, gaps.min(axis=0))
    return None if meant is None else objects[meant]


def in_view(world: World, objects: Sequence[TrueObject], viewer: Pose2) -> list[TrueObject] | None:
    """Return the objects clearly in view; None if it is not clear of one of them, as how high the camera is matters."""
    seen = []
    for thing in objects:
        if _share_in_view(thing, viewer, FIELD_OF_VIEW_RAD, world.surely_sees) >= CLEARLY_SEEN:
            seen.append(thing)
        elif _share_in_view(thing, viewer, FIELD_OF_VIEW_RAD + np.deg2rad(20.0), world.might_see) > 0.0:
            return None
    return seen


def _share_in_view(
    thing: TrueObject, viewer: Pose2, field_of_view_rad: float, sees: Callable[[NDArray, NDArray, int], bool]
) -> float:
    """Return the share of an object's (at most 60) cells that is in a field of view and that a test says is seen."""
    here = np.array([viewer.x_m, viewer.y_m])
    cells = thing.cells_m[:: max(1, len(thing.cells_m) // 60)]
    bearing = np.arctan2(*(cells - here).T[::-1]) - viewer.yaw_rad
    ahead = np.abs((bearing + np.pi) % (2.0 * np.pi) - np.pi) <= field_of_view_rad / 2.0
    return sum(sees(here, cell, thing.id) for cell in cells[ahead]) / len(cells)


def is_approachable(world: World, thing: TrueObject) -> bool:
    """Return whether a robot can stand near an object and see it, and then nearer to it than to others of its class."""
    distance, cell = thing.tree.query(world.roomy)
    if distance.min() > REACH_M:
        return False
    near = np.flatnonzero(distance <= distance.min() + _ALONE_M)
    some = near[:: max(1, len(near) // 40)]
    nearest_m = thing.cells_m[np.asarray(cell)[some]]
    sees = any(world.sight_is_free(eye, c, thing.id) for eye, c in zip(world.roomy[some], nearest_m, strict=True))
    return sees and _stands_alone(world, thing, world.roomy[near])


def beside(world: World, thing: TrueObject, side: str) -> TrueGoal | None:
    """Return the goal on a compass side of an object, if the robot can stand there and sees the object."""
    direction = np.array(_COMPASS[side])
    extent = float(((thing.cells_m - thing.centroid_m) @ direction).max()) + world.spec.cell_size_m / 2.0
    point = thing.centroid_m + direction * (extent + world.robot.radius_m + CLEARANCE_M)
    if not _can_stand(world, point) or not world.sight_is_free(point, thing.centroid_m, thing.id):
        return None
    if thing.distance_m(point) > REACH_M or not _stands_alone(world, thing, point[None]):
        return None
    return TrueGoal("beside", thing.label, thing.id, side=side, point_m=(float(point[0]), float(point[1])))


def between(world: World, a: TrueObject, b: TrueObject) -> TrueGoal | None:
    """Return the goal in the gap between two objects, if the robot can stand there and sees both."""
    share = np.linspace(0.0, 1.0, 4001)
    line = a.centroid_m + share[:, None] * (b.centroid_m - a.centroid_m)
    ids = world.ids[world.spec.cells_of(line)]
    leaves = share[ids == a.id].max(initial=0.0)
    enters = share[(ids == b.id) & (share > leaves)].min(initial=1.0)
    gap_m = float((enters - leaves) * np.linalg.norm(b.centroid_m - a.centroid_m))
    point = a.centroid_m + (leaves + enters) / 2.0 * (b.centroid_m - a.centroid_m)
    sees = all(world.sight_is_free(point, o.centroid_m, o.id) for o in (a, b))
    if not 0.8 <= gap_m <= 5.0 or not sees or not _can_stand(world, point):
        return None
    return TrueGoal("between", a.label, a.id, other=b.id, point_m=(float(point[0]), float(point[1])))


def side_error_m(world: World, goal: TrueGoal, point_m: Sequence[float]) -> float:
    """How far a point is from being on the goal's side of its object (within 45 degrees of it), metres; 0 = is."""
    thing = world.by_id(goal.object)
    direction = np.array(_COMPASS[goal.side or "north"])
    offset = np.asarray(point_m) - thing.centroid_m
    along, across = float(offset @ direction), abs(float(offset[0] * direction[1] - offset[1] * direction[0]))
    extent = float(((thing.cells_m - thing.centroid_m) @ direction).max()) + world.spec.cell_size_m / 2.0
    return max(extent - along, across - along, 0.0)


def _can_stand(world: World, point_m: NDArray) -> bool:
    return bool(world.roomy_tree.query(point_m)[0] <= 0.25)


def _stands_alone(world: World, thing: TrueObject, points_m: NDArray) -> bool:
    own = thing.tree.query(points_m)[0]
    others = [o.tree.query(points_m)[0] for o in world.of_class(thing.label) if o is not thing]
    return all(bool((own < other).all()) for other in others)


FAMILIES: Final = (
    "plain", "n-th closest", "from a side", "near another", "between", "compass", "in view", "multi-goal", "absent",
)  # fmt: skip
_FILE: Final = files("simaps_viz.evaluation").joinpath("phrasings.json")
PHRASINGS: Final[dict[str, tuple[str, ...]]] = {
    kind: tuple(wordings) for kind, wordings in json.loads(_FILE.read_text(encoding="utf-8")).items()
}
"""{kind of command: how it is worded}. ``{x}``, ``{y}`` and ``{z}`` are things, ``{nth}`` an ordinal word, ``{beyond}``
a rank that the class does not have. ``next_to`` is for two things less than a metre apart; ``absent_things`` are words
for things that scenes seldom have, of which those a scene has are left out.
"""
ORDINALS: Final = tuple(known_words.ORDINALS)[:10]
_MOST: Final = {
    "left": "leftmost", "right": "rightmost", "north": "northernmost", "south": "southernmost", "east": "easternmost",
    "west": "westernmost",
}  # fmt: skip
AWAY_M: Final = 1.5
"""A run starts at least this far from its first goal: whoever does not move gets no point."""
_TRIES: Final = 2000
_STARTS: Final = 40
"""How many starts are tried for one command that few starts suit."""
_SIDES: Final = ("north", "south", "east", "west", "left", "right")


@dataclass(frozen=True)
class Task:
    """One command, and what carrying it out right means."""

    number: int
    """From 0; unique in its set."""
    family: str
    command: str
    start: Pose2
    goals: tuple[TrueGoal, ...]
    """In order; empty when the command is to be refused."""

    @property
    def wants_refusal(self) -> bool:
        """Whether the world lacks what the command asks for."""
        return not self.goals


Meaning = tuple[str, tuple[TrueGoal, ...]]
"""A command and its goals; asked at most once in a set."""
Draft = tuple[Pose2, str, tuple[TrueGoal, ...]]
"""A start, a command and its goals, before it is known that the command can be read."""


def make_tasks(world: World, *, count: int = 100, seed: int = 0) -> tuple[Task, ...]:
    """Make commands of all families, as evenly as the world allows; the same for the same world, count and seed.

    Raises:
        InputError: the world has too little in it.
    """
    maker = _Maker(world, np.random.default_rng([seed, 20_23]))
    found: dict[str, list[Task]] = {family: [] for family in FAMILIES}
    dry: set[str] = set()
    asked: set[Meaning] = set()
    while (made := sum(map(len, found.values()))) < count:
        open_families = [family for family in FAMILIES if family not in dry]
        if not open_families:
            raise InputError(f"{world.name}: expected a world of which {count} commands can be made, found {made}")
        family = min(open_families, key=lambda f: len(found[f]))
        task = maker.draw(family, asked)
        if task is None:
            dry.add(family)
        else:
            found[family].append(task)
    in_order = [task for family in FAMILIES for task in found[family]]
    return tuple(Task(i, t.family, t.command, t.start, t.goals) for i, t in enumerate(in_order))


class _Maker:
    """Draws at random until something comes out that is clear."""

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        self.world, self.rng = world, rng
        clean = {
            label: world.of_class(label)
            for label in world.labels
            if min(len(o.cells_m) for o in world.of_class(label)) >= MIN_CELLS and not is_ambiguous(label, world.labels)
        }
        if not clean:
            raise InputError(f"{world.name}: expected at least one class of objects seen well from above, found none")
        self.objects: dict[str, tuple[TrueObject, ...]] = clean
        self.approachable = {o.id for os in clean.values() for o in os if is_approachable(world, o)}
        known = Vocabulary(world.tops.labels)
        self.absent = [word for word in PHRASINGS["absent_things"] if not known.resolve(word)]
        self._drafts: dict[str, Callable[[], Draft | None]] = {
            "plain": self._plain,
            "n-th closest": self._nth_closest,
            "from a side": self._from_side,
            "near another": self._near,
            "between": self._between,
            "compass": self._compass,
            "in view": self._in_view,
            "multi-goal": self._multi,
            "absent": self._absent,
        }

    def draw(self, family: str, asked: set[Meaning]) -> Task | None:
        """Return a new task of a family and note it in ``asked``; None when many tries gave none."""
        for _ in range(_TRIES):
            draft = self._drafts[family]()
            if draft is None or draft[1:] in asked:
                continue
            start, command, goals = draft
            if self._is_away(start, goals) and self._is_read(command):
                asked.add((command, goals))
                return Task(0, family, command, start, goals)
        return None

    def _start(self) -> Pose2:
        x, y = self.world.roomy[self.rng.integers(len(self.world.roomy))]
        return Pose2.from_heading(round(float(x), 4), round(float(y), 4), float(self.rng.integers(360)))

    def _is_away(self, start: Pose2, goals: Sequence[TrueGoal]) -> bool:
        here = _here(start)
        if not goals:
            return True
        point = goals[0].point_m
        from_object = self.world.by_id(goals[0].object).distance_m(here)
        return (from_object if point is None else float(np.linalg.norm(np.subtract(point, here)))) >= AWAY_M

    def _is_read(self, command: str) -> bool:
        try:
            return not read_command(command, self.world.labels).alternatives
        except CommandError:
            return False

    def _pick(self, options: Sequence[str]) -> str:
        return options[int(self.rng.integers(len(options)))]

    def _label(self, at_least: int = 1) -> str | None:
        labels = [label for label, objects in self.objects.items() if len(objects) >= at_least]
        return self._pick(labels) if labels else None

    def _goal(self, thing: TrueObject | None) -> tuple[TrueGoal, ...] | None:
        if thing is None or thing.id not in self.approachable:
            return None
        return (TrueGoal("object", thing.label, thing.id),)

    def _closest(self, start: Pose2, label: str) -> TrueObject | None:
        return nth_closest(self.objects[label], _here(start), 1)

    def _is_nearest_from(self, before: TrueObject, thing: TrueObject) -> bool:
        """Return whether a thing is also the closest of its class to the goal before it."""
        others = self.objects[thing.label]
        gaps = [float(before.tree.query(o.cells_m)[0].min()) for o in others]
        return ranked(gaps, 1) == others.index(thing)

    def _rank(self, low: int, high: int) -> int:
        return int(self.rng.integers(low, min(high, len(ORDINALS)) + 1))

    # ---- one method for each family: a draft that is clear, or None

    def _plain(self) -> Draft | None:
        start, label = self._start(), self._label() or ""
        goal = self._goal(self._closest(start, label))
        wordings = PHRASINGS["only"] if len(self.objects[label]) == 1 else PHRASINGS["closest"]
        return (start, self._pick(wordings).format(x=plain(label)), goal) if goal else None

    def _nth_closest(self) -> Draft | None:
        start, label = self._start(), self._label(2)
        if label is None:
            return None
        n = self._rank(2, len(self.objects[label]))
        goal = self._goal(nth_closest(self.objects[label], _here(start), n))
        return (start, self._pick(PHRASINGS["nth"]).format(nth=ORDINALS[n - 1], x=plain(label)), goal) if goal else None

    def _from_side(self) -> Draft | None:
        label = self._label(2)
        if label is None:
            return None
        side, n = self._pick(_SIDES), self._rank(1, len(self.objects[label]))
        wording = self._pick(PHRASINGS["outermost"] if n == 1 else PHRASINGS["from_side"])
        words = wording.format(nth=ORDINALS[n - 1], x=plain(label), side=side, most=_MOST[side])
        for _ in range(_STARTS if side in ("left", "right") else 1):  # few starts have the whole class ahead
            start = self._start()
            goal = self._goal(nth_from(self.objects[label], side, n, start))
            if goal is not None:
                return start, words, goal
        return None

    def _near(self) -> Draft | None:
        start, label, other = self._start(), self._label(2), self._label()
        if label is None or other is None or label == other:
            return None
        found = nearest_to(self.objects[label], self.objects[other], _here(start))
        goal = self._goal(found)
        if found is None or goal is None:
            return None
        gap_m = min(float(found.tree.query(o.cells_m)[0].min()) for o in self.objects[other])
        wordings = PHRASINGS["near"] + (PHRASINGS["next_to"] if gap_m < 1.0 else ())
        return start, self._pick(wordings).format(x=plain(label), y=plain(other)), goal

    def _between(self) -> Draft | None:
        start, label, other = self._start(), self._label() or "", self._label() or ""
        a, b = self._closest(start, label), self._closest(start, other)
        if a is None or b is None or label == other:
            return None
        goal = between(self.world, a, b)
        return (
            (start, self._pick(PHRASINGS["between"]).format(x=plain(label), y=plain(other)), (goal,)) if goal else None
        )

    def _compass(self) -> Draft | None:
        start, label, side = self._start(), self._label() or "", self._pick(_SIDES[:4])
        thing = self._closest(start, label)
        goal = thing and beside(self.world, thing, side)
        return (start, self._pick(PHRASINGS["compass"]).format(x=plain(label), side=side), (goal,)) if goal else None

    def _in_view(self) -> Draft | None:
        label = self._label(2) or self._label() or ""
        n = self._rank(1, min(len(self.objects[label]), 3))
        wording = self._pick(PHRASINGS["first_in_view"] if n == 1 else PHRASINGS["in_view"])
        for _ in range(_STARTS):
            start = self._start()
            seen = in_view(self.world, self.objects[label], start)
            goal = self._goal(nth_closest(seen, _here(start), n)) if seen else None
            if goal is not None:
                return start, wording.format(nth=ORDINALS[n - 1], x=plain(label)), goal
        return None

    def _multi(self) -> Draft | None:
        start, wording = self._start(), self._pick(PHRASINGS["multi"])
        labels = [self._label() or "" for _ in range(3 if "{z}" in wording else 2)]
        things = [self._closest(start, label) for label in labels]
        goals = [goal for thing in things for goal in self._goal(thing) or ()]
        if len(goals) < len(labels) or len(set(labels)) < len(labels):
            return None
        if not all(self._is_nearest_from(a, b) for a, b in pairwise(things) if a and b):
            return None
        return start, wording.format(**dict(zip("xyz", map(plain, labels), strict=False))), tuple(goals)

    def _absent(self) -> Draft | None:
        start, label, wording = self._start(), self._label() or "", self._pick(PHRASINGS["absent"])
        count = len(self.objects[label])
        if ("{absent}" in wording and not self.absent) or ("{beyond}" in wording and not 2 <= count < len(ORDINALS)):
            return None
        beyond = ORDINALS[min(count, len(ORDINALS) - 1)]
        absent = self._pick(self.absent) if self.absent else ""
        return start, wording.format(x=plain(label), beyond=beyond, absent=absent), ()


def is_ambiguous(label: str, labels: Sequence[str]) -> bool:
    """Return whether the plain word for a class is read as anything but that class alone."""
    try:
        reading = read_command(f"go to the {plain(label)}", labels)
    except CommandError:
        return True
    return bool(reading.alternatives) or reading.program.strip() != f'robot.move_to_object("{label}")'


def _here(start: Pose2) -> NDArray:
    return np.array([start.x_m, start.y_m])
