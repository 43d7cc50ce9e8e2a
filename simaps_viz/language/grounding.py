"""What names and ranks mean on one map, seen from one pose: which instances, where their cells are, how far apart.

Distances are in metres on the map plane between the centres of the nearest cells, so they are from edge to edge to
within a cell; 1 is the closest, ties go to the smaller instance id.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import plain
from simaps_viz.errors import CommandError, PlanningError
from simaps_viz.language.cells import (
    FIELD_OF_VIEW_RAD,
    Packed,
    Sight,
    cells_of_map,
    nearest_others,
    pairs_within,
    wall_cells,
)
from simaps_viz.language.words import ANY, KNOWN_THINGS, Vocabulary, plural, singular
from simaps_viz.structures import Instance, Pose2, Room, SIMap

OPAQUE_HEIGHT_M: Final = 1.5
"""Cells at least this high cannot be looked over by a robot that drives there."""
MAX_LOOKED: Final = 100_000_000
"""What the functions of one program may look at together: cells, and pairs of things."""
_ALL: Final = ("anything", "everything", "something", "all")


@dataclass(frozen=True)
class Candidate:
    """An instance that a phrase could mean."""

    rank: int
    """1 is the closest to where the command was given."""
    instance: Instance
    distance_m: float


@dataclass(frozen=True)
class Things:
    """A set: things, or rooms, in an order, and what they are in words."""

    items: tuple[Any, ...]
    """Instances, or rooms."""
    noun: str
    """In the singular, as in "chair"."""
    nouns: str
    before: tuple[str, ...] = ()
    """Words before the noun, as in ("red",)."""
    after: str = ""
    """Words after it, as in "on your left"."""
    missing: str | None = None
    """Where the map lacks what was named: the sentence that says so."""
    elsewhere: tuple[Any, ...] = ()
    """Of an empty set of what is in a room: the nearest of that name in another one."""
    instead: tuple[Any, ...] = ()
    """What else of its name may be meant where a relation fits none of it, as of "the table" another table."""
    most: str = ""
    """What the first is among them, as in "leftmost"; said of it once it is chosen."""
    levels: tuple[float, ...] = ()
    """Of a set in an order: how far along it each is, in the smallest step that the map can tell."""
    tied: tuple[Any, ...] = ()
    """Once the first were chosen: those that are as near, as large and so on, as far as the map can tell."""
    surer: tuple[Any, ...] = ()
    """Of the nearest, if that is doubtful or behind a wall: the nearest that is not, which others are looked for by."""

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.items)

    @property
    def one(self) -> str:
        """One of it in words: "red chair on your left"."""
        return " ".join([*self.before, self.noun, *self.after.split()])

    @property
    def many(self) -> str:
        """Several of it in words: "red chairs on your left"."""
        return " ".join([*self.before, self.nouns, *self.after.split()])

    @property
    def the(self) -> str:
        """Return the set as it is spoken of: "the red chair", "the red chairs", or "a red chair" of an empty one."""
        return f"the {self.one if len(self) == 1 else self.many}" if self.items else with_article(self.one)

    def number(self, n: int | None = None) -> str:
        """Return how many there are in words: "no red chair", "1 red chair", "3 red chairs"."""
        n = len(self) if n is None else n
        return f"no {self.one}" if n == 0 else f"{n} {self.one if n == 1 else self.many}"

    def none(self) -> str:
        """Return the sentence that there are none."""
        if self.missing:
            return self.missing
        where = "" if self.after else " on this map"
        if self.noun == "thing" and not self.before:
            return f"There is nothing {self.after or 'on this map'}."
        return f"There is no {self.one}{where}."

    def expect(self, n: int, asked: str = "") -> None:
        """Raise CommandError, which says how many there are, unless there are at least n.

        Args:
            n: how many are needed.
            asked: what was asked for, as in "the 4th was"; by default "4 were".
        """
        if not self.items:
            raise CommandError(self.none())
        if len(self) < n:
            there = f"is only 1 {self.one}" if len(self) == 1 else f"are only {len(self)} {self.many}"
            where = "" if self.after else " on this map"
            raise CommandError(f"There {there}{where}; {asked or f'{n} were'} asked for.")

    def nth(self, rank: int) -> Any:
        """Return one by its rank, from 1 or, from the end, from -1; CommandError when there are too few."""
        from_end = " from the end" if rank < 0 else ""
        self.expect(abs(rank), f"the {ordinal(abs(rank))}{from_end} was")
        return self.items[rank - 1 if rank > 0 else rank]

    def first(self, n: int) -> "Things":
        """Return the first n; CommandError when there are too few."""
        self.expect(n)
        before = (self.most, *self.before) if self.most and n < len(self) else self.before
        left = zip(self.items[n:], self.levels[n:], strict=False)
        tied = tuple(item for item, level in left if level - self.levels[n - 1] <= 1.0 + 1e-9)
        return replace(self, items=self.items[:n], before=before, most="", levels=(), tied=tied)

    def of(self, items: Sequence[Any], before: str = "", after: str = "") -> "Things":
        """Return other things of this kind, with more words before or after the noun."""
        words = (*([before] if before else []), *self.before)
        after = f"{self.after} {after}".strip()
        return replace(self, items=tuple(items), before=words, after=after, levels=(), tied=())


Named = str | Instance | Things
"""What an argument may call things by: a name, one of them, or a set."""


class Grounding:
    """Answers which instance is meant, for one map and one viewer.

    Args:
        simap: the map.
        viewer: the robot's pose: ranks, left and right are those of this moment. May be set anew.
        field_of_view_rad: full horizontal angle of what is in view.
        eye_height_m: height of the camera; by default that of the map's recording.
        max_looked: how many cells and pairs of things may be looked at before PlanningError.
    """

    def __init__(
        self,
        simap: SIMap,
        viewer: Pose2,
        *,
        field_of_view_rad: float = FIELD_OF_VIEW_RAD,
        eye_height_m: float | None = None,
        max_looked: float = MAX_LOOKED,
    ) -> None:
        self.simap = simap
        self.cells = cells_of_map(simap)
        self._eye = {"field_of_view_rad": field_of_view_rad, "eye_height_m": eye_height_m}
        self._looked, self._max_looked = 0.0, max_looked
        self._vocabulary = Vocabulary(simap.counts(hidden=True))
        self.viewer = viewer

    @property
    def viewer(self) -> Pose2:
        """The pose that ranks, sides and views refer to."""
        return self._viewer

    @viewer.setter
    def viewer(self, pose: Pose2) -> None:
        self._viewer = pose
        self._from_here: NDArray | None = None

    @property
    def sight(self) -> Sight:
        """What can be seen from where the viewer is."""
        self._eyes.viewer = self.viewer
        return self._eyes

    @cached_property
    def _eyes(self) -> Sight:
        return Sight(self.simap, self.viewer, **self._eye)

    @cached_property
    def opaque(self) -> NDArray:
        """The cells that cannot be looked over, bool [rows, cols]."""
        with np.errstate(invalid="ignore"):
            return (self.simap.grid.height_m >= OPAQUE_HEIGHT_M) | wall_cells(self.simap)

    def look(self, cells: float) -> None:
        """Count work, so that its limit is the same on every machine; raise PlanningError beyond the limit."""
        self._looked += cells
        if self._looked > self._max_looked:
            raise PlanningError(f"stopped: the program would look at more than {self._max_looked:g} cells")

    # ---- names

    def labels_of(self, name: str) -> tuple[str, ...]:
        """Return the map's classes a name takes together, or raise CommandError.

        A class of that very name, or its singular, stands alone; a generic name ("seat", "any table") takes all
        classes of its kind, a synonym the most fitting one.
        """
        found = self._vocabulary.resolve("thing" if name.strip().lower() in _ALL else name)
        if found:
            return found.labels
        raise CommandError(self.missing(name))

    def missing(self, name: str) -> str:
        """Return a sentence that the map lacks what a name means, with what may have been meant."""
        near = self._vocabulary.suggest(name)
        hint = f" Did you mean {near}?" if near else "" if self.simap.instances else " It has no objects at all."
        return f"There is no {name.removeprefix(ANY)} on this map.{hint}"

    def label_of(self, name: str) -> str:
        """Return the first of the classes a name takes together, or raise CommandError."""
        return self.labels_of(name)[0]

    def members(self, name: Named) -> tuple[Instance, ...]:
        """Return all that a name means: class by class for a name, in their order for a set."""
        if isinstance(name, Things):
            return tuple(i for i in name.items if isinstance(i, Instance))
        if not isinstance(name, str):
            return (self.pick(name),)
        labels = self.labels_of(name)
        found = [i for label in labels for i in self._of_label.get(label, ())]
        return tuple(sorted(found, key=lambda i: i.id in self.hidden_ids))

    def named(self, name: str) -> Things:
        """Return the things of a name, the closest first; the empty set, which knows why, where the map has none."""
        word = singular(plain(name.strip().removeprefix(ANY)))
        try:
            labels = self.labels_of(name)
        except CommandError as error:
            known = word in KNOWN_THINGS or plain(name) in KNOWN_THINGS
            return Things((), word if known else name.strip(), plural(word), missing=str(error))
        noun = "thing" if name.strip().lower() in _ALL else plain(labels[0]) if len(labels) == 1 else word
        return Things(self.instances(name), noun, plural(noun))

    @cached_property
    def hidden_ids(self) -> frozenset[int]:
        """Ids of the things that no cell shows."""
        return frozenset(i.id for i in self.simap.hidden)

    @cached_property
    def _of_label(self) -> dict[str, list[Instance]]:
        """The things of each class, those that cells show first."""
        found = defaultdict(list)
        for thing in self.simap.objects:
            found[thing.label].append(thing)
        return found

    # ---- ranks

    def ranked(self, things: Sequence[Instance]) -> list[Instance]:
        """Return things in the order of their distance."""
        return sorted(things, key=lambda i: (self.distance_m(i), i.id))

    def candidates(self, name: Named) -> tuple[Candidate, ...]:
        """Return all instances a name may mean, the closest first, with their distances."""
        ranked = self.ranked(self.members(name))
        return tuple(Candidate(k, i, self.distance_m(i)) for k, i in enumerate(ranked, start=1))

    def instances(self, name: Named) -> tuple[Instance, ...]:
        """Return all instances a name may mean, the closest first."""
        return tuple(self.ranked(self.members(name)))

    def pick(self, name: Named, which: int | Named = 1) -> Instance:
        """Return the instance of that rank, or the given one once its class is checked; of a set, by its order."""
        if isinstance(which, Things):
            which = which.nth(1)
        if isinstance(which, Instance):
            if isinstance(name, str) and which.label != name and which.label not in self.labels_of(name):
                wanted = self.label_of(name) if len(self.labels_of(name)) == 1 else name
                raise CommandError(f"instance {which.id} is a {which.label}, but a {wanted} was asked for")
            return which
        if isinstance(name, str):
            self.labels_of(name)
            name = self.named(name)
        elif not isinstance(name, Things):
            name = one_thing(name)
        if not isinstance(which, int) or which < 1:
            raise CommandError(f"ranks count from 1, the closest; {which} was asked for")
        found = name.nth(which)
        if not isinstance(found, Instance):
            raise CommandError(f"expected a thing, found the room {found.name}")
        return found

    def pair(self, other_a: Named, other_b: Named) -> tuple[Instance, Instance]:
        """Return two different instances for two names, sets or instances; equal names mean the two closest."""
        a = self.pick(other_a)
        if isinstance(other_b, Instance):
            b = other_b
        else:
            second = self.named(other_b) if isinstance(other_b, str) else other_b
            second = second if isinstance(second, Things) else one_thing(second)
            b = next((i for i in second.items if i != a), None)
            b = self.pick(one_thing(b) if b is not None else second, 1 if b is not None else 2)
        if a.id == b.id:
            raise CommandError(f"between needs two different objects, but the same {a.label} was named twice")
        return a, b

    # ---- distances

    def distance_m(self, instance: Instance) -> float:
        """Return the distance from the viewer to the centre of the instance's nearest cell."""
        if self._from_here is None:
            self.look(self.cells.size)
            self._from_here = self.cells.from_point(self.viewer.x_m, self.viewer.y_m)
        return float(self._from_here[self.cells.row_of[instance.id]])

    def cells_of(self, instance: Instance) -> NDArray:
        """Return the centres of the instance's cells, float64 [n, 2], map frame."""
        return self.cells.of(instance.id)

    def rows(self, things: Sequence[Instance]) -> NDArray:
        """Return the things' numbers in the arrays of ``cells``, int64 [n]."""
        return np.array([self.cells.row_of[i.id] for i in things], np.int64)

    def centroids(self, things: Sequence[Instance]) -> NDArray:
        """Return the things' centroids, float64 [n, 2], map frame."""
        return self.cells.centroids[self.rows(things)]

    def nearest_of(self, a: Packed, b: Packed) -> tuple[NDArray, NDArray]:
        """Return how far each of some things is from the nearest other thing, and which of them that is.

        Returns:
            float64 [things], metres, infinite where there is none; int64 [things], -1 = none.
        """
        self.look(len(a.ids) * len(b.ids) / 8.0 + len(a.cells) + len(b.cells))
        most = int(10.0 * (self._max_looked - self._looked)) + 1
        squares, which, work = nearest_others(a.cells, a.starts, a.ids, b.cells, b.starts, b.ids, most)
        self.look(work / 10.0)
        return self.cells.metres(squares), which

    def neighbours(
        self, things: Sequence[Instance], others: Sequence[Instance], most_m: float
    ) -> list[tuple[int, int, float]]:
        """Return all pairs of a thing and a different other that are at most that far apart, with their distance.

        Things are given by their position in their sequence.
        """
        a, b = self.cells.pack(things), self.cells.pack(others)
        self.look(len(a.ids) * len(b.ids) / 8.0 + len(a.cells) + len(b.cells))
        most, limit = int(10.0 * (self._max_looked - self._looked)) + 1, self.cells.squares(most_m)
        pairs, work = pairs_within(a.cells, a.starts, a.ids, b.cells, b.starts, b.ids, limit, most)
        self.look(work / 10.0)
        apart = self.cells.metres(pairs[:, 2]).tolist()
        return list(zip(pairs[:, 0].tolist(), pairs[:, 1].tolist(), apart, strict=True))


def one_thing(thing: Any) -> Things:
    """Return the set of one thing, or of one room; CommandError for a position."""
    if isinstance(thing, list):
        raise CommandError("expected a thing, found a position")
    noun = plain(thing.label) if isinstance(thing, Instance) else thing.name
    return Things((thing,), noun, plural(noun))


def the_room(room: Room) -> str:
    """Return "the kitchen", but "room 3"."""
    return room.name if room.name[-1:].isdigit() else f"the {room.name}"


def with_article(words: str) -> str:
    """Return "a chair", "an oven"."""
    return f"{'an' if words[:1] in 'aeiou' else 'a'} {words}"


def ordinal(n: int) -> str:
    """Return "1st", "2nd", "3rd", "4th", "11th"."""
    ending = "th" if n % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}{ending}"
