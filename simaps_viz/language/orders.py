"""Orders and questions: verb phrases over noun phrases, and what joins them, to the steps of a program."""

import re
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final, NamedTuple

from simaps_viz.errors import CommandError
from simaps_viz.language.grammar import no_reading, no_reading_if
from simaps_viz.language.nouns import (
    AHEAD,
    ALL,
    CORNERS,
    GRAMMAR,
    IN_ROOM,
    IT,
    LAST,
    LEFT_OUT,
    ONE,
    SAME,
    SUCH,
    Part,
    Parts,
    Phrase,
    lent,
    quoted,
    refine,
    select,
    sharing,
    united,
)
from simaps_viz.language.primitives import SAID
from simaps_viz.language.words import Noun

_METRES: Final = {
    "METRES": 1.0, "CENTIMETRES": 0.01, "MILLIMETRES": 0.001, "KILOMETRES": 1000.0, "FEET": 0.3048, "INCHES": 0.0254,
    "YARDS": 0.9144, "STEPS": 0.7,
}  # fmt: skip
_A_LITTLE_M: Final = 0.5
_A_LITTLE_DEG: Final = 30.0
_MAX_BARE_M: Final = 15.0
"""A larger number without a unit that says how far to one side is an angle."""
_MAX_TIMES: Final = 100
_MAX_LAPS: Final = 20
_COMPASS: Final = {"north": 0.0, "east": 90.0, "south": 180.0, "west": 270.0}
AT_BACK: Final = ', "behind")'
ONE_OF_ROOM: Final = re.compile(rf'inside\({ONE}, room\("[^"]*"\)\)')
ALL_ROOMS: Final = Phrase("rooms()", "rooms()", "room", True)
EVERYTHING: Final = Phrase('things("anything")', 'things("anything")', "thing", True)


@dataclass(frozen=True)
class Do:
    """Lines of a program; ``{0}`` is the first phrase as arguments of a primitive, ``{0.text}`` as a value."""

    lines: tuple[str, ...]
    phrases: tuple[Phrase, ...] = ()
    notes: tuple[str, ...] = ()
    verb: str = "go"
    """"go" or "face": what is done with a thing that is named next without a verb; "" where one is named so here."""


@dataclass(frozen=True)
class Repeat:
    """Steps that are done several times."""

    times: int
    steps: "Steps"


@dataclass(frozen=True)
class Choose:
    """Steps that are done where a condition holds, and others where it does not."""

    test: str
    phrases: tuple[Phrase, ...]
    then: "Steps"
    otherwise: "Steps" = ()
    after: bool = False
    """Whether the condition was said after the steps, so that "it" in it is what they name."""


Step = Do | Repeat | Choose
Steps = tuple[Step, ...]


def _act(step: Step) -> Do:
    """Return a step that is lines of a program; a loop or a choice is no reading."""
    return step if isinstance(step, Do) else no_reading()


@dataclass(frozen=True)
class Measure:
    """Metres or degrees as program text, with a note on how they were read."""

    text: str
    note: tuple[str, ...] = ()
    has_unit: bool = True

    @property
    def negated(self) -> str:
        """Return it with the other sign."""
        return self.text[1:] if self.text.startswith("-") else f"-{self.text}"


def tidy(number: float) -> str:
    """Return a number as program text without needless digits: 2.0 -> "2"."""
    return f"{round(number, 6):.6f}".rstrip("0").rstrip(".")


_rule, _words = GRAMMAR.rule, GRAMMAR.words
_ONE_METRE: Final = Measure("1", ("no distance was said: 1 m",))


def _each(call: str, targets: Sequence[Phrase], verb: str = "go", notes: tuple[str, ...] = ()) -> Steps:
    return tuple(Do((call,), (phrase,), notes, verb) for phrase in targets)


_words("_np", "np")

# ---- distances and angles

for _name, _size in _METRES.items():
    _rule("unit", _name)(lambda name=_name: name)


@_rule(
    "distance",
    "n:amount? SIZE? unit FURTHER? | n:NUM | DET? half:HALF OF? DET? unit FURTHER? | (INDEF | OTHER) SIZE? (half:HALF "
    "(OF? DET)?)? unit | (n:amount | DET)? quarter:QUARTER (OF DET)? unit | few:SLIGHTLY | n:amount unit AND DET? "
    "half:HALF",
)
def _distance(n: float | None = None, unit: str = "", half: str = "", quarter: str = "", few: str = "") -> Measure:
    if few:
        return Measure(tidy(_A_LITTLE_M), (f"a little is read as {_A_LITTLE_M:g} m",))
    amount = 1.0 if n is None else n
    if n is not None and half:
        amount += 0.5
    elif half:
        amount *= 0.5
    elif quarter:
        amount *= 0.25
    note = f"{tidy(amount)} is read as metres" if not unit else ""
    note = f"a step is read as {_METRES['STEPS']:g} m" if unit == "STEPS" else note
    return Measure(tidy(amount * _METRES[unit or "METRES"]), (note,) if note else (), bool(unit))


_rule("distance", "(EXACTLY | BY) distance")(lambda distance: distance)
_rule("distance", "DET unit AND DET? HALF", cost=-0.1)(lambda unit: Measure(tidy(1.5 * _METRES[unit])))
_rule("angle", "n:NUM DEGREES?")(lambda n: Measure(tidy(n)))


@_rule("angle", "(DET | n:amount)? QUARTER")
@_rule("portion", "(DET | n:amount)? (half:HALF | QUARTER | eighth:EIGHTH) (OF? DET)? (TURN | CIRCLE)")
def _part_of_turn(n: float = 1.0, half: str = "", eighth: str = "") -> Measure:
    return Measure(tidy(n * (180.0 if half else 45.0 if eighth else 90.0)))


_rule("angle", "portion")(lambda portion: portion)
_rule("angle", "SLIGHTLY")(lambda: Measure(tidy(_A_LITTLE_DEG), (f"a little is read as {_A_LITTLE_DEG:g} degrees",)))


# ---- going to things and rooms

_words("_prep", "TO | TOWARD | NEAR | AT | BY | ON | FOR | FORWARD | BACK | IN | UNTIL (HERE IS)? | ONLY")
_words("_goer", "GO OVER? (AND? STAND)? | STAND (FOR HERE)? | TAKE | RETURN")
_words("_place", "DET* POINT")
_words("_go", "_goer _prep* | APPROACH _prep* | _prep+")
_words("_aim", "(WHERE | DET? ONE THAT?) HERE? (GO | NEED)+ (_prep | GO)* THEN? | DET* GOAL")


@_rule(
    "order",
    "_goer EITHER? _prep+ (_place _prep*)? WHERE? targets IS? | BACK _prep+ targets | APPROACH (_prep | STOP)* "
    "targets | (_goer | APPROACH) WHERE targets IS+ | targets (COMMA | STOP)+ GO | NEED TO? targets VISITED? | _prep+ "
    "targets HERE? (GO | STAND) | !(ON | IN | AT) _prep+ targets | (GO STAND? | TAKE) _prep* targets:there | (targets "
    "| targets:there) COMMA? IS _aim | DET* GOAL (IS | COMMA | STOP)* targets",
)
def _go_to(targets: tuple[Phrase, ...]) -> Steps:
    return _each("robot.move_to_{0.goal}", targets)


@_rule("order", "(NEED targets VISITED | NEED? targets:there VISITED) sorted", cost=-0.3)
def _go_sorted(targets: tuple[Phrase, ...], sorted: Parts) -> Steps:
    """Read "I'd like the three shelves inspected, west end first", "... I want them checked, the largest first"."""
    phrase, part = targets[0], sorted[0]
    no_reading_if(len(targets) > 1 or not (phrase.many or phrase.text == IT))
    return _go_to((replace(phrase, text=f'order({phrase.text}, "{part.text}")', whole="", many=True, base=ONE),))


@_rule("order", "targets IS THEN", cost=0.1)
@_rule("order", "TO targets", cost=-0.001)
@_rule("order", "AT targets", cost=-0.02)
@_rule("order", "(ON | IN | AT) _prep* targets")
def _likewise(targets: tuple[Phrase, ...]) -> Steps:
    """Read "look at the sofa and then at the table", "turn to the sofa, then to the table": the verb of the first."""
    return _each("", targets, "")


# "where can I wash my hands?", which moves nothing
_rule("question", "place:PLACE &ASKED", cost=-0.05)(lambda place: _told(select(place, ()), "where"))


@_rule("order", "verb:GO DET? noun", cost=0.3)
def _go_tersely(verb: str, noun: Noun) -> Steps:
    """Read "go sink", but not "move chair"."""
    no_reading_if(
        verb.split(maxsplit=1)[0] in ("move", "shift", "run", "get", "steer", "roll", "swing") or not noun.known
    )
    return _go_to((select(noun, ()),))


@_rule("order", "WANTED", cost=-0.05)
@_rule("order", "_goer (BY | NEAR | AT)+ IT", cost=-0.05)
def _go_by() -> Steps:
    """Read "there are boxes under the bench. Stand by them": one place will do."""
    return _go_to((Phrase(IT, "", "thing", any=True),))


@_rule("order", "place:PLACE (AT | ON | IN | BY | TO)* targets !ASKED", cost=0.1)
def _want_to_use(place: Noun, targets: tuple[Phrase, ...]) -> Steps:
    """Read "I'd love to sit on one of the chairs", or in which room: "... to watch tv in the bedroom"."""
    if len(targets) == 1 and targets[0].is_room:
        return _go_to((select(place, (Part("filter", f"inside({{}}, {targets[0].text})", phrase=targets[0]),)),))
    return _go_to(targets)


@_rule(
    "order",
    "(PASS | HANDS | _go) via:targets IN? COMMA? ONWAY targets",
    "ONWAY targets COMMA? (PASS | _go) via:targets",
    cost=-0.6,
)
@_rule("order", "_go targets COMMA? VIA via:targets", "_go VIA via:targets TO targets", cost=-0.6)
def _on_the_way(via: tuple[Phrase, ...], targets: tuple[Phrase, ...]) -> Steps:
    """Read "pass by the coat rack on your way to the suitcase", "go to the suitcase via the kitchen"."""
    return (*_go_to(via), *_go_to(targets))


# "I left my laptop on the table, go check"
_rule("order", "APPROACH", cost=0.6)(lambda: _go_to(_there()))
# "walk past the cake and then stop at the laptop", "past the rack and then on to the bench"
_rule("order", "PASS via:targets (COMMA | AND | THEN)+ (&_verb order | ON? TO targets)", cost=-0.2)(
    lambda via, order=(), targets=(): (*_go_to(via), *order, *_go_to(targets))
)
# "go to the corner with the plant"
_rule("order", "_go _dets spot:SPOT WITH np", cost=-0.1)(
    lambda spot, np: _go_to((replace(np, text=f'at({np.whole or np.text}, "{spot}")', whole=""),))
)
# "go somewhere to sit", "... something I can read, but not in the bedroom"
_rule("order", "(_goer | APPROACH WHERE?)? place:PLACE (&(COMMA | BUT | EXCEPT) post)*")(
    lambda place, post=(): _go_to((select(place, post),))
)


@_rule(
    "order",
    "!(WHERE | WITH | THAT | TO | FROM | OF | AWAY | FRONT | BEHIND) relation COMMA (_go | APPROACH) "
    "(_dets | every:EVERY (OF | DET)*) pre* noun post*",
    cost=-0.3,
)
def _go_at(relation: Parts, noun: Noun, pre: Parts = (), post: Parts = (), every: str | None = None) -> Steps:
    """Read "on the east side of the table, go to the second chair from the south": one that is there."""
    parts = [*relation, *pre, *post]
    return _go_to((select(noun, parts, every=every is not None),))


# "guide us past the sofas": by each of them
_rule("order", "_goer VIA targets", cost=0.3)(_go_to)


@_rule("order", "(_go | APPROACH) targets COMMA? (STARTWITH FROM?)? DET? key (ONE | ONES)? (n:ORD)?", cost=-0.3)
def _go_in_turn(targets: tuple[Phrase, ...], key: str, n: int = 1) -> Steps:
    """Read "visit the bed, the fridge and the sofa, the nearest first"."""
    no_reading_if(len(targets) < 2 or n != 1)
    each = united([replace(phrase, text=phrase.single) for phrase in targets])
    return _go_to((replace(each, text=f'order({each.text}, "{key}")', word="thing", many=True),))


@_rule("there", "it:IT | THAT")
def _there(it: str = "") -> tuple[Phrase, ...]:
    return (Phrase(IT, "", "it" if it in ("it", "there") else "thing", any=it == "there"),)


@_rule("order", "!(_np FINITE !WHAT) targets", cost=0.7)
def _bare(targets: tuple[Phrase, ...]) -> Steps:
    no_reading_if(any(phrase.free for phrase in targets))
    return _each("", targets, "")


@_rule("order", "!(ON | IN | AT) _go room")
def _go_room(room: Phrase) -> Steps:
    return _each("robot.move_to_{0.goal}", [room])


# "how many laptops are there, all rooms?", which moves nothing
# "toilet, then the sofa": a thing, where the map has one
_rule("_there_is", "name:NOUN")(lambda name: no_reading_if(not name.known))
_rule("order", "!(_there_is !ROOM) room !ASKED")(
    lambda room: _go_room(room) if room.text == "room()" else _each("", [room], "")
)


@_rule("order", "LEAVE (room | HERE)? !ATLEAST")
def _leave(room: Phrase | None = None) -> Steps:
    out = (Do(('robot.move_to_object(room("other"))',)),)
    if room is None or room.text == "room()":
        return out
    # Who is told to leave a room without being in it stays, and says where it is.
    return (Choose("distance({0.argument}) == 0", (room,), out, (Do(('tell(room(), "which")',)),)),)


@_rule("order", "_go _dets NEAREST? spot:SPOT ((OF | IN) (room | DET* MAP) | BETWEEN _dets _number? ROOMS)?", cost=0.2)
def _go_spot(spot: str, room: Phrase | None = None) -> Steps:
    where = "{0.text}" if room else "room()"
    calls = {"corner": f'corner({where}, "")', "middle": f"centre({where})", "door": f"entrance({where})"}
    if spot not in calls:
        raise CommandError(f"there is no {spot} on this map to go to")
    return (Do((f"robot.move_to({calls[spot]})",), (room,) if room else ()),)


@_rule("order", "_go _dets spot:SPOT ((OF | IN) room)? (NEAR | BY | AT | BEHIND | (_is? NEAREST TO?)) np", cost=-0.3)
def _go_spot_near(spot: str, np: Phrase, room: Phrase | None = None) -> Steps:
    """Read "go to the corner by the window": of the corners, the one nearest to it."""
    no_reading_if(spot != "corner")
    where = room or Phrase("room()", "", "room")
    return (Do(('robot.move_to(corner({0.text}, "", {1.argument}))',), (where, replace(np, many=False))),)


