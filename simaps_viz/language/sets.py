"""The functions of programs: sets of things, their order, sizes and places, evaluated from where the robot is.

Each method `_name` of `Sets` carries out the function of that name in ``functions.json``, which holds its meaning. What
a phrase of the meaning comes to:

- *Next to* is at most 1 m, edge to edge: a chair pulled back from its table is still that table's.
- A *side* is a direction: north is +y, east is +x. Of the robot it is measured from its heading. Of a thing, *front*
  is towards the robot, *behind* away from it, and *left* a quarter turn counter-clockwise from robot -> thing.
- *On* a thing is what has at least half of its cells within the convex outline of the thing's cells, a higher top,
  fewer cells, and does not begin more than 0.4 m above the thing's top, as a picture over a desk does.
- *Length* and *width* are those of the smallest rectangle around the cells, of any direction; *height* is the highest
  cell's. *Round* fills at least 82 % of the smallest circle around it, *long* is at least 1.6 times as long as wide,
  *square* is at most 1.25 times as long as wide, and not round.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from simaps_viz.colors.classes import plain
from simaps_viz.colors.naming import has_color, lab
from simaps_viz.errors import CommandError, InputError, PlanningError
from simaps_viz.language.cells import Packed, wall_cells
from simaps_viz.language.grounding import (
    MAX_LOOKED,
    Grounding,
    Named,
    Things,
    one_thing,
    ordinal,
    the_room,
    with_article,
)
from simaps_viz.language.primitives import SAID, SELF, Primitive
from simaps_viz.language.telling import told
from simaps_viz.language.words import KINDS, plural
from simaps_viz.structures import Instance, Path, Pose2, Room, SIMap

NEXT_TO_M: Final = 1.0
BESIDE_M: Final = 3.0
"""How far from a thing what is on its left, right, front or back may be, edge to edge, where something is that near."""
_CLEARLY_M: Final = 0.3
"""How much nearer to another table a seat stands that is not at this one."""
_BEHIND_M: Final = 0.5
"""How much nearer to the table the seat is that another one stands behind."""
_SEATS: Final = frozenset(("chair", "stool", "bar stool", "office chair"))
_TABLES: Final = frozenset((*KINDS["table"], "desk", "counter", "kitchen counter", "bar"))
_BOARDS: Final = ("shelf", "shelves", "bookcase", "rack")
"""What one thing stands on above another: how its name ends."""
CLEARANCE_M: Final = 0.3
"""Gap between the robot's hull and the thing that it stops beside."""
_AT_WALL_M: Final = 0.35
_IN_CORNER_M: Final = 0.6
_HANGING_M: Final = 0.4
"""What begins that far above a top hangs over it: it does not stand on it."""
_NOBODY_M: Final = 0.5
_WITHIN: Final = 0.5
_RELATIONS: Final = ("near", "on", "under", "inside", "side", "between")
"""Functions to which "the table" may be another than the nearest, see `the`."""
_BY_ANCHOR: Final = (*_RELATIONS, "opposite", "facing", "order", "nearest", "farthest")
"""Functions whose arguments other than S are what things are looked for by."""
ALIKE: Final = 0.05
"""Share by which areas may differ and still be taken for as large, see `Sets._sorted_by`."""
_SPECK_M2: Final = 0.05
_DOORS: Final = ("door", "doorway", "entrance", "exit")
_MAX_LISTED: Final = 8
_NO_COLORS: Final = "The colours of things are not known on this map."
_ACROSS_M: Final = 0.6
"""What is opposite a thing is at least this far from it: the table in front of a couch is not."""
_ROUND, _LONG, _SQUARE, _OBLONG = 0.82, 1.6, 1.25, 1.15
_ROUGHLY_ROUND, _BOXY = 0.7, 0.89
"""The share that a square fills of its circle is .64; of its box a circle fills .79, a square all."""
_DIAGONAL: Final = float(np.sqrt(0.5))
_COMPASS: Final = {
    "north": (0.0, 1.0), "south": (0.0, -1.0), "east": (1.0, 0.0), "west": (-1.0, 0.0),
    "north east": (_DIAGONAL, _DIAGONAL), "north west": (-_DIAGONAL, _DIAGONAL),
    "south east": (_DIAGONAL, -_DIAGONAL), "south west": (-_DIAGONAL, -_DIAGONAL),
}  # fmt: skip
_TURNS: Final = {"front": 0.0, "left": 0.5 * np.pi, "behind": np.pi, "right": -0.5 * np.pi}
_MOST_IN_PLACE: Final = tuple(SAID["most"][key] for key in ("far", *_TURNS, *_COMPASS))
"""What the first of an order is called where doubtful things come after the certain ones."""
_BY_SIZE: Final[dict[str, tuple[str, int]]] = SAID["by_size"]
"""{key of order: what it measures, and 1 where the most of it comes first, else -1}."""

Lap = Callable[[Sequence[Instance], float], list[list[float]]]
"""(things that stand together, turns) -> the positions of a loop all around them; raises PlanningError."""
Route = Callable[[Sequence[Any]], Path]
"""(things or rooms, one or two) -> the way from where the robot is, or from the first, to the last."""
KeepOff = Callable[[NDArray, Sequence[Instance], str, float | None], None]
"""(cells, the things on them, what they are in words, metres) -> None: later drives keep that far from them."""


class Position(list[float]):
    """A position [x, y], metres, map frame, that knows what it was made from.

    Args:
        point: x and y.
        thing: that it was made from.
        side: where it is of the thing, in words, if the robot has to be on that very side: "behind".
    """

    def __init__(self, point: Sequence[float] | NDArray, thing: Instance | None = None, side: str = "") -> None:
        super().__init__([float(point[0]), float(point[1])])
        self.thing, self.side = thing, side


