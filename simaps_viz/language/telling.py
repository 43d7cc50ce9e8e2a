"""What is told in answer to a question: a sentence, a value, and the things it speaks of."""

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.naming import color_name
from simaps_viz.errors import CommandError
from simaps_viz.language.grounding import Things, one_thing, the_room, with_article
from simaps_viz.language.primitives import SAID, SELF
from simaps_viz.language.words import KINDS, plural
from simaps_viz.structures import Instance

if TYPE_CHECKING:
    from simaps_viz.language.sets import Sets

Told = tuple[str, Any, Sequence[Instance]]
"""The sentence, its value (number, truth, name or None), and the things it speaks of."""
_MAX_LISTED: Final = 12
_BEND_M: Final = 0.35
"""How far a way may leave the straight line before that is a turn."""
_WIDE: Final = frozenset((*KINDS["storage"], *KINDS["picture"], "couch", "tv", "window", "door", "curtain"))
"""What is deep rather than long: its longer side is its width."""
_LANDMARK_M: Final = 1.0
_COUNTED: Final = ("count", "whether", "where", "which")
"""Questions whose answers say how many are doubtful beside the number."""
_BENDS: Final = ((25.0, "straight on"), (60.0, "bear {}"), (130.0, "turn {}"), (180.1, "turn around"))
"""(degrees up to which, what a turn is called)."""
_COMPASS: Final = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")


def told(sets: "Sets", value: Any, kind: str, other: Any, key: str) -> Told:
    """Return the answer to one question; see `tell` in ``functions.json``.

    Raises:
        CommandError: when a value is of no use for that kind of question.
    """
    text, said, things = _told(sets, value, kind, other, key)
    unsure = sum(thing.id in sets.simap.doubtful for thing in things)
    if not unsure or (kind in _COUNTED and len(things) > 1):
        return text, said, things
    who = "It" if len(things) == 1 else "All" if unsure == len(things) else f"{unsure} of them"
    return f"{text} {who} {'are' if unsure > 1 else 'is'} doubtful.", said, things


def _told(sets: "Sets", value: Any, kind: str, other: Any, key: str) -> Told:
    if isinstance(value, int | float | list):
        numbers = [_numbered(sets, one) for one in sets.counted]
        text, said, things = _plain(value, kind)
        shown = len(numbers) > 1 or (numbers and isinstance(value, bool))
        return (f"{text[:-1]}: {'; '.join(numbers)}." if shown else text), said, things
    found = sets.set_of(_room_or(sets, value))
    if not found.items:
        return _nothing(found, kind)
    if kind in _OF_TWO:
        return _OF_TWO[kind](sets, found, other, key)
    if not isinstance(found.items[0], Instance):
        return _rooms(sets, found, kind)
    if kind == "size":
        return _size(sets, found, key)
    return _TELL.get(kind, _what)(sets, found)


def _plain(value: float | list, kind: str) -> Told:
    """Return the answer that is a truth value, a number or a position."""
    if isinstance(value, bool):
        return ("Yes." if value else "No."), value, []
    if isinstance(value, list):
        return (f"At x {value[0]:.2f} m, y {value[1]:.2f} m." if len(value) == 2 else f"{len(value)}."), None, []
    return (f"{value:.2f} m." if kind in ("distance", "size") else f"{value:g}."), value, []


def _room_or(sets: "Sets", value: Any) -> Any:
    """Return a room of that name, if a text names one and no class of things, else the value."""
    room = sets.room_of(value) if isinstance(value, str) else None
    return value if room is None else room


def place_of(sets: "Sets", thing: Instance) -> str:
    """Describe where a thing is: "2.4 m from you, on your left, in the kitchen"."""
    words = [f"{sets.distance_m(thing):.1f} m from you", _bearing(sets, np.array(thing.centroid_m[:2]))]
    room = _room_name(sets, thing)
    return ", ".join([word for word in words if word] + ([f"in {room}"] if room else []))


def _bearing(sets: "Sets", point: NDArray) -> str:
    """Return "on your left" of a place, nothing where the robot stands there."""
    offset = point - (sets.viewer.x_m, sets.viewer.y_m)
    turn = np.rad2deg(np.arctan2(offset[1], offset[0]) - sets.viewer.yaw_rad)
    return SAID["bearings"][int(np.floor((turn + 22.5) % 360.0 / 45.0))] if np.hypot(*offset) > 1e-6 else ""