@_rule("order", "_go? _dets side (SIDE | END | spot:SPOT) (OF | IN) (room | DET* MAP)", cost=-0.1)
@_rule("order", "_go? _dets FAREND (OF | IN) room", cost=-0.2)
@_rule("order", "_goer THROUGHOUT room", cost=0.2)
def _go_end_of_room(side: str = "end", room: Phrase | None = None, spot: str = "wall") -> Steps:
    no_reading_if(spot in ("window", "door"))
    return (Do((f'robot.move_to(spot({{0.text}}, "{side}"))',), (room or Phrase("room()", "", "room"),)),)


# "go to the long side of the table", "stand at the head of the table"
_rule("order", "_go? end_of np", cost=-0.3)(
    lambda end_of, np: no_reading() if np.is_room else _each(f'robot.move_to(spot({{0.argument}}, "{end_of}"))', (np,))
)


# "go down the corridor to the coat rack"
_rule("order", "_goer THROUGHOUT room _prep+ targets", cost=-0.2)(
    lambda room, targets: (*_go_room(room), *_go_to(targets))
)
_rule("order", "(_go | PASS)? DET? BETWEEN pair (IT? HERE? (GO | STAND))?", cost=-0.5)(
    lambda pair: (Do(("robot.move_in_between({0.argument}, {1.argument})",), pair),)
)
_rule("order", "_go? DET? BETWEEN np", "_goer UNDER np", cost=0.2)(
    lambda np: no_reading() if np.many or np.text == IT else (Do(("robot.move_to(robot.get_pos({0}))",), (np,)),)
)


_rule("beside", "DET? side (SIDE | END)? (OF | FROM)", "DET* SIDE (OF | FROM)")(lambda side="beside": side)


@_rule("order", "_go? _place? beside targets", "_go? targets POSS beside:side SIDE?", cost=-0.2)
@_rule("order", "(_go | APPROACH) targets FROM DET? beside:side (SIDE | END)?", cost=0.7)
def _go_beside(beside: str, targets: tuple[Phrase, ...]) -> Steps:
    # "half of the chairs", "half of room"
    no_reading_if(beside == "beside" and (targets[0].many or targets[0].is_room))
    if beside in ("left", "right", *_COMPASS):
        return _each(f"robot.move_{'to_' if beside in ('left', 'right') else ''}{beside}({{0}})", targets)
    return _each(f'robot.move_to(spot({{0.argument}}, "{beside}"))', targets)


_rule("order", "_go? FRONT targets", cost=-0.2)(
    lambda targets: _each('robot.move_to(spot({0.argument}, "front"))', targets)
)


@_rule("order", "_go? BEHIND targets", "PASS targets", cost=-0.1)
def _go_behind(targets: tuple[Phrase, ...]) -> Steps:
    notes = tuple(f"behind the {p.word} is read as its side away from the robot" for p in targets)
    return _each('robot.move_to(spot({0.argument}, "behind"))', targets, notes=notes[:1])


@_rule(
    "order",
    "_go? _place? (IN | few:LESSTHAN)? distance (TO | ON)* (beside | FRONT | BEFORE | back:BEHIND | back:PASS | "
    "off:away | off:SHORT OF) np (COMMA NOCLOSER)? | _go? np COMMA distance off:SHORT | "
    "_go? FRONT np COMMA distance (SHORT | AWAY)? | "
    "_go (FORWARD | compass)* UNTIL np IS (_prep | SHORT | DET)* distance off:SHORT | _go (FORWARD | compass)* "
    "UNTIL (EXIST (_prep | SHORT)* distance BETWEEN (np AND HERE | HERE AND np) | HERE IS? distance off:away np)",
    cost=-0.3,
)
def _go_off(
    distance: Measure, np: Phrase, beside: str = "front", back: str = "", off: str = "", few: str = "", **_: Any
) -> Steps:
    no_reading_if(not distance.has_unit)  # "visit two of the chairs"
    if few and off:
        return _go_to((np,))
    side = "behind" if back else "beside" if off else beside
    note = (*distance.note, f"{distance.text} m is measured from the edge of the {np.word}")
    return (Do((f'robot.move_to(spot({{0.argument}}, "{side}", {distance.text}))',), (np,), note),)


_rule(
    "short",
    "(STAND | KEEP | HALT) AT? distance SHORT",
    "BUT? KEEP distance (OF (BERTH | DISTANCE))?",
    "(STAND EXIST | (KEEP | GIVE) ATLEAST?) distance (OF (BERTH | DISTANCE))? BETWEEN (HERE AND IT | IT AND HERE)",
    "TO? IN distance (OF IT)?",
    "(KEEP | GIVE | STAND | HALT) (ATLEAST | AT)? (distance (OF DISTANCE)? | DET? DISTANCE OF BY? distance) "
    "((_away | TO) (IT | ITS END))?",
    "(STAND | GO)? NOCLOSER THAN distance ((TO | FROM) IT)?",
    cost=-0.3,
)(lambda distance: distance)
# "... Stop 1 m short."
_rule("order", "short")(lambda short: _go_off(short, Phrase(IT, ONE, "thing"), back="", off="away"))


@_rule("done", "order _mid* short", cost=-0.5)
def _go_short(order: Steps, short: Measure) -> Steps:
    """Read "go to the fridge, but no closer than 1 m": no nearer on the way either."""
    last = _act(order[-1])
    no_reading_if(last.lines != _go_to((EVERYTHING,))[0].lines or last.phrases[0].many)
    return (*order[:-1], *_go_off(short, last.phrases[0], back="", off="away"))


@_rule(
    "order",
    "_go* (FORWARD | compass)* UNTIL (HERE IS?)? (LEVEL (WITH | TO)? np | NEAR np)",
    "_go* (FORWARD | compass)* UNTIL (WITH np IS? (ON | TO | AT)+ DET* _lateral SIDE? | np IS ((ON | TO | AT)+ DET* "
    "_lateral SIDE? (OF HERE)? | NEAR HERE | LEVEL))",
    cost=-0.4,
)
def _go_until_level(np: Phrase, compass: Sequence[float] = ()) -> Steps:
    """Read "straight on until you are level with the sofa", "until the sofa is on your left"."""
    turns = tuple(f"robot.turn_absolute({tidy(degrees)})" for degrees in compass)
    return (Do((*turns, 'robot.move_to(spot({0.argument}, "level"))'), (np,)),)


_words("_away", "away")
_rule("away", "AWAY? FROM", "AWAY FROM?", "OF")(lambda: "from")


@_rule("order", "_go? _dets corner:INTER (SPOT | (SIDE | END | SPOT)? (OF | IN) (np | DET* MAP))", cost=-0.2)
def _go_corner(corner: float, np: Phrase | None = None) -> Steps:
    which = CORNERS.get(corner)
    if which is None:
        raise CommandError("a corner lies north-east, south-east, south-west or north-west")
    thing = np or Phrase("room()", "", "room")
    return (Do((f'robot.move_to(corner({{0.argument}}, "{which}"))',), (thing,)),)


_rule("times", "n:whole TIMES")(lambda n: n)
_rule("times", "TWICE")(lambda: 2)
_rule("times", "THRICE")(lambda: 3)
_rule("times", "ONCE")(lambda: 1)
_rule("round", "way")(lambda way: -1.0 if way == "left" else 1.0)


@_rule(
    "lapped",
    "lap:CIRCLE (AROUND | OF)? targets round? times? (COMMA? round)? | (GO | TAKE | CIRCLE | MAKE)? times "
    "(CIRCLE | AROUND) targets | (MAKE | GO)? EXACTLY? times? (n:amount | DET | FULL | half:HALF)* lap:LAP round? "
    "(AROUND | OF | BY) targets times? | GO half:HALF AROUND "
    "targets | CIRCLE targets (COMMA | AND)* UNTIL? (MAKE | EXIST)? n:amount LAP",
    cost=-0.4,
)
def _circle(
    targets: tuple[Phrase, ...], times: int = 1, n: Any = 1, half: Any = (), round: float = 1.0, lap: str = ""
) -> Steps:
    # of all plants: each is visited
    no_reading_if(lap.endswith(("tour", " of")) and any(phrase.many for phrase in targets))
    number = max(times, *n) if isinstance(n, tuple) else max(times, n)
    if targets[0].is_room:  # "go round all the rooms"
        return _go_to(targets)
    turns = round * (0.5 if half else number)
    if not 0 < number <= _MAX_LAPS:
        raise CommandError(f"up to {_MAX_LAPS} laps can be driven, found {number:g}")
    lines = (f"for point in lap({{0.measure}}{'' if turns == 1 else f', {tidy(turns)}'}):", "    robot.move_to(point)")
    return tuple(Do(lines, (phrase,)) for phrase in targets)


_rule("order", "lapped")(lambda lapped: lapped)
_rule("order", "lapped COMMA? BACKTOO", cost=-0.7)(lambda lapped: (*lapped, *_home()))


@_rule("order", "_goer? FORWARD? TOWARD np (COMMA | BUT)* (ONLY | BY | FOR)* distance ONLY?", cost=-0.3)
@_rule("order", "_goer FORWARD? ((BY | FOR)? distance)? FORWARD? TOWARD np", "_goer distance NEAR np", cost=0.05)
def _go_toward(np: Phrase, distance: Measure | None = None) -> Steps:
    if distance is None:
        return _go_to((np,))
    return (Do(("robot.face({0})", f"robot.move_forward({distance.text})"), (np,), distance.note),)


_rule("order", "(BACKUP | GO AWAY) (BY? distance)? FROM np (BY? distance)?")(
    lambda np, distance=_ONE_METRE: (
        Do(("robot.face({0})", f"robot.move_forward({distance.negated})"), (np,), distance.note),
    )
)
_rule("order", "_goer? HALFWAY np")(lambda np: (Do(("robot.move_to(way({0.argument}))",), (np,)),))
_rule(
    "order",
    "(_along COMMA?)? (_goer? FROM (HERE | a:np) (TO | NEAR)+ | FROM (HERE | a:np) COMMA? _goer _prep+) np (_along | "
    "COMMA? back:BACKTOO (TO _np)?)?",
    cost=-0.5,
)(
    lambda np, a=None, back="": (
        *(_go_to((a,)) if a else ()),
        *_go_to((np,)),
        *((_go_to((a,)) if a else _home()) if back else ()),
    )
)
_words("_along", "_goer? (THROUGHOUT | NEAR) _np | FOLLOW _np")


@_rule("order", "_goer? times? SHUTTLE BETWEEN pair times?", cost=-0.6)
def _shuttle(pair: tuple[Phrase, Phrase], times: int = 1) -> Steps:
    a, b = _apart(pair)
    if a.text == IT:
        return (Repeat(times, (*_go_to((a,)), *_go_to((b,)))),)
    turns = ", ".join(str(n + 1) for n in range(times))  # both are looked up before the first is gone to
    there = ("    robot.move_to_object(one)", "    robot.move_to_object(other)")
    return (Do(("one = {0.single}", "other = {1.single}", f"for turn in [{turns}]:", *there), (a, b)),)


def _apart(pair: tuple[Phrase, Phrase]) -> tuple[Phrase, ...]:
    """Return two things that were named by one plural, "the two backpacks", each by itself."""
    a, b = pair
    if a.text != b.text or a.text == IT:
        return pair
    return tuple(replace(a, text=f"nth({a.text}, {n})") for n in (1, 2))


# "round trip from the couch to the microwave and back"
_rule(
    "order",
    "MAKE? ROUNDTRIP (COMMA | STOP)* FROM? a:np TO b:np (COMMA? AND? (BACKTOO | BACK) (TO (_np | DET? START))?)?",
    cost=-0.6,
)(lambda a, b: _go_to((a, b, a)))


@_rule("order", "MAKE? ROUNDTRIP (COMMA | STOP)* _prep+ targets (COMMA? BACKTOO)?", cost=-0.5)
@_rule("order", "_go targets COMMA? BACKTOO", cost=-0.6)
def _there_and_back(targets: tuple[Phrase, ...]) -> Steps:
    return (*_go_to(targets), *_home())


_words("_beginning", "DET? START | _prep+ DET? START | (TO? EXACTLY? HERE)+ | TO EXACTLY? _place HERE")


@_rule(
    "order",
    "RETURN _beginning? | (_goer | BACK) _prep* DET? START | _prep+ DET? START | GO? BACK _beginning?",
    cost=-0.3,
)
def _home() -> Steps:
    return (Do(('robot.move_to(pose("start"))',)),)


_rule("order", "_goer _prep* (DET? POINT)? x:NUM COMMA? y:NUM", cost=-1.0)(
    lambda x, y: (Do((f"robot.move_to([{tidy(x)}, {tidy(y)}])",)),)
)


@_rule("order", "HALT", "STAND (AT? HERE)?")
def _halt() -> Steps:
    return (Do(("robot.turn(0)",), notes=("in the end the robot stands still",)),)


# ---- turning

_words("_turning", "TURN | SPIN | MAKE DET? TURN")
_UNSIDED: Final = "degrees without a side is read as a turn to the right"
_words("_looking", "(GO | STAND)? FACE | LOOK | LOOK _prep+ | FACE _prep+ | TURN _prep* (LOOK | FACE) _prep*")
_rule(
    "order",
    "(_looking targets (COMMA? STILL)? | APPROACH targets COMMA? STILL) | _turning AROUND? (TO | TOWARD)+ _looking? "
    "targets | _turning way? AROUND? UNTIL HERE? (SEE | LOOK AT? | FACE) targets | _turning way? AROUND? (UNTIL | SO "
    "| THAT)+ targets IS (FRONT HERE | FORWARD (OF HERE)? | VIEW | SEEN) | _turning AROUND _looking targets | (KEEP | "
    "WITH) targets IS? (FRONT HERE | VIEW)",
)(lambda targets, way="": _each("robot.face({0})", targets, "face"))


@_rule("order", "_looking np there:IT", cost=0.1)
def _face_there(np: Phrase, there: str) -> Steps:
    """Read "go into the bedroom and look at the window there": that in the room where the robot is by then."""
    no_reading_if(there != "there" or np.many)
    return _each("robot.face({0})", [_changed(np, f"inside({np.whole or np.text}, room())")], "face")


_rule("order", "_turning AWAY FROM np", "UTURN _prep+ np", "(LOOK | FACE) AWAY FROM np", "_goer? YOURBACK np")(
    lambda np: (Do(("robot.face({0})", "robot.turn(180)"), (np,)),)
)
_words("_course", "DET? DIRECTION (OF | TO)? DET?")


for _name, _degrees in _COMPASS.items():
    _rule("compass", _name.upper())(lambda degrees=_degrees: degrees)