class Sets(Grounding):
    """Carries out functions and look-ups on one map, from where the robot is.

    Args:
        simap: the map.
        viewer: where the robot is; set it anew whenever the robot has moved.
        start: where the command was given; by default the viewer.
        lap: makes the positions of a loop around things.
        route: plans a way that is only told.
        keep_off: keeps later drives away from things.
        radius_m: of the robot.
        options: as for `Grounding`.
    """

    def __init__(
        self,
        simap: SIMap,
        viewer: Pose2,
        start: Pose2 | None = None,
        *,
        lap: Lap | None = None,
        route: Route | None = None,
        keep_off: KeepOff | None = None,
        radius_m: float = 0.2,
        max_looked: float = MAX_LOOKED,
        **options: Any,
    ) -> None:
        super().__init__(simap, viewer, max_looked=max_looked, **options)
        self.start = start or viewer
        self.answer: dict[str, Any] | None = None
        """What ``tell`` answered so far: text, value (of several questions a list), instances."""
        self._values: list[Any] = []
        self.counted: list[Things] = []
        """What was counted since ``tell`` answered last and nothing else was measured."""
        self.notes: dict[str, None] = {}
        """What was chosen although the map cannot tell it from others, in words."""
        self.anchors: dict[int, None] = {}
        """Ids of the single things that others were looked for by: of "the chair by the oven" the oven."""
        self.among: tuple[int, ...] = ()
        """Ids of the things that the last choice was made of, in the order of that choice."""
        self.away_m: tuple[float, ...] = ()
        """How far each of them is from what the nearest to it, or the farthest from it, was asked for; else empty."""
        self.ranking = ""
        """How many they are and how they were ordered, in words: "3 chairs, the leftmost first"."""
        self._make_lap, self._keep_off, self._radius_m = lap, keep_off, radius_m
        self.route = route

    def call(self, function: Primitive, arguments: Mapping[str, Any]) -> Any:
        """Carry out a function with all its arguments by name, checked.

        Raises:
            CommandError: in words, when there is nothing or too little of what is asked for.
            PlanningError: when there is no way around, or the work exceeds its limit.
        """
        self.look(sum(len(value) for value in arguments.values() if isinstance(value, Things)) + 1)
        if function.name in _BY_ANCHOR:
            arguments = {name: value if name == "S" else self.surer(value) for name, value in arguments.items()}
        if function.name in ("distance", "size"):
            self.counted.clear()
        found = getattr(self, f"_{function.name}")(**arguments)
        before = dict(self.anchors)
        if isinstance(found, Things) and not found.items and function.name in _RELATIONS:
            # "The bottles on the counter" are on that counter which has bottles, if the nearest has none.
            for name, value in arguments.items():
                for other in value.instead if name != "S" and isinstance(value, Things) else ():
                    fitting = self.call(function, {**arguments, name: one_thing(other)})
                    if fitting.items:
                        return fitting
                    self.anchors = dict(before)
        if function.name in _BY_ANCHOR:
            self._note_anchors(*(value for name, value in arguments.items() if name != "S"))
        return found

    def _note_anchors(self, *values: Any) -> None:
        """Remember those values that are one thing as what others were looked for by."""
        for value in values:
            one = value.items[0] if isinstance(value, Things) and len(value) == 1 else value
            if isinstance(one, Instance):
                self.anchors[one.id] = None

    def surer(self, value: Any) -> Any:
        """Return the nearest that is neither doubtful nor behind a wall instead of one that is, and note that."""
        if not isinstance(value, Things) or not value.surer:
            return value
        taken, (nearest,) = value.surer[0], value.items
        self.notes = {note: None for note in self.notes if not note.endswith(f": {nearest.name} is taken.")}
        why = "doubtful" if nearest.id in self.simap.doubtful else "behind a wall"
        self.notes[f"{nearest.name.capitalize()} is nearer, but {why}: {taken.name} is taken."] = None
        return replace(value, items=value.surer, surer=())

    # ---- what arguments mean

    def set_of(self, named: Named) -> Things:
        """Return a set as it is, that of one thing or room, or all things of a name."""
        if isinstance(named, Things):
            return named
        return self.named(named) if isinstance(named, str) else one_thing(named)

    def things_of(self, named: Named) -> list[Instance]:
        """Return the things of a set; CommandError when rooms are among them."""
        items = self.set_of(named).items
        rooms = [item for item in items if not isinstance(item, Instance)]
        if rooms:
            raise CommandError(f"expected things, found the room {rooms[0].name}")
        return list(items)

    def thing_of(self, named: Named) -> Instance:
        """Return the one thing that is meant: the closest of a name, the first of a set."""
        return self.pick(named, 1)

    def room_of(self, value: Any) -> Room | None:
        """Return the room that an argument is, or None: a room, the first of a set of rooms, a name of rooms only."""
        if isinstance(value, Things):
            value = value.items[0] if value.items else None
        if value is None or isinstance(value, Instance | list):
            return None
        if not isinstance(value, str):
            return value
        known = self._vocabulary.resolve(value) is not None
        found = () if known or not value.strip() else self._rooms_called(value)
        return found[0] if found else None

    def _all_rooms(self) -> tuple[Room, ...]:
        rooms = self.simap.rooms
        if not rooms:
            raise CommandError("This map has no rooms.")
        return rooms

    def _rooms_called(self, name: str) -> tuple[Room, ...]:
        if not self.simap.rooms:
            return ()
        return self._by_distance(self.simap.rooms_named(name))

    def _by_distance(self, rooms: Sequence[Room]) -> tuple[Room, ...]:
        far = self._far(rooms, SELF)
        return tuple(rooms[k] for k in sorted(range(len(rooms)), key=lambda k: (far[k], rooms[k].id)))

    def _here(self) -> Room:
        return self.simap.room_at(self.viewer.x_m, self.viewer.y_m) or self._by_distance(self._all_rooms())[0]

    def _cells_of_room(self, room: Room) -> NDArray:
        """Return the centres of a room's cells, float64 [n, 2]."""
        self.look(self.simap.instance.size)
        return self.cells.centres(np.argwhere(self.simap.room_cells == room.id))

    def _pack(self, items: Sequence[Any]) -> Packed:
        """Return the cells of things or of rooms."""
        if not items or isinstance(items[0], Instance):
            return self.cells.pack(items)
        self.look(len(items) * self.simap.instance.size)
        parts = [np.argwhere(self.simap.room_cells == room.id) for room in items]
        starts = np.cumsum([0, *map(len, parts)], dtype=np.int64)
        return Packed(np.concatenate(parts), starts, np.zeros(len(items), np.int64))

    def _point_of(self, value: Any) -> NDArray | None:
        """Return a position, or that of the robot, [2]; None for a value that is not a point."""
        if isinstance(value, str) and value in ("", SELF):
            return np.array([self.viewer.x_m, self.viewer.y_m])
        return np.array(value, np.float64) if isinstance(value, list) else None

    def _far(self, items: Sequence[Any], value: Any) -> NDArray:
        """Return how far things, or rooms, are from a point, a room or the nearest of some things, float64 [n]."""
        point = self._point_of(value)
        in_rooms = bool(items) and not isinstance(items[0], Instance)
        if point is None:
            room = self.room_of(value)
            in_rooms |= room is not None
            far = self.nearest_of(self._pack(items), self._pack(self._some(value).items if room is None else [room]))[0]
        elif in_rooms:
            far = np.array([np.hypot(*(self._cells_of_room(room) - point).T).min() for room in items])
        else:
            self.look(self.cells.size)
            far = self.cells.from_point(*point)[self.rows(items)]
        return np.where(far <= self.simap.spec.cell_size_m + 1e-9, 0.0, far) if in_rooms else far

    def _some(self, value: Any) -> Things:
        found = self.set_of(value)
        found.expect(1)
        return found

    def middle_of(self, value: Any) -> tuple[NDArray, Instance | None]:
        """Return the position that a value stands at [2], and the thing, if it is one."""
        point = self._point_of(value)
        if point is not None:
            return point, getattr(value, "thing", None)
        room = self.room_of(value)
        if room is not None:
            return np.array(room.centre_m, np.float64), None
        thing = self.thing_of(value)
        return np.array(thing.centroid_m[:2]), thing

    # ---- sources

    _things = Grounding.named

    def _search(self, words: str) -> Things:
        known = self.named(words)
        if known.items:
            return known
        if words in _DOORS and self.simap.rooms and (here := self._here()).doors:
            way = f'the way out of {the_room(here)} is known as an opening: say "go to the door"'
            return replace(known, missing=f"There is no {words} on this map, but {way}.")
        try:
            found = self.simap.search(words, k=len(self.simap.instances))
        except CommandError:
            return replace(known, noun=words, nouns=words)
        return Things(tuple(one.instance for one in found), words, words)

    def _room(self, name: Any) -> Room:
        if not isinstance(name, str):
            room = self.room_of(name)
            if room is None:
                self._all_rooms()
                thing = self.thing_of(name)
                room = self.simap.room_of(thing.id)
                if room is None:
                    raise CommandError(f"The {thing.label} is in no room of this map.")
            return room
        if name.strip().lower() == "other":
            return self._next_room()
        found = self._rooms(name) if name.strip() else one_thing(self._here())
        if not found.items and self._all_rooms() and self._vocabulary.resolve(name):
            return self._room(self.thing_of(name))  # the name of a thing
        return found.nth(1)

    def _next_room(self) -> Room:
        """Return the other room that is first reached by driving; the nearest where no way into any is known."""
        beyond = {door.room for door in self._here().doors}
        others = self._rooms("other")
        ways: list[tuple[float, int]] = []
        for at, room in enumerate(others.items):
            if self.route and room.id in beyond:
                with suppress(PlanningError):
                    ways.append((self.route([room]).length_m, at))
        return others.items[min(ways)[1]] if ways else others.nth(1)

    def _rooms(self, name: str) -> Things:
        word = name.strip().lower()
        if word in ("", "other"):
            rooms = self._by_distance(self._all_rooms())
            here = self._here() if word else None
            return Things(tuple(r for r in rooms if r is not here), f"{word} room".strip(), f"{word} rooms".strip())
        found = self._rooms_called(name)
        if found or not self.simap.rooms:
            missing = None if found else f"There is no {word} on this map, which has no rooms."
            return Things(found, word, plural(word), missing=missing)
        has = ", ".join(room.name for room in self.simap.rooms[:8])
        return Things((), word, plural(word), missing=f"There is no {word} on this map. It has: {has}.")

    # ---- filters

    def _keep(self, S: Named, kept: Sequence[bool] | NDArray, before: str = "", after: str = "") -> Things:
        found = self.set_of(S)
        return found.of([i for i, keep in zip(found.items, kept, strict=True) if keep], before, after)

    def _relate(self, S: Named, T: Named, kept: set[int], words: str) -> Things:
        """Keep the things of these ids; where the map has nothing of T's name, say so."""
        other = self.set_of(T)
        found = self._keep(S, [i.id in kept for i in self.set_of(S).items], after=words)
        return replace(found, missing=found.missing or other.missing) if not other.items else found

    def _side(self, S: Named, side: str, of: Any) -> Things:
        things = self.things_of(S)
        centroids = self.centroids(things)
        room = self.room_of(of) if of != "map" else None
        if of == "map" or room is not None:
            name = "the map" if room is None else the_room(room)
            place = "middle" if side == "middle" else f"{side} part"
            return self._keep(S, self._in_part(centroids, side, of), after=f"in the {place} of {name}")
        if side == "middle":
            raise CommandError('the middle is that of a room or of "map"')
        if isinstance(of, str) and of in ("", SELF):
            offset = centroids - (self.viewer.x_m, self.viewer.y_m)
            bearing = np.arctan2(offset[:, 1], offset[:, 0])
            middle, reach = self._bearing_of(side), {"left": 70.0, "right": 70.0, "front": 45.0, "behind": 45.0}
            off = np.abs(np.rad2deg((bearing - middle + np.pi) % (2.0 * np.pi) - np.pi))
            kept = (off <= reach.get(side, 60.0) + 1e-9) & (np.hypot(*offset.T) > 1e-6)
            return self._keep(S, kept, after=SAID["own_side"].get(side, f"to the {side} of you"))
        others = self._some(of)
        kept = self._beside(things, self.things_of(others), side)
        return self._keep(S, kept, after=f"{_side_words(side)} {others.the}")

    def _beside(self, things: Sequence[Instance], others: Sequence[Instance], side: str) -> NDArray:
        """Return which things lie on a side of their nearest of the others, bool [things]."""
        kept = np.zeros(len(things), bool)
        far, nearest = self.nearest_of(self.cells.pack(things), self.cells.pack(others))
        if side in ("end", "flank"):
            longer = [other for other in others if self._is_longer(other)] or others[:1]
            for other in longer:
                mine = np.flatnonzero(nearest == others.index(other)).tolist()
                kept[mine] = self._at_ends([things[i] for i in mine], other) == (side == "end")
            return kept & (far <= NEXT_TO_M + 1e-9)
        for j, other in enumerate(others):
            mine = np.flatnonzero(nearest == j).tolist()
            way = self.way_of(side, np.array(other.centroid_m[:2]))
            offset = self.centroids([things[i] for i in mine]) - other.centroid_m[:2]
            along, across = offset @ way, offset @ (-way[1], way[0])
            kept[mine] = (along > 0.0) & (np.abs(across) <= np.sqrt(3.0) * along + 1e-9)
            kept[mine] &= np.array([not self._apart(things[i], other) for i in mine], bool)
        close = kept & (far <= BESIDE_M + 1e-9)
        return close if close.any() else kept

    def _is_longer(self, thing: Instance) -> bool:
        length, width, *_ = self._box(thing)
        return length >= _OBLONG * width

    def _long_axis(self, thing: Instance) -> tuple[NDArray, NDArray]:
        """Return the middle of a thing's rectangle, and the unit vector of its longer way, float64 [2] each.

        Raises:
            CommandError: it is about as wide as long.
        """
        if not self._is_longer(thing):
            raise CommandError(f"The {thing.label} is about as wide as long: which side of it is an end is not known.")
        corners = cv2.boxPoints(cv2.minAreaRect((self._hull(thing) - thing.centroid_m[:2]).astype(np.float32)))
        edge = max(corners[1] - corners[0], corners[2] - corners[1], key=lambda edge: float(np.hypot(*edge)))
        return corners.mean(axis=0) + thing.centroid_m[:2], edge / np.hypot(*edge)

    def _at_ends(self, things: Sequence[Instance], other: Instance) -> NDArray:
        """Return which things are rather at an end of another than at a long side of it, bool [n]."""
        middle, along = self._long_axis(other)
        length, width, *_ = self._box(other)
        offset = self.centroids(things) - middle
        return np.abs(offset @ along) - length / 2.0 > np.abs(offset @ (-along[1], along[0])) - width / 2.0

    def _bearing_of(self, side: str) -> float:
        """Return the yaw of a side of the robot, radians."""
        if side in _TURNS:
            return self.viewer.yaw_rad + _TURNS[side]
        if side not in _COMPASS:
            raise CommandError(f'which side of the robot is meant by "{side}" is not known')
        return float(np.arctan2(_COMPASS[side][1], _COMPASS[side][0]))

    def way_of(self, side: str, point_m: NDArray) -> NDArray:
        """Return the unit vector from a place to its side, as the robot sees it, float64 [2], map frame."""
        if side in _COMPASS:
            return np.array(_COMPASS[side])
        if side in ("end", "flank"):
            raise CommandError("an end or a long side is that of a thing or room")
        ahead = point_m - (self.viewer.x_m, self.viewer.y_m)
        far = float(np.hypot(*ahead))
        yaw = self.viewer.yaw_rad if far < 1e-6 else float(np.arctan2(ahead[1], ahead[0]))
        turn = {"front": np.pi, "beside": np.pi, "behind": 0.0}.get(side, _TURNS.get(side, 0.0))
        return np.array([np.cos(yaw + turn), np.sin(yaw + turn)])

    def _in_part(self, points_m: NDArray, side: str, of: Any) -> NDArray:
        """Return which points lie in that third of a room or of the map, bool [n]."""
        room = self.room_of(of) if of != "map" else None
        outline = self._map_corners if room is None else np.array(room.polygon_m, np.float64).reshape(-1, 2)
        kept = np.ones(len(points_m), bool)
        ways = [self._part_way(one) for one in side.split()] if side != "middle" else [(1.0, 0.0), (0.0, 1.0)]
        for way in ways:
            low, high = (outline @ way).min(), (outline @ way).max()
            at = (points_m @ np.array(way) - low) / max(high - low, 1e-9)
            kept &= (np.abs(at - 0.5) <= 1.0 / 6.0 + 1e-9) if side == "middle" else (at >= 2.0 / 3.0 - 1e-9)
        return kept if room is None else kept & self._inside_room(points_m, room)

    def _part_way(self, side: str) -> NDArray:
        """Return the direction of a part of a room; its front is what is nearest to the robot looking ahead."""
        yaw = self._bearing_of(side) + (np.pi if side in ("front", "behind") else 0.0)
        return np.array([np.cos(yaw), np.sin(yaw)])

    @cached_property
    def _map_corners(self) -> NDArray:
        row, col = np.nonzero(self.simap.grid.observations > 0)
        spec = self.simap.spec
        low = spec.centre_of(row.min(initial=0) - 0.5, col.min(initial=0) - 0.5)
        high = spec.centre_of(row.max(initial=0) + 0.5, col.max(initial=0) + 0.5)
        return np.array([low, (low[0], high[1]), high, (high[0], low[1])])

    def _inside_room(self, points_m: NDArray, room: Room) -> NDArray:
        at = [self.simap.room_at(float(x), float(y)) for x, y in points_m]
        return np.array([one is not None and one.id == room.id for one in at], bool)

    def _near(self, S: Named, T: Any, metres: float | None) -> Things:
        if metres is not None and metres < 0:
            raise CommandError(f"metres: expected 0 or more, found {metres:g}")
        most = NEXT_TO_M if metres is None else float(metres)
        within = "next to" if metres is None else f"within {most:g} m of"
        items, room = self.set_of(S).items, self.room_of(T)
        in_rooms = bool(items) and not isinstance(items[0], Instance)
        if room is not None or self._point_of(T) is not None or in_rooms:
            what = "you" if isinstance(T, str) else "that place" if room is None else the_room(room)
            kept = (self._far(items, T) <= most + 1e-9) & np.array([item is not room for item in items], bool)
            if in_rooms and room is None:
                kept &= [not near or self._is_open(item, T) for item, near in zip(items, kept, strict=True)]
            return self._keep(S, kept, after=f"{within} {what}")
        things = self.things_of(S)
        others = self.things_of(T)
        pairs = self.neighbours(things, others, most)
        if metres is None:
            pairs = [one for one in pairs if not self._apart(things[one[0]], others[one[1]])]
            pairs = self._at_their_own(things, others, pairs)
        return self._relate(S, T, {things[i].id for i, _, _ in pairs}, f"{within} {self.set_of(T).the}")

    def _apart(self, a: Instance, b: Instance) -> bool:
        """Whether two things stand in different rooms with a wall between their middles."""
        rooms = self._room_ids.get(a.id), self._room_ids.get(b.id)
        if None in rooms or rooms[0] == rooms[1]:
            return False
        return self._walled(np.array(a.centroid_m[:2]), np.array(b.centroid_m[:2]))

    @cached_property
    def _room_ids(self) -> dict[int, int]:
        """{id of a thing: id of the room that it is in}."""
        return {number: room.id for room in self.simap.rooms for number in room.objects}

    def _is_open(self, room: Room, value: Any) -> bool:
        """Whether no wall stands between a room and a point or the nearest of some things."""
        point = self._point_of(value)
        ends = np.concatenate([self.cells_of(i) for i in self.things_of(value)]) if point is None else point[None]
        cells = self._cells_of_room(room)
        far, nearest = map(np.asarray, KDTree(cells).query(ends))
        return not self._walled(ends[far.argmin()], cells[nearest[far.argmin()]])

    def _at_their_own(
        self, things: Sequence[Instance], others: Sequence[Instance], pairs: list[tuple[int, int, float]]
    ) -> list[tuple[int, int, float]]:
        """Leave out the pairs of a seat and a table, desk or counter where it is at another or behind a seat."""
        taken = {other.id for other in others}
        rivals = [i for i in self.simap.instances if plain(i.label) in _TABLES and i.id not in taken]
        tables = {j for j, other in enumerate(others) if plain(other.label) in _TABLES}
        seats = sorted({i for i, j, _ in pairs if j in tables and plain(things[i].label) in _SEATS})
        if not seats:
            return pairs
        nearest: dict[int, float] = {}
        for k, _, far in self.neighbours([things[i] for i in seats], rivals, NEXT_TO_M):
            nearest[seats[k]] = min(nearest.get(seats[k], np.inf), far)
        kept = [one for one in pairs if one[1] not in tables or one[2] <= nearest.get(one[0], np.inf) + _CLEARLY_M]
        rows, gap = [things[i] for i in seats], {(i, j): far for i, j, far in kept if j in tables}
        apart = {(seats[a], seats[b]): far for a, b, far in self.neighbours(rows, rows, NEXT_TO_M)}
        behind = {
            (i, j)
            for (i, j), far in gap.items()
            if any(gap.get((k, j), np.inf) <= far - _BEHIND_M and apart.get((i, k), np.inf) < far for k in seats)
        }
        return [one for one in kept if one[:2] not in behind]

    def _on(self, S: Named, T: Named, *, within: bool = False) -> Things:
        """Keep what stands on a thing; with ``within``, and of a shelf, also what lies on its lower boards."""
        if self.room_of(T) is not None:
            return self._inside(S, T)
        things, others = self.things_of(S), self.things_of(T)
        tops = [other for other in others if not (within or plain(other.label).endswith(_BOARDS))]
        hidden = [i for i in things if i.id in self.hidden_ids]
        # What stands on a lower board does so by its surface in space rather than by its cells.
        kept = {
            i.id for i in hidden if self._stands_so(i, others, ("on",)) and not self._stands_so(i, tops, ("under",))
        }
        kept |= {i.id for i in hidden if self._stands_so(i, others, ("inside",))}
        shown = [i for i in things if i.id not in self.hidden_ids]
        kept |= {a for a, _ in self._standing(shown, others, hanging=False)}
        kept |= {i.id for i in shown if self._stands_so(i, others, ("on",))}
        return self._relate(S, T, kept, f"{'in' if within else 'on'} {self.set_of(T).the}")

    def _under(self, S: Named, T: Named) -> Things:
        things, others = self.things_of(S), self.things_of(T)
        shown = [i for i in things if i.id not in self.hidden_ids]
        kept = {b for _, b in self._standing(others, shown)} | {a for a, _ in self._standing(shown, others, lower=True)}
        kept |= {i.id for i in things if self._stands_so(i, others, ("under",))}
        return self._relate(S, T, kept, f"under {self.set_of(T).the}")

    @staticmethod
    def _stands_so(thing: Instance, others: Sequence[Instance], relations: Sequence[str]) -> bool:
        """Whether a thing has one of these relations in space to one of the others."""
        pairs = {number: share for name in relations for number, share in getattr(thing, name).items()}
        return any(pairs.get(other.id, 0.0) >= _WITHIN for other in others)

    def _standing(
        self, things: Sequence[Instance], others: Sequence[Instance], *, lower: bool = False, hanging: bool = True
    ) -> list[tuple[int, int]]:
        """Return the ids of all pairs of a thing and an other that it stands on or hangs over, or lies lower within."""
        touching = self.neighbours(things, others, 2.0 * self.simap.spec.cell_size_m)
        found = []
        for i, j in sorted({*((i, j) for i, j, _ in touching), *self._inner_pairs(things, others)}):
            a, b = things[i], others[j]
            tops = self._top_m(a), self._top_m(b)
            if (
                a.cells < b.cells
                and (tops[0] < tops[1] if lower else tops[0] > tops[1])
                and (hanging or a.aabb_m[0][2] - _HANGING_M < tops[1])
                and self._share_within(a, b) >= _WITHIN
            ):
                found.append((a.id, b.id))
        return found

    def _inner_pairs(self, things: Sequence[Instance], others: Sequence[Instance]) -> list[tuple[int, int]]:
        """Return the pairs of which the thing's centroid lies in the other's box: it may touch a third thing only."""
        a, b = self.rows(things), self.rows(others)
        at = self.cells.centroids[a][:, None, :]
        within = ((at >= self.cells.low[b]) & (at <= self.cells.high[b])).all(axis=2) & (a[:, None] != b)
        return [(int(i), int(j)) for i, j in np.argwhere(within)]

    def _top_m(self, thing: Instance) -> float:
        """Return the median height of a thing's cells, or the top of what no cell shows."""
        if thing.id in self.hidden_ids:
            return thing.aabb_m[1][2]
        return float(np.nanmedian(self.simap.grid.height_m[self.cells.rows_and_cols(thing.id)]))

    def _share_within(self, thing: Instance, other: Instance) -> float:
        """Return the share of a thing's cells within the convex outline of another's."""
        points, hull = self.cells_of(thing), self._hull(other)
        self.look(len(points) * len(hull) / 8.0)
        after = np.roll(hull, -1, axis=0)
        edge = after - hull
        turn = edge[:, 0, None] * (points[:, 1] - hull[:, 1, None]) - edge[:, 1, None] * (
            points[:, 0] - hull[:, 0, None]
        )
        return float(((turn >= -1e-9).all(axis=0) | (turn <= 1e-9).all(axis=0)).mean())

    def _hull(self, thing: Instance) -> NDArray:
        """Return the corners of the convex outline of a thing's cells, in order, float64 [n, 2]."""
        half = self.simap.spec.cell_size_m / 2.0
        edge = self.cells.edge(thing.id)
        corners = np.concatenate([edge + np.array([x, y]) for x in (-half, half) for y in (-half, half)])
        return corners[np.asarray(cv2.convexHull(corners.astype(np.float32), returnPoints=False))[:, 0].astype(np.intp)]

    def _between(self, S: Named, A: Named, B: Named) -> Things:
        a, b = self._close_pair(A, B) or self.pair(A, B)
        found = self.between_pair(self.things_of(S), a, b)
        if not found:
            a, b = self.pair(A, B)
            found = self.between_pair(self.things_of(S), a, b)
        self._note_anchors(a, b)
        return self.set_of(S).of(found, after=f"between {pair_words(a, b)}")

    def _close_pair(self, A: Named, B: Named) -> tuple[Instance, Instance] | None:
        """Return, of several lamps and one table, the lamp nearest to the table, and the table; None for other sets."""
        sets = [self.things_of(A), self.things_of(B)]
        if sorted(min(len(one), 2) for one in sets) != [1, 2]:
            return None
        one, several = sorted(sets, key=len)
        far, _ = self.nearest_of(self.cells.pack(several), self.cells.pack(one))
        near = several[int(far.argmin())]
        return None if near in one else (near, one[0])

    def between_pair(self, things: Sequence[Instance], a: Instance, b: Instance) -> list[Instance]:
        """Return the things between two others, the nearest to the line of their centroids first."""
        start, end = np.array(a.centroid_m[:2]), np.array(b.centroid_m[:2])
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        at = self.centroids(things)
        # Thales: in the circle over the line a-b, both ends are seen more than a quarter turn apart.
        inside = ((at - start) * (at - end)).sum(axis=1) < 0.0
        off = np.abs(along[0] * (at - start)[:, 1] - along[1] * (at - start)[:, 0]).round(9)
        order = sorted(range(len(things)), key=lambda i: (off[i], things[i].id))
        out = {a.id, b.id, *(below for _, below in self._standing((a, b), things, hanging=False))}
        return [things[i] for i in order if inside[i] and things[i].id not in out]

    def _opposite(self, S: Named, T: Named) -> Things:
        things, other = self.things_of(S), self.thing_of(T)
        middle, way = np.array(other.centroid_m[:2]), self._outlook(other)
        offset = self.centroids(things) - middle
        across = np.abs(offset @ (-way[1], way[0]))
        far = self._far(things, other)
        kept = (across <= np.sqrt(1.0 / 3.0) * (offset @ way)) & (far >= _ACROSS_M) & np.isfinite(far)
        shown = [ok and not self._walled(middle, middle + to) for ok, to in zip(kept.tolist(), offset, strict=True)]
        return self._relate(
            S,
            one_thing(other),
            {i.id for i, ok in zip(things, shown, strict=True) if ok},
            f"opposite {one_thing(other).the}",
        )

    def _facing(self, S: Named, T: Named) -> Things:
        kept, other = [], self.thing_of(T)
        for thing in self.things_of(S):
            try:
                way = self._outlook(thing)
            except CommandError:
                way = np.zeros(2)
            offset = np.array(other.centroid_m[:2]) - thing.centroid_m[:2]
            kept.append(float(offset @ way) > _DIAGONAL * float(np.hypot(*offset)))
        return self._keep(S, kept, after=f"facing {one_thing(other).the}")

    def _outlook(self, thing: Instance) -> NDArray:
        """Return the direction that a thing looks in: a seat to its table, others away from the wall behind them."""
        middle = np.array(thing.centroid_m[:2])
        tables = [i for i in self.simap.instances if plain(i.label) in _TABLES and i.id != thing.id]
        if plain(thing.label) in _SEATS and tables:
            far, which = self.nearest_of(self.cells.pack([thing]), self.cells.pack(tables))
            if far[0] <= NEXT_TO_M:
                cells = self.cells_of(tables[which[0]])
                to = cells[np.hypot(*(cells - middle).T).argmin()] - middle
                return to / max(float(np.hypot(*to)), 1e-9)
        hull, (length, width, *_) = self._hull(thing), self._box(thing)
        (_, (one, two), angle) = cv2.minAreaRect((hull - middle).astype(np.float32))
        along = np.deg2rad(angle) + (0.0 if one >= two else 0.5 * np.pi)
        turns = (1, 3) if length > _SQUARE * width else (0, 1, 2, 3)
        backs = []
        for turn in turns:
            way = np.array([np.cos(along + turn * 0.5 * np.pi), np.sin(along + turn * 0.5 * np.pi)])
            edge = middle + way * float(((hull - middle) @ way).max())
            if self._walled(edge, edge + _IN_CORNER_M * way, unseen=True):
                backs.append(-way)
        if len(backs) != 1:
            raise CommandError(f"Which way the {thing.label} looks is not known on this map.")
        return backs[0]

    def _walled(self, start: NDArray, end: NDArray, *, unseen: bool = False) -> bool:
        """Whether a wall, or also what was never seen, stands on the straight line between two points."""
        self.look(self.simap.instance.size / 100.0)
        spec = self.simap.spec
        steps = 2 + int(np.hypot(*(end - start)) / (0.5 * spec.cell_size_m))
        points = start + np.linspace(0.0, 1.0, steps)[:, None] * (end - start)
        cols, rows = np.floor((points - (spec.x0_m, spec.y0_m)) / spec.cell_size_m).astype(np.int64).T
        on_map = (rows >= 0) & (rows < spec.rows) & (cols >= 0) & (cols < spec.cols)
        stops = self._solid | (self.simap.grid.observations == 0) if unseen else self._solid
        return bool(stops[rows[on_map], cols[on_map]].any() or (unseen and not on_map.all()))

    @cached_property
    def _solid(self) -> NDArray:
        """The cells of walls, bool [rows, cols], but for those on which things such as windows were seen."""
        return wall_cells(self.simap) & (self.simap.instance == 0)

    def _inside(self, S: Named, R: Any) -> Things:
        if R == "" and not self.simap.rooms:
            return self.set_of(S)
        if isinstance(R, str) and R.strip() and self._vocabulary.resolve(R) and not self._rooms_called(R):
            return self._on(S, R, within=True)
        rooms = self._rooms(R).items if isinstance(R, str) and R else self.set_of(R).items if R else (self._here(),)
        if any(isinstance(room, Instance) for room in rooms):
            return self._on(S, R, within=True)
        if not rooms:
            self.set_of(self._rooms(R) if isinstance(R, str) else R).expect(1)
        ids = {number for room in rooms for number in room.objects}
        names = " or ".join(the_room(room) for room in rooms[:3]) if len(rooms) <= 3 else "these rooms"
        found = self._keep(S, [i.id in ids for i in self.things_of(S)], after=f"in {names}")
        others = self.set_of(S).items
        if R or found.items or not others:
            return found
        # Who asks "in here" may mean the whole place.
        nearest = self.ranked(others)[0]
        there = [room for room in self._all_rooms() if nearest.id in room.objects]
        where = f"in {the_room(there[0])}" if there else "elsewhere"
        number = "there is one" if len(others) == 1 else f"the nearest of {len(others)} is"
        return replace(found, missing=f"{found.none()[:-1]}; {number} {where}.", elsewhere=(nearest,))

    def _visible(self, S: Named) -> Things:
        kept = []
        for thing in self.things_of(S):
            self.look(12.0 * self.distance_m(thing) / self.simap.spec.cell_size_m)
            kept.append(self.sight.sees(thing, self.cells_of(thing)))
        return self._keep(S, kept, after="in view")

    def _counts(self, S: Named, T: Named) -> dict[int, int]:
        """Return {id: how many of T are next to it, and to no nearer thing of the same classes}."""
        rooms = [room for room in self.set_of(S).items if not isinstance(room, Instance)]
        if rooms:  # what stands in them counts
            wanted = {i.id for i in self.things_of(T)}
            return {room.id: len(wanted.intersection(room.objects)) for room in rooms}
        things, others = self.things_of(S), self.things_of(T)
        rivals = [i for label in dict.fromkeys(i.label for i in things) for i in self.simap.of_class(label)]
        # What no cell shows is counted for the thing that it is most of all on, in or under.
        unseen = [i for i in others if i.id in self.hidden_ids]
        others = [i for i in others if i.id not in self.hidden_ids]
        owner: dict[int, tuple[float, int]] = {}
        for i, j, far in self.neighbours(others, rivals, NEXT_TO_M):
            owner[others[i].id] = min(owner.get(others[i].id, (np.inf, 0)), (far, rivals[j].id))
        for one in unseen:
            shares = {i.id: max(of.get(i.id, 0.0) for of in (one.on, one.inside, one.under)) for i in rivals}
            number = max(shares, key=lambda at: (shares[at], -at), default=0)
            if shares.get(number, 0.0) >= _WITHIN:
                owner[one.id] = (0.0, number)
        counts = dict.fromkeys([i.id for i in things], 0)
        for _, number in owner.values():
            if number in counts:
                counts[number] += 1
        return counts

    def _having(self, S: Named, T: Named, n: int) -> Things:
        counts, other = self._counts(S, T), self.set_of(T)
        kept = {number for number, of in counts.items() if of >= n}
        return self._relate(S, T, kept, f"with {with_article(other.one) if n == 1 else f'{n} {other.many}'}")

    def _without(self, S: Named, T: Named) -> Things:
        counts = self._counts(S, T)
        return self._keep(
            S, [counts[i.id] == 0 for i in self.set_of(S).items], after=f"without {with_article(self.set_of(T).one)}"
        )

    def _empty(self, S: Named) -> Things:
        things, all_things = self.things_of(S), list(self.simap.instances)
        taken = {b for _, b in self._standing(all_things, things, hanging=False)}
        people = self.simap.of_class("person")
        taken |= {things[i].id for i, _, _ in self.neighbours(things, people, _NOBODY_M)}
        return self._keep(S, [i.id not in taken for i in things], before="empty")

    def _colored(self, S: Named, color: str) -> Things:
        things = self.things_of(S)
        seen = [self.simap.color_of(i) for i in things]
        if things and not any(seen):
            raise CommandError(_NO_COLORS)
        try:
            kept = [rgb is not None and has_color(rgb, color) for rgb in seen]
            if not any(kept):
                kept = [rgb is not None and has_color(rgb, color, nearly=True) for rgb in seen]
        except InputError as error:
            raise CommandError(str(error)) from None
        return self._keep(S, kept, before=color.strip().lower())

    def _shaped(self, S: Named, shape: str) -> Things:
        kept = self._keep(S, [self._has_shape(i, shape) for i in self.things_of(S)], before=shape)
        found = self.set_of(S)
        if found.items and not kept.items:  # the map knows outlines only: it cannot say that there is none
            return replace(kept, missing=f"No {found.one} looks {shape} from above.")
        return kept

    def _has_shape(self, thing: Instance, shape: str) -> bool:
        length, width, round_share, box_share = self._box(thing)
        # The outline of a round thing that was seen badly has a corner or two: then its box is filled as by a circle.
        full = length <= _SQUARE * width + 1e-9 and round_share >= _ROUGHLY_ROUND and box_share <= _BOXY
        is_round = full or round_share >= _ROUND
        if shape == "long":
            return length >= _LONG * width - 1e-9
        return is_round if shape == "round" else not is_round and length <= _SQUARE * width + 1e-9

    def _box(self, thing: Instance) -> tuple[float, float, float, float]:
        """Return length and width, metres, and the shares that its outline fills of the smallest circle and box."""
        if thing.id not in self.cells.boxes:
            self.look(len(self.cells.edge(thing.id)))
            hull = self._hull(thing)
            hull = (hull - hull[0]).astype(np.float32)  # numbers near 0 keep more digits
            sides = sorted(cv2.minAreaRect(hull)[1])
            circle = np.pi * cv2.minEnclosingCircle(hull)[1] ** 2
            area = float(cv2.contourArea(hull))
            shares = area / max(float(circle), 1e-9), area / max(sides[0] * sides[1], 1e-9)
            self.cells.boxes[thing.id] = round(sides[1], 4), round(sides[0], 4), *shares
        return self.cells.boxes[thing.id]

    def _sized(self, S: Named, key: str, than: float | None) -> Things:
        measure, sign = _BY_SIZE[key]
        sizes = np.array([self.measure(i, measure) for i in self.things_of(S)])
        if than is not None:
            more, unit = SAID["more"][key]
            return self._keep(S, sign * (sizes - than) > 1e-9, after=f"{more} than {than:g} {unit.split()[0]}")
        middle = (sizes.min(initial=np.inf) + sizes.max(initial=-np.inf)) / 2.0 if len(sizes) else 0.0
        return self._keep(S, sign * (sizes - middle) >= -1e-9, before=key)

    def _at(self, S: Named, place: str) -> Things:
        word = place.strip().lower()
        if word in ("wall", "corner"):
            return self._keep(S, self._at_walls(self.things_of(S), word), after=SAID["places"][word])
        if word == "here":
            here = self.simap.room_at(self.viewer.x_m, self.viewer.y_m) if self.simap.rooms else None
            found = self._inside(S, here) if here else self.set_of(S)
            return found if found.items else self.set_of(S)
        if word in ("middle", "center", "centre"):
            things = self.things_of(S)
            kept = [self._in_middle(np.array([i.centroid_m[:2]])) for i in things]
            return self._keep(S, kept, after=SAID["places"]["middle"])
        if word == "floor":  # on no other thing; a rug is floor
            things = self.things_of(S)
            above = {i.id for i in self._on(S, self._minus("anything", "rug")).items}
            return self._keep(S, [i.id not in above for i in things], after=SAID["places"][word])
        near = self._near(S, place, None)
        return replace(near, after=f"{self.set_of(S).after} by {self.set_of(place).the}".strip())

    def _in_middle(self, at: NDArray) -> bool:
        room = self.simap.room_at(*at[0]) if self.simap.rooms else None
        return bool(self._in_part(at, "middle", room or "map")[0])

    def _at_walls(self, things: Sequence[Instance], place: str) -> list[bool]:
        """Return which things stand at a wall, or in a corner: with walls straight off it in two directions."""
        self.look(self.cells.size)
        far, walls = self._walls
        reach = _AT_WALL_M if place == "wall" else _IN_CORNER_M
        packed = self.cells.pack(things)
        apart = np.minimum.reduceat(far[*packed.cells.T], packed.starts[:-1]) if things else np.zeros(0)
        kept = (apart <= reach + 1e-6).tolist()
        return [near and (place == "wall" or self._has_corner(i, walls)) for i, near in zip(things, kept, strict=True)]

    @cached_property
    def _walls(self) -> tuple[NDArray, KDTree]:
        """How far each cell is from a wall, float32 [rows, cols], metres, and a tree over walls; specks are none."""
        spec = self.simap.spec
        self.look(self.simap.instance.size)
        _, part, stats, _ = cv2.connectedComponentsWithStats(wall_cells(self.simap).astype(np.uint8), connectivity=8)
        large = stats[:, cv2.CC_STAT_AREA] * spec.cell_size_m**2 >= _SPECK_M2
        large[0] = False  # what is no wall
        walls = large[np.asarray(part, np.intp)]
        if not walls.any():
            raise CommandError("This map shows no walls.")
        far = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * spec.cell_size_m
        return far, KDTree(self.cells.centres(np.argwhere(walls)))

    def _has_corner(self, thing: Instance, tree: KDTree) -> bool:
        edge = self.cells.edge(thing.id)
        close = np.unique(np.concatenate(tree.query_ball_point(edge, _IN_CORNER_M)).astype(np.int64))
        walls = np.asarray(tree.data)[close]
        self.look(len(close) + len(edge))
        # How far the walls are in each of 24 directions; a straight wall is nearest in one of them only.
        offset = walls - edge[KDTree(edge).query(walls)[1]]
        sector = np.round(np.rad2deg(np.arctan2(offset[:, 1], offset[:, 0])) / 15.0).astype(np.int64) % 24
        far = np.full(24, np.inf)
        np.minimum.at(far, sector, np.hypot(*offset.T).round(9))
        around = np.min([np.roll(far, turn) for turn in (-2, -1, 1, 2)], axis=0)
        nearest = np.flatnonzero(np.isfinite(far) & (far <= around))
        apart = np.abs(nearest[:, None] - nearest) % 24
        apart = np.minimum(apart, 24 - apart)
        return bool(((apart >= 5) & (apart <= 7)).any())

    def _called(self, S: Named, n: int) -> Things:
        found = self.set_of(S)
        kept = [isinstance(i, Instance) and i.id == n for i in found.items]
        if found.items and not any(kept):
            near = ", ".join(i.name for i in found.items[:3] if isinstance(i, Instance))
            rank = f"; the {ordinal(n)} closest is the {ordinal(n)} {found.one}" if n <= len(found) else ""
            raise CommandError(f"There is no {found.one} {n} on this map. Near you: {near}{rank}.")
        return self._keep(found, kept, after=f"called {n}")

    def _minus(self, A: Named, B: Named) -> Things:
        first, second = self.set_of(A), self.set_of(B)
        out = {_key(i) for i in second.items}
        kept = [_key(i) not in out for i in first.items]
        if all(kept):
            return first
        if any(kept) and len(second) == 1 and isinstance(second.items[0], Instance):
            return self._keep(first, kept, after=f"other than {second.items[0].name}")
        if second.noun == first.noun or len(second) == 1:
            return self._keep(first, kept, before="other")
        return self._keep(first, kept, after=f"other than {second.the}")

    def _union(self, A: Named, B: Named) -> Things:
        first, second = self.set_of(A), self.set_of(B)
        if not first.items or not second.items:
            some, none = (second, first) if second.items else (first, second)
            return (
                some
                if some.items
                else replace(some, noun=f"{some.one} or {none.one}", before=(), after="", missing=None)
            )
        both = {_key(i): i for i in (*first.items, *second.items)}
        if len({is_thing for is_thing, _ in both}) > 1:
            raise CommandError("a set holds things or rooms, not both")
        alike = list(both.values())
        items = tuple(alike[k] for k in self._order_of(alike, np.zeros(len(alike))))
        if (first.one, first.many) == (second.one, second.many):
            return replace(first, items=items, levels=(), tied=())
        return Things(items, f"{first.one} or {second.one}", f"{first.many} or {second.many}")

    def _common(self, A: Named, B: Named) -> Things:
        first, second = self.set_of(A), self.set_of(B)
        both = {_key(i) for i in second.items}
        words = " ".join(word for word in second.before if word not in first.before)
        after = second.after if second.after != first.after else ""
        return self._keep(first, [_key(i) in both for i in first.items], words, after)

    # ---- order and choice

    def _order(self, S: Named, key: str, of: Any) -> Things:
        found = self.set_of(S)
        if key in ("near", "far"):
            found, score = self._by_gap(found, of, -1.0 if key == "far" else 1.0)
            near, after = self._sorted_by(found, score, key), self._near_words(found, key, of)
            return replace(near, most="", after=after) if after else near
        if key in ("apart", "together"):
            return replace(found, items=tuple(self._paired(list(found.items), key)), most=SAID["most"][key])
        if key in ("many", "few"):
            if isinstance(of, str) and not of:
                raise CommandError(f"order by {key}: expected what to count, found nothing")
            if not found.items:
                return found
            others = self.set_of(of)
            others.expect(1)
            counts, sign = self._counts(found, of), -1 if key == "many" else 1
            if key == "many" and not any(counts.values()):
                raise CommandError(f"None of the {found.many} has a {others.one} next to it.")
            # Counts that differ by one are two levels apart: no tie.
            ordered = self._sorted_by(found, [2.0 * sign * counts[i.id] for i in found.items], "")
            counted = others.many
            # "The table with 4 chairs" says already how many.
            is_said = key == "few" and found.after.endswith(counted)
            words = "" if is_said else f"with the {'most' if key == 'many' else 'fewest'} {counted}"
            return replace(ordered, after=f"{found.after} {words}".strip())
        return self._sorted_by(found, self._scores(found.items, key, of), key)

    def _near_words(self, found: Things, key: str, of: Any) -> str:
        """Return what things are nearest to: "nearest to the lamp", also of those that are within 3 m of it."""
        if self._point_of(of) is not None or self.room_of(of) is not None:
            return ""
        others = self.set_of(of)
        if found.after and not (others.items and found.after.endswith(others.the)):
            return ""
        words = f"{SAID['most'][key]} {'from' if key == 'far' else 'to'}"
        is_side = found.after.startswith(tuple(map(_side_words, (*SAID["side_of"], *SAID["end_of"], *_COMPASS))))
        return f"{found.after}, {words} {'it' if len(others) == 1 else 'them'}" if is_side else f"{words} {others.the}"

    def _sorted_by(self, found: Things, score: Sequence[float] | NDArray, key: str) -> Things:
        """Return a set in the order of a score, with the levels at which the map can tell one from another.

        Where things end is known to a cell, and so is how far or how long they are. An area is taken for as large
        where it differs by less than ``ALIKE``: on a thing of half a square metre that is a quarter of a cell all
        around. Angles, lightness and the middle of several things have no such step.
        """
        order = self._order_of(found.items, score)
        at = np.array(score, np.float64)[order]
        measure = _BY_SIZE[key][0] if key in _BY_SIZE else ""
        if measure == "area":
            at = np.sign(at) * np.log(np.maximum(np.abs(at), 1e-9)) / np.log1p(ALIKE)
        elif measure == "lightness" or key in ("middle", "front", "behind"):
            at = at / 1e-9
        elif key:
            at = at / self.simap.spec.cell_size_m
        items = tuple(found.items[k] for k in order)
        return replace(found, items=items, most=SAID["most"].get(key, ""), levels=tuple(at.tolist()), tied=())

    def _paired(self, items: list[Any], key: str) -> list[Any]:
        """Return things, or rooms, of which the two that are farthest apart, or closest together, come first."""
        self.look(len(items) ** 2)
        at = np.array([self.middle_of(i)[0] for i in items]).reshape(-1, 2)
        apart = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)).round(9)
        if len(items) < 2:
            return items
        np.fill_diagonal(apart, -np.inf if key == "apart" else np.inf)
        pair = np.unravel_index(apart.argmax() if key == "apart" else apart.argmin(), apart.shape)
        return [items[k] for k in sorted(map(int, pair))] + [item for k, item in enumerate(items) if k not in pair]

    def _scores(self, items: Sequence[Any], key: str, of: Any) -> NDArray:
        """Return by what things, or rooms, are sorted, the smallest first, float64 [n]."""
        if key in _BY_SIZE:
            measure, sign = _BY_SIZE[key]
            sizes = np.array([self.size_of(i, measure) for i in items])
            if len(sizes) and np.isnan(sizes).all():
                raise CommandError(_NO_COLORS)
            return np.where(np.isnan(sizes), np.inf, -sign * sizes)
        if key in ("first", "last"):
            put = self._some(of).items
            return np.array([(item in put) == (key == "last") for item in items], np.float64)
        at = np.array([self.middle_of(i)[0] for i in items]).reshape(-1, 2)
        if key == "middle":
            return np.hypot(*(at - at.mean(axis=0)).T) if len(at) else np.zeros(0)
        if key in _COMPASS:
            return -(at @ np.array(_COMPASS[key]))
        yaw = self.viewer.yaw_rad
        if not (isinstance(of, str) and of in ("", SELF)):
            towards = self.middle_of(of)[0] - (self.viewer.x_m, self.viewer.y_m)
            yaw = float(np.arctan2(towards[1], towards[0])) if np.hypot(*towards) > 1e-6 else yaw
        offset = at - (self.viewer.x_m, self.viewer.y_m)
        if key in ("front", "behind"):
            off = np.abs((np.arctan2(offset[:, 1], offset[:, 0]) - yaw + np.pi) % (2.0 * np.pi) - np.pi)
            return off if key == "front" else -off
        left = offset @ (-np.sin(yaw), np.cos(yaw))
        return -left if key == "left" else left

    def _order_of(self, items: Sequence[Any], score: Sequence[float] | NDArray) -> list[int]:
        far = self._far(items, SELF)
        return sorted(range(len(items)), key=lambda k: (round(float(score[k]), 9), far[k], items[k].id))

    def _by_gap(self, found: Things, of: Any, sign: float) -> tuple[Things, NDArray]:
        """Return a set without what distances are measured from, and the distances, times the sign."""
        items = found.items
        apart = self._far(items, of)
        room = self.room_of(of)
        kept = [k for k in range(len(items)) if np.isfinite(apart[k]) and (room is None or items[k] is not room)]
        return replace(found, items=tuple(items[k] for k in kept)), sign * apart[kept]

    def _nearest(self, S: Named, n: int, of: Any) -> Things:
        return self._few(S, "near", n, of)

    def _farthest(self, S: Named, n: int, of: Any) -> Things:
        return self._few(S, "far", n, of)

    def _few(self, S: Named, key: str, n: int, of: Any) -> Things:
        found = self.set_of(S)
        found.expect(n)
        ranked = self._order(found, key, of)
        if len(ranked) < n and len(found) >= n:
            left = len(ranked)
            raise CommandError(
                f"There {'is' if left == 1 else 'are'} {found.number(left)} besides that one; {n} were asked for."
            )
        chosen = self._first(ranked, n)
        from_here = isinstance(of, str) and of in ("", SELF)
        if key == "near" and len(chosen) == 1:
            self._note_anchors(self._end_of(chosen.items[0], of))
        return self._with_surer(chosen, ranked, from_here=from_here) if key == "near" else chosen

    def _end_of(self, item: Any, of: Any) -> Instance | None:
        """Return which of some things is the nearest to what was chosen by them; None for points and rooms."""
        if self._point_of(of) is not None or self.room_of(of) is not None:
            return None
        others = self.set_of(of).items
        _, nearest = self.nearest_of(self._pack([item]), self._pack(others))
        return others[int(nearest[0])]

    def _with_surer(self, chosen: Things, ranked: Things, *, from_here: bool = True) -> Things:
        """Return the nearest with the nearest that is not doubtful, if itself is.

        Where a mere name means one behind a wall, that is the nearest in the robot's room, if there is one.
        """
        things = [item for item in ranked.items if isinstance(item, Instance)]
        if len(chosen) != 1 or not things:
            return chosen
        certain = [thing for thing in things if thing.id not in self.simap.doubtful] or things
        surer = certain[0]
        if from_here and not (ranked.before or ranked.after) and self._is_walled_off(surer):
            here = self._here().objects
            surer = next((thing for thing in certain if thing.id in here), surer)
        return chosen if surer is things[0] else replace(chosen, surer=(surer,))

    def _is_walled_off(self, thing: Instance) -> bool:
        """Whether a thing is in another room than the robot, with a wall between."""
        here = (self.viewer.x_m, self.viewer.y_m)
        room = self.simap.room_at(*here) if self.simap.rooms else None
        if room is None or self._room_ids.get(thing.id, room.id) == room.id:
            return False
        return self._walled(np.array(here), np.array(thing.centroid_m[:2]))

    def _first(self, S: Named, n: int) -> Things:
        found = self.set_of(S)
        found = self._choice_of(self._with_certain(found, n))
        chosen = found.first(n)
        if chosen.tied:
            several = found.of((*chosen.items, *chosen.tied))
            which = f"which of {several.number()} {'is' if n == 1 else 'are'} {found.most or 'meant'}"
            listed = [", ".join(item.name for item in some.items[:_MAX_LISTED]) for some in (several, chosen)]
            more = ", …" if len(several) > _MAX_LISTED else ""
            note = f"The map cannot tell {which} ({listed[0]}{more})"
            self.notes[f"{note}: {listed[1]} {'is' if n == 1 else 'are'} taken."] = None
        return chosen

    def _with_certain(self, found: Things, n: int) -> Things:
        """Return what is ordered by place, not nearness, without the doubtful before the nth certain one; note them."""
        most = found.most or SAID["most"].get(_distance_order(found), "")
        unsure = [isinstance(item, Instance) and item.id in self.simap.doubtful for item in found.items]
        certain = [k for k, is_unsure in enumerate(unsure) if not is_unsure][:n]
        if most not in _MOST_IN_PLACE or len(certain) < n or certain[-1] < n:
            return found
        kept = [*certain, *range(certain[-1] + 1, len(found))]
        passed = [item.name for item, is_unsure in zip(found.items[: certain[-1]], unsure, strict=False) if is_unsure]
        taken = ", ".join(found.items[k].name for k in certain)
        but = f"would be {most}, but {'are' if len(passed) > 1 else 'is'} doubtful"
        self.notes[f"{', '.join(passed).capitalize()} {but}: {taken} {'are' if n > 1 else 'is'} taken."] = None
        levels = tuple(found.levels[k] for k in kept) if found.levels else ()
        return replace(found, items=tuple(found.items[k] for k in kept), levels=levels)

    def _the(self, S: Named) -> Things:
        found = self.set_of(S)
        ranked = self._order(found, "near", "") if len(found) > 1 else found
        nearest = self._with_surer(replace(ranked, levels=()).first(1), ranked) if len(found) > 1 else found
        return replace(nearest, instead=found.items[1:])

    def _last(self, S: Named, n: int) -> Things:
        found = self._choice_of(self.set_of(S))
        found.expect(n)
        return replace(found, items=found.items[-n:], most="", levels=())

    def _only(self, S: Named, word: str) -> Things:
        found = self.set_of(S)
        if len(found) > 1:
            raise CommandError(f'Which {found.one} is "{word}" is not known: there are {found.number()}.')
        return found

    def _nth(self, S: Named, k: int) -> Any:
        return self._choice_of(self.set_of(S)).nth(k)

    def _choice_of(self, found: Things) -> Things:
        """Remember what is chosen from, in its order, for whoever is shown the choice."""
        self.among = tuple(i.id for i in found.items if isinstance(i, Instance))
        self.ranking = found.number() + (f", the {found.most} first" if found.most else "")
        measured = not found.most and _distance_order(found)
        self.away_m = tuple(abs(at) * self.simap.spec.cell_size_m for at in found.levels) if measured else ()
        return found

    # ---- numbers

    def _count(self, S: Named) -> int:
        found = self.set_of(S)
        self.counted.append(found)
        return len(found)

    def distance_between(self, A: Any, B: Any) -> float:
        """Return how far apart two things, rooms, positions, or the robot, are, edge to edge, metres."""
        if self._point_of(A) is not None:
            A, B = B, A
        point, end = self._point_of(A), self._point_of(B)
        if point is not None and end is not None:
            return round(float(np.hypot(*(point - end))), 9)
        room = self.room_of(A)
        items = self._some(A).items if room is None else (room,)
        if end is None and {_key(i) for i in items} & {_key(i) for i in self._some(self.room_of(B) or B).items}:
            return 0.0
        return float(self._far(items, B).min())

    _distance = distance_between

    def size_of(self, T: Any, key: str) -> float:
        """Return the area, length, width or height of a thing or room, square metres or metres, or lightness."""
        room = self.room_of(T)
        if room is None:
            return self.measure(self.thing_of(T), key)
        if key in ("height", "lightness"):
            raise CommandError(f"The {'height' if key == 'height' else 'colour'} of a room is not on this map.")
        sides = sorted(cv2.minAreaRect(np.array(room.polygon_m, np.float32))[1])
        return {"area": room.area_m2, "length": round(sides[1], 4), "width": round(sides[0], 4)}[key]

    _size = size_of

    def measure(self, thing: Instance, key: str) -> float:
        """Return the area, length, width or height of a thing, square metres or metres, or its lightness, 0 to 100.

        NaN where its colour is not known.
        """
        if key == "lightness":
            rgb = self.simap.color_of(thing)
            return float("nan") if rgb is None else float(lab(rgb)[0])
        if key == "area":
            return thing.area_m2(self.simap.spec.cell_size_m)
        if key == "height":
            return float(thing.aabb_m[1][2])
        return self._box(thing)[0 if key == "length" else 1]

    # ---- the way

    def _avoid(self, S: Any, metres: float | None) -> None:
        if metres is not None and metres < 0:
            raise CommandError(f"metres: expected 0 or more, found {metres:g}")
        room = self.room_of(S)
        things = [] if room is not None else self.things_of(self._some(S))
        if self._keep_off is None:
            raise PlanningError("nothing is driven here, so nothing can be avoided")
        if room is not None:
            self._keep_off(self.simap.room_cells == room.id, (), the_room(room), 0.0 if metres is None else metres)
        else:
            cells = np.isin(self.simap.instance, [thing.id for thing in things])
            self._keep_off(cells, things, self.set_of(S).the, metres)

    # ---- positions

    def _lap(self, T: Named, turns: float) -> list[list[float]]:
        found = self._some(T)
        if self._make_lap is None:
            raise PlanningError(f"no way around {found.the} is known")
        return self._make_lap([self.thing_of(T)] if isinstance(T, str) else self.things_of(found), turns)

    def _spot(self, T: Any, side: str, metres: float | None) -> Position:
        room = self.room_of(T)
        if room is not None and side == "level":
            raise CommandError(f"a robot is level with a thing, not with {room.name}")
        if room is not None:
            return self._end_of_room(room, side)
        thing = self.thing_of(T)
        centroid = np.array(thing.centroid_m[:2])
        if side == "level":
            here = np.array([self.viewer.x_m, self.viewer.y_m])
            ahead = np.array([np.cos(self.viewer.yaw_rad), np.sin(self.viewer.yaw_rad)])
            return Position(here + ahead * max(float((centroid - here) @ ahead), 0.0))
        if side in ("end", "flank"):  # that of the two which is nearer
            _, along = self._long_axis(thing)
            way = along if side == "end" else np.array([-along[1], along[0]])
            way = way if self.way_of("front", centroid) @ way >= 0.0 else -way
        else:
            way = self.way_of(side, centroid)
        extent = float(((self.cells.edge(thing.id) - centroid) @ way).max()) + self.simap.spec.cell_size_m / 2.0
        beyond = self._radius_m + CLEARANCE_M if metres is None else metres
        words = side if side == "beside" else _side_words(side)
        return Position(centroid + way * (extent + beyond), thing, words)

    def _end_of_room(self, room: Room, side: str) -> Position:
        cells = self._cells_of_room(room)
        if side == "end":  # of its longer way, that farther from the robot
            offset = cells - cells.mean(axis=0)
            along = offset @ np.linalg.eigh(offset.T @ offset)[1][:, -1]
            here = (self.viewer.x_m, self.viewer.y_m)
            ends = [cells[along.argmin()], cells[along.argmax()]]
            farther = max(ends, key=lambda end: float(np.hypot(*(end - here))))
            third = cells[np.abs(along - along[(cells == farther).all(axis=1)][0]) <= np.ptp(along) / 6.0]
            return Position(third[np.hypot(*(third - third.mean(axis=0)).T).argmin()])
        ways = [self._part_way("front" if one == "beside" else one) for one in side.split()]
        at = cells @ np.sum(ways, axis=0)
        third = cells[at >= at.min() + (at.max() - at.min()) * 2.0 / 3.0]
        return Position(third[np.hypot(*(third - third.mean(axis=0)).T).argmin()])

    def _way(self, A: Any, B: Any, share: float) -> Position:
        end, thing = self.middle_of(A)
        start, _ = self.middle_of(B)
        return Position(start + share * (end - start), thing)

    def _centre(self, T: Any) -> Position:
        if self.room_of(T) is None and not isinstance(T, list) and T not in ("", SELF):
            things = self.things_of(self._some(T))
            return Position(self.centroids(things).mean(axis=0), things[0] if len(things) == 1 else None)
        return Position(*self.middle_of(T))

    def _corner(self, T: Any, which: str, of: Any) -> Position:
        room = self.room_of(T)
        thing = self.thing_of(T) if room is None else None
        cells = self._cells_of_room(room) if room is not None else self.cells.edge(self.thing_of(T).id)
        low, high = cells.min(axis=0), cells.max(axis=0)
        corners = {}
        for name in ("north east", "north west", "south east", "south west"):
            way = np.sign(_COMPASS[name])
            if thing is not None:
                corners[name] = np.where(way > 0, high, low) + way * CLEARANCE_M
            else:  # of a room, which is no rectangle: its farthest cell that way
                corners[name] = cells[(cells @ way).argmax()]
        from_here = isinstance(of, str) and of in ("", SELF)
        near = (
            np.array([[self.viewer.x_m, self.viewer.y_m]])
            if from_here
            else np.concatenate([self.cells_of(one) for one in self.things_of(self._some(of))])
        )
        name = which or min(corners, key=lambda name: float(np.hypot(*(near - corners[name]).T).min()))
        return Position(corners[name], thing, "at a corner of" if thing else "")

    def _entrance(self, R: Any) -> Position:
        room = self._room(R)
        if not room.doors:
            raise CommandError(f"No doorway of {the_room(room)} is known on this map.")
        here = (self.viewer.x_m, self.viewer.y_m)
        return Position(
            min((door.point_m for door in room.doors), key=lambda p: float(np.hypot(*np.subtract(p, here))))
        )

    def _pose(self, when: str) -> Position:
        pose = self.start if when == "start" else self.viewer
        return Position((pose.x_m, pose.y_m))

    # ---- look-ups of the robot

    def nth_from(self, name: Named, side: str, n: int) -> Instance:
        """Return the n-th thing counted from a side, by centroids; left and right are the viewer's."""
        return self._order(self._found(name), side, "").nth(n)

    def closest_to(self, name: Named, other: Named, which: int | Named = 1) -> Instance:
        """Return the thing whose cells come nearest to another's; that itself left out."""
        found = self._found(name)
        target = other if isinstance(other, Instance) else self.pick(other, which)
        self._note_anchors(target)
        near = self._order(found, "near", target).items
        if not near:
            raise CommandError(f"There is only 1 {found.one} on this map; none is left to be near it.")
        return near[0]

    def between(self, name: Named, other_a: Named, other_b: Named) -> Instance:
        """Return the thing between two others, nearest to the line of their centroids."""
        return self._between(self._found(name), other_a, other_b).nth(1)

    def in_view(self, name: Named) -> Things:
        """Return the things within the field of view that nothing hides, the closest first."""
        return self._visible(self._found(name))

    def _found(self, name: Named) -> Things:
        if isinstance(name, str):
            self.labels_of(name)
        return self.set_of(name)

    # ---- answers

    def _tell(self, value: Any, kind: str, other: Any, key: str) -> None:
        text, said, things = told(self, value, kind, other, key)
        self.counted.clear()
        before = self.answer or {"text": "", "instances": []}
        ids = [*before["instances"], *(i.id for i in things)]
        self._values.append(said)
        value = said if len(self._values) == 1 else list(self._values)
        self.answer = {
            "text": f"{before['text']} {text}".strip(),
            "value": value,
            "instances": list(dict.fromkeys(ids)),
        }


def pair_words(a: Instance, b: Instance) -> str:
    """Speak of two things: "the couch and the lamp", and of two of one class by their names."""
    return f"{a.name} and {b.name}" if a.label == b.label else f"the {a.label} and the {b.label}"


def _distance_order(found: Things) -> str:
    """Return "near" or "far" where a set is in the order of its distance from others, as its words say, else empty."""
    last = found.after.rpartition(", ")[2]
    return next((key for key in ("near", "far") if last.startswith(SAID["most"][key])), "")


def _side_words(side: str) -> str:
    return (SAID["side_of"] | SAID["end_of"]).get(side, f"{side} of")


def _key(item: Any) -> tuple[bool, int]:
    return isinstance(item, Instance), item.id