def _room_name(sets: "Sets", thing: Instance) -> str:
    if not sets.simap.rooms:
        return ""
    room = sets.simap.room_of(thing.id)
    return the_room(room) if room is not None else ""


def _nothing(found: Things, kind: str) -> Told:
    missing = (found.missing or "").partition(" It has")[0]
    text = missing or found.none()
    if kind == "whether":
        return f"No, {text[0].lower()}{text[1:]}", False, found.elsewhere
    return text, 0 if kind == "count" else None, []


def _number(sets: "Sets", found: Things, where: str = "") -> str:
    """Return "are 3 chairs", with how many of them are doubtful."""
    return f"{'is' if len(found) == 1 else 'are'} {_numbered(sets, found, where)}"


def _numbered(sets: "Sets", found: Things, where: str = "") -> str:
    n, doubtful = len(found), sum(thing.id in sets.simap.doubtful for thing in found.items)
    some = "all" if doubtful == n else doubtful
    more = f", {some} of them doubtful" if doubtful and n > 1 else ""
    return f"{found.number()}{where}{more}"


def _count(sets: "Sets", found: Things) -> Told:
    where = "" if found.after else " on this map"
    return f"There {_number(sets, found, where)}.", len(found), list(found.items)


def _whether(sets: "Sets", found: Things) -> Told:
    nearest = sets.ranked(found.items)[0]
    if len(found) == 1:
        return f"Yes, there is one {found.one}; it is {place_of(sets, nearest)}.", True, list(found.items)
    return f"Yes, there {_number(sets, found)}; the nearest is {place_of(sets, nearest)}.", True, list(found.items)


def _where(sets: "Sets", found: Things) -> Told:
    first = found.items[0]
    if len(found) == 1:
        # what was looked for may be a kind or a description: say what it is, too
        is_a = "" if found.noun == _noun(first) else f"{with_article(_noun(first))}, "
        text = f"{_cap(found.the)} is {is_a}{place_of(sets, first)}"
        also = [f"{with_article(_noun(i))}, {place_of(sets, i)}" for i in found.tied]
        # Of two that are as large, say, neither is the largest.
        tied = f"; as far as the map can tell, so is {'; and '.join(also)}" if also else ""
        return f"{text}{tied}.", first.label, [first]
    places = "; ".join(place_of(sets, i) for i in found.items[:_MAX_LISTED])
    more = "; …" if len(found) > _MAX_LISTED else ""
    return f"There {_number(sets, found)}: {places}{more}.", first.label, list(found.items)


def _what(sets: "Sets", found: Things) -> Told:
    counts: dict[str, int] = {}
    for thing in found.items:
        counts[_noun(thing)] = counts.get(_noun(thing), 0) + 1
    parts = [with_article(noun) if n == 1 else f"{n} {plural(noun)}" for noun, n in counts.items()]
    listed = _and(
        parts[:_MAX_LISTED] + ([f"{len(parts) - _MAX_LISTED} more kinds"] if len(parts) > _MAX_LISTED else [])
    )
    there = "is" if len(found) == 1 else "are"
    after = f" {found.after}" if found.after else ""
    text = f"There {there} {listed}{after}."
    if len(found) == 1 and not found.after:
        text = f"It is {listed}, {place_of(sets, found.items[0])}."
    return text, ", ".join(counts), list(found.items)


def _room(sets: "Sets", found: Things) -> Told:
    names = [_room_name(sets, i) or "no room of this map" for i in found.items]
    if len(found) == 1:
        name = names[0]
        return f"{_cap(found.the)} is in {name}.", name.removeprefix("the "), list(found.items)
    parts = [f"{names.count(name)} in {name}" for name in dict.fromkeys(names)]
    return f"{_cap(found.the)} are: {_and(parts)}.", names[0].removeprefix("the "), list(found.items)


def _color(sets: "Sets", found: Things) -> Told:
    seen = [sets.simap.color_of(thing) for thing in found.items]
    named = Counter(color_name(rgb) for rgb in seen if rgb is not None)
    if not named:
        return f"The colour of {found.the} is not known on this map.", None, list(found.items[:1])
    (name, _), *others = named.most_common()
    looks = f"about {name}" if not others else _and([f"{n} about {color}" for color, n in named.most_common()])
    verb = "looks" if len(found) == 1 else "look"
    return (
        f"{_cap(found.the)} {verb} {looks}, as the camera saw {'it' if len(found) == 1 else 'them'}.",
        name,
        list(found),
    )