_rule("compass", "point:INTER")(lambda point: point)
_rule("heading", "DET? compass spot:SPOT", cost=0.1)(lambda compass, spot: no_reading() if spot != "wall" else compass)
_rule("heading", "DET? compass (SIDE | DIRECTION)?", "_course DET? compass")(lambda compass: compass)
_rule("order", "(_looking | _turning (way? AROUND? UNTIL HERE? IS?)? _prep* _looking?) heading", cost=-0.1)(
    lambda heading, way="": (Do((f"robot.turn_absolute({tidy(heading)})",)),)
)


@_rule(
    "order",
    "(_looking _course? angle | FINAL? _course angle | _turning TO (_course | DET)? angle _course?) (COMMA? compass)?",
)
def _face_heading(angle: Measure, compass: float | None = None) -> Steps:
    no_reading_if(compass is not None and float(angle.text) % 360.0 != compass)
    return (Do((f"robot.turn_absolute({angle.text})",)),)


for _name in ("left", "right"):
    _rule("lateral", _name.upper())(lambda name=_name: name)


_rule(
    "order", "(KEEP | WITH | _turning (UNTIL | WITH | THAT | SO)*) np IS? (ON | TO | AT) DET? lateral SIDE?", cost=-0.5
)(lambda np, lateral: (Do((f"robot.with_object_on_{lateral}({{0}})",), (np,)),))
_rule("hand", "(_prep | DET)* lateral SIDE?")(lambda lateral: lateral)
_rule("way", "hand")(lambda hand: hand)
_rule("way", "_prep* CLOCKWISE")(lambda: "right")
_rule("way", "_prep* COUNTERCLOCKWISE")(lambda: "left")


@_rule(
    "order",
    "_turning way | _turning (BY | FOR | DET | FULL | COMMA)* angle TURN? COMMA? way? TURN? | angle:portion (COMMA? "
    "way)? | _looking way | MAKE (BY | DET)* angle? TURN? way (TURN | angle TURN)? | MAKE DET? angle TURN? way? TURN? "
    "| way:hand | OTHER way TURN | (BY | FOR)? angle TURN? way | _turning AROUND (BY | FOR)? angle way? | way TURN | "
    "MAKE DET? TURN way",
)
def _turn(angle: Measure | None = None, way: str = "") -> Steps:
    by = angle or Measure("90")
    notes = by.note if way else (*by.note, f"{by.text} {_UNSIDED}")
    return (Do((f"robot.turn({by.negated if way == 'left' else by.text})",), (), notes),)


@_rule("order", "TURN (RIGHT | BACK | HALF)? (AROUND | BACK | BY)", "(MAKE DET?)? UTURN", cost=-0.1)
def _turn_around() -> Steps:
    return (Do(("robot.turn(180)",)),)


@_rule(
    "order",
    "MAKE DET? (SLIGHTLY | SIZE) SPIN | SPIN AROUND? way? | LOOK AROUND HERE? | "
    "(TURN | SPIN | MAKE | GIVE HERE? | GO | LOOK) AROUND? (AT | BY | IN)? (DET | ONE)? _whole way? | "
    "DET? _whole way? | TURN FULL AROUND | TURN AROUND FULL",
    cost=0.1,
)
def _turn_fully(way: str = "") -> Steps:
    notes = ("a full turn is 360 degrees", *(() if way else (f"360 {_UNSIDED}",)))
    return (Do((f"robot.turn({'-' if way == 'left' else ''}360)",), (), notes),)


_rule("order", "(_goer | HALT) FOR? whole SECONDS")(
    lambda whole: (Do(("robot.turn(0)",), notes=("the robot stops there; how long it waits is not simulated",)),)
)


@_rule("order", "_turning AROUND? times (COMMA | STOP)* way", "_whole times? (COMMA | STOP)* way", cost=-0.3)
@_rule("order", "_turning times")
def _turn_times(times: int = 1, way: str = "") -> Steps:
    """Read "spin round three times", "spin round once, to the right"."""
    return (Repeat(times, _turn_fully(way)),) if times > 1 else _turn_fully(way)


_words("_whole", "CIRCLE | FULL (CIRCLE | TURN | SPIN) | SPIN | FULL _lateral TURN")
_words("_lateral", "LEFT | RIGHT")

# ---- driving without a goal

_words("_step", "GO | STEPS | TAKE")


@_rule(
    "order",
    "_step FORWARD+ | _step (BY | FOR)? distance FORWARD* | FORWARD | distance FORWARD | MAKE distance FORWARD* | "
    "&OTHER distance FORWARD?",
)
@_rule("order", "(MAKE | GO) distance ONLY", cost=0.1)
def _forward(distance: Measure = _ONE_METRE) -> Steps:
    return (Do((f"robot.move_forward({distance.text})",), (), distance.note),)


# "one metre. Right ninety. One metre."
_rule("order", "distance", cost=0.5)(
    lambda distance: no_reading() if not distance.has_unit else (replace(_forward(distance)[0], verb=_ONWARD),)
)


_ONWARD: Final = "onward"
"""The verb of a distance alone, which only goes on with what is driven before or after it."""


@_rule(
    "order",
    "(MAKE | GO | CIRCLE) DET? shape:SHAPE (ON DET* MAP)? "
    "(COMMA | STOP | WITH | OF | EVERY | DET | SIDE | IS)* distance SIDE?",
)
@_rule("order", "(MAKE | GO | CIRCLE) DET? distance shape:SHAPE")
def _square(shape: str, distance: Measure) -> Steps:
    """Read "do a square, every side half a metre": back to where it began."""
    no_reading_if(shape != "square" or not distance.has_unit)
    side = Do((f"robot.move_forward({distance.text})", "robot.turn(90)"), (), distance.note)
    return (Repeat(4, (side,)),)


@_rule(
    "order",
    "BACKUP | BACK distance | _step _backward | back:RETURN (BY | FOR)? distance | (_step | MAKE) distance _backward | "
    "BACKWARD | distance _backward",
)
@_rule("order", "(_step | MAKE) distance (COMMA | STOP)+ _backward", cost=-0.1)
def _backward(distance: Measure = _ONE_METRE, back: str = "") -> Steps:
    verb = _BACK_AGAIN if back.startswith(("come", "go", "return")) else "go"
    return (Do((f"robot.move_forward({distance.negated})",), (), distance.note, verb),)


_BACK_AGAIN: Final = "back"
"""The verb of "come back one metre": the way it faces, once it has turned around."""


def _reversed(step: Step) -> Step:
    if not isinstance(step, Do) or step.verb != _BACK_AGAIN:
        return step
    return replace(step, lines=tuple(line.replace("(-", "(") for line in step.lines))


_words("_backward", "BACK | BACKWARD")
_rule(
    "order",
    "_step (_prep | DET)* compass SIDE? | _step (BY | FOR)? distance (_prep | DET)* "
    "compass | MAKE distance (_prep | DET)* compass | distance AWAY? (_prep | DET)* compass",
    cost=-0.2,
)(
    lambda compass, distance=_ONE_METRE: (
        Do((f"robot.turn_absolute({tidy(compass)})", f"robot.move_forward({distance.text})"), (), distance.note),
    )
)


@_rule("order", "GO way | (_step | MAKE)? (BY | FOR)? distance way", cost=-0.2)
@_rule("order", "strafe:STRAFE distance? way")
def _sideways(way: str, distance: Measure = _ONE_METRE, strafe: str = "") -> Steps:
    """Read "two metres to the left", after which the robot looks there, and "strafe left", after which it does not."""
    no_reading_if(not strafe and not distance.has_unit and float(distance.text) > _MAX_BARE_M)  # "ninety to the right"
    angle = 90 if way == "right" else -90
    lines = (f"robot.turn({angle})", f"robot.move_forward({distance.text})")
    if not strafe:
        return (Do(lines, (), distance.note),)
    note = ("the robot cannot drive sideways: it turns, drives, and turns back", *distance.note)
    return (Do((*lines, f"robot.turn({-angle})"), (), note),)


# ---- questions

Condition = tuple[str, tuple[Phrase, ...]]
_ASKS: Final = frozenset(["is", "are", "do", "does", "have", "has", "can", "could", "would", "got", "isn", "aren"])
"""What opens questions whether something is there."""


def _changed(phrase: Phrase, text: str, notes: tuple[str, ...] | None = None, many: bool | None = None) -> Phrase:
    notes = phrase.notes if notes is None else notes
    return replace(phrase, text=text, whole="", notes=notes, many=phrase.many if many is None else many)


def _told(phrase: Phrase, kind: str, *more: str) -> Steps:
    rest = "".join(f", {one}" for one in more)
    unknown = _unknown_in(phrase.inner if kind in ("count", "whether", "where") else (phrase,))
    if unknown:  # "there is no kid" is no answer to what a kid did
        raise CommandError(f'"{unknown}"')
    left_out = next((note for note in phrase.notes if LEFT_OUT in note), "")
    if left_out and kind in ("count", "whether"):  # one bottle is no answer to whether there is a thermos bottle
        raise CommandError(left_out.split(f" {LEFT_OUT}")[0])
    text = phrase.whole if kind in ("count", "whether", "list", "what") and phrase.whole else phrase.text
    return (
        Do((f'tell({{0.text}}, "{kind}"{rest})',), (replace(phrase, text=text, many=False, together=phrase.many),)),
    )


def _unknown_in(phrases: Sequence[Phrase]) -> str:
    """Return a word within some phrases that is not known at all."""
    found = (one.word if one.free else _unknown_in(one.inner) for one in phrases)
    return next((word for word in found if word), "")


_words("_count", "COUNT? HOWMANY ONLY? | COUNT ONLY?")
_rule(
    "question",
    "EXIST? _count STOP? DET* np (IS | EXIST | DOES)* post* (HERE | SEE)? | _count np (DOES | IS | WITH)* "
    "DET* (MAP | HERE) (WITH | SEE)?",
)(lambda np, post=(): _told(refine(np, post), "count"))


@_rule("question", "&EXCEPT besides:post (COMMA | STOP)? question", cost=0.2)
@_rule("question", "!(WHERE | WITH | THAT) relation COMMA? question", cost=0.4)
def _asked_there(question: Steps, relation: Parts = (), besides: Parts = ()) -> Steps:
    """Read "in the kitchen how many windows are there?", "apart from the kitchen, how many windows are there?"."""
    step = _act(question[0])
    no_reading_if(len(question) > 1 or not step.phrases or not (first := step.phrases[0]).base)
    compared = "count(" in step.lines[0] or (not besides and "minus(" in first.text)  # "more cups than bottles"
    no_reading_if(first.is_room or first.base in (ONE, SAME) or compared)
    chosen = first.text.startswith(("first(", "nth(", "nearest(", "farthest(", "last("))  # the nearest of those there
    there = refine(replace(first, text=first.base, whole="") if chosen else first, relation or besides)
    text = (first.text.replace(first.base, there.text) if chosen else there.text).replace(ONE, first.base)
    return (replace(step, phrases=(replace(there, text=text), *step.phrases[1:])),)


@_rule("question", "HOWMANY (OF? IT | IS | EXIST)* ONES? post*", cost=0.3)
def _how_many_more(post: Parts = ()) -> Steps:
    """Read "... and how many in the kitchen?", "how many of them?" after "how many lamps are in the bedroom"."""
    return _told(select(None, post, every=True) if post else Phrase(IT, ONE, "thing"), "count")


@_rule("question", "HOWMANY SEATED relation", cost=-0.5)
def _how_many_fit(relation: Parts) -> Steps:
    """Read "how many people can sit at the table?": as many as seats are there."""
    no_reading_if(relation[0].kind != "near")  # how many sit on a couch is not known
    return _told(refine(Phrase('things("seat")', 'things("seat")', "seat"), relation), "count")


_OF_THAT_NAME: Final = Phrase(SAME, SAME, "thing")
_NUMBERED: Final = (
    "exist:EXIST n:whole (OF DET)? np HERE? | exist:EXIST n:whole OF (IT | ONES)",
    "(exist:EXIST (ATLEAST | more:MORETHAN | few:LESSTHAN | only:EXACTLY | most:ATMOST) | only:EXISTONLY) n:whole np? "
    "HERE?",
)


# "how many cups and bottles are there?"
_rule("question", "HOWMANY a:np AND b:np (IS | EXIST)* (HERE | _in_map)?", cost=-0.1)(
    lambda a, b: _told(replace(united(sharing((a, b))), many=False), "count")
)


@_rule("question", "(LIST | WHICH (OF DET*)? | WHAT IS?) a:np AND b:np IS?", cost=-0.3)
def _list_together(a: Phrase, b: Phrase) -> Steps:
    """Read "which cups and bottles are on the table?"."""
    no_reading_if(not (a.many and b.many))
    return _told(replace(united(sharing((a, b))), many=False), "list")


# "on how many of the tables is there a tray?"
_rule(
    "question",
    "(ON | IN | AT) HOWMANY (OF | DET | DIFFERENT)* (np | ROOMS) (EXIST | IS | APPROACH | SEE | HERE | DOES)+ "
    "of:np IS?",
    cost=-0.1,
)(
    lambda of, np=ALL_ROOMS: _told(
        _changed(np, f"having({np.whole or np.text}, {of.argument})", np.notes + of.notes), "count"
    )
)
# "are there two or three chairs?"
_rule("question", "EXIST _number ((COMMA | OR)+ EXIST? EXACTLY? _number)+ np HERE?", cost=-0.5)(
    lambda np: _told(np, "count")
)


@_rule("question", *_NUMBERED, cost=-0.3)
def _are_there(n: int, np: Phrase = _OF_THAT_NAME, exist: str = "is", **_: str) -> Steps:
    no_reading_if(exist.split(maxsplit=1)[0] not in _ASKS)  # "there are three bags" asks nothing
    test, phrases = _at_least(n, np, **_)
    return (Do((f'tell({test}, "whether")',), phrases),)


@_rule("question", "HOWMANY counted:COUNTED a:np THAN (b:np | relation) (IS | EXIST)*", cost=-0.3)
def _how_many_more_than(counted: str, a: Phrase, b: Phrase | None = None, relation: Parts = ()) -> Steps:
    """Read "how many more chairs than tables are there?"."""
    phrases = _counts(counted, a, b, relation)[1]
    swap = phrases if counted == "more" else phrases[::-1]
    return (Do(('tell(count({0.text}) - count({1.text}), "count")',), swap),)


_rule(
    "question",
    "_count ROOMS (IS | EXIST | APPROACH | WITH)* (IN? HERE)? _in_map?",
    "_count ROOMS (_is | DOES | WITH)* DET* MAP WITH?",
)(lambda: _told(ALL_ROOMS, "count"))
_words("_in_map", "(IN | ON) DET* MAP")


