"""Noun phrases: "the second red chair from the left that is not near a table" to a set expression of a program.

The expression is evaluated when its line runs, from where the robot is then. A phrase is put together from its noun and
its parts: filters first, then the order, then rank or number.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from simaps_viz.colors.classes import plain
from simaps_viz.errors import CommandError
from simaps_viz.language.grammar import TOO_MANY, Grammar, no_reading, no_reading_if
from simaps_viz.language.words import ANY, AROUND_QUESTIONS, NO_NAMES, Noun, plural, singular

GRAMMAR: Final = Grammar()
IT: Final = "‹it›"
ONE: Final = "‹one›"
SAME: Final = "‹same›"
THAT: Final = re.compile(r"‹that ([^‹›|]*)\|([^‹›|]*)›")
LAST: Final = "‹last›"
SUCH: Final = "‹such›"
"""Stand in an expression for what was named before: that thing, all things of its name, all that were meant, the last
of this name, or (of the same name) it, or all things of the name that the sentence before named."""
CORNERS: Final = {45.0: "north east", 135.0: "south east", 225.0: "south west", 315.0: "north west"}
AHEAD: Final = 'side({}, "front")'
NEAR_M: Final = 3.0
"""How far from it "the chair near the table" may stand, edge to edge; of those in reach the nearest to it is meant."""
MAX_RANK: Final = 10_000
MAX_NUMBER: Final = 2**31
MAX_COUNT: Final = 100
_MAX_DEPTH: Final = 18
_MAX_REPEATED: Final = 120
"""Characters of what things are near, up to which the nearest to it is taken rather than the first near it."""
_SIDES: Final = ("left", "right", "north", "south", "east", "west", "middle")
ALL: Final = re.compile(r'things\(("[^"]*")\)')
IN_ROOM: Final = re.compile(r'inside\(things\("[^"]*"\), (room\("[^"]*"\)|"")\)')
_VAGUE: Final = re.compile(r'only\((?:things\("[^"]*"\)|rooms\(\)|‹one›), "([^"]*)"\)')
_BEST_OF: Final = ("order", True)
"""Said of one thing: "the chair at the table that is nearest to the sofa" is, with one table, the nearest chair."""
_BEST: Final = re.compile(rf"\b(?:order|nearest|farthest)\({ONE}")
_RANKED: Final = re.compile(r'nth\(things\(("[^"]*")\), (\d+)\)')


@dataclass(frozen=True)
class Phrase:
    """A noun phrase as program text."""

    text: str
    """A set, a thing or a room."""
    base: str
    """All things of that name."""
    word: str
    """Its noun, in the singular."""
    many: bool = False
    """Whether each of them is meant; otherwise the first."""
    notes: tuple[str, ...] = ()
    others: tuple[tuple[str, str], ...] = ()
    """Pairs of a name and another one that may be meant."""
    free: bool = False
    """Whether its noun is no known word."""
    whole: str = ""
    """All things that fit, where ``text`` is a choice among them that was not asked for; otherwise ``text``."""
    greedy: bool = False
    """Whether it has a part that more likely belongs to a phrase around it, as "in view" and "except"."""
    penalty: float = 0.0
    lone: bool = False
    """Whether the map has only one thing of that name."""
    inner: tuple["Phrase", ...] = ()
    """Phrases within it."""
    together: bool = False
    """Whether all of it is spoken of at once, as in a question."""
    among: bool = False
    """Whether it is one of those that were spoken of at once, as in "count the chairs, go to the one by the door"."""
    any: bool = False
    """Whether any thing of the name will do, as after "a"."""

    @property
    def is_room(self) -> bool:
        """Whether it is a room, or several."""
        return self.base.startswith("rooms(")

    @property
    def argument(self) -> str:
        """Return it as an argument that takes a name too."""
        found = ALL.fullmatch(self.text)
        return found[1] if found else self.text

    @property
    def arguments(self) -> str:
        """Return it as the arguments ``name`` and ``instance`` of a primitive."""
        found = _RANKED.fullmatch(self.text)
        if found:
            return f"{found[1]}, {found[2]}"
        # The first of a set, and the nearest of things, is what a primitive takes without being told.
        inner = self.text.removeprefix("nearest(").removesuffix(")")
        return replace(self, text=inner).argument if ALL.fullmatch(inner) else self.argument

    @property
    def goal(self) -> str:
        """Return it as the end of a call that drives to it."""
        arguments = self.arguments
        ranked = arguments.startswith('"') and arguments.rpartition(", ")[2].isdigit()
        return f"{'nth_closest' if ranked else 'object'}({arguments})"

    @property
    def single(self) -> str:
        """Return the thing itself rather than the set whose first it is."""
        if (
            self.many
            or self.together
            or self.text.startswith(
                ("nth(", "first(", "only(", "nearest(", "farthest(", "last(", "room(", "union(", IT, "‹that")
            )
        ):
            return self.text
        if self.lone and ALL.fullmatch(self.text):
            return self.text
        return f"{'nearest' if ALL.fullmatch(self.text) else 'first'}({self.text})"

    @property
    def measure(self) -> str:
        """Return what a distance is measured from: of several things of a name the nearest, unless any will do."""
        return self.argument if self.any or self.many else replace(self, text=self.single).argument

    @property
    def definite(self) -> str:
        """Return what a relation is to: as `measure`, or another of its name if only that one fits."""
        if self.any or self.many or self.text.startswith("‹") or self.single == self.text:
            return self.measure
        return f"the({self.text})"


@dataclass(frozen=True)
class Part:
    """A word or phrase that says which things are meant.

    ``kind`` is "filter" (``text`` is an expression with ``{}`` for the set, ``of`` what they are beside), "near"
    (``text`` is what they are near), "but" (of several things ``text`` is a filter, of one ``definite`` is), "order"
    (``text`` is the key, ``of`` what it is measured from), "from" (what an order is measured from), "then" (the order
    in which several are gone through), "rank", "count", "other" or "vague"
    (``text`` is a word that is not known: only one thing may be left that it could tell from others), "counted" or
    "row" where there has to be a rank or number, or a side, and "single" where one thing has to be meant.
    """

    kind: str
    text: str = ""
    of: str = ""
    number: int = 0
    phrase: Phrase | None = None
    """Whose notes belong to it."""
    definite: str = ""
    """``text`` where, of several things of the name that was said, only the nearest is meant."""
    note: str = ""
    outer: bool = False
    """Whether it more likely belongs to the outermost phrase."""


Parts = tuple[Part, ...]


def quoted(label: str) -> str:
    """Return a label as a string of a program; quotes and backslashes cannot leave it."""
    plain = "".join(c for c in label if c.isprintable() and c not in '"\\‹›')
    return f'"{plain[:100]}"'


def select(noun: Noun | None, parts: Iterable[Part], *, every: bool = False, some: bool = False) -> Phrase:
    """Put a phrase together.

    Args:
        noun: its noun; None where it is that of the phrase before ("the red one", "the second").
        parts: what else was said.
        every: each of the things is meant, as after "every".
        some: one of several is meant, as in "one of the chairs".

    Raises:
        CommandError: the parts contradict each other.
    """
    parts = _clear(_of_one_thing(tuple(parts), noun), noun)
    is_plural = every or (noun is not None and noun.is_plural)
    rank, count = _number(parts, "rank"), _number(parts, "count")
    walls = is_plural and not some and rank is None and count is None
    sided = count is not None and not any(part.kind == "order" for part in parts)
    parts = tuple(_told_of(part, several=is_plural or some, walls=walls, sided=sided) for part in parts)
    if rank is not None and (rank == 0 or abs(rank) > MAX_RANK):
        raise CommandError(f"ranks count from 1 to {MAX_RANK}, found {rank}")
    if count is not None and not 1 <= count <= MAX_COUNT:
        raise CommandError(f"from 1 to {MAX_COUNT} things can be visited, found {count}")
    _check_counted(parts, rank, count, several=is_plural, lone=noun is None)
    _check_added(parts, several=(count or 1) > 1)
    parts = tuple(_seated(part, noun) if part.kind == "near" and part.phrase else part for part in parts)
    base, word, notes, others = _based(noun, max(abs(rank or 1), count or 1, 2 if is_plural or parts else 1))
    # "The cup on the table" may stand on any table; "the cups on the table", and a question, mean the nearest table.
    if some:
        is_plural, count = False, None if count == 1 else count
    many = is_plural or (count or 1) > 1
    text = whole = base
    # "The chairs at the bar except the leftmost": that of those, not that of all chairs.
    exceptions = tuple(part for part in parts if many and part.outer and _BEST.search(part.text))
    for part in parts:
        if part.kind == "filter" and part not in exceptions:
            text = (part.definite if (many or some) and part.definite else part.text).replace("{}", text)
            whole = (part.definite or part.text).replace("{}", whole)
    # "The other chair, not the one by the desk" says which one the other is not.
    if any(part.kind == "filter" and part.text.startswith("minus({}") for part in parts):
        parts = tuple(part for part in parts if part.kind != "other")
    elif any(part.kind == "other" for part in parts):
        text = f"minus({text}, {'room()' if noun and noun.base else LAST})"
    chosen = any(part.kind in ("order", "rank", "count", "other", "from") for part in parts)
    if len({part.text for part in parts if part.kind == "order"}) > 1:  # "the big plant in the north-east"
        for part in parts:
            if part.kind == "order" and part.number:
                text = f'sized({text}, "{part.text}")' if part.number == 1 else f'side({text}, "{part.text}", "map")'
        parts = tuple(part for part in parts if part.kind != "order" or not part.number)
    for part in parts:
        whole = f"near({whole}, {part.definite or part.text})" if part.kind == "near" else whole
    text, many = _chosen(text, word, parts, rank, count, many, several=many or some)
    text, whole = _without_best(text, exceptions), _without_best(whole, exceptions)
    text = _sorted_by(text, tuple(part for part in parts if part.kind == "then"), many)
    text = text.replace(ONE, base)
    whole = text if chosen else whole
    inner = [part.phrase for part in parts if part.phrase]
    _check(text, word, inner, many)
    notes += tuple(part.note for part in parts if part.note) + tuple(note for p in inner for note in p.notes)
    others += tuple(pair for p in inner for pair in p.others)
    free = noun is not None and noun.count == 0 and not noun.known
    lone = noun is not None and noun.count == 1 and not noun.wide
    greedy = any(part.outer for part in parts)
    penalty = 0.2 * sum(part.phrase.greedy for part in parts if part.phrase) + _vacuous(base, parts)
    penalty += 0.3 * (lone and _BEST_OF in {(part.kind, bool(part.of)) for part in parts})
    return Phrase(
        text,
        base,
        word,
        many,
        notes,
        others,
        free,
        whole.replace(ONE, base),
        greedy,
        penalty,
        lone=lone,
        inner=tuple(inner),
    )


_COMPASS_SIDE: Final = re.compile(r'side\(\{\}, "(north|south|east|west)"\)')


def _told_of(part: Part, *, several: bool, walls: bool, sided: bool) -> Part:
    """Return what "the lamp, but the red one" (which it is) and "the lamps but the red one" (which not) say.

    With ``walls`` "the lamps along the south wall" are all of that side, and with ``sided`` "the two on the south side"
    the southernmost.
    """
    side = _COMPASS_SIDE.fullmatch(part.text) if sided else None
    if side:
        return Part("order", side[1])
    if walls and part.kind == "order" and part.number == 2:
        return replace(part, kind="filter", text=f'side({{}}, "{part.text}", "map")', number=0)
    if part.kind != "but":
        return part
    return replace(part, kind="filter", text=part.text if several else part.definite, definite="")


def _without_best(text: str, exceptions: Parts) -> str:
    """Leave out exceptions such as "the leftmost" from among what fits."""
    for part in exceptions:
        text = part.text.replace("{}", text).replace(ONE, text)
    return text


def _seated(part: Part, noun: Noun | None) -> Part:
    """Return "at the table in the kitchen", said of seats, as that table which most of them stand at."""
    table = part.phrase
    whole = table.whole if table and table.base == 'things("table")' and not table.many else ""
    if noun is None or noun.label not in ("chair", "stool", "bar stool", "seat") or not whole.startswith("inside"):
        return part
    return replace(part, definite=f'first(order({whole}, "many", things({quoted(noun.label)})))')


def _vacuous(base: str, parts: Parts) -> float:
    """Return how unlikely it is that things are told from others by being none of another class."""
    others = [
        f"minus({{}}, {part.phrase.base})" == part.text for part in parts if part.phrase and part.phrase.base != base
    ]
    return 0.05 * (any(others) and base.startswith("things(") and base != 'things("anything")')


LEFT_OUT: Final = "is left out"
"""Of a word that is not known, where it could tell nothing from anything."""


def _clear(parts: Parts, noun: Noun | None) -> Parts:
    """Return the parts of a phrase without words that are not known where the map has one thing of its name."""
    if noun is None or noun.count != 1 or noun.is_plural or noun.wide:
        return parts
    vague = [part.text for part in parts if part.kind == "vague"]
    if vague and plain(noun.label).endswith(f" {noun.spoken}"):  # a server rack is no coat rack
        raise CommandError(f'"{vague[0]}"')
    left_out = f"{LEFT_OUT}: the map has one {noun.spoken}"
    return tuple(
        replace(part, kind="", note=f'"{part.text}" {left_out}') if part.kind == "vague" else part for part in parts
    )


def _of_one_thing(parts: Parts, noun: Noun | None) -> Parts:
    """Return the parts without the other name of "the footstool, the little ottoman"; raise where it names others."""
    for part in parts:
        no_reading_if(part.kind == "alias" and (noun is None or noun.label != part.of or noun.spoken == part.text))
    parts = tuple(_freed(part, noun.spoken if noun else "") for part in parts)
    if _number(parts, "count") and any(part.kind == "order" and part.number == 2 for part in parts):
        parts = tuple(part for part in parts if part.text != 'at({}, "wall")')  # so many along a wall: the outermost
    paired = _number(parts, "count") == 2  # "the two chairs that stand side by side"
    parts = tuple(replace(one, kind="order") if one.kind == "abreast" and paired else one for one in parts)
    return tuple(part for part in parts if part.kind != "alias")


def _check_counted(parts: Parts, rank: int | None, count: int | None, *, several: bool, lone: bool) -> None:
    """Raise where it was said from where things are counted, and not which, or not from where they are."""
    kinds = {part.kind for part in parts}
    no_reading_if(rank is None and count is None and "counted" in kinds)  # "approach the bench from the left"
    no_reading_if(several and "single" in kinds)  # "the chairs at the desk, the one by the door": the desk is by it
    sided = any(part.kind == "order" and part.text in (*_SIDES, *CORNERS.values()) for part in parts)
    # "at the counter there are four stools: the last one in the row" is seen from where the robot is
    told = rank in (1, -1) and (lone or not kinds.isdisjoint(("near", "filter")))
    if rank is not None and not (sided or told) and "row" in kinds:
        raise CommandError("from which end of the row is counted was not said")


def _check_added(parts: Parts, *, several: bool) -> None:
    """Raise where a thing has two colours: "the red chair, the green one" are two things; or two things have one."""
    filters = [part for part in parts if part.kind == "filter"]
    added = [part.text.partition("(")[0] for part in filters if part.number]
    if len(added) > (not several) or any(
        part.text.startswith(name) and not part.number for part in filters for name in added
    ):
        raise CommandError("")


def _check(text: str, word: str, inner: Sequence[Phrase], many: bool) -> None:
    vague = _VAGUE.search(text)
    if vague:  # what it says of them is all that tells them apart
        raise CommandError(f'"{vague[1]}"')
    if _depth(text) > _MAX_DEPTH:
        raise CommandError(TOO_MANY)
    if not many and any(phrase.many and phrase.base == "rooms()" for phrase in inner):
        raise CommandError(f"which {word} of each room is meant was not said; name the rooms one by one")


def _sorted_by(text: str, orders: Parts, many: bool) -> str:
    """Apply the order in which several things are gone through."""
    no_reading_if(orders and not many)  # "the desks with a keyboard, the left one first" is said of the desks
    for part in orders:
        text = f'order({text}, "{part.text}"{_of(part.of)})'
    return text


def _based(noun: Noun | None, needed: int) -> tuple[str, str, tuple[str, ...], tuple[tuple[str, str], ...]]:
    if noun is None or noun.base:
        return (noun.base, noun.spoken, (), ()) if noun else (ONE, "thing", (), ())
    if not noun.known:
        return f"search({quoted(noun.label)})", noun.spoken, (), ()
    if noun.wide and (noun.count if noun.count is not None else 1) < needed:
        return (
            f"things({quoted(noun.wide)})",
            noun.spoken,
            (f'"{noun.spoken}" takes its kinds together',),
            ((noun.wide, noun.label),),
        )
    pairs = tuple((noun.label, other) for other in noun.others)
    return f"things({quoted(noun.label)})", noun.spoken, (noun.note,) if noun.note else (), pairs


def _chosen(
    text: str, word: str, parts: Sequence[Part], rank: int | None, count: int | None, many: bool, *, several: bool
) -> tuple[str, bool]:
    """Apply order, rank and number; returns the text, and whether it is several things.

    ``several`` says that it is at least chosen among several.
    """
    key, of = _order(parts, many and count is None, rank is not None)
    vague = [part.text for part in parts if part.kind == "vague"]
    if vague and (many or several or rank is not None or text.startswith("search(")):
        raise CommandError(f'"{vague[0]}"')
    for part in parts:
        if part.kind != "near":
            continue
        beside = part.definite if several and part.definite else part.text
        # "The third chair at the counter" and "the large plant beside the couch" are next to it.
        alike = several or rank is not None or key in _SIDES or (part.number and key not in ("", "near", "far"))
        text = f"near({text}, {beside})" if alike and count is None else f"near({text}, {beside}, {NEAR_M:g})"
    for unknown in vague:
        text = f"only({text}, {quoted(unknown)})"
    if key in ("", "near") and not of and not many and rank == -1 and count is None:
        rank, key = None, "far"
    ordered = text if (key or "near", of) == ("near", "") else f'order({text}, "{key or "near"}"{_of(of)})'
    if count is not None and (count > 1 or many):
        return _some(text, ordered, key, of, rank, count), True
    if many and rank is not None:
        raise CommandError(f"the {'last' if rank < 0 else 'first'} of how many {plural(word)} was not said")
    if many:
        return _all(text, word, key, of), True
    if rank is not None:
        return f"nth({ordered}, {rank})", False
    if key in ("near", "far"):
        name = "nearest" if key == "near" else "farthest"
        return (f"{name}({text}, 1{_of(of)})" if of else f"{name}({text})"), False
    return (f"first({ordered})" if key else text), False


def _order(parts: Sequence[Part], many: bool, ranked: bool) -> tuple[str, str]:
    """Return the key things are ordered by and what it is measured from; "" for none."""
    orders = list(dict.fromkeys((part.text, part.of) for part in parts if part.kind == "order"))
    measured = [part.text for part in parts if part.kind == "from"]
    if measured and ranked and not orders:  # "the third chair from the door"
        return "near", measured[0]
    if measured:  # "the nearest chair to the desk"
        no_reading_if(len(orders) != 1 or orders[0] not in (("near", ""), ("far", "")))
        return orders[0][0], measured[0]
    if len(orders) == 2 and ("near", "") in orders:
        orders.remove(("near", ""))  # "the nearest chair on the far left"
    if len(orders) > 1:
        raise CommandError("two ways of counting were said for one thing")
    if orders:
        return orders[0]
    few = [part.text for part in parts if part.kind == "fewest"]
    if few and not many:
        return "few", few[0]
    # Of several things beside another one, that nearest to it is meant first.
    beside = [part.text if part.kind == "near" else part.of for part in parts if part.kind in ("near", "filter")]
    beside = [of for of in beside if 0 < len(of) <= _MAX_REPEATED]
    return ("near", beside[0]) if beside and not many else ("", "")


def _some(text: str, ordered: str, key: str, of: str, rank: int | None, count: int) -> str:
    if rank not in (None, 1, -1):
        raise CommandError("a rank and several things were said together")
    if key in ("", "near", "far") and (rank != -1 or ordered == text):
        return f"{'farthest' if key == 'far' or rank == -1 else 'nearest'}({text}, {count}{_of(of)})"
    return f"{'last' if rank == -1 else 'first'}({ordered}, {count})"


def _all(text: str, word: str, key: str, of: str) -> str:
    if key == "near" and of:
        return f"near({text}, {of})"
    if key in ("large", "small", "long", "short", "tall", "low") and not text.startswith("rooms("):
        return f'sized({text}, "{key}")'
    if key:
        raise CommandError(f"how many of the {plural(word)} are meant was not said")
    return text


def _of(of: str) -> str:
    return f", {of}" if of else ""


def _number(parts: Sequence[Part], kind: str) -> int | None:
    found = {part.number for part in parts if part.kind == kind}
    if len(found) > 1:
        raise CommandError(f"two {'ranks' if kind == 'rank' else 'numbers'} were said for one thing")
    return next(iter(found), None)


def _depth(text: str) -> int:
    depth = most = 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        most = max(most, depth)
    return most


def refine(phrase: Phrase, parts: Iterable[Part]) -> Phrase:
    """Return a phrase with further filters, as "is the sofa red" adds one."""
    text, found = phrase.whole or phrase.text, [phrase]
    for part in (_freed(one, phrase.word) for one in parts):
        text = (part.definite or part.text).replace("{}", text) if part.kind == "filter" else text
        text = f"near({text}, {part.definite or part.text})" if part.kind == "near" else text
        no_reading_if(part.kind not in ("filter", "near"))  # whether it is so is asked, not which one it is
        found += [part.phrase] if part.phrase else []
    pairs = tuple(pair for p in found for pair in p.others)
    inner = (*phrase.inner, *found[1:])
    notes = tuple(n for p in found for n in p.notes)
    return replace(phrase, text=text, whole="", notes=notes, others=pairs, inner=inner)


def united(phrases: Sequence[Phrase]) -> Phrase:
    """Return one phrase for "the chair or the couch"."""
    phrases = lent(phrases)
    first = phrases[0]
    no_reading_if(any(one.free or one.is_room != first.is_room for one in phrases))
    if first.base not in (ONE, SAME):  # "the counter with the cake or the one with the sinks"
        phrases = [
            replace(one, text=one.text.replace(ONE, first.base), base=first.base)
            if one.base == ONE != one.text and one.text != IT
            else one
            for one in phrases
        ]
    text = first.argument
    for other in phrases[1:]:
        text = f"union({text}, {other.argument})"
    pairs = tuple(pair for p in phrases for pair in p.others)
    return Phrase(text, text, first.word, first.many, tuple(n for p in phrases for n in p.notes), pairs)


def sharing(phrases: Sequence[Phrase]) -> Sequence[Phrase]:
    """Return things of which what is said of the last is true: of "stools or chairs at the bar" the stools, too."""
    *others, last = phrases
    if last.text.count(last.base) != 1 or not all(one.many and ALL.fullmatch(one.text) for one in others):
        return phrases
    return [*(replace(one, text=last.text.replace(last.base, one.text), whole="") for one in others), last]


def _filter(text: str, *phrases: Phrase, outer: bool = False, of: str = "", definite: str = "") -> Parts:
    notes = tuple(n for p in phrases for n in p.notes)
    pairs = tuple(pair for p in phrases for pair in p.others)
    greedy = any(p.greedy for p in phrases)
    inner = None
    if phrases:
        inner = replace(phrases[0], notes=notes, others=pairs, greedy=greedy)
    return (Part("filter", text, of, phrase=inner, outer=outer, definite=definite),)


_rule = GRAMMAR.rule

# ---- sides, numbers

for _side in _SIDES[:-1]:
    _rule("side", _side.upper())(lambda side=_side: side)


_rule("amount", "n:NUM", "n:ONE")(lambda n: n)


@_rule("whole", "n:amount")
def _whole(n: float) -> int:
    if n != int(n):
        raise CommandError(f"things are counted in whole numbers, found {n:g}")
    return int(n)


# ---- adjectives: parts that may stand before the noun, and after "is"


_rule("adjective", "color:COLOR")(lambda color: _filter(f'colored({{}}, "{color}")'))
# "orange-red": what may be called either
_rule("adjective", "one:COLOR other:COLOR", cost=-0.1)(
    lambda one, other: _filter(f'union(colored({{}}, "{one}"), colored({{}}, "{other}"))')
)
_rule("adjective", "shape:SHAPE")(lambda shape: _filter(f'shaped({{}}, "{shape}")'))
_rule("adjective", "EMPTY")(lambda: _filter("empty({})"))
_rule("adjective", "FREE")(lambda: (Part("free", "empty({})"),))


def _freed(part: Part, name: str) -> Part:
    """Return what "free" says: of a table or desk that nobody is at it, of anything else that nothing is on it, too."""
    if part.kind != "free":
        return part
    table = name.split()[-1:] in (["table"], ["desk"], ["counter"])
    return replace(part, kind="filter", text='minus({}, near({}, "person"))' if table else part.text)


# "the chair that stands by itself": nothing of its kind is next to it
_rule("adjective", "ALONE")(lambda: _filter("minus({}, near({}, {}))"))
_rule("adjective", "TAKEN")(lambda: _filter("minus({}, empty({}))"))
_rule("adjective", "SEEN")(lambda: _filter("visible({})"))
_rule("adjective", "NOT adjective")(lambda adjective: tuple(_negated(part) for part in adjective))


def _negated(part: Part) -> Part:
    """Return the filter that keeps what a part would not choose."""
    match part.kind:
        case "filter" | "free":
            left_out, of = part.text, part.phrase
            if of and of.text.startswith('room("'):  # "not in the bedroom": in none of them
                left_out = left_out.replace(of.text, of.whole or of.text)
        case "near":
            left_out = f"near({{}}, {part.text})"
            for name, wide in part.phrase.others if part.phrase else ():
                if wide.startswith(ANY):  # "not at a table": at none of any kind
                    left_out = left_out.replace(quoted(name), quoted(wide))
        case "order":
            left_out = f'first(order({{}}, "{part.text}"{_of(part.of)}))'
        case "rank":
            left_out = f"nth({{}}, {part.number})"
        case _:
            raise CommandError("")
    return replace(part, kind="filter", text=f"minus({{}}, {left_out})", definite="")


@_rule("size", "key:SUPER", "key:MORE")
def _size(key: str) -> Parts:
    return (Part("order", key),)


_rule("size", "key:SIZE")(lambda key: (Part("order", key, number=1),))


@_rule("pre", "n:ORD")
def _ranked(n: int) -> Parts:
    return (Part("rank", number=n),)


_rule("pre", "NEAREST | NEARBY | far:FARTHEST")(lambda far="": (Part("order", "far" if far else "near"),))
_rule("pre", "side:MOST SIDE?", "side SIDE?")(lambda side: (Part("order", side),))
# "the east wall picture"
_rule("pre", "side spot:SPOT", cost=0.2)(lambda side, spot: (*_spot(spot), Part("order", side, number=2)))
_rule("pre", "MIDDLE")(lambda: (Part("order", "middle"),))
_rule("pre", "OTHER")(lambda: (Part("other"),))


@_rule("pre", "n:whole DIFFERENT", "EXACTLY n:whole", cost=-0.1)
@_rule("pre", "n:whole")
def _counted(n: int) -> Parts:
    return (Part("count", number=n),)


_rule("pre", "adjective", "adjective:size")(lambda adjective: adjective)


# ---- relations: parts that stand after the noun

GRAMMAR.words("_at", "ON", "TO", "AT", "IN", "BY")
GRAMMAR.words("_near", "BY", "AT", "AROUND", "OVER", "OF", "FOR")
GRAMMAR.words("_here", "(FROM | TO | AT | OF | AWAY)* HERE")
GRAMMAR.words("_dets", "DET*")
_rule("relation", "VIEW", "SEE", "SEEN")(lambda: _filter("visible({})", outer=True))


@_rule("relation", "n:ORD? FROM DET? side (SIDE | END)?")
@_rule("relation", "NUMBER n:amount FROM DET? side (SIDE | END)?", cost=-0.2)
def _from_side(side: str, n: float = 0) -> Parts:
    no_reading_if(n != int(n))
    return (*(_ranked(int(n)) if n else ()), Part("order", side), Part("counted"))


GRAMMAR.words("_described", "adjective")
GRAMMAR.words("_side", "side")
GRAMMAR.words("_key", "key")
GRAMMAR.words("_number", "whole")
_rule(
    "relation",
    "COMMA? GO? FROM? DET? side SIDE? TO DET? _side SIDE?",
    "STOP GO? FROM? DET? side SIDE? TO DET? _side SIDE? !COMMA",
    cost=-0.1,
)(lambda side: (Part("then", side),))
# "from the nearest to the farthest"
_rule("relation", "FROM DET? key TO DET? _key", cost=-0.4)(lambda key: (Part("then", key),))
_rule("relation", "COMMA? key:SORTEDBY (np | HERE) COMMA? (ASCENDING | last:DESCENDING)?", cost=-0.4)(
    lambda key, np=None, last="": (Part("then", "far" if last else key, np.measure if np else "", phrase=np),)
)


@_rule(
    "sorted",
    "(COMMA | BUT | AND)* STARTWITH DET? (key:key | FROM? DET? side) SIDE? (ONE | ONES)?",
    "COMMA? WITH? FROM? DET? (key:key | side) (ONE | ONES | OF IT | OF ONES | SIDE | END)? n:ORD",
    cost=-0.2,
)
def _sorted(key: str = "", side: str = "", n: int = 1) -> Parts:
    """Read "starting with the farthest", "the nearest one first"."""
    no_reading_if(n != 1)
    return (Part("then", key or side),)


_rule("post", "sorted")(lambda sorted: sorted)

for _token, _key in (("NEAREST", "near"), ("FARTHEST", "far")):
    _rule("key", _token)(lambda name=_key: name)
_rule("key", "name:SUPER", "name:MORE", "name:MOST")(lambda name: name)
_rule("relation", "_at? _dets side SIDE? (OF HERE)?")(lambda side: _filter(f'side({{}}, "{side}")'))
_rule("relation", "(AT | ON) _dets side END | _at? _dets side:MOST (SIDE | END)? | n:ORD? FARTHEST _at? DET? side")(
    lambda side, n=0: (*(_ranked(n) if n else ()), Part("order", side))
)
# "the plant in the north-east": the one farthest that way
_rule("relation", "_at? _dets corner:INTER (SIDE | SPOT)? (OF DET* MAP)?", cost=-0.2)(
    lambda corner: no_reading() if corner not in CORNERS else (Part("order", CORNERS[corner]),)
)


@_rule("relation", "_at? _dets side (SIDE | END)? (OF | FROM) np", cost=-0.05)
def _side_of(side: str, np: Phrase) -> Parts:
    if np.is_room:
        return _filter(f'side({{}}, "{side}", {np.argument})', np)
    return _filter(
        f'side({{}}, "{side}", {np.argument})', np, of=np.argument, definite=f'side({{}}, "{side}", {np.definite})'
    )


@_rule("relation", "_at? _dets end:FAREND OF np", cost=0.1)
def _at_far_end(np: Phrase, end: str) -> Parts:
    no_reading_if(end == "end" and not np.is_room)
    return (*_filter(f"near({{}}, {np.measure})", np), Part("order", "far"))


# "the second seat from the left in that row of five": what stands in a row is counted from its side
_rule("relation", "COMMA? (IN | OF | FROM) (DET | THAT)* ROW (OF whole)?")(lambda whole=0: (Part("row"),))
_rule("relation", "BETWEEN DET* ROW (OF whole)?", cost=-0.2)(lambda whole=0: (Part("order", "middle"),))


@_rule("relation", "BETWEEN np", cost=-0.1)
def _amid_them(np: Phrase) -> Parts:
    """Read "the table in the middle of the nine square ones": of these the middle one."""
    count = re.search(r", (\d+)\)$", np.text)
    no_reading_if(not np.many or not count or int(count[1]) < 3)
    return (*_filter(f"common({{}}, {np.text})", np), Part("order", "middle"))


@_rule("relation", "ON SAME noun AS np", cost=-0.3)
def _on_the_same(noun: Noun, np: Phrase) -> Parts:
    """Read "the cup on the same table as the laptop"."""
    shared = f"having({select(replace(noun, is_plural=True), ()).text}, {np.argument})"
    return _filter(f"on({{}}, {shared})", np)


_rule("relation", "_at? _dets side (SIDE | END)? (OF | IN) DET* MAP")(
    lambda side: _filter(f'side({{}}, "{side}", "map")')
)
_rule("relation", "(FRONT | BEFORE) HERE", "FORWARD (OF HERE)?", "behind:BEHIND HERE")(
    lambda behind="": _filter('side({}, "behind")' if behind else AHEAD)
)


@_rule("relation", "FRONT np | behind:BEHIND np")
def _in_front(np: Phrase, behind: str = "") -> Parts:
    return _side_of("behind" if behind else "front", np)


@_rule("relation", "near:NEAR np", "_near np")
def _close(np: Phrase, near: str = "") -> Parts:
    no_reading_if(near.startswith(("closer", "nearer")))  # of several the nearest
    beside = re.search(r"next to|beside|against|alongside", near) is not None
    return (Part("near", np.argument, number=int(beside), phrase=np, definite=np.definite),)


@_rule("relation", "NEAR np _at _dets side SIDE?", cost=-0.3)
def _close_on_side(np: Phrase, side: str) -> Parts:
    """Read "next to the microwave on the left", of the only microwave: on its left."""
    no_reading_if(not np.lone or side not in ("left", "right"))
    return (*_side_of(side, np), *_close(np))


_rule("relation", "(TO | AWAY? FROM | OF) np", cost=-0.05)(lambda np: (Part("from", np.measure, phrase=np),))
# "the chair at the north end of the table": of those next to it the northernmost
_rule("relation", "(AT | ON | BY | IN) _dets side END OF np", cost=-0.4)(
    lambda side, np: (*_filter(f"near({{}}, {np.measure})", np), Part("order", side))
)


@_rule("end_of", "(AT | ON | BY)? _dets (FOOT | end:END | end:FAREND | key:SIZE (SIDE | END)) OF")
def _end_of(end: str = "", key: str = "") -> str:
    """Read "at the head of", "on a long side of"."""
    no_reading_if(key not in ("", "long", "short") or end not in ("", "end", "ends", "head"))
    return "flank" if key == "long" else "end"


@_rule("relation", "end_of np", "NEAR _dets key:SIZE SIDE OF np", cost=-0.2)
def _at_end_or_flank(np: Phrase, end_of: str = "end", key: str = "") -> Parts:
    """Read "the chair at the head of the table", "the bench at the foot of the bed": next to one of its short sides."""
    no_reading_if(np.is_room or key not in ("", "long", "short"))
    if np.word in ("bed", "couch"):
        return _close(np)
    side = "flank" if key == "long" else end_of
    text = f'side({{}}, "{side}", {np.argument})'
    return _filter(text, np, of=np.argument, definite=text.replace(np.argument, np.definite))


@_rule(
    "relation",
    "THAT DISTANCE (TO | FROM) np IS key:SUPER | "
    "WITH DET? (key:SUPER | key:MORE | FEWEST) DISTANCE ((TO | FROM) (np | HERE))?",
    cost=-0.3,
)
def _at_least_distance(key: str = "small", np: Phrase | None = None) -> Parts:
    """Read "the chair whose distance to the door is smallest", "the lamp with the smallest distance to the door"."""
    no_reading_if(key not in ("small", "short", "large", "long"))
    of = np.measure if np else ""
    return (Part("order", "near" if key in ("small", "short") else "far", of, phrase=np),)


_rule("relation", "_at? ITS side (SIDE | END)?", cost=-0.1)(lambda side: _side_of(side, Phrase(IT, ONE, "thing")))


@_rule("relation", "ON np", "IN within:np")
def _on(np: Phrase | None = None, within: Phrase | None = None) -> Parts:
    name, of = ("inside", within) if within else ("on", np)
    assert of is not None
    return _filter(f"{name}({{}}, {of.argument})", of, definite=f"{name}({{}}, {of.definite})")


_HUNG: Final = ("picture", "painting", "poster", "photo", "clock", "mirror", "window", "whiteboard")


@_rule("relation", "UNDER np")
def _under(np: Phrase) -> Parts:
    if np.word.split()[-1] in _HUNG:  # at the wall, below it
        return _close(np)
    return _filter(f"under({{}}, {np.argument})", np, definite=f"under({{}}, {np.definite})")


# "the couch that faces the tv", "the chair looking at the window"
_rule("relation", "FACING np", cost=-0.1)(lambda np: _filter(f"facing({{}}, {np.measure})", np))
_rule("relation", "OPPOSITE np", cost=-0.1)(lambda np: _filter(f"opposite({{}}, {np.measure})", np, of=np.measure))


# "the two chairs that are farthest apart"
_rule("relation", "key:PAIRED", cost=-0.3)(lambda key: (Part("order", key), Part("count", number=2)))


@_rule("relation", "BETWEEN pair")
def _between(pair: tuple[Phrase, Phrase]) -> Parts:
    return _filter(f"between({{}}, {pair[0].argument}, {pair[1].argument})", *pair)


_rule("relation", "n:ORD? NEAREST (TO | OF)? np")(
    lambda np, n=0: (*(_ranked(n) if n else ()), Part("order", "near", np.measure, phrase=np))
)


@_rule("relation", "DET? (NEAREST TO? | far:FARTHEST AWAY? FROM?) DET? side spot:SPOT", cost=-0.2)
def _nearest_wall(side: str, spot: str, far: str = "") -> Parts:
    """Read "the chair farthest from the west wall": the easternmost."""
    opposite = {"north": "south", "south": "north", "east": "west", "west": "east", "left": "right", "right": "left"}
    no_reading_if(spot != "wall")
    return (Part("order", opposite[side] if far else side),)


_rule("relation", "n:ORD? DET? (NEAREST | far:FARTHEST AWAY?) (_here | ONE)?", "NEAR HERE")(
    lambda n=0, far="": (*(_ranked(n) if n else ()), Part("order", "far" if far else "near"))
)
_rule("relation", "NEARBY")(lambda: _filter('near({}, "robot", 3)'))


@_rule("relation", "IN? ELSEWHERE")
def _elsewhere() -> Parts:
    return _filter("minus({}, inside({}, room()))")


_rule("relation", "ABREAST")(lambda: (Part("abreast", "together"),))
_rule("relation", "(FROM | TO)? HERE | EXIST HERE? | (IN | ON | OF) DET* MAP")(lambda: ())
# "the plant that stands on the floor": on nothing else
_rule("relation", "ON det:DET place:MAP", cost=-0.05)(
    lambda det, place: no_reading() if (det, place) != ("the", "floor") else _filter('at({}, "floor")')
)
# "how many laptops are outside of the office"
_rule("relation", "OUTSIDE room")(lambda room: _filter(f"minus({{}}, inside({{}}, {room.text}))", room))


@_rule("relation", "ANYWHERE? IN here:HERE")
def _in_here(here: str) -> Parts:
    """Read "in here": in the room where the robot is, of a map that has rooms."""
    if here != "here":  # "in this place"
        return ()
    return _filter('inside({}, "")')


@_rule("relation", "(IN | OF | AT | FROM) room (AND | OR) IN? more:room", cost=0.3)
@_rule("pre", "room POSS", cost=0.1)
@_rule("relation", "(IN | OF | AT | FROM) room")
def _inside(room: Phrase, more: Phrase | None = None) -> Parts:
    if more:  # "how many chairs are in the kitchen and the hall"
        return _filter(f"inside({{}}, union({room.text}, {more.text}))", room, more)
    if room.text == 'room("other")':  # "the ball by the bench and then that in the other room"
        return _elsewhere()
    return _filter(f"inside({{}}, {room.text})", room)


# "the chair at the table, the left one", "the chair at the head of the table, on the north side"
_rule("post", "COMMA DET side SIDE? ONE", "COMMA (AT | ON) DET side (SIDE | END)", cost=0.1)(
    lambda side: (Part("order", side),)
)
# "the suitcase on the sofa, the larger of the two"
_rule("post", "COMMA? DET (adjective:size | key) ONE? (OF (DET | BOTH | EVERY)* (_number | IT)?)?", cost=0.1)(
    lambda adjective=(), key="": adjective or (Part("order", key),)
)


# "the window on the wall, behind the bench"
_rule("post", "COMMA &(IN _room_too) relation", cost=0.1)(lambda relation: relation)
_rule("post", "COMMA &(BEHIND | FRONT | NEAR | BY | UNDER | BETWEEN) relation", cost=-0.25)(lambda relation: relation)


@_rule("post", "COMMA (IT IS)? DET adjective (one:ONE | !(NOUN | NOUNS | ONES | WORD)) post*", cost=0.1)
def _the_red_one(adjective: Parts, post: Parts = (), one: float = 0) -> Parts:
    """Read "the box under the bench, the red one": a list where another colour was said before."""
    said = (replace(part, number=1, outer=part.text.startswith("colored(")) for part in adjective)
    return (*said, *post, *((Part("single"),) if one else ()))


# "the chair, it is by the window", "the desk. It must not be red", "the desk, it has a plant on it"
_rule(
    "post",
    "(COMMA | STOP | BUT)+ IT (IS | negation:NOT)+ (relation | adjective | DET adjective ONE)",
    "(COMMA | STOP | BUT)+ IT &(WITH | WITHOUT) relation",
    "(COMMA | STOP)+ NEED DET adjective ONE",
    cost=0.2,
)(
    lambda relation=(), adjective=(), negation=(): (
        tuple(_negated(part) for part in (*relation, *adjective)) if negation else (*relation, *adjective)
    )
)
# "the desk, there is a laptop on it"; not "go to the desk. Is there a laptop on it?"
_rule("post", "(COMMA | STOP)+ exist:EXIST np (ON | AT | UNDER | NEAR) IT", cost=0.2)(
    lambda exist, np: no_reading() if not exist.startswith("there") else _having(np)
)
# "the footstool, the little ottoman": one thing by two names
_rule("post", "COMMA DET pre* name:NOUN !(COMMA? (AND | OR) | COMMA DET)", cost=0.1)(
    lambda name, pre=(): (Part("alias", name.spoken, name.label), *pre)
)
# "a chair, any chair"
_rule("post", "COMMA said:INDEF pre* name:NOUN", cost=-0.2)(
    lambda said, name, pre=(): no_reading() if said != "any" else (Part("alias", "", name.label), *pre)
)
# "the smallest table, coffee tables included"
_rule("relation", "COMMA? INCLUDING np", "COMMA np INCLUDED")(lambda np: _filter(f"union({{}}, {np.base})", np))


@_rule("relation", "ON DET* SIDE FACING HERE", cost=-0.2)
def _on_near_side() -> Parts:
    """Read "on the side facing you": of what was named before."""
    thing = Phrase(IT, ONE, "thing")
    return (*_in_front(thing), *_close(thing))


# "the tub where one takes a bath": whatever that means, it is no choice where one is left
_rule("post", "said:CLAUSE", cost=1.0)(lambda said: (Part("vague", said),))
# "the bin, the bedroom one"
_rule("post", "COMMA DET room ONE !(ORD | LASTLY)", cost=-0.1)(_inside)
# "the chair at the table, the one farther from you": of the chairs rather than of the tables
_rule("post", "COMMA DET ONE (OF IT)? post", cost=0.29)(
    lambda post: (*(replace(part, outer=True) for part in post), Part("single"))
)
# "the table, the one in this room"
_rule("post", "COMMA? (IT IS)? DET ONE post", cost=0.3)(lambda post: post)


@_rule("relation", "IN DET* SAME ROOM (AS np)?", cost=-0.1)
def _same_room(np: Phrase | None = None) -> Parts:
    other = np or Phrase(IT, ONE, "thing")
    return _filter(f"inside({{}}, room({other.argument}))", other)


@_rule(
    "relation",
    "(IN | AT | BY | NEAR | ON) DET* far:FARTHEST? spot:SPOT ((OF | IN) room)?",
    "ON room POSS? spot:SPOT",
    cost=0.1,
)
def _spot(spot: str, room: Phrase | None = None, far: str = "") -> Parts:
    inside = _inside(room) if room else ()
    return (*inside, *_filter(f'at({{}}, "{spot}")'), *((Part("order", "far"),) if far else ()))


# "the sofa by the east wall": of those at a wall the easternmost
_rule(
    "relation",
    "(AT | BY | NEAR | ON | IN) DET* ((side | side:MOST) spot:SPOT | spot:SPOT TO? DET? side) ((OF | IN) room)?",
    cost=-0.1,
)(lambda side, spot, room=None: (*_spot(spot, room), Part("order", side, number=2)))


@_rule("relation", "(MORETHAN | less:LESSTHAN) distance AWAY? (FROM (np | HERE))?", cost=-0.2)
@_rule("relation", "less:IN distance (OF | FROM) np")
def _farther_than(distance: Any, np: Phrase | None = None, less: str = "") -> Parts:
    """Read "the chairs more than two metres from the table", "within two metres of the table"."""
    near = f"near({{}}, {np.measure if np else quoted('robot')}, {distance.text})"
    return _filter(near if less else f"minus({{}}, {near})", *([np] if np else []))


@_rule("relation", "IS? DET? key:MORE THAN distance", cost=-0.2)
def _more_than(key: str, distance: Any) -> Parts:
    """Read "taller than one metre", "farther away than two metres"."""
    if key in ("near", "far"):
        return _farther_than(distance, less="" if key == "far" else key)
    key = {"large": "long", "small": "short"}.get(key, key)
    return _filter(f'sized({{}}, "{key}", {distance.text})')


_rule("relation", "IS? DET? key:MORE THAN n:amount SQUAREMETRES", cost=-0.3)(
    lambda key, n: no_reading() if key not in ("large", "small") else _filter(f'sized({{}}, "{key}", {n:g})')
)


@_rule("relation", "(WITH | WHERE IS+) DET* (least:ATLEAST | more:MORETHAN)? n:whole np _on_it?", cost=-0.6)
def _having_some(n: int, np: Phrase, more: str = "", least: str = "") -> Parts:
    """Read "the table with four chairs": of those with more, that with the fewest."""
    fewest = () if more or least else (Part("fewest", np.argument),)
    return (*fewest, *_filter(f"having({{}}, {np.argument}, {n + bool(more)})", np))


@_rule(
    "relation",
    "(WITHONLY | WITH only:EXACTLY | WHERE (only:ONLY | only:EXACTLY)) n:whole np (_on_it? | IS+ _at?) | "
    "WITH (most:ATMOST | few:LESSTHAN) n:whole np _on_it?",
    cost=-0.6,
)
def _having_no_more(n: int, np: Phrase, only: str = "", most: str = "", few: str = "") -> Parts:
    """Read "with only two chairs", "with at most two chairs"."""
    some = "{}" if most or few else f"having({{}}, {np.argument}, {n})"
    return _filter(f"minus({some}, having({{}}, {np.argument}, {n + (not few)}))", np)


_rule(
    "relation",
    "WITH BOTH a:np AND b:np _on_it? | WITH a:np AND !(DET | INDEF | EVERY | _number) b:np _on_it? | WITH a:np "
    "_on_it? AND b:np _on_it | WITH a:np _on_it AND b:np | WHERE a:np AND b:np IS+",
    cost=-0.3,
)(lambda a, b: _filter(f"having(having({{}}, {a.argument}), {b.argument})", a, b))
_rule("relation", "WITH ITS pre* noun")(lambda noun, pre=(): _having(select(noun, pre)))


@_rule(
    "relation",
    "WITH np _on_it?",
    "WHERE IS+ np",
    "WHERE np IS+ ((AT | ON | IN) IT?)?",
    "THAT np IS+ (ON | AT | IN | BY | NEAR)",
    "(ON | IN | AT) THAT np IS+",
)
def _having(np: Phrase) -> Parts:
    if np.text == IT:
        raise CommandError("what the thing has was not said")
    return _filter(f"having({{}}, {_such(np).argument})", np)


def _such(np: Phrase) -> Phrase:
    """Return "one", said of what a thing has, as one of what the sentence before named: no table has a table on it."""
    return replace(np, text=SUCH) if np.text == ONE else np


# "with five chairs around it and a vase on it"
_rule("relation", "(WITH | WHERE IS+) n:whole a:np _on_it? AND b:np _on_it?", cost=-1.0)(
    lambda n, a, b: (*_having_some(n, a), *_having(b))
)
# "the desk with a plant on it": not with one beside it
_rule("relation", "WITH np (IS | HANG)? ON IT?", cost=-0.1)(
    lambda np: no_reading() if np.text == IT or np.many else _filter(f"under({{}}, {_such(np).argument})", np)
)
# "the desk with a backpack under it"
_rule("relation", "WITH np UNDER IT?", cost=-0.1)(lambda np: _filter(f"having({{}}, under({np.argument}, {{}}))", np))
_rule("relation", "WITH key:numerous np _on_it?", cost=-0.3)(
    lambda key, np: (Part("order", key, np.argument, phrase=np),)
)


@_rule("relation", "WITHOUT np _on_it?", "WHERE NUMBER np IS+", "WITH NEITHER np NOR more:np _on_it?")
def _without(np: Phrase, more: Phrase | None = None) -> Parts:
    if np.base == ONE and not more:  # "the books without the ones on shelves"
        return _except((np,))
    return tuple(p for one in (np, more) if one for p in _filter(f"without({{}}, {one.argument})", one))


_rule("relation", "(WITHOUT ANYTHING | WITH NOTHING) _on_it? | (WHERE | THAT)? NOTHING IS? (ON | AT | IN)?", cost=-0.3)(
    lambda: _filter("empty({})")
)


@_rule("relation", "BUTNO np (COMMA? (NUMBER | OR | NOR) more:np)* _on_it?", cost=-0.1)
def _but_without(np: Phrase, more: Sequence[Phrase] = ()) -> Parts:
    """Read "a desk with a keyboard but no book on it": of the desk, not of the keyboard."""
    return tuple(p for one in (np, *more) for p in _filter(f"without({{}}, {one.argument})", one, outer=True))


# "a room with a ball and no bed, no tv"
_rule("relation", "WITH a:np BUTNO b:np (COMMA? (NUMBER | OR | NOR) more:np)* _on_it?", cost=-0.3)(
    lambda a, b, more=(): (*_having(a), *(replace(part, outer=False) for part in _but_without(b, more)))
)
# "the bed, not the big one, the other one"
_rule("post", "(COMMA | BUT)? DET OTHER ONE", "(COMMA | BUT)+ DET OTHER", cost=0.3)(lambda: (Part("other", number=1),))
_rule("relation", "EXCEPT DET OTHER ONE", cost=-0.6)(lambda: (Part("other"),))
_rule("relation", "WITH ANYTHING _on_it", cost=-0.3)(lambda: _filter("minus({}, empty({}))"))
GRAMMAR.words("_on_it", "(IS | HANG)? (ON | NEAR | AT | AROUND | BY | IN | OVER | TO) IT?")
GRAMMAR.words("_is", "(THAT | IS | EXIST | HANG)+")
_rule("post", "(_is DET?)? relation")(lambda relation: relation)
_rule("post", "_is? NOT DET? relation (BUT so:relation)?")(
    lambda relation, so=(): (*(_negated(part) for part in relation), *so)
)
_rule("post", "_is adjective", "_is DET? adjective:size (ONE | OF EVERY)?")(lambda adjective: adjective)
# "things that are not chairs"
_rule("post", "_is NOT np", cost=0.1)(lambda np: _filter(f"minus({{}}, {np.whole or np.text})", np, outer=True))
# "a chair, none of the black ones and none outside the office"
_rule("post", "(COMMA | AND | BUT)+ NOTHING relation", cost=0.1)(
    lambda relation: tuple(replace(_negated(part), outer=True) for part in relation)
)


@_rule("post", "(AND | COMMA | BUT)+ (THAT | IS)* NOT (relation | adjective)")
@_rule("post", "COMMA? BUT? NOTHING _is (relation | adjective)", "(COMMA | STOP) ONLY NOT relation", cost=0.1)
def _but_none(relation: Parts = (), adjective: Parts = ()) -> Parts:
    """Read "a chair that is not red", "... but none that stands at a table", "... Only not at the long table"."""
    return tuple(_negated(part) for part in (*relation, *adjective))


# "every chair, but only the red ones"
_rule("post", "COMMA? (AND | BUT)? ONLY DET* (relation | adjective+ ONES? | (ONES | ONE) post+)", cost=-0.1)(
    lambda relation=(), adjective=(), post=(): (*relation, *adjective, *post)
)
_rule("post", "_is? NEITHER (a:adjective | a:relation) NOR (b:adjective | b:relation)")(
    lambda a, b: tuple(_negated(part) for part in (*a, *b))
)


@_rule("post", "(COMMA | BUT)* (GIVE | KEEP) targets ALONE", cost=-0.2)
@_rule("post", "COMMA? WITHOUT &(DET ONE) targets", cost=-0.1)
@_rule("post", "STOP EXCEPT TO? &(DET _described? ONE) targets", cost=0.2)
@_rule(
    "post",
    "COMMA? said:EXCEPT TO? targets (COMMA? (AND | OR) &(ON | IN | AT | UNDER | NEAR | BY | BEHIND) relation)* "
    "!(ORD | LASTLY)",
    cost=-0.05,
)
def _except(targets: tuple[Phrase, ...], said: str = "", relation: Parts = ()) -> Parts:
    """Read "except the red ones", "not counting those on desks", "apart from the kitchen", "without the one here"."""
    corrected = LAST in targets[-1].text  # "not the big one, the other one"
    rooms = any(phrase.is_room for phrase in targets)
    no_reading_if(
        corrected or any(phrase.text == ONE for phrase in targets) or (rooms and said in ("", "but", *_NEGATIONS))
    )
    text = "{}"
    for phrase in targets:  # "not one at the counter": none of them
        left_out = (
            f"inside({{}}, {phrase.text})" if phrase.is_room else (phrase.any and phrase.whole) or phrase.argument
        )
        text = f"minus({text}, {left_out})"
    for part in relation:
        text = f"minus({text}, {_negated(part).text.removeprefix('minus({}, ').removesuffix(')')})"
    (part,) = _filter(text, *targets, outer=True)
    if said == "but" and len(targets) == 1 and targets[0].base == ONE and not targets[0].many:
        part = replace(part, kind="but", definite=f"common({{}}, {targets[0].text})")
    return (part,)


# "the closest chair, and grey ones don't count"
_rule("post", "(COMMA | AND | BUT | STOP)+ targets NOTCOUNTED")(lambda targets: _except(targets, "except"))
# "how many cups are there, only the kitchen?"
_rule("post", "COMMA ONLY room", cost=-0.3)(_inside)


_NEGATIONS: Final = ("not", "but not", "and not", "only not")


@_rule("post", "COMMA? said:EXCEPT DET* room ONE !ORD", cost=-0.1)
def _except_of_room(room: Phrase, said: str = "but") -> Parts:
    """Read "but not the bedroom one"; of one thing "but the bedroom one" says which."""
    (there,) = _inside(room)
    if said != "but":
        return (replace(there, text=f"minus({{}}, {there.text})", outer=True),)
    return (replace(there, kind="but", text=f"minus({{}}, {there.text})", definite=there.text, outer=True),)


@_rule("numbered", "n:ONE", cost=0.5)  # "somewhere to sit: one of the chairs"
@_rule("numbered", "n:NUM", "NUMBER n:amount")
def _numbered(n: float) -> Parts:
    """Read "chair 18": a name, no rank."""
    if n != int(n) or not 1 <= n <= MAX_NUMBER:
        raise CommandError(f"the number of a thing is a whole number from 1, found {n:g}")
    return _filter(f"called({{}}, {int(n)})")


# ---- nouns and whole phrases


_rule("noun", "name:NOUN", "name:NOUNS")(lambda name: name)


@_rule("noun", "word:WORD+", cost=1.0)
def _unknown(word: Sequence[str]) -> Noun:
    said = _named(word)
    if word[-1] in AROUND_QUESTIONS["light"]:  # "how many cups have you registered?"
        raise CommandError(f'"{word[-1]}"')
    return Noun(singular(said), singular(said), False, count=0)


# "the squeaky chair": whatever that means, it is no choice where one is left
_rule("pre", "word:WORD", cost=1.0)(lambda word: (Part("vague", _named([word])),))


def _named(word: Sequence[str]) -> str:
    said = " ".join(word)
    if not NO_NAMES.isdisjoint(word):
        raise CommandError(f'"{said}"')
    return said


_rule("noun", "ANYTHING", cost=0.1)(lambda: Noun("thing", "anything"))


@_rule("thing", "_dets pre* noun said:numbered? post*", "every:EVERY (OF | DET)* pre* noun post*")
@_rule("thing", "_dets pre* noun (said:adjective | said:size) post*", cost=0.5)
@_rule("thing", "_dets pre* room noun (&(COMMA? EXCEPT | WITH) post)*", cost=0.7)
@_rule("thing", "_dets pre* noun room", cost=0.4)
def _one(
    noun: Noun, pre: Parts = (), said: Parts = (), post: Parts = (), every: str = "", room: Phrase | None = None
) -> Phrase:
    """Read "the red chair at the table", "chair 18", "the table big", "windows living room", "the café counter"."""
    said = _inside(room) if room else said
    return select(noun, (*pre, *said, *post), every=bool(every))


@_rule("thing", "BOTH (OF | DET)* pre* noun post*")
def _both(noun: Noun, pre: Parts = (), post: Parts = ()) -> Phrase:
    no_reading_if(noun.known and not noun.is_plural)  # "both the sofa and the lamp"
    return select(noun, (Part("count", number=2), *pre, *post), every=True)


_CLOSEST_BESIDE: Final = re.compile(r"^nearest\((near\(.*, (?:the\(things\()?(.+?)(?:\)\))?\)), 1, \2\)$")


@_rule("thing", "_dets outer:pre+ ONE? (OF | (OF (DET | EVERY)+)) pre* noun post*", cost=0.1)
def _part_of(noun: Noun, outer: Parts, pre: Parts = (), post: Parts = ()) -> Phrase:
    """Read "the second of the chairs in view", "two of the red chairs", "the left one of the two"."""
    no_reading_if(not noun.is_plural)
    inner = tuple(part for part in pre if part.kind != "count")
    parts = (*outer, *inner, *post)
    several = any(part.kind == "count" and part.number > 1 for part in parts)
    phrase = select(replace(noun, is_plural=several), parts, some=not several)
    # "on one of the tables", "... by the bed": on any of them
    any_ = not several and all(part.kind == "count" for part in outer)
    return replace(phrase, any=any_, text=_CLOSEST_BESIDE.sub(r"\1", phrase.text) if any_ else phrase.text)


@_rule("thing", "THAT ONE? &(WITH | WHERE | THAT | ON | IN | NEAR | BY | UNDER) post+", cost=0.5)
@_rule("thing", "_dets pre* ONE (OF IT)? post*", "_dets pre* ones:ONES post*", cost=0.3)
def _same_name(pre: Parts = (), post: Parts = (), ones: str = "") -> Phrase:
    no_reading_if(any(part.kind == "other" and part.number for part in post))  # "not the big one, the other one"
    return replace(select(None, (*pre, *post), every=bool(ones)), among=True)


@_rule("thing", "_dets outer:pre+ ONE? OF (IT | DET _number | DET+ pre+ ONES) !(NOUN | NOUNS | COLOR | SIZE)", cost=0.1)
def _chosen_of_them(outer: Parts, pre: Parts = ()) -> Phrase:
    """Read "the larger of the two", "the nearest of the red ones"."""
    no_reading_if(not any(part.kind == "order" for part in outer))
    return _same_name((*outer, *pre))


# "a chair, not one at the counter"
_rule("np", "ONE &(ON | IN | AT | BY | NEAR | UNDER | WITH) post+", cost=0.2)(
    lambda post: replace(select(None, post), among=True, any=True, penalty=0.0)
)
# "both bins, the kitchen one last"
_rule("thing", "_dets room ONE post*", cost=0.2)(lambda room, post=(): select(None, (*_inside(room), *post)))


@_rule("thing", "_dets ONE _at DET* (side SIDE? | MIDDLE)", cost=-0.1)
def _of_them_on(side: str = "middle") -> Phrase:
    """Read "the one on the left" after "there are two chairs at the desk": the leftmost of these."""
    found = select(None, [Part("order", side)])
    return replace(found, text=found.text.replace(ONE, SAME), base=SAME, whole="")


@_rule("thing", "(DET+ | &ORD | &_room_too) pre+ !OF post*", cost=0.9)
def _elided(pre: Parts, post: Parts = ()) -> Phrase:
    no_reading_if(any(part.kind == "vague" for part in pre))
    # "in the south"
    no_reading_if(not post and all(part.kind == "order" and part.text in _SIDES[2:6] for part in pre))
    return select(None, (*pre, *post))


# "the westernmost, then the easternmost"
_rule("thing", "DET+ side:MOST !OF", cost=0.9)(lambda side: select(None, [Part("order", side)]))


@_rule("thing", "_dets pre* of:NOUN POSS? (noun:NOUN | noun:NOUNS) post*", cost=0.6)
def _compound(of: Noun, noun: Noun, pre: Parts = (), post: Parts = ()) -> Phrase:
    """Read "the desk chair", "the desk's chair": the chair nearest the desk; "the bar counter" is one thing."""
    if of.label == noun.label:
        return select(noun, (*pre, *post))
    note = f'"{of.spoken} {noun.spoken}" is read as the {noun.spoken} nearest the {of.spoken}'
    place = select(of, ())
    ordered = any(part.kind == "order" for part in post)  # "the book table closer to the counter"
    beside = Part("near" if ordered else "order", place.argument if ordered else "near", phrase=place, note=note)
    return select(noun, (*pre, beside if ordered else replace(beside, of=place.measure), *post))


@_rule("thing", "_dets pre* noun (_is? ONLY | WITH ROOM)? FOR (n:whole | np) post*", cost=-0.2)
def _for_so_many(noun: Noun, n: int = 0, np: Phrase | None = None, pre: Parts = (), post: Parts = ()) -> Phrase:
    """Read "a table for six", "... for six people": one with as many seats."""
    people = re.fullmatch(r'nearest\(\w+\("(?:person|people)"\), (\d+)\)', np.text) if np else None
    number = int(people[1]) if people else n
    no_reading_if(not number or noun.spoken.split()[-1] not in ("table", "desk"))
    seats = Phrase('things("seat")', 'things("seat")', "seat", True)
    return select(noun, (*pre, *_having_some(number, seats), *post))


# "the sofa and its table"
_rule("thing", "ITS pre* noun post*")(lambda noun, pre=(), post=(): select(noun, (*pre, Part("near", IT), *post)))


@_rule("thing", "THAT noun", cost=0.1)
def _that(noun: Noun) -> Phrase:
    """Read "that desk", which was named before."""
    found = select(replace(noun, is_plural=False), ())
    return replace(found, text=f"‹that {found.word}|{found.base}›", whole="")


# "that huge teddy"; not "which couch is larger"
_rule("thing", "that:THAT pre+ noun post*", "that:THAT noun post+", cost=0.2)(
    lambda that, noun, pre=(), post=(): no_reading() if that != "that" else _one(noun, pre, post=post)
)


@_rule(
    "thing", "(EVERY | BOTH OF?)? it:IT !WHERE", "BOTH | EVERY !(IN | OF)", "(EVERY | BOTH) OF? DET* whole", cost=0.02
)
def _it(it: str = "", whole: int = 0) -> Phrase:
    """Read "it", "all of them", "stop at both"."""
    return Phrase(IT, ONE, "it" if it in ("it", "there") else "thing")


# "there are two bags. Take whichever is nearer"
_rule("thing", "key:WHICHEVER (TO? HERE)?", cost=0.1)(
    lambda key: replace(select(None, [Part("order", key)]), among=True)
)


@_rule("thing", "WHATEVER np IS+ (ON | IN | AT)", cost=-0.2)
def _what_it_is_on(np: Phrase) -> Phrase:
    """Read "whatever the laptop is standing on"."""
    below = _filter(f"under({{}}, {np.measure})", np)  # the smallest, as a table stands on a rug
    return select(Noun("thing", "anything"), (*below, Part("order", "small")))


@_rule("np", "thing")
def _np(thing: Phrase) -> Phrase:
    return replace(thing, penalty=0.0)


_rule("np", "room", cost=0.05)(lambda room: room)


@_rule("np", "(INDEF | ONE) pre+ noun post*", cost=-0.1)
def _any_such(noun: Noun, pre: Parts, post: Parts = ()) -> Phrase:
    """Read "a small table": any of the smaller ones, not the smallest."""
    parts = [
        Part("filter", f'sized({{}}, "{part.text}")') if part.kind == "order" and part.number == 1 else part
        for part in (*pre, *post)
    ]
    return replace(select(noun, parts), any=True, penalty=0.0)


_rule("np", "(INDEF | ONE) thing", cost=-0.05)(lambda thing: replace(thing, any=True, penalty=0.0))


@_rule("np", "EITHER? thing (COMMA more:thing)* COMMA? OR TO? AT? last:thing", cost=0.1)
def _either(thing: Phrase, last: Phrase, more: Sequence[Phrase] = ()) -> Phrase:
    found = united(sharing((thing, *more, last)))
    # "not at any table or desk"; "the bag, the one on the floor, not the one on the bench or the desk"
    unlike = 0.3 * any(one.base == ONE for one in more)
    return replace(found, penalty=0.15 if "minus(" in thing.text else unlike)


@_rule("np", "EITHER? a:thing (AND | OR) TO? b:thing COMMA? key:WHICHEVER (TO? HERE)?", cost=-0.2)
@_rule("np", "key:WHICHEVER COMMA? OF? a:thing (AND | OR) TO? b:thing", cost=-0.2)
def _whichever(a: Phrase, b: Phrase, key: str) -> Phrase:
    """Read "the laptop or the keyboard, whichever is closer"."""
    both = united((a, b))
    return replace(both, text=f'first(order({both.text}, "{key}"))', many=False)


_rule("np", "EITHER OF? thing")(lambda thing: replace(thing, any=True, many=False))


@_rule("pair", "a:thing AND b:thing")
def _pair(a: Phrase, b: Phrase) -> tuple[Phrase, Phrase]:
    a, b = lent((a, b))
    return replace(a, many=False), replace(b, many=False)


@_rule("pair", "IT", cost=-0.1)
def _them() -> tuple[Phrase, Phrase]:
    both = Phrase(IT, ONE, "thing")
    return both, both


@_rule("pair", "n:thing !(AND DET)")
def _two(n: Phrase) -> tuple[Phrase, Phrase]:
    if not n.many:
        raise CommandError(f"between takes two things, and only the {n.word} was named")
    number = re.search(r", (\d+)\)$", n.text)
    if number and int(number[1]) != 2:
        raise CommandError(f"between takes two things, not {number[1]}")
    plainly = re.fullmatch(r"nearest\((things\(\"[^\"]*\"\)), 2\)", n.text)
    if plainly or ALL.fullmatch(n.text):
        whole = replace(n, text=plainly[1] if plainly else n.text, many=False)
        return whole, whole
    return replace(n, text=f"nth({n.text}, 1)", many=False), replace(n, text=f"nth({n.text}, 2)", many=False)


_rule("targets", "np")(lambda np: (np,))
_rule("joint", "COMMA")(lambda: False)
_rule("joint", "COMMA? AND (COMMA | AND)*")(lambda: True)


@_rule("targets", "BOTH? one:np (joint TO? FOR? AT? np)+")
def _several(one: Phrase, np: tuple[Phrase, ...], joint: tuple[bool, ...]) -> tuple[Phrase, ...]:
    phrases = lent((one, *np))
    # "the chairs at the table, the left one" may be one thing
    no_reading_if(joint == (False,) and phrases[1].text.startswith(("nth(", "first(", "nearest(", "farthest(")))
    room = IN_ROOM.fullmatch(phrases[-1].text)
    if room and all(phrase.many and ALL.fullmatch(phrase.text) for phrase in phrases[:-1]):
        # "each chair and each table in the living room": all of them are in it
        phrases = tuple(replace(p, text=f"inside({p.text}, {room[1]})", whole="") for p in phrases[:-1]) + phrases[-1:]
    return phrases


def lent(phrases: Sequence[Phrase]) -> tuple[Phrase, ...]:
    """Lend the noun of a phrase to those before it that have none: "the first and the third chair"."""
    found = list(phrases)
    for at in range(len(found) - 2, -1, -1):
        a, b = found[at], found[at + 1]
        if a.base == ONE != b.base and a.text != IT:
            found[at] = replace(a, text=a.text.replace(ONE, b.base), base=b.base, word=b.word)
    return tuple(found)


# ---- rooms


@_rule("room", "_dets name:ROOMKIND (MAP | AREA | ROOM)?", "_dets name:ROOMKIND (n:NUM | NUMBER n:amount)")
@_rule("room", "name:ROOMKIND n:ONE", cost=0.5)  # but not "the bedroom one"
def _named_room(name: str, n: float | None = None) -> Phrase:
    """Read "the kitchen", "office 2"."""
    no_reading_if(n is not None and n != int(n))
    called = quoted(name if n is None else f"{name} {int(n)}")
    return Phrase(f"room({called})", f"rooms({called})", name, whole=f"rooms({called})")


@_rule("room", "_dets (noun:NOUN | name:MAP) ROOM")
def _room_for(noun: Noun | None = None, name: str = "") -> Phrase:
    """Read "the printer room": that where the printer is, and "the shop room" by its name."""
    return _room_of(select(noun, ())) if noun and noun.known else _named_room(f"{noun.spoken if noun else name} room")


_rule("room", "ROOM NUMBER? n:whole")(lambda n: Phrase(f'room("room {n}")', "rooms()", "room"))
# "that room": what was named last, or where that is
_rule("room", "that:THAT ROOM", cost=-0.1)(
    lambda that: no_reading() if that != "that" else Phrase(f"room({IT})", "rooms()", "room")
)
_rule("room", "_dets ROOM", "_dets SAME ROOM")(lambda: Phrase("room()", "rooms()", "room", whole="rooms()"))


@_rule("room", "_dets OTHER (ROOM | name:ROOMKIND)", "_dets ROOM NEXTDOOR", cost=-0.3)
def _other_room(name: str = "") -> Phrase:
    if name:
        return Phrase(f"first(minus(rooms({quoted(name)}), room()))", f"rooms({quoted(name)})", name)
    return Phrase('room("other")', "rooms()", "room")


@_rule("room", "_dets ROOM (THAT | IS | WHERE)* IN? np IS? IN?", cost=0.2)
def _room_of(np: Phrase) -> Phrase:
    """Read "the room the printer is in"."""
    whole = f"having(rooms(), {np.argument})"
    return Phrase(f"room({np.argument})", "rooms()", "room", False, np.notes, np.others, whole=whole)


_rule("numerous", "MOSTLY")(lambda: "many")
_rule("numerous", "FEWEST")(lambda: "few")
_rule("numerous", "counted:COUNTED")(lambda counted: "many" if counted == "more" else "few")
_rule("room_name", "ROOM")(lambda: Noun("room", "", base="rooms()"))
_rule("room_name", "ROOMS")(lambda: Noun("room", "", base="rooms()", is_plural=True))
_rule("room_name", "name:ROOMKIND", cost=0.3)(lambda name: Noun(name, "", base=f"rooms({quoted(name)})"))
GRAMMAR.words(
    "_told_by",
    "THAT | IS | WITH | WITHOUT | NEAR | NEAREST | FARTHEST | BY | AT | WHERE | EXIST | BUTNO | (IN | OF) DET* MAP",
)


@_rule("room", "_dets pre+ name:room_name (&_told_by post)*", "_dets name:room_name (&_told_by post)+", cost=-0.1)
def _room_told(name: Noun, pre: Parts = (), post: Parts = ()) -> Phrase:
    """Read "the second largest room", "the bedroom with the desk", "the room next to the kitchen"."""
    parts = (*pre, *post)
    if name.base == "rooms()" and any(part.kind == "order" and part.text in ("near", "far") for part in parts):
        name = replace(name, base='rooms("other")')  # the nearest one is not the one that the robot is in
    return select(name, parts)


@_rule("room", "ONE OF DET* _number? name:ROOMKIND | _dets FULL name:ROOMKIND", cost=-0.3)
@_rule("room", "every:EVERY (OF | DET)* name:ROOMKIND | every:BOTH (OF | DET)* name:ROOMKIND", cost=0.1)
def _rooms_called(name: str, every: str = "") -> Phrase:
    """Read "one of the offices", "the whole office", "every office"."""
    return Phrase(f"rooms({quoted(name)})", f"rooms({quoted(name)})", name, bool(every))


# "in the other two rooms": that many others are there
_rule("room", "_dets OTHER whole ROOMS", cost=-0.3)(
    lambda whole: Phrase(f'nearest(rooms("other"), {whole})', "rooms()", "room", True)
)


@_rule(
    "room", "(EVERY (OF | DET)* OTHER? (ROOMS | ROOM) | DET? ROOMS) ((IN | OF) DET* MAP)? | EVERY (IN | OF) DET* MAP"
)
@_rule(
    "room", "(EVERY (OF | DET)* (ROOMS | ROOM) | DET? ROOMS) COMMA? EXCEPT room (COMMA? (AND | OR) room)*", cost=-0.2
)
def _all_rooms(room: Sequence[Phrase] | Phrase = ()) -> Phrase:
    text = "rooms()"
    for one in (room,) if isinstance(room, Phrase) else room:
        text = f"minus({text}, {one.text})"
    return Phrase(text, "rooms()", "room", True)