def _size(sets: "Sets", found: Things, key: str) -> Told:
    thing = found.items[0]
    sizes = {name: sets.measure(thing, name) for name in ("length", "width", "height", "area")}
    the = _cap(found.the if len(found) == 1 else f"the nearest {found.one}")
    key = SAID["by_size"].get(key, [key])[0]
    if key == "width" and _noun(thing) in _WIDE:
        sizes["width"] = sizes["length"]
    if key in sizes:
        return f"{the} {SAID['measured'][key].format(sizes[key])}.", round(sizes[key], 3), [thing]
    text = "{} is {:.2f} m long, {:.2f} m wide and {:.2f} m high; it covers {:.2f} m²."
    return text.format(the, *sizes.values()), round(sizes["area"], 3), [thing]


def _distance(sets: "Sets", found: Things, other: Any, _: str) -> Told:
    first = found.items[0]
    end = sets.set_of(_room_or(sets, other)) if other not in ("", SELF) and not isinstance(other, list) else None
    if end is not None and not end.items:
        return _nothing(end, "distance")
    far = sets.distance_between(first, SELF if other == "" else other if end is None else end.items[0])
    subject = _cap(_name_of(found))
    things = [i for i in (first, *(end.items[:1] if end else ())) if isinstance(i, Instance)]
    away = "away" if end is None else f"from {_name_of(end)}"
    return f"{subject} is {far:.1f} m {away}.", round(far, 3), things


def _way(sets: "Sets", found: Things, other: Any, _: str) -> Told:
    """Describe the way to a thing or room, from the robot or from another one, turn by turn, its value the length."""
    begin = None if other in ("", SELF) else sets.set_of(_room_or(sets, other))
    if begin is not None and not begin.items:
        return _nothing(begin, "way")
    if sets.route is None:
        raise CommandError("no way can be told where nothing is driven")
    goal = found.items[0]
    path = sets.route([*(begin.items[:1] if begin else ()), goal])
    start = path.points_m[0]
    corners = cv2.approxPolyDP((path.points_m - start).astype(np.float32)[:, None], _BEND_M, False)[:, 0] + start
    parts, before = [], None if begin else sets.viewer.yaw_rad
    for a, b in pairwise(corners):
        yaw = float(np.arctan2(*(b - a)[::-1]))
        if before is None:
            turn = f"go {_COMPASS[round(yaw / (0.25 * np.pi)) % 8]}"
        else:
            off = float(np.rad2deg((yaw - before + np.pi) % (2.0 * np.pi) - np.pi))
            side = "left" if off > 0 else "right"
            turn = next(said for most, said in _BENDS if abs(off) <= most).format(side)
            turn += _landmark(sets, a, goal) if parts else ""
        parts.append(f"{turn}, {float(np.hypot(*(b - a))):.1f} m")
        before = yaw
    at = [sets.simap.room_at(*point) for point in path.points_m] if sets.simap.rooms else []
    rooms = list(dict.fromkeys(the_room(room) for room in at if room is not None))
    through = f" through {_and(rooms)}" if len(rooms) > 1 else ""
    where = f"from {_name_of(begin)} to {_name_of(found)}" if begin else f"to {_name_of(found)}"
    text = f"The way {where} is {path.length_m:.1f} m long{through}{': ' if parts else ''}{'; '.join(parts)}."
    if isinstance(goal, Instance):
        off_m = sets.distance_between(goal, path.points_m[-1].tolist())
        text += f" It ends {off_m:.1f} m from the edge of {_name_of(found)}."
    return text, round(path.length_m, 3), [goal] if isinstance(goal, Instance) else []


def _landmark(sets: "Sets", point: NDArray, goal: Any) -> str:
    """Return " at the chair" where one thing stands nearest to a turn, else nothing."""
    far = sets.cells.from_point(float(point[0]), float(point[1]))
    near = min(
        (i for i in sets.simap.instances if i != goal), key=lambda i: float(far[sets.cells.row_of[i.id]]), default=None
    )
    if near is None or far[sets.cells.row_of[near.id]] > _LANDMARK_M:
        return ""
    return f" at {one_thing(near).the}"