@_rule("question", "_count n:np WITH of:np", cost=0.3)
@_rule("question", "_count n:np (DOES | WITH | IS) of:np WITH ((on:ON | AROUND | NEAR | BY | AT) IT)?", cost=-0.2)
def _how_many_at(n: Phrase, of: Phrase, on: str = "") -> Steps:
    beside = "inside" if of.is_room else "having" if n.is_room else "on" if on else "near"
    return _told(_changed(n, text=f"{beside}({n.text}, {of.argument})", notes=n.notes + of.notes), "count")


# "how many chairs has the table with the laptop?"
_rule("question", "_count noun WITH of:np", cost=-0.4)(lambda noun, of: _how_many_at(select(noun, ()), of))
_words("_ask", "(LIST | LOOK | SEEQ | SEE)+")


@_rule(
    "question",
    "_ask? WHERE (IS | EXIST | DOES | GO | APPROACH | TURN | LOOK | FACE | TO | HERE)* np (IS | GO | AT | ANYWHERE)*",
)
def _where(np: Phrase) -> Steps:
    return _told(np, "where")


@_rule("question", "IN? WHICH (ROOM | ROOMS) (IS | EXIST | HERE | WITH | DOES | APPROACH | SEE)* np IS? IN?", cost=-0.2)
@_rule("question", "IS np IN room OR IN? _room_too", cost=-0.3)
def _which_room(np: Phrase, room: Phrase | None = None) -> Steps:
    return _told(np, "room")


@_rule(
    "question",
    "IN? WHICH (ROOM | ROOMS) (IS | EXIST | HERE | WITH | DOES | APPROACH | SEE)* DET* key:numerous np",
    cost=-0.4,
)
def _which_room_has_most(key: str, np: Phrase) -> Steps:
    """Read "in which room are the most chairs?"."""
    ordered = f'first(order(rooms(), "{key}", {np.whole or np.argument}))'
    return _told(_changed(ALL_ROOMS, ordered, np.notes, many=False), "which")


_words("_room_too", "room")
_rule("question", "WHEREAMI HERE? IN? HERE?", "WHERE IS? HERE IS?", "IN? WHICH ROOM IS? HERE IS? IN?", cost=-0.3)(
    lambda: (Do(('tell(room(), "which")',)),)
)


@_rule("question", "EXIST np (ANYWHERE | HERE)* _in_map? &ASKED", "IS np HERE", "DOES DET* MAP WITH np")
@_rule("question", "exist:EXIST np (ANYWHERE | HERE)* _in_map?")
def _is_there(np: Phrase, exist: str = "is") -> Steps:
    # "there is a chair on your left" asks nothing
    no_reading_if(exist.split(maxsplit=1)[0] not in _ASKS or "count" in exist)
    return _told(np, "whether")


# "are you in the kitchen?"
_rule("question", "IS HERE IN room", cost=-0.2)(
    lambda room: (Do(('tell(distance({0.argument}) == 0, "whether")',), (room,)),)
)


@_rule("question", "IS room DET? key:MORE THAN n:amount SQUAREMETRES", cost=-0.4)
def _is_room_larger(room: Phrase, key: str, n: float) -> Steps:
    no_reading_if(key not in ("large", "small"))
    return (Do((f'tell(size({{0.argument}}, "area") {">" if key == "large" else "<"} {n:g}, "whether")',), (room,)),)


@_rule("question", "IS a:np b:np &ASKED", cost=0.3)
def _is_it_the_most(a: Phrase, b: Phrase) -> Steps:
    """Read "is the kitchen the biggest room?"."""
    no_reading_if(not b.text.startswith("first(order("))
    phrases = tuple(replace(one, many=False) for one in (a, b))
    return (Do(('tell(count(minus({0.argument}, {1.argument})) == 0, "whether")',), phrases),)


_rule("question", "EXIST DET* room")(
    lambda room: (Do((f'tell({room.whole or room.text}, "whether")',), notes=room.notes),)
)


@_rule(
    "question",
    "EXIST np IN EVERY (OF | DET)* (ROOM | ROOMS)",
    "(DOES | WITH) EVERY (OF | DET)* (ROOM | ROOMS) WITH np",
    cost=-0.4,
)
def _is_there_in_every_room(np: Phrase) -> Steps:
    """Read "is there a clock in every room?": no room is without."""
    rest = f"without({ALL_ROOMS.text}, {np.argument})"
    return (Do(('tell(count({0.text}) == 0, "whether")',), (_changed(ALL_ROOMS, rest, np.notes, many=False),)),)


# "the chairs by the door?": a question moves nothing
_rule("question", "np &ASKED", cost=0.4)(
    lambda np: no_reading() if np.free else _told(np, "which" if np.word in ("thing", "object", "item") else "where")
)
# "any wine glasses here?"
_rule("question", "INDEF np (HERE | ANYWHERE | BY)? &ASKED", cost=0.2)(lambda np: _told(np, "whether"))
_rule("question", "SEEQ np HERE?")(lambda np: _told(_changed(np, text=f"visible({np.text})"), "whether"))
_rule(
    "question",
    "IS np (ON | TO | AT)* DET* side (SIDE | OF | HERE)* OR (ON | TO | AT)* DET* _side (SIDE | OF | HERE)* | IS np "
    "(BEHIND | FRONT) HERE? OR (FRONT | BEHIND) HERE",
    cost=-0.5,
)(lambda np, side="": _told(np, "where"))


@_rule(
    "question",
    "(ON | IN | AT | NEAR | BY) WHICH (OF DET*)? noun (IS | EXIST | DOES | APPROACH | HERE)+ np IS?",
    "WHICH (OF DET*)? noun (IS | EXIST | DOES)+ np IS? (ON | IN | AT | NEAR | BY)",
    cost=-0.2,
)
def _on_which(noun: Noun, np: Phrase) -> Steps:
    """Read "on which table is the cake?"."""
    things = select(replace(noun, is_plural=True), ())
    text = f"having({things.text}, {np.argument})"
    return _told(_changed(things, text, things.notes + np.notes, many=False), "list")


@_rule("question", "IS np (ON | AT | IN | NEAR | UNDER) a:np OR (ON | AT | IN | NEAR | UNDER)? b:np", cost=-0.5)
def _at_which_of_two(np: Phrase, a: Phrase, b: Phrase) -> Steps:
    """Read "is the laptop on the desk or on the bed?"."""
    both = united((a, b))
    return _told(_changed(both, f"having({both.text}, {np.argument})", both.notes + np.notes, many=False), "list")


@_rule("question", "IS np (ON | TO)* DET* side (SIDE | OF)* OR (ON | TO)* DET* _side SIDE? OF b:np", cost=-0.6)
def _on_which_side_of(np: Phrase, b: Phrase, side: str) -> Steps:
    """Read "is the stove left or right of the fridge?"."""
    compass = ', "compass"' if side in _COMPASS else ""
    return (
        Do((f'tell({{0.text}}, "side", {{1.argument}}{compass})',), (replace(np, many=False), replace(b, many=False))),
    )


@_rule("question", "(IS | EXIST) of:np (ON | AT | BY | NEAR | IN) EVERY (OF | DET)* pre* noun", cost=-0.6)
@_rule("question", "DOES (EVERY | BOTH) (OF | DET)* pre* noun WITH of:np _on_it?", cost=-0.2)
@_rule("question", "IS (EVERY | BOTH) (OF | DET)* pre* noun NOT? (said:relation | said:adjective)", cost=-0.2)
def _are_all(noun: Noun, pre: Parts = (), said: Parts = (), of: Phrase | None = None) -> Steps:
    """Read "are all the chairs in the kitchen?", "do all the desks have a lamp?": no other one is, none is without."""
    every = select(noun, pre, every=True)
    fitting = f"having({every.text}, {of.argument})" if of else refine(every, said).text
    other = _changed(every, f"minus({every.text}, {fitting})", every.notes + (of.notes if of else ()), many=False)
    return (Do(('tell(count({0.text}) == 0, "whether")',), (other,)),)


@_rule(
    "question",
    "EXIST COUNTED a:np OR COUNTED? b:np | COUNTED a:np OR COUNTED? b:np &ASKED",
    "(WHAT | WHICH) (EXIST | IS | HERE)* COUNTED OF? HERE? (COMMA | STOP) a:np OR b:np",
    cost=-0.3,
)
def _which_are_more(a: Phrase, b: Phrase) -> Steps:
    """Read "are there more tables or more chairs?"."""
    test, (a, b) = _counts("more", a, b)
    return (Choose(test, (a, b), _told(a, "count"), _told(b, "count")),)


@_rule("question", "EXIST AS MANY a:np AS (b:np | relation)", cost=-0.3)
def _are_as_many(a: Phrase, b: Phrase | None = None, relation: Parts = ()) -> Steps:
    """Read "are there as many vases as clocks?", "... windows in the kitchen as in the living room?"."""
    b = b or _of_its_name(a, relation)
    return (Do(('tell(count({0.text}) == count({1.text}), "whether")',), _counts("more", a, b)[1]),)


@_rule("question", "EXIST? counted:COUNTED np IN? a:room OR IN? b:room", cost=-0.5)
@_rule(
    "question",
    "(IN? WHICH (ROOM | ROOMS)? | WHERE) (IS | EXIST | HERE | WITH | DOES | APPROACH | SEE | IT)* counted:COUNTED np "
    "(COMMA | STOP)+ IN? a:room OR IN? b:room",
    cost=-0.5,
)
def _where_are_more(counted: str, np: Phrase, a: Phrase, b: Phrase) -> Steps:
    """Read "are there more chairs in the kitchen or in the living room?"."""
    key = "many" if counted == "more" else "few"
    ordered = f'first(order(union({a.argument}, {b.argument}), "{key}", {np.argument}))'
    return _told(_changed(a, ordered, a.notes + b.notes + np.notes, many=False), "which")


_rule("asked", "WHERE (IS | IT | HERE | THAT)*")(lambda: "where")
_rule("asked", "HOWFAR AWAY? (IS IT)?")(lambda: "distance")
_rule("asked", "HOWBIG (IS IT)?")(lambda: "size")
_rule("asked", "WHATCOLOR (IS IT)?")(lambda: "color")
_rule("asked", "(IN | TO)? WHICH (ROOM | ROOMS) (IS IT)? IN?")(lambda: "room")
_rule("asked", "WHAT (IS IT)?")(lambda: "which")
# "and where?", "how far?" after what was asked or done before
_rule("question", "asked", cost=0.4)(
    lambda asked: (Do((f'tell({{0.text}}, "{asked}")',), (Phrase(IT, ONE, "thing"),)),)
)
# "what is its length?" of what was named before
_rule("question", "(WHAT IS)? ITS key:EXTENT", cost=0.2)(lambda key: _how_big(key, Phrase(IT, ONE, "thing")))
_words("_whether", "(THEN | AND)* WHETHER")
_rule("question", "_whether question")(lambda question: question)


@_rule("question", "(IS | DOES) condition:in_one_room", "DOES condition:room_has_more", cost=-0.6)
@_rule("question", "condition:counts", cost=-0.3)
@_rule("question", "_whether condition", cost=0.1)
def _does_it_hold(condition: Condition) -> Steps:
    """Read "check whether the suitcase is under a table", "tell me if there are more chairs than stools"."""
    test, phrases = condition
    return (Do((f'tell({test}, "whether")',), phrases),)


@_rule(
    "question",
    "IS (DET* OF)? np (relation | NOT? adjective)",
    "IF np IS (relation | NOT? adjective)",
    "_whether np IS (relation | NOT? adjective)",
    cost=0.1,
)
def _is_it(np: Phrase, relation: Parts = (), adjective: Parts = ()) -> Steps:
    no_reading_if(not relation and not adjective)  # "are the stools in a row?"
    return _told(refine(np, (*relation, *adjective)), "whether")


# "is in the kitchen a fridge?"
_rule("question", "IS relation COMMA? np HERE?", cost=0.1)(_is_it)


@_rule("question", "DOES np (has:WITH | WITHOUT) of:np _on_it?", "DOES np WITH ANYTHING _on_it")
def _does_it(np: Phrase, of: Phrase | None = None, has: str = "have") -> Steps:
    no_reading_if(has == "with")
    text = f"having({np.text}, {of.argument})" if of else f"minus({np.text}, empty({np.text}))"
    return _told(_changed(np, text=text, notes=np.notes + (of.notes if of else ())), "whether")


_rule("compared", "key:MORE")(lambda key: key)
_rule("compared", "key:SUPER")(lambda key: key)
_rule("compared", "NEAREST HERE?", "NEAREST _here")(lambda: "near")
_rule("compared", "FARTHEST AWAY? _here?")(lambda: "far")


@_rule("question", "IS a:np (compared | NEAR) (TO | FROM)? c:np THAN (TO | FROM)? b:np IS?", cost=-0.4)
def _nearer_than(a: Phrase, b: Phrase, c: Phrase, compared: str = "near") -> Steps:
    """Read "is the cake farther from the fridge than the toaster?"."""
    no_reading_if(compared not in ("near", "far"))
    sign, phrases = "<" if compared == "near" else ">", tuple(replace(one, many=False) for one in (a, c, b))
    test = f"distance({{0.argument}}, {{1.argument}}) {sign} distance({{2.argument}}, {{1.argument}})"
    return (Do((f'tell({test}, "whether")',), phrases),)


@_rule("question", "IS a:np compared (FROM? HERE)? THAN b:np IS?", cost=-0.3)
def _compare(a: Phrase, compared: str, b: Phrase) -> Steps:
    line = f'tell({{0.text}}, "compare", {{1.argument}}, "{compared}")'
    return (Do((line,), (replace(a, many=False), replace(b, many=False))),)


@_rule(
    "question",
    "WHICH (OF (DET | _number)*)? noun IS DET? compared ONE? (COMMA | STOP)? a:thing COMMA? OR b:thing",
    cost=-0.5,
)
def _which_of_two_named(noun: Noun, compared: str, a: Phrase, b: Phrase) -> Steps:
    """Read "which table is larger, the one here or the one over there?"."""
    named = select(noun, ())
    a, b = (lent((one, named))[0] for one in (a, b))
    return _which_of_two(a, b, compared)


@_rule("question", "(WHICH | WHAT) (IS | OF | ONE)* DET? compared ONE? (TO? HERE)? (COMMA | STOP)+ np", cost=-0.7)
def _which_of_several(compared: str, np: Phrase) -> Steps:
    """Read "what is nearest to you, the fridge, the oven or the toaster?"."""
    no_reading_if(not np.text.startswith("union("))
    return _told(_changed(np, f'first(order({np.text}, "{compared}"))', many=False), "which")


# "larger", "closer to the stove"
_rule("by", "compared ONE?")(lambda compared: (compared, None))
_rule("by", "(compared | NEAR) (TO | FROM)? of:np")(lambda of, compared="near": (compared, of))


@_rule(
    "question",
    "(WHICH | WHAT) (ROOM IS DET? compared ONE? | IS DET? compared ROOM) COMMA? a:room COMMA? OR b:room",
    cost=-0.8,
)
@_rule(
    "question",
    "(WHICH | WHAT) (IS | OF | ONE)* DET? by HERE? (TO HERE)? (COMMA | STOP)? a:np COMMA? OR b:np | "
    "(COMPARE | BETWEEN | AMONG)? a:np (AND | WITH | TO | COMPARE | OR) b:np (COMMA | STOP | AND)+ (WHICH | WHAT) "
    "(IS | ONE | OF | IT)* DET? by | IS IT? a:np OR b:np (THAT | IS)* DET? by | (WHICH | WHAT) (IS | ONE | OF | "
    "DET)* compared (AMONG | OF | BETWEEN) a:np (AND | OR) b:np | (WHICH | WHAT) ONE? (OF | DET | BETWEEN | AMONG)* "
    "a:np (AND | OR) b:np (COMMA | THAT | IS)+ DET? by | IS of:np (compared | NEAR) (TO | HERE)* a:np OR NEAR? TO? "
    "b:np | IS (HERE | IT)? (compared TO? | NEAR) a:np OR (TO | NEAR)? b:np",
    cost=-0.6,
)
def _which_of_two(
    a: Phrase, b: Phrase, compared: str = "near", of: Phrase | None = None, by: tuple[str, Phrase | None] | None = None
) -> Steps:
    """Read "which is larger, the bed or the sofa?", "is the fridge closer to the stove or to the sofa?"."""
    both, (key, than) = united((a, b)), by or (compared, of)
    no_reading_if(than and key not in ("near", "far"))
    text = f'first(order({both.text}, "{key}"))'
    if than:
        text = f"{'nearest' if key == 'near' else 'farthest'}({both.text}, 1, {than.measure})"
    return _told(_changed(both, text, both.notes + (than.notes if than else ())), "which")


@_rule("question", "WHICH (ONE? OF DET*)? np | (WHICH ONE? | WHAT) IS (np | np:room IN? HERE)")
def _which(np: Phrase) -> Steps:
    no_reading_if(np.free)
    chosen = np.text.startswith(("first(", "nth(", "nearest(", "farthest(", "last("))
    return _told(np, "which" if chosen else "list")


@_rule("question", "WHICH OF DET* pre* (noun | noun:room_name) post+", cost=-0.5)
def _which_of_several_is(noun: Noun, post: Parts, pre: Parts = ()) -> Steps:
    """Read "which of the two bedrooms has more books?": one of them."""
    parts = [part for part in (*pre, *post) if part.kind != "count"]
    no_reading_if(not any(part.kind == "order" for part in parts))
    return _which(select(replace(noun, is_plural=False), parts))


@_rule(
    "question", "WHICH (OF DET*)? pre* noun IS DET ONE (post+ | (ON | IN | TO) DET* (side SIDE? | MIDDLE))", cost=-0.1
)
def _which_is_the_one(noun: Noun, pre: Parts = (), post: Parts = (), side: str = "middle") -> Steps:
    """Read "which oven is the one in the middle?", "which chair is the one by the door?"."""
    parts = (*pre, *post) or [Part("order", side)]
    return _which(select(replace(noun, is_plural=False), parts))


@_rule("question", "WHICH (OF DET*)? np IS DET? compared ONE?", cost=-0.1)
def _which_is_more(np: Phrase, compared: str) -> Steps:
    ordered = (np.whole or np.text) if compared == "near" else f'order({np.whole or np.text}, "{compared}")'
    return _told(_changed(np, text=f"first({ordered})"), "which")


@_rule("question", "WHICH np (IS | HERE)* DET? (NEAREST | far:FARTHEST) (TO | FROM)? of:np", cost=-0.1)
@_rule("question", "WHICH np IS of:np DET? (NEAREST | far:FARTHEST) (TO | FROM)?", cost=-0.1)
def _which_is_nearer(np: Phrase, of: Phrase, far: str = "") -> Steps:
    name = "farthest" if far else "nearest"
    return _told(_changed(np, f"{name}({np.whole or np.text}, 1, {of.measure})", np.notes + of.notes), "which")


@_rule("question", "what:LIST (THAT | IS)* post+", cost=0.1)
@_rule("question", "post:relation COMMA? what:WHAT (IS | EXIST | ON | IN | IT | HERE)*", cost=-0.2)
@_rule("question", "LIST? what:WHAT (IS | EXIST | DOES | SEE | THAT)* post+ IS?")
def _what_is(post: Parts, what: str) -> Steps:
    parts = [*post]
    # "what is on the table besides the book?" leaves out books, not a table
    no_reading_if(not parts or any(part.phrase and part.phrase.greedy and not part.outer for part in parts))
    if "else" in what.split():  # "what else is on the counter with the microwave?"
        named = [inner for part in parts if part.phrase for inner in part.phrase.inner or (part.phrase,)]
        parts += [Part("filter", f"minus({{}}, {one.measure})", phrase=one) for one in named if not one.is_room]
    if any(part.kind == "order" for part in parts):
        return _told(select(Noun("thing", "anything"), parts), "which")
    if any(part.text == AHEAD for part in parts):  # not what is there beyond the next wall
        parts.append(Part("filter", "visible({})"))
    sided = any(re.fullmatch(r'side\(\{\}, "\w+"\)', part.text) for part in parts)
    if sided and not any("room(" in part.text for part in parts):  # nor beyond the walls on the other sides
        parts.append(Part("filter", 'at({}, "here")'))
    return _told(refine(EVERYTHING, parts), "what")


@_rule("question", "WHAT (IS | EXIST | THAT | HANG)* OVER np", cost=-0.5)
def _what_hangs_over(np: Phrase) -> Steps:
    """Read "what is hanging over the bed?": of what hangs on walls."""
    over = f"near(near({{}}, {np.measure}), {np.measure}, 1)"
    return _told(select(Noun("thing", "thing on the wall"), (Part("filter", over, phrase=np),)), "what")


# "which object is at (10, 3.1)?"
_rule("question", "(WHICH | WHAT) np? (IS | EXIST)* (AT | NEAR | ON | TO)+ DET* POINT? x:NUM COMMA? y:NUM", cost=-0.8)(
    lambda x, y, np=EVERYTHING: _told(
        _changed(np, f"nearest({np.whole or np.text}, 1, [{tidy(x)}, {tidy(y)}])", many=False), "which"
    )
)


@_rule("question", "WHAT (IS | DOES) np IS? (ON | near:NEAR)", "(ON | near:NEAR) WHAT (IS | DOES) np IS?", cost=-0.2)
def _what_is_it_on(np: Phrase, near: str = "") -> Steps:
    relation = "near" if near else "under"
    return _told(_changed(EVERYTHING, f"{relation}({EVERYTHING.text}, {np.measure})", np.notes), "what")


_rule("question", "(LOOK AROUND AND LIST)? SEEWHAT (IN? HERE)?")(
    lambda: _told(_changed(EVERYTHING, text='visible(things("anything"))'), "list")
)


@_rule("question", "WHATALL", "WHAT np (IS | EXIST)+ (HERE | IN DET* MAP)?", "LIST DET* np")
def _list(np: Phrase = EVERYTHING) -> Steps:
    if np.is_room and np.text.startswith("room("):  # "describe the kitchen"
        return _told(_changed(EVERYTHING, f"inside({EVERYTHING.text}, {np.text})"), "list")
    return _told(np, "list")


_rule(
    "question",
    "HOWFAR AWAY? (FROM HERE)? IS np AWAY? (FROM HERE)? | HOWFAR AWAY? (IS (IT | HERE)?)? (FROM HERE)? (TO | FROM) np "
    "| HOWFAR np IS? AWAY? (FROM HERE)? | HOWFAR (IT | IS)* (FROM HERE)? (TO | FROM | UNTIL)+ np (FROM HERE)? |"
    " (WHAT IS)? DET? DISTANCE (FROM HERE)? (TO | FROM | OF) np",
)(lambda np: (Do(('tell({0.text}, "distance")',), (replace(np, many=False),)),))


@_rule(
    "question",
    "HOWFAR AWAY? APART? (IS IT?)? (FROM | BETWEEN)? a:np AWAY? (TO | FROM | AND | UNTIL) b:np APART? | HOWFAR AWAY? "
    "FROM a:np IS b:np | (WHAT IS)? DET? DISTANCE (BETWEEN | FROM)? a:np (AND | TO) b:np",
    cost=-0.1,
)
def _how_far_apart(a: Phrase, b: Phrase) -> Steps:
    return (Do(('tell({0.text}, "distance", {1.argument})',), (replace(a, many=False), replace(b, many=False))),)


@_rule(
    "question",
    "_route (FROM (HERE | a:np))? _towards b:np (FROM HERE)? | _route _towards b:np FROM a:np | _route BETWEEN a:np "
    "AND b:np | HOWFARTODRIVE b:np",
    cost=-0.3,
)
def _how_to_get(b: Phrase, a: Phrase | None = None) -> Steps:
    """Read "how do I get from the couch to the bed?"."""
    phrases = tuple(replace(one, text=one.single, many=False) for one in (b, a) if one)
    return (Do((f'tell({{0.text}}, "way"{", {1.argument}" if a else ""})',), phrases),)


_words("_route", "HOWTOGET | HOWFARTODRIVE")
_words("_towards", "TO | TOWARD | NEAR | AT | IN | NEAREST")
# "how far is it?"
_rule(
    "question",
    "HOWFAR apart:APART? IS pair | HOWFAR IS pair apart:APART",
    "(HOWFAR | (WHAT IS)? DET? DISTANCE) BETWEEN pair",
    cost=-0.1,
)(lambda pair, apart="": no_reading() if pair[0].text == IT and not apart else _how_far_apart(*_apart(pair)))


@_rule("question", "IS np adjective OR (more:adjective OR?)+", cost=-0.2)
def _which_color(np: Phrase, adjective: Parts, more: Parts) -> Steps:
    """Read "is the bed red or blue?"."""
    no_reading_if(any(not part.text.startswith("colored(") for part in (*adjective, *more)))
    return _what_color(np)


@_rule("question", "WHATCOLOR (IS | DOES | OF | WITH)* np IS? WITH?")
def _what_color(np: Phrase) -> Steps:
    """Read "what colour is the chair?", of several the nearest; "what colour are the chairs?" is asked of each."""
    return _told(np if np.many else _changed(np, np.single), "color")


@_rule(
    "question",
    "key:HOWBIG (IS | OF | DOES)? np (IS | APPROACH)?",
    "np POSS? key:EXTENT",
    "(WHAT IS)? DET? key:EXTENT OF np",
)
def _how_big(key: str, np: Phrase) -> Steps:
    of = key if key in ("length", "height", "width") else ""
    return (Do((f'tell({{0.text}}, "size", "", "{of}")',), (replace(np, many=False),)),)


# ---- conditions


@_rule("condition", "(HERE | DOES)* (SEE | SEEQ) np", "np IS? (SEEN | VIEW)", cost=-0.1)
def _is_seen(np: Phrase) -> Condition:
    text = np.whole or np.text
    # "If you see a bed in the bedroom": wherever the robot is, that one is there.
    return _exists(np if IN_ROOM.fullmatch(text) else _changed(np, f"visible({text})"))


# "unless you are already near it"
_rule("condition", "HERE IS? negation:NOT? (NEAR | AT | BY) np", cost=-0.1)(
    lambda np, negation="": (f"distance({{0.argument}}) {'>' if negation else '<='} 1", (replace(np, many=False),))
)
_rule("condition", "DET? DISTANCE (TO | FROM) np IS? (less:LESSTHAN | MORETHAN) distance", cost=-0.3)(
    lambda np, distance, less="": (
        f"distance({{0.argument}}) {'<' if less else '>'} {distance.text}",
        (replace(np, many=False),),
    )
)


@_rule("room_has_more", "a:room WITH counted:COUNTED np THAN b:room")
def _room_has_more(a: Phrase, counted: str, np: Phrase, b: Phrase) -> Condition:
    inside = tuple(_changed(np, f"inside({np.text}, {room.text})", many=False) for room in (a, b))
    return f"count({{1.text}}) {'>' if counted == 'more' else '<'} count({{2.text}})", (a, *inside)


_rule("condition", "room_has_more", cost=-0.4)(lambda room_has_more: room_has_more)
_rule("condition", "test:in_one_room", "test:counts", cost=-0.3)(lambda test: test)


@_rule("condition", "room WITH np", cost=-0.3)
def _room_has(room: Phrase, np: Phrase) -> Condition:
    """Read "if the kitchen has a toaster, go to it": what it has is spoken of."""
    no_reading_if(room.many)
    inside = f"inside({np.whole or np.text}, {room.text})"
    return "count({0.text}) > 0", (_changed(np, inside, np.notes + room.notes, many=False),)


@_rule("condition", "INDEF? np (ANYWHERE | HERE)* &ASKED", cost=0.2)
@_rule("condition", "DET* MAP WITH np", cost=-0.2)
@_rule("condition", "EXIST np (ANYWHERE | HERE | EITHER | _in_map)*", "np EXIST")
def _exists(np: Phrase) -> Condition:
    np = _changed(np, np.whole or np.text)
    return "count({0.text}) > 0", (replace(np, many=False, together=np.many),)


# "if in the kitchen there is a toaster"
_rule("condition", "relation COMMA? EXIST negation:NOT? np", cost=-0.2)(
    lambda np, relation, negation="": _holds(np, relation, negation=negation)
)


@_rule("condition", "(NOT | WITHOUT | NUMBER) np (ANYWHERE | HERE)* &ASKED", cost=0.1)
@_rule("condition", "EXIST (NOT | WITHOUT | NUMBER) np EITHER?", "HERE NEVER SEE np", "it:IT NOT np", cost=-0.2)
def _exists_not(np: Phrase, it: str = "there") -> Condition:
    no_reading_if(it != "there")  # "there isn't a chair", but not "it isn't a chair"
    return "count({0.text}) == 0", (_changed(np, np.whole or np.text, many=False),)


@_rule("condition", "IS? np IS? negation:NOT? (relation | adjective)", cost=0.1)
def _holds(np: Phrase, relation: Parts = (), adjective: Parts = (), negation: str = "") -> Condition:
    phrase = refine(np, (*relation, *adjective))
    return f"count({{0.text}}) {'==' if negation else '>'} 0", (replace(phrase, many=False),)


_rule(
    "in_one_room",
    "a:np AND b:np IS? negation:NOT? IN DET* (SAME | ONE) ROOM",
    "a:np AND b:np IS? IN _number? (negation:OTHER | negation:DIFFERENT) ROOMS",
)(lambda a, b, negation="": _holds(a, _inside_of(b), negation=negation))


def _inside_of(np: Phrase) -> Parts:
    return (Part("filter", f"inside({{}}, room({np.argument}))", phrase=np),)