def _side(sets: "Sets", found: Things, other: Any, key: str) -> Told:
    end = sets.set_of(other)
    if not end.items:
        return _nothing(end, "side")
    pair = (found.items[0], end.items[0])
    middles = [sets.middle_of(one)[0] for one in pair]
    sides = ("north", "south", "east", "west") if key == "compass" else tuple(SAID["side_of"])
    side = max(sides, key=lambda side: float(sets.way_of(side, middles[1]) @ (middles[0] - middles[1])))
    where = f"{side} of" if key == "compass" else SAID["side_of"][side]
    seen = "" if key == "compass" else ", seen from where you are"
    text = f"{_cap(_name_of(found))} is {where} {_name_of(end)}{seen}."
    return text, side, list(pair)


def _compare(sets: "Sets", found: Things, other: Any, key: str) -> Told:
    end = sets.set_of(_room_or(sets, other))
    if not end.items:
        return _nothing(end, "compare")
    key = key or "large"
    more, unit = SAID["more"].get(key, SAID["more"]["large"])
    measure, sign = SAID["by_size"].get(key, ("", 1 if key == "far" else -1))
    pair = (found.items[0], end.items[0])
    both = [sets.size_of(one, measure) if measure else sets.distance_between(one, SELF) for one in pair]
    if np.isnan(both).any():
        raise CommandError("The colours of these things are not known on this map.")
    truth = bool(sign * both[0] > sign * both[1])
    the = [_name_of(found), _name_of(end)]
    equal = round(both[0], 2) == round(both[1], 2)
    than = (
        f"as {'light' if key in ('dark', 'bright') else key} as" if equal else f"{'' if truth else 'not '}{more} than"
    )
    things = [i for i in pair if isinstance(i, Instance)]
    return (
        f"{'Yes' if truth else 'No'}, {the[0]} is {than} {the[1]}: {both[0]:.2f} {unit} against {both[1]:.2f}.",
        truth,
        things,
    )


def _rooms(sets: "Sets", found: Things, kind: str) -> Told:
    first, n = found.items[0], len(found)
    names = [the_room(room) for room in found.items]
    here = sets.distance_between(first, SELF) == 0.0
    match kind:
        case "count":
            return f"There {'is' if n == 1 else 'are'} {found.number()} on this map.", n, []
        case "size":
            return f"{_cap(names[0])} covers {first.area_m2:.1f} m².", round(first.area_m2, 3), []
        case "where" | "whether":
            away = f"{sets.distance_between(first, SELF):.1f} m from you, {_bearing(sets, np.array(first.centre_m))}"
            place = "where you are" if here else away
            yes, value = ("Yes, ", True) if kind == "whether" else ("", first.name)
            return _cap(f"{yes}{names[0]} is {place}."), value, []
        case "what":
            inside = tuple(sets.simap.by_id(number) for number in first.objects)
            things = Things(inside, "thing", "things", after=f"in {names[0]}")
            return _what(sets, things) if inside else _nothing(things, kind)
        case "which" | "room" if n == 1:
            also = _and([the_room(room) for room in found.tied])
            tied = f"; as far as the map can tell, so is {also}" if also else ""
            return f"{'You are in' if here and not also else 'It is'} {names[0]}{tied}.", first.name, []
    return f"There {'is' if n == 1 else 'are'} {_and(names)}.", ", ".join(room.name for room in found.items), []


_TELL: Final = {
    "count": _count, "whether": _whether, "where": _where, "which": _where, "what": _what, "list": _what, "room": _room,
    "color": _color,
}  # fmt: skip
_OF_TWO: Final = {"compare": _compare, "distance": _distance, "side": _side, "way": _way}


def _noun(thing: Instance) -> str:
    return one_thing(thing).noun


def _name_of(found: Things) -> str:
    first = found.items[0]
    if not isinstance(first, Instance):
        return the_room(first)
    return (
        found.the if len(found) == 1 else f"the nearest {found.one}" if not found.before else f"the first {found.one}"
    )


def _and(parts: list[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _cap(text: str) -> str:
    return text[:1].upper() + text[1:]