@_rule(
    "condition",
    "(ATLEAST | more:MORETHAN | few:LESSTHAN | only:EXACTLY | most:ATMOST) n:whole np? &ASKED",
    cost=-0.1,
)
@_rule("condition", *_NUMBERED, cost=-0.3)
def _at_least(
    n: int, np: Phrase = _OF_THAT_NAME, more: str = "", few: str = "", only: str = "", most: str = "", exist: str = ""
) -> Condition:
    sign = ">" if more else "<" if few else "==" if only else "<=" if most else ">="
    return f"count({{0.text}}) {sign} {n}", (replace(_changed(np, np.whole or np.text, many=False), together=n > 1),)


def _of_its_name(phrase: Phrase, parts: Parts) -> Phrase:
    """Return the things of the name of a phrase of which something else is said."""
    return refine(Phrase(phrase.base, phrase.base, phrase.word, True), parts)


# "if there are three, ...", "if it has two, ..." after "if the office has four desks, ..."
_rule("condition", "(EXIST | IT WITH) EXACTLY? n:whole HERE? &(COMMA | THEN)", cost=-0.3)(
    lambda n: _at_least(n, only="exactly")
)
# "if the office has two desks, ..."
_rule("condition", "room WITH (ATLEAST | only:EXACTLY)? n:whole np", cost=-0.5)(
    lambda room, n, np, only="": _at_least(n, _changed(np, f"inside({np.whole or np.text}, {room.text})"), only=only)
)


@_rule("counts", "EXIST counted:COUNTED a:np THAN (b:np | relation)")
def _counts(
    counted: str, a: Phrase, b: Phrase | None = None, relation: Parts = ()
) -> tuple[str, tuple[Phrase, Phrase]]:
    b = b or _of_its_name(a, relation)
    room = IN_ROOM.fullmatch(a.text)
    if room and ALL.fullmatch(b.text):  # "more chairs in the kitchen than windows"
        b = _changed(b, f"inside({b.text}, {room[1]})")
    elif (room := IN_ROOM.fullmatch(b.text)) and ALL.fullmatch(a.text) and a.base != b.base:
        a = _changed(a, f"inside({a.text}, {room[1]})")  # "more chairs than windows in the kitchen"
    a, b = (_changed(one, one.whole or one.text, many=False) for one in (a, b))
    return f"count({{0.text}}) {'>' if counted == 'more' else '<'} count({{1.text}})", (a, b)


@_rule("condition", "a:np IS compared HERE? THAN b:np", cost=-0.3)
def _is_more(a: Phrase, compared: str, b: Phrase) -> Condition:
    phrases = (replace(a, many=False), replace(b, many=False))
    if compared in ("near", "far"):
        return f"distance({{0.argument}}) {'<' if compared == 'near' else '>'} distance({{1.argument}})", phrases
    key, most = SAID["by_size"][compared]
    sign = "<" if most < 0 else ">"
    return f'size({{0.argument}}, "{key}") {sign} size({{1.argument}}, "{key}")', phrases


@_rule("condition", "EXIST np compared HERE?", "np IS compared HERE?", cost=-0.3)
def _is_nearer(np: Phrase, compared: str) -> Condition:
    """Read "unless there is a bed closer to you": than what is gone to."""
    no_reading_if(compared not in ("near", "far"))
    sign = "<" if compared == "near" else ">"
    return f"distance({{1.argument}}) {sign} distance({{0.argument}})", (Phrase(IT, "", "thing"), np)


# ---- what to keep away from


@_rule(
    "avoided",
    "AVOID (targets | targets:there) (BY distance)?",
    "GIVE targets BERTH",
    "GIVE? BERTH (TO | FROM | AROUND | FOR) targets",
)
@_rule(
    "avoided",
    "(KEEP | STAND | GO | WITH | GIVE)? ATLEAST? (distance (OF? DISTANCE)? | DET? DISTANCE OF? ATLEAST? distance) "
    "ATLEAST? (away | AWAY | SHORT FROM? | EMPTY OF | TO | FROM) targets",
    "GIVE targets BERTH COMMA? (OF | ATLEAST)* distance ATLEAST?",
    "GIVE (targets | targets:there) ATLEAST? distance (OF (ROOM | BERTH | DISTANCE))?",
    "BUT? (GIVE | KEEP | WITH) ATLEAST? distance (OF (BERTH | DISTANCE))? BETWEEN (HERE AND targets | targets AND "
    "HERE)",
    "(GO | TAKE)? NOCLOSER THAN distance (TO | FROM) targets",
    "NEVER (GO | APPROACH) compared THAN distance (TO | FROM | NEAR)* targets",
    "NEVER (GO | APPROACH) IN distance (TO | FROM | NEAR | OF)* targets",
    cost=-0.2,
)
def _avoided(targets: tuple[Phrase, ...], distance: Measure | None = None, **_: str) -> Steps:
    no_reading_if(distance and not distance.has_unit)
    more = f", {distance.text}" if distance else ""
    notes = distance.note if distance else ()
    no_reading_if(any(one.text == IT for one in targets) and distance)  # what is gone to: as far as that from it
    whole = [_changed(one, one.text if one.is_room else one.whole or one.text, many=False) for one in targets]
    return tuple(Do((f"avoid({{0.argument}}{more})",), (phrase,), notes) for phrase in whole)


# ---- what joins orders

_words("_mayhap", "(COMMA | AND | THEN | STOP)*")
_words(
    "_verb",
    "APPROACH | BACKUP | CIRCLE | FACE | GO | HALT | KEEP | LOOK | MAKE | PASS | RETURN | SPIN | STRAFE | TURN | UTURN",
)


@_rule("done", "order ((COMMA | STOP)? times)?", "order n:ORD", "ONLY &_verb order", "order COMMA? said:NOWAIT")
def _times(order: Steps, times: int = 1, n: int = 1, said: str = "instead") -> Steps:
    no_reading_if(n != 1 or said not in ("instead", "rather"))  # "look at the sofa first"
    if not 1 <= times <= _MAX_TIMES:
        raise CommandError(f"an order can be repeated from 1 to {_MAX_TIMES} times, found {times}")
    return (Repeat(times, order),) if times > 1 else order


# "I want to sit down, show me the way"
_rule("done", "order (COMMA | STOP | AND | THEN)* verb:TAKE", cost=0.2)(
    lambda order, verb: no_reading() if not verb.endswith(("way", "where", "is", "go")) else order
)


@_rule(
    "done",
    "order ((COMMA | STOP | BY | FOR | ONLY | EXACTLY)* angle)+",
    "order ((COMMA | STOP | BY | FOR | ONLY)* distance)+",
    "order ONCE? (COMMA | STOP)+ way",
    cost=-0.1,
)
def _by_so_much(order: Steps, angle: Sequence[Measure] = (), distance: Sequence[Measure] = (), way: str = "") -> Steps:
    """Read "turn left, 30 degrees", "forward: two metres", "a full turn, to the right": how much was not yet said."""
    last = _act(order[-1])
    if way:
        no_reading_if(not any(_UNSIDED in note for note in last.notes))
        return (*order[:-1], Do((last.lines[0].replace("(", "(-" if way == "left" else "("),)))
    measure = (*angle, *distance)[-1]
    default = {"1", "90", tidy(_A_LITTLE_M), tidy(_A_LITTLE_DEG)}
    call = "turn" if angle else "move_forward"
    no_reading_if((angle and len(last.lines) > 1) or (distance and not last.notes))
    return (*order[:-1], _resized(last, call, measure, default))


def _resized(step: Do, call: str, measure: Measure, sizes: Container[str] | None = None) -> Do:
    """Return a turn or move of one of some sizes, None for any, by another angle or distance."""
    for line in step.lines:
        said = re.fullmatch(rf"robot\.{call}\((-?)([\d.]+)\)", line)
        if said and (sizes is None or said[2] in sizes):
            by = measure.negated if said[1] else measure.text
            lines = tuple(f"robot.{call}({by})" if one == line else one for one in step.lines)
            return replace(step, lines=lines, notes=measure.note)
    raise CommandError("")


@_rule("done", "order COMMA ONLY? TURN", cost=0.1)
def _just_turn(order: Steps) -> Steps:
    """Read "turn so that the couch is on your right, just turn"."""
    no_reading_if(not all(isinstance(step, Do) and _kind(step) == "turn" for step in order))
    return order


class _Marked(NamedTuple):
    """Steps, and which of all they are: from 1, -1 the last, 0 where that was not said."""

    rank: int
    steps: Steps


@_rule("marked", "(n:ORD | last:LASTLY) STAND? (IS | COMMA)* (done | wanted)", cost=0.1)
@_rule("marked", "DET* goal:GOAL (IS | COMMA | STOP)* wanted", cost=-0.5)
@_rule("marked", "(done | wanted) (IS | GO)? (n:ORD | last:LASTLY | next:AFTER !_np)")
@_rule("marked", "STARTWITH wanted | last:ENDWITH wanted", "done")
def _marked(
    done: Steps = (), wanted: Steps = (), n: int = 0, last: str = "", goal: str = "", next: str = ""
) -> _Marked:
    """Read "first the fridge", "the fridge comes last", "end at the fridge": a step, and which one it is."""
    no_reading_if(goal and not re.search(r"last|final", goal))
    return _Marked(-1 if last or goal else n or int(not (done or next)), done or wanted)


@_rule("logical", "one:marked (_mid+ more:marked)+ !(_mid+ _marked)", cost=-0.3)
def _as_marked(one: _Marked, more: Sequence[_Marked]) -> Steps:
    """Read "end at the fridge, but start with the sink", "toilet first, suitcase second, refrigerator last"."""
    marked = (one, *more)
    ranks = [rank for rank, _ in marked]
    said = [rank for rank in ranks if rank]
    in_turn = sorted(marked, key=lambda one: one[0] if one[0] > 0 else _MAX_TIMES * (1 - 2 * one[0]))
    told = [step for _, steps in in_turn for step in steps if isinstance(step, Do) and "‹" not in str(step.phrases)]
    # one twice, or one that refers to another
    no_reading_if(len({*map(str, told)}) < sum(len(steps) for _, steps in marked))
    no_reading_if(not said or len({*said}) < len(said) or (0 in ranks and not {*said} <= {1, -1}))
    return tuple(replace(step, verb="") if step in _go_to(step.phrases) else step for step in told)


_words("_marked", "marked")
_words("_thing", "thing")
_words("_mid", "COMMA | STOP | AND | BUT | THEN")
_words("_visit", "MAKE | TAKE | HANDS | APPROACH | GIVE | KEEP | LOOK | _go | ON | AT | FROM")


@_rule("done", "order _mid+ _visit? (one:thing | adjective) (n:ORD | last:LASTLY)", cost=-0.5)
@_rule(
    "done",
    "order ONCE? _mid* (STARTWITH | last:ENDWITH | (BUTFIRST | (COMMA | BUT)+ n:ORD) _visit?) one:thing (_and_others | "
    "!(_mid+ (ORD | AFTER)? _thing))",
    "them:targets _mid+ (STARTWITH | last:ENDWITH) one:thing !(_mid+ (ORD | AFTER)? _thing)",
    cost=-0.4,
)
def _one_first(
    order: Steps = (),
    one: Phrase | None = None,
    adjective: Parts = (),
    n: int = 1,
    last: str = "",
    them: tuple[Phrase, ...] = (),
) -> Steps:
    """Read "visit both desks, but leave the one in the bedroom for last", "..., starting with the red one"."""
    order = order or _go_to(them)
    one = one or select(None, adjective)
    head = order[0]
    named = [step for step in order if isinstance(step, Do) and [one.base] == [p.base for p in step.phrases]]
    if len(named) == 1 < len(order) and n in (1, -1):  # "the oven and the sink, the sink first"
        rest = tuple(step for step in order if step is not named[0])
        return (*rest, *named) if last or n == -1 else (*named, *rest)
    head = _act(head)
    no_reading_if(n not in (1, -1) or len(order) != 1 or len(head.phrases) != 1)
    every = head.phrases[0]
    if every.text == IT:  # "visit all of them, and begin with the red one"
        every = replace(every, many=True)
    no_reading_if(
        not every.many or one.base not in (ONE, SAME, every.base) or one.many or LAST in one.text or one.text == IT
    )
    text = one.text if one.base == every.base != ONE else one.text.replace(one.base, every.text)
    key = "last" if last or n == -1 else "first"
    return (replace(head, phrases=(_changed(every, f'order({every.text}, "{key}", {text})'),)),)


_words("_and_others", "_mid+ (ORD | AFTER | THEN)* DET? (OTHER (ONE | ONES)? | ONES) (ORD | AFTER | THEN | LASTLY)*")


@_rule("item", "ORD COMMA? question", cost=0.2)
@_rule("item", "place:PLACE (COMMA | STOP | AND | SO)+ question", cost=-0.5)
def _numbered_question(question: Steps, place: Noun | None = None) -> Steps:
    """Read "first, how many chairs are there?", "I'm worn out, where is the bed?": the wish says why."""
    if place and any(IT in one.text for step in question if isinstance(step, Do) for one in step.phrases):
        return _taken_from(question, found := select(place, ()), found)
    return question


# "where is my suitcase? I need it": why it is asked
_rule("item", "question (COMMA | STOP | AND)+ NEED IT", cost=-0.3)(lambda question: question)
# "when you go to the kitchen"
_rule("done", "(ORD | after:AFTER) COMMA? done", "NEED HERE? TO? done", "(HERE | GO) &(_verb | STAND) done", cost=0.2)(
    lambda done, after="after": no_reading() if after != "after" else done
)


_rule("item", "steps:done", "steps:question", "steps:logical")(lambda steps: steps)


@_rule("if", "IF condition")
def _whether(condition: Condition) -> Condition:
    return condition


_rule("if", "IFSEE np")(_is_seen)
_rule("if", "IFKNOWN DET? OF? np ANYWHERE?")(_exists)


@_rule("body", "done ((COMMA | AND | THEN | BUT)+ more:done)*", "question")
def _body(done: Steps = (), question: Steps = (), more: Steps = ()) -> Steps:
    """Read what is done on a condition, up to the end of a sentence."""
    return (*done, *question, *more)


@_rule("logical", "condition:if (COMMA | THEN)* said:HALT _mayhap OTHERWISE COMMA? b:body", cost=-0.3)
def _if_stop_there(condition: Condition, said: str, b: Steps) -> Steps:
    """Read "if the tablet is on the table, stop there, otherwise go to the desk": there, where it is."""
    no_reading_if(not said.endswith("there") or not condition[1])
    return _if(condition, _go_to(_there()), b)


@_rule("logical", "condition:if ((COMMA | STOP? THEN)+ | &_verb) a:body (_otherwise b:body)?", cost=-0.2)
@_rule("logical", "condition:if ((COMMA | THEN)+ | &_verb) a:items (_otherwise b:items)?")
def _if(condition: Condition, a: Steps, b: Steps = ()) -> Steps:
    """Read "if there is a dog go to it, and if there is none, go to the tv": one beside the other."""
    inner = a[0]
    alone = not b and len(a) == 1 and isinstance(inner, Choose) and bool(inner.otherwise) and not inner.after
    if alone and isinstance(inner, Choose) and inner.phrases[0].base == condition[1][0].base:
        return (Choose(*condition, inner.then, inner.otherwise),)
    more = next((at for at, step in enumerate(a) if at and isinstance(step, Choose) and not step.after), len(a))
    return (Choose(*condition, a[:more], b), *a[more:]) if not b else (Choose(*condition, a, b),)


@_rule(
    "logical",
    "UNLESS condition ((COMMA | THEN)+ | &_verb) a:items",
    "a:done COMMA? UNLESS condition (_mayhap OTHERWISE COMMA? b:items | _mayhap IFSO COMMA? b:body)?",
    "a:done COMMA? UNLESS condition _mayhap b:order COMMA? said:NOWAIT",
)
def _unless(condition: Condition, a: Steps, b: Steps = (), said: str = "instead") -> Steps:
    no_reading_if(said not in ("instead", "rather"))
    test, phrases = condition
    inverse = test.replace(" > 0", " == 0") if test.endswith(" > 0") else f"not {test}"
    return (Choose(inverse, phrases, a, b, after=any(IT in phrase.text for phrase in phrases)),)


@_rule(
    "logical",
    "a:done _mayhap (OR | AND)? COMMA? OTHERWISE (COMMA | THEN)* b:done",
    "a:done COMMA? IFSO _mayhap (OR | AND)? COMMA? OTHERWISE COMMA? b:done",
    cost=0.2,
)
def _or_else(a: Steps, b: Steps) -> Steps:
    """Read "go to the sofa or, if there is none, to the chair"."""
    named = _act(a[0]).phrases
    no_reading_if(len(a) != 1 or not named or "‹" in named[0].text)
    test, phrases = _exists(named[0])
    return (Choose(test, phrases, a, b),)


@_rule("logical", "a:done _mayhap condition:if ((COMMA | STOP? THEN)+ | &_verb) b:done", cost=-0.4)
def _where_it_is_missing(a: Steps, condition: Condition, b: Steps) -> Steps:
    """Read "go to the piano. If there is no piano, go to the sofa": one of the two, as with "if there is none"."""
    test, (missing, *_) = condition
    gone_to = [one.whole or one.text for one in a[0].phrases] if isinstance(a[0], Do) else []
    no_reading_if(test != "count({0.text}) == 0" or gone_to != [missing.text])
    return _or_else(a, b)


@_rule(
    "logical",
    "(_go _dets word:WORD+ name:NOUN | IF EXIST _dets word:WORD+ name:NOUN (COMMA | THEN)* _go IT) _mayhap "
    "(OTHERWISE | IF EXIST (NOT | WITHOUT | NUMBER) WORD+ NOUN) (COMMA | THEN)* b:done",
    cost=-0.2,
)
def _unknown_or_else(word: Sequence[str], name: Noun, b: Steps) -> Steps:
    """Read "go to the pool table. If there is none, to the sofa": what an unknown word tells of is no other table."""
    said = " ".join((*word, name.spoken))
    return _or_else(_go_to((select(Noun(said, said, False, count=0), ()),)), b)


_rule("logical", "a:done COMMA? condition:if (_mayhap OTHERWISE COMMA? b:items)?")(
    lambda a, condition, b=(): (Choose(condition[0], condition[1], a, b, after=True),)
)
_rule(
    "logical",
    "b:done _mayhap BUTFIRST COMMA? a:done | BEFORE b:done COMMA? a:done | b:done COMMA? AFTER a:done | a:done "
    "COMMA? BEFORE b:done | AFTER a:done COMMA? b:done",
    cost=0.1,
)(lambda a, b: (*a, *b))


@_rule("logical", "BEFORE b:done COMMA? PASS targets", cost=-0.3)
@_rule("logical", "b:done COMMA? NOTBEFORE targets", cost=-0.2)
def _not_before(b: Steps, targets: tuple[Phrase, ...]) -> Steps:
    """Read "before you go to the sink, go past the oven", "... but not before you have been to the oven"."""
    return (*_go_to(targets), *b)


@_rule(
    "logical",
    "WHETHER? condition (COMMA | AND | STOP | THEN)* IFSO (COMMA | STOP)* a:body (_else b:body)?",
    "WHETHER? condition ASKED THEN COMMA? a:body (_else b:body)?",
    "WHETHER? condition ASKED STOP? a:body _else b:body",
    "WHETHER? condition (COMMA | AND | STOP | THEN)* OTHERWISE COMMA? b:body",
    cost=-0.2,
)
def _if_so(condition: Condition, a: Steps = (), b: Steps = ()) -> Steps:
    """Read "is there a free seat at the table? If so, go there", "... If not, go to the sofa"."""
    if not a:
        return (Choose(f"not {condition[0]}", condition[1], b),)
    return (Choose(*condition, a, b),)


_words("_otherwise", "_mayhap OTHERWISE (COMMA | THEN)*")
_words("_else", "_mayhap (OTHERWISE COMMA? | LACKING (COMMA | STOP | THEN)+)")


@_rule(
    "logical",
    "(condition:if ((COMMA | STOP? THEN)+ | &_verb) | condition ASKED THEN? COMMA?) a:body _mayhap "
    "other:if ((COMMA | THEN)+ | &_verb) b:body",
    cost=-0.6,
)
def _if_and_if_not(condition: Condition, a: Steps, other: Condition, b: Steps) -> Steps:
    """Read "if there is a dog go to it, and if there is no dog go to the tv"."""
    (test, (named, *_)), (inverse, (missing, *_)) = condition, other
    no_reading_if({test, inverse} != {"count({0.text}) > 0", "count({0.text}) == 0"} or named.base != missing.base)
    return (Choose(test, condition[1], a, b),)


@_rule("logical", "PLACE (COMMA | STOP | SO)+ b:done", cost=-0.3)
def _so(b: Steps) -> Steps:
    """Read "I want to wash my hands, so bring me to a sink": the wish says why."""
    no_reading_if(any(IT in phrase.text for step in b if isinstance(step, Do) for phrase in step.phrases))
    return b


@_rule(
    "logical",
    "b:done (COMMA | AND | STOP | BUT)* NEVER (not_:order | went:GO | went:APPROACH | TURN AROUND?) "
    "((COMMA | STOP)+ ONLY? LOOK)?",
    "NEVER (went:GO | went:APPROACH | TURN AROUND?) (COMMA | AND | STOP | BUT)+ ONLY? b:done",
    cost=0.3,
)
def _only(b: Steps, not_: Steps = (), went: str = "") -> Steps:
    """Read "look at the clock, but don't drive there", "go back one metre, don't turn": what is not done anyway."""
    done = {"move" if not step.verb else _kind(step) for step in b if isinstance(step, Do)}
    never = {_kind(step) for step in not_ if isinstance(step, Do)} or {"move" if went else "turn"}
    no_reading_if(not all(isinstance(step, Do) for step in (*b, *not_)) or done & never)
    return b


def _kind(step: Do) -> str:
    """Return whether a step moves, turns or tells."""
    lines = " ".join(step.lines)
    return "move" if "move" in lines else "tell" if "tell(" in lines else "turn"


@_rule(
    "logical",
    "(NEVER (not_:done | HANDS _np) | NEITHER _np NOR _np) (COMMA | AND | STOP | EXCEPT | THEN)+ b:done",
    cost=0.3,
)
@_rule("logical", "NOT not_:wanted (COMMA | STOP)+ &_verb b:done", cost=0.5)
def _but(b: Steps, not_: Steps = ()) -> Steps:
    """Read "don't go to the sofa, go to the table", "not the sofa. Go to the table", "not the red one. Go there"."""
    no = [one for step in not_ if isinstance(step, Do) for one in step.phrases if one.base == ONE != one.text]
    if not no or not isinstance(b[0], Do) or not any(IT in one.text for one in b[0].phrases):
        return b
    no_reading_if(len(no) > 1 or b[0].phrases[0].text != IT)
    rest = replace(b[0].phrases[0], text=f"minus({ONE}, {no[0].whole or no[0].text})", base=ONE, any=False)
    return (replace(b[0], phrases=(rest,)), *b[1:])


@_rule("declared", "relation+ IS _dets pre* noun post*", cost=-0.2)
@_rule(
    "declared",
    "ANYWHERE? (relation COMMA?)* exist:EXIST HERE? _dets (ROW OF _dets)? pre* (noun | noun:room_name) (post | IT)*",
    cost=-0.25,
)
@_rule("introduced", "(SEE | SEEQ) _dets (row:ROW OF _dets)? pre* noun (post | IT)*")
@_rule("introduced", "LOOK AT? _dets row:ROW OF _dets pre* noun (post | IT)*")
@_rule("introduced", "LOOK AT? _dets &(pre* NOUNS) pre* noun (post | IT)* &(STOP (GO | TAKE | APPROACH))")
def _introduced(
    noun: Noun, pre: Parts = (), relation: Parts = (), post: Parts = (), row: str = "", exist: str = "there"
) -> Phrase:
    """Read "at the long table there are two chairs side by side", "the row of chairs in front of the counter"."""
    no_reading_if(exist.split(maxsplit=1)[0] in _ASKS)
    parts = [*pre, *relation, *post]
    if row:  # what stands in a row along something is next to it
        parts += [Part("filter", f"near({{}}, {part.of})") for part in parts if part.kind == "filter" and part.of]
    return select(noun, parts)


@_rule("declared", "exist:EXIST a:thing AND b:thing", cost=-0.25)
def _declared_both(exist: str, a: Phrase, b: Phrase) -> Phrase:
    """Read "there is a chair on your left and a chair on your right", "... and one on your right"."""
    b = replace(b, text=b.text.replace(ONE, a.base), base=a.base) if b.base == ONE else b
    no_reading_if(exist.split(maxsplit=1)[0] in _ASKS or a.base != b.base)
    return replace(united([replace(one, text=one.single) for one in (a, b)]), base=a.base, many=True)


# "one of the desks has a plant on it"
_rule("declared", "&(_np FINITE !WHAT) thing", cost=-0.25)(lambda thing: thing)


@_rule("logical", "topic:declared ((COMMA | AND | STOP | THEN | BUT)+ | &_verb) b:items", cost=-1.2)
@_rule("logical", "topic:declared (COMMA | AND | STOP | THEN | BUT)+ aside:items", cost=0.3)
def _of_declared(topic: Phrase, b: Steps = (), aside: Steps = ()) -> Steps:
    """Read "there are two chairs at the table. Go to the left one", "the desk has a lamp on it. Go to that desk"."""
    refers = isinstance(step := (b or aside)[0], Do | Choose) and any("‹" in one.text for one in step.phrases)
    no_reading_if(refers != bool(b))
    # "The bench in the office is new. Go to the bench": that one.
    told = _changed(topic, topic.text)
    aside = tuple(
        replace(
            one, phrases=tuple(told if p.text == topic.base != topic.text and not p.any else p for p in one.phrases)
        )
        if isinstance(one, Do)
        else one
        for one in aside
    )
    return (Do((), (replace(topic, base=topic.whole or topic.text),)), *(b or aside))


@_rule("logical", "topic:np stop:STOP b:items", cost=-0.3)
def _headed(topic: Phrase, stop: str, b: Steps) -> Steps:
    """Read "the appliances: oven, fridge, then the sink", "the yellow things: both armchairs": each as it is named."""
    named = [one for step in b if isinstance(step, Do) for one in step.phrases]
    alone = len(named) == len(b) and not any("‹" in one.text for one in named)
    no_reading_if(
        stop != ":"
        or not (topic.many or "anything" in topic.base)
        or topic.free
        or not alone
        or not (len(b) > 1 or "anything" in topic.base)
    )
    return b


_rule("not_that", "(NOT IT | NOT THAT | NOWAIT) (COMMA | STOP)+")(lambda: "not that")


@_rule("item", "topic:np (COMMA | STOP)+ b:items", cost=0.2)
@_rule(
    "logical",
    "topic:introduced (COMMA | STOP)+ struck:not_that? b:items",
    "topic:np (COMMA | STOP)+ struck:not_that b:items",
    cost=-0.1,
)
@_rule("logical", "(named:declared _mid+)? MINE topic:np _mid+ b:items", cost=-1.0)
@_rule("logical", "NEED topic:np (COMMA | AND | STOP)+ b:question", cost=-0.3)
@_rule("logical", "AMONG topic:np (COMMA | STOP)? b:items", cost=0.2)
@_rule("logical", "BETWEEN topic:np COMMA? &(APPROACH | TAKE | HANDS | GO) b:items", cost=-1.0)
@_rule("logical", "named:np MEANT topic:np (COMMA | AND | STOP | THEN)+ b:items", cost=0.1)
def _of_topic(topic: Phrase, b: Steps, named: Phrase | None = None, struck: str = "") -> Steps:
    """Read "the lamp by the bed, go to it", "there are two chairs at the table. Go to the left one, then the other"."""
    topic = lent((topic, named))[0] if named else topic
    first = b[0]
    # "the table; the chair left of it": both are gone to
    no_reading_if(isinstance(first, Do) and not first.verb and not topic.many and IT in first.phrases[0].text)
    return _taken_from(b, topic, topic if struck else replace(topic, base=topic.whole or topic.text))


@_rule(
    "logical",
    "NOT topic:np ((COMMA | AND | STOP)+ NOT more:np)* ((COMMA | AND | STOP | EXCEPT | THEN)+ | &_verb) b:done",
    cost=0.3,
)
def _not_but(b: Steps, topic: Phrase, more: Sequence[Phrase] = ()) -> Steps:
    """Read "not the near chair, the other one", "not the lamp on the desk, not the one by the bed. The last one."."""
    it = any(IT in phrase.text for step in b[:1] if not isinstance(step, Repeat) for phrase in step.phrases)
    no_reading_if(it or topic.greedy or LAST in topic.text or any(one.base != ONE for one in more))
    if not more and topic.base not in (ONE, "rooms()") and all(isinstance(one, Do) for one in b):
        named = [phrase.base for one in b if isinstance(one, Do) for phrase in one.phrases]
        if named and not {ONE, SAME, topic.base} & {*named}:  # "not the sofa, the table"
            return b
    first = b[0]
    if (
        not more
        and isinstance(first, Do)
        and [LAST in p.text and p.base == topic.base for p in first.phrases] == [True]
    ):
        other = first.phrases[0]  # "not the sofa with the bear, the other sofa"
        return (replace(first, phrases=(replace(other, text=other.text.replace(LAST, topic.single)),)), *b[1:])
    for one in more:
        topic = replace(topic, base=f"minus({topic.base}, {one.text.replace(ONE, topic.base)})")
    return _taken_from(b, topic, replace(topic, base=f"minus({topic.base}, {topic.single})"))


def _taken_from(steps: Steps, topic: Phrase, group: Phrase) -> Steps:
    """Return the steps with "it", "one" and "the other" of the first of them taken from what was named before them."""
    no_reading_if(topic.free or topic.base == ONE)
    found: list[Step] = []
    for step in steps:
        told = isinstance(step, Do) and "".join(step.lines).startswith("tell(")
        phrases = () if isinstance(step, Repeat) else step.phrases
        taken = tuple(_taken(one, topic, group, told=told, first=not found) for one in phrases)
        if taken == phrases:
            break
        found.append(replace(step, phrases=taken))
        if isinstance(step, Do) and not step.lines:  # what follows speaks of what is only named here
            break
    no_reading_if(not found)
    return (*found, *steps[len(found) :])


def _taken(phrase: Phrase, topic: Phrase, group: Phrase, *, told: bool, first: bool) -> Phrase:
    if phrase.base in (ONE, SAME) and phrase.text != IT:
        group = topic if LAST in phrase.text else group
        them = topic.text if topic.many else topic.single
        text = phrase.text.replace(phrase.base, group.base).replace(LAST, topic.single).replace(IT, them)
        return replace(
            phrase, text=text, whole=phrase.whole.replace(phrase.base, group.base), base=group.base, word=topic.word
        )
    if SUCH in phrase.text:
        return replace(phrase, text=phrase.text.replace(SUCH, topic.base))
    if not first or IT not in phrase.text:
        return phrase
    if phrase.text != IT:
        text, base, whole = (one.replace(IT, topic.single) for one in (phrase.text, phrase.base, phrase.whole))
        text = text.replace("near(", "inside(", topic.is_room)  # "the office: how many chairs does it have?"
        return replace(phrase, text=text, base=base, whole=whole)
    if told:
        return replace(
            topic, text=topic.whole if topic.many and topic.whole else topic.text, many=False, together=topic.many
        )
    return replace(topic, text=topic.single, many=False) if phrase.any else topic


@_rule("logical", "AMONG topic:np (COMMA | STOP) b:items", cost=-0.9)
def _one_of_topic(topic: Phrase, b: Steps) -> Steps:
    """Read "of the two couches, the one with the bear on it"."""
    chosen = b[0].phrases if isinstance(b[0], Do) else ()
    no_reading_if(not topic.many or len(chosen) != 1 or chosen[0].base not in (ONE, SAME) or chosen[0].text == IT)
    return _of_topic(topic, b)


_TAKEN: Final = frozenset(["chair", "couch", "sofa", "stool", "seat", "armchair", "bench", "table", "desk", "bed"])
"""What a person takes by going there: "take the couch". Other things only by rank, "take the second"."""


@_rule("order", "(verb:TAKE | verb:MAKE | verb:HANDS) targets n:ORD?", cost=0.2)
def _take_one(verb: str, targets: tuple[Phrase, ...], n: int = 0) -> Steps:
    """Read "two fridges: take the left one", "do the table first"."""
    chosen = all(one.base in (ONE, SAME) and one.text != IT for one in targets)
    ranked = ("nth(", "first(order(", *(("nearest(things(", "farthest(things(") if verb == "pick" else ()))
    picked = all(one.word in _TAKEN or one.text.startswith(ranked) for one in targets)
    if verb not in ("take", "do", "pick", "get") or not (
        chosen or (verb == "do" and (n == 1 or targets[0].many)) or (verb in ("take", "pick") and picked)
    ):
        raise CommandError("")
    return _go_to(targets)


@_rule(
    "order",
    "(NUMBER | COUNT) np _mid+ (_go | TAKE | MAKE | HANDS | APPROACH)* DET* (NUMBER n:whole | n:ORD (ONE | noun)?)",
    cost=-0.4,
)
def _of_numbered(np: Phrase, n: int, noun: Noun | None = None) -> Steps:
    """Read "number the stools west to east and take number two", "counting from the left, go to the third"."""
    no_reading_if(not np.text.startswith("order(") or (noun is not None and quoted(noun.label) not in np.base))
    return _go_to((replace(np, text=f"nth({np.text}, {n})", many=False, whole=""),))


class _Next(NamedTuple):
    """A further item, and whether a word joins it to those before: not by a comma alone; None where nothing stands."""

    joint: bool | None
    steps: Steps


_words("_forth", "FORWARD distance")
_rule("next", "(COMMA | AND | THEN | STOP | BUT)* (AND | THEN) (COMMA | AND | THEN | STOP | BUT)* item")(
    lambda item: _Next(True, item)
)
_rule("next", "(COMMA | STOP | BUT)+ item")(lambda item: _Next(False, item))
_rule("next", "&(_verb | _forth) item")(lambda item: _Next(None, item))


def _alike(item: Steps, next: Sequence[_Next]) -> Iterator[_Next]:
    """Read "do the living room one first and then the bedroom": the one of that room, too."""
    before = item[-1]
    for joint, more in next:
        one, last = more[0], before.phrases[0] if isinstance(before, Do) and before.phrases else None
        like = last is not None and ONE_OF_ROOM.fullmatch(last.text)
        if last and like and isinstance(one, Do) and not one.verb and one.phrases[0].is_room:
            told = f"inside({ONE}, {one.phrases[0].text})"
            one = replace(one, phrases=(replace(last, text=told, whole=told),))
        steps = (one, *more[1:])
        yield _Next(joint, steps)
        before = steps[-1]


def _enumerated(steps: Sequence[Step]) -> list[Step]:
    """Read "go by the bins: first the one in the hall, then that in the kitchen": each once, in this order."""
    several = (at for at, step in enumerate(steps) if isinstance(step, Do) and step.phrases and step.phrases[0].many)
    at = next(several, 0)
    head, rest = steps[at], steps[at + 1 :]
    listed = [step.phrases[0] for step in rest if isinstance(step, Do) and step.phrases]
    if (
        not (isinstance(head, Do) and _kind(head) == "move" and head.phrases and head.phrases[0].many)
        or not 2 <= len(listed) == len(rest)
        or any(one.base != ONE or ONE not in one.text for one in listed)
    ):
        return []
    told = [
        replace(step, phrases=(replace(one, text=one.text.replace(LAST, before.single)),))
        for step, one, before in zip(rest, listed, (head.phrases[0], *listed), strict=False)
    ]
    group = replace(head.phrases[0], base=head.phrases[0].whole or head.phrases[0].text)
    return [*steps[:at], *_taken_from(tuple(told), head.phrases[0], group)]


def _is_driven(step: Do) -> bool:
    """Whether a step turns or moves by so much, said with a verb or a side."""
    return step.verb != _ONWARD and any("robot.turn" in line or "move_forward(" in line for line in step.lines)


@_rule("items", "item next*")
def _items(item: Steps, next: Sequence[_Next] = ()) -> Steps:
    named = [isinstance(step, Do) and not step.verb for step in (item[-1], *(steps[0] for _, steps in next))]
    joined = any(joint for joint, _ in next)
    next = [*_alike(item, next)]
    for before, (joint, _) in zip((item, *(steps for _, steps in next)), next, strict=False):
        # "how many boxes are there hiding under the bed?" moves nothing
        no_reading_if(joint is None and isinstance(before[-1], Do) and _kind(before[-1]) == "tell")
    # "the bar: second stool" is one thing, told twice
    no_reading_if(not joined and any(b and not a for a, b in pairwise(named)))
    steps = [*item]
    driven = [step for step in (*item, *(one for _, more in next for one in more)) if isinstance(step, Do)]
    no_reading_if(any(step.verb == _ONWARD for step in driven) and not any(_is_driven(step) for step in driven))
    for joint, said in next:
        turned = steps[-1:] == [*_turn_around()]  # "turn around and come back a metre": the way it faces by then
        more = tuple(_reversed(one) if turned and one is said[0] else one for one in said)
        first = more[0]
        if steps[-1:] == [*_turn_around()] and isinstance(first, Do) and AT_BACK in str(first):
            steps.pop()  # "turn round and go to the sofa behind you": behind it before it turns
        if joint is not False or [*more] != [*_turn_around()] or steps[-1:] != [*more]:
            steps += more  # but "about-face! Look the other way" says one turn twice
    if not next or next[0][0] is False:
        steps = _enumerated(steps) or steps
    for at in range(len(steps) - 1, 0, -1):  # "if …; if …; otherwise …": the otherwise is that of all
        first, second = steps[at - 1 : at + 1]
        if isinstance(first, Choose) and isinstance(second, Choose) and second.otherwise and not first.otherwise:
            steps[at - 1 : at + 1] = [replace(first, otherwise=(second,))]
    return tuple(steps)


_rule("start", "_mayhap items (COMMA | STOP | THEN)*")(lambda items: items)


@_rule(
    "start",
    "_mayhap (n:whole LAP | (MAKE (DET | IT | THAT)*)? times) COMMA? STOP items (_mayhap AGAIN)? _mayhap",
    "_mayhap items (COMMA | AND | THEN | STOP)+ AGAIN _mayhap",
    cost=-0.5,
)
def _so_many_times(items: Steps, n: int = 0, times: int = 0) -> Steps:
    """Read "do this two times: the fridge, then the sink", "two rounds: ..., and the same again"."""
    number = max(n, times) if n or times else 2
    if not 1 <= number <= _MAX_TIMES:
        raise CommandError(f"an order can be repeated from 1 to {_MAX_TIMES} times, found {number}")
    return (Repeat(number, items),) if number > 1 else items


@_rule(
    "start",
    "_around (a:items _around)? avoided (_around b:items)? _around",
    "avoided COMMA? ONWAY b:wanted _around",
    cost=0.1,
)
def _keeping_away(avoided: Steps, a: Steps = (), b: Steps = ()) -> Steps:
    """Read "go to the couch, but keep away from the table"."""
    no_reading_if((not a and not b) or all(isinstance(step, Do) and _kind(step) == "tell" for step in (*a, *b)))
    return (*avoided, *a, *b)


@_rule(
    "start",
    "_around (KEEP | STAND | GO | GIVE | WITH)* (ATLEAST distance | distance ATLEAST) (away | AWAY | TO | FROM) np "
    "_around",
    cost=-0.4,
)
def _kept_off(distance: Measure, np: Phrase, away: str = "") -> Steps:
    """Read "stay at least two metres away from the couch", with nothing else to do: so far away, unless it is."""
    no_reading_if(not distance.has_unit or np.text == IT)
    return (Choose(f"distance({{0.argument}}) < {distance.text}", (np,), _go_off(distance, np, off="away")),)


_words("_around", "(COMMA | AND | THEN | STOP | BUT | ONLY)*")
_rule("wanted", "targets")(_go_to)


@_rule(
    "start", "_mayhap items _mayhap (NOWAIT (COMMA | STOP)*)+ (angle | distance | n:amount) (_mayhap NOWAIT)? _mayhap"
)
def _instead_so_much(
    items: Steps, angle: Measure | None = None, distance: Measure | None = None, n: float = 0
) -> Steps:
    """Read "forward two metres. Sorry, one", "turn left 30 degrees, no, 45"."""
    last, call = items[-1], "turn" if angle and "turn" in str(items[-1]) else "move_forward"
    measure = angle or distance or Measure(tidy(n))
    return (*items[:-1], _resized(_act(last), call, measure))


@_rule(
    "start", "_mayhap items _mayhap (NOWAIT (COMMA | STOP)*)* REVERSED (COMMA | STOP)* again:items? _mayhap", cost=-0.5
)
def _the_other_way_round(items: Steps, again: Steps = ()) -> Steps:
    """Read "the sofa, then the basket. No, the other way round: basket first": the steps, the last of them first."""
    steps = [step for step in items if isinstance(step, Do) and step.phrases and "‹" not in str(step.phrases)]
    no_reading_if(not 2 <= len(steps) == len(items))
    told = [str(step.phrases) for step in again if isinstance(step, Do)]
    if told != [str(step.phrases) for step in steps[::-1]][: len(told)]:
        raise CommandError("the order that is meant was not understood")
    return tuple(step if step.verb else replace(step, lines=steps[0].lines, verb=steps[0].verb) for step in steps[::-1])


_words("_struck", "(NOWAIT (COMMA | STOP)*)+ items")
_words("_items", "items")
# "how many cups, no, bottles, how many bottles are there?"
_rule("start", "_mayhap _items _mayhap (NOWAIT COMMA?)+ _np b:question _mayhap", cost=0.3)(lambda b: b)


@_rule("start", "_mayhap np COMMA room _mayhap", cost=0.3)
def _in_room(np: Phrase, room: Phrase) -> Steps:
    """Read "tv, bedroom"."""
    no_reading_if(np.many or np.free)
    return _go_to((replace(np, text=f"inside({np.text}, {room.text})"),))


@_rule(
    "start",
    "_mayhap ((items | NOT _np) _mayhap (_struck _mayhap)* (NOWAIT (COMMA | STOP)*)+ | (NOWAIT COMMA?)+) "
    "(NOT _np ((COMMA | STOP)+ | &DET))? b:items (_mayhap (IS WHAT)? NOWAIT)? _mayhap",
    "_mayhap (items _mayhap)? (b:done COMMA? (IS WHAT)? said:NOWAIT | (NOWAIT COMMA?)* IT IS b:wanted NEED) "
    "(COMMA NOT _np)? _mayhap",
    cost=0.05,
)
def _instead(b: Steps, items: Steps = (), said: str = "") -> Steps:
    """Read "go to the sofa, no wait, the table", "... the table I meant": what follows replaces the order before it."""
    # "go to the sofa, no": what else was not said
    no_reading_if(said and not (said in ("instead", "rather") or (items and said.startswith(("i ", "we ")))))
    last, first = items[-1] if items else None, b[0]
    if first == _halt()[0]:  # "no, stay here" takes back all that was said
        return b
    if isinstance(last, Do) and last.phrases and isinstance(first, Do) and first.phrases:
        # "the glass on the counter, no wait, the one on the table", "... the one left of it"
        struck = last.phrases[0]
        lent_to = [lent((phrase, struck))[0] for phrase in first.phrases]
        told = "".join(first.lines).startswith("tell(")
        taken = [one if told else _taken(one, struck, struck, told=False, first=True) for one in lent_to]
        first = replace(first, phrases=tuple(taken))
        in_room = not struck.is_room and "room" in struck.text and any(one.is_room for one in taken)
        no_reading_if(in_room or any(one.text == struck.text for one in taken))  # a correction says something else
    if isinstance(last, Do) and last.phrases and isinstance(first, Do) and not first.verb:
        first = replace(last, phrases=(*first.phrases, *last.phrases[1:]))
    return (*items[:-1], first, *b[1:])
