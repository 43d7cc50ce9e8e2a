"""Words to tokens: at each place of a sentence, every way to read the words there."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

from simaps_viz.errors import CommandError
from simaps_viz.language.asides import plainly
from simaps_viz.language.grammar import Edge
from simaps_viz.language.lexicon import (
    ACTIVITIES,
    COMPASS_POINTS,
    MAX_PHRASE,
    NEEDS,
    NUMBERS,
    ORDINALS,
    PHRASES,
    WISHES,
)
from simaps_viz.language.program import MAX_NUMBER
from simaps_viz.language.words import Vocabulary, correct, read_number, read_rank

_PIECE: Final = re.compile(
    r"(?P<ordinal>\d+)(?:st|nd|rd|th)\b"
    r"|(?P<comma>\d+,\d+)(?=\s*(?:m|cm|met(?:er|re)s?|centimet(?:er|re)s?|feet|ft)\b)"
    r"|(?P<number>(?<![\w.])-?\d+(?:\.\d+)?|\d+(?:\.\d+)?|(?<![\w.])\.\d+)|(?P<poss>['’]s\b)"
    r"|(?P<word>[^\W\d_]+)|(?P<mark>[,.;:!?#°&])|(?P<other>[^\s\-_()\"'’\[\]]+)"
)
_STOPS: Final = (",", ".", ";", ":", "!", "?")
_MOST: Final = re.compile(r"(left|right|north|south|east|west)(?:ern|er)?most")
_SIDE: Final = re.compile(r"(left|right|north|south|east|west)(?:ern|erly|ward)?$")
_ON_PAPER: Final = re.compile(r"\b(top|upper|bottom|lower)[\s-]+(left|right)\b")
"""A corner of the map as it is drawn, north up."""
_PAPER: Final = {"top": "north", "upper": "north", "bottom": "south", "lower": "south", "left": "west", "right": "east"}
_POINT: Final = re.compile(r"(north|south)(east|west)(?:ern|erly|wards?|bound)?$")
_POINTS: Final = {tuple(name.split()): degrees for name, degrees in COMPASS_POINTS.items() if " " in name}
_KEYWORDS: Final = tuple(
    sorted(w[0] for w, found in PHRASES.items() if len(w) == 1 and len(w[0]) >= 4 and any(k for k, _ in found))
) + tuple(word for word in (*ORDINALS, *NUMBERS) if len(word) >= 4)
_BEFORE_ORDERS: Final = (*_STOPS, "then")
_MOTION: Final = re.compile(
    r"(?:(?:yourself|yourselves|your \w+) )?(?:(?:right |straight )?"
    r"(?:over|across|along|down|up|round|around|back|out|off|on|in|through) )*"
    r"(?:to|onto|into|towards?|between|in between|up against)\b"
)
"""What mostly a verb of motion is followed by: "squeeze in between", "skedaddle over to", "plant yourself next to"."""
_PUT: Final = re.compile(r"sat|stood|laid|set|hung|put|left|kept")
_PLACED: Final = re.compile(rf"\w{{2,}}(?:ed|ing)|{_PUT.pattern}")
_PLACE: Final = re.compile(
    r"((?:(?:up|down|out|right|just|away|all|around|about|in|off) )*)(?:on|in|at|by|near|next to|close to|beside|under|"
    r"underneath|beneath|behind|"
    r"between|against|inside|above|below|over|opposite|alongside|atop|around|in front of)\b"
)
"""What follows a word that only says how a thing is there: "propped up against", "dangling over"."""
_ADVERB: Final = re.compile(
    r"(?!(?:fami|assemb|jel|but?ter|bel|pars|ho|li|bul|daff?odi|rely|ap|sup|mono|anoma|part|near|hard|bare|scarce|alternate|"
    r"repeated|continual|endless|dai|hour|week|month|year|diagonal|simultaneous|separate|backward|exclusive|sole)ly)\w{3,}ly"
)
"""How something is done or said, "gracefully", but not how much, how often or which way."""
_COST_OF_WORD: Final = 0.3
"""Of a token, for each word by which another one that begins there is longer."""
_COST_OF_HOMONYM: Final = 0.05
_COST_OF_ROOM: Final = 0.2


@dataclass(frozen=True)
class Sentence:
    """What was said: its words without the polite ones, and the tokens that begin at each."""

    words: tuple[str, ...]
    edges: tuple[tuple[Edge, ...], ...]
    """One more than words."""
    notes: tuple[str, ...]

    @property
    def unknown(self) -> tuple[str, ...]:
        """Words that are not known at all."""
        within = {at for here, edges in enumerate(self.edges) for edge in edges for at in range(here + 1, edge.end)}
        words = enumerate(zip(self.words, self.edges, strict=False))
        found = [w for at, (w, edges) in words if at not in within and all(e.kind == "WORD" for e in edges)]
        return tuple(dict.fromkeys(found))


def read_words(text: str, vocabulary: Vocabulary, *, correcting: bool = False) -> Sentence:
    """Return the tokens of a command.

    Args:
        text: what was said.
        vocabulary: of the map.
        correcting: replace misspelled words by known ones, with a note on each.

    Raises:
        CommandError: a number larger than a program may hold.
    """
    said = _ON_PAPER.sub(lambda found: f"{_PAPER[found[1]]} {_PAPER[found[2]]}", plainly(text))
    pieces = [(str(m.lastgroup), m[m.lastgroup or 0]) for m in _PIECE.finditer(said)]
    notes: list[str] = []
    if correcting:
        pieces = _corrected(pieces, vocabulary, notes)
    pieces = list(_without_fillers(pieces, vocabulary, notes))
    pieces = [
        one for one, after in zip_longest(pieces, pieces[1:]) if one[1] != "," or not after or after[1] not in _STOPS
    ]
    words = tuple(piece for _, piece in pieces)
    edges = [tuple(_edges(pieces[at][0], words, at, vocabulary)) for at in range(len(words))]
    return Sentence(words, (*edges, ()), tuple(notes))


def _without_fillers(
    pieces: Sequence[tuple[str, str]], vocabulary: Vocabulary, notes: list[str]
) -> Iterator[tuple[str, str]]:
    """Leave out polite phrases, and how to drive, unless the words are part of something longer."""
    words = [piece for _, piece in pieces]
    at = 0
    while at < len(pieces):
        phrases = list(_phrases(words[at : at + MAX_PHRASE]))
        length = max([vocabulary.match(words[at : at + 6]), _activity(words, at, vocabulary)[1], 1])
        longest, found = phrases[-1] if phrases else (0, [])
        kinds = {kind for kind, _ in found}
        if at and words[at - 1] in ("the", "a", "that") and words[at + longest - 1] == "one":  # "the little one"
            kinds.add("ONE")
        adverb = (
            not longest
            and length == 1
            and _ADVERB.fullmatch(words[at]) is not None
            and not vocabulary.match(words[at : at + 1])
        )
        longest = 1 if adverb else longest
        if longest >= length and kinds <= {"", "MANNER"}:
            if "MANNER" in kinds:
                said = " ".join(words[at : at + longest])
                notes.append(f'"{said}" is left out: the robot has one way to drive')
            at += longest
            continue
        for _ in range(max(length, longest)):
            yield pieces[at]
            at += 1


def _phrases(words: Sequence[str]) -> Iterator[tuple[int, list[tuple[str, str]]]]:
    """Return the phrases of the grammar at the start of some words, the shortest first, with their lengths."""
    for length in range(1, min(MAX_PHRASE, len(words)) + 1):
        found = PHRASES.get(tuple(words[:length]))
        if found is not None:
            yield length, found


def _edges(kind: str, words: Sequence[str], at: int, vocabulary: Vocabulary) -> Iterator[Edge]:
    found = list(_readings(kind, words, at, vocabulary))
    longest = max((length for length, _, _ in found), default=0)
    for length, name, value in found:
        homonym = _COST_OF_HOMONYM * (length == longest and name in ("NOUN", "NOUNS") and len(found) > 1)
        # A toilet is a thing where the map has one, and otherwise the room of that name.
        room = _COST_OF_ROOM * (name == "ROOMKIND" and any(other in ("NOUN", "NOUNS") for _, other, _ in found))
        yield Edge(name, value, at + length, _COST_OF_WORD * (longest - length) + homonym + room)
    after = " ".join(words[at + 1 : at + 6])
    placed = _PLACE.match(after) if at and (_PUT if found else _PLACED).fullmatch(words[at]) else None
    for particles in {0, placed[1].count(" ")} if placed else ():
        yield Edge("IS", words[at], at + 1 + particles, _COST_OF_HOMONYM)
    if not found:
        yield Edge("WORD", words[at], at + 1)
        if (at == 0 or words[at - 1] in _BEFORE_ORDERS) and _MOTION.match(after):
            yield Edge("GO", "go", at + 1, _COST_OF_HOMONYM)


def _readings(kind: str, words: Sequence[str], at: int, vocabulary: Vocabulary) -> Iterator[tuple[int, str, object]]:
    """Return each token that begins at a place: its length in words, its kind and its value."""
    rest = words[at : at + MAX_PHRASE]
    digits = float(words[at].replace(",", ".")) if kind in ("number", "comma") else None
    if digits is not None and digits > MAX_NUMBER:
        raise CommandError(f"numbers go up to {MAX_NUMBER:.0f}, found {words[at][:30]}")
    rank, length = read_rank(rest, int(words[at]) if kind == "ordinal" else None)
    if length:
        yield length, "ORD", rank
    number, length = read_number(rest, digits)
    if length:
        yield length, "ONE" if list(rest[:length]) == ["one"] else "NUM", number
    yield from _sides(rest)
    wanted, length = _activity(words, at, vocabulary)
    if wanted:
        yield length, "NOUN", vocabulary.noun(wanted)
        yield length, "PLACE", vocabulary.noun(wanted)
    length = vocabulary.match(rest[:6])
    if length:
        noun = vocabulary.noun(" ".join(rest[:length]))
        yield length, "NOUNS" if noun.is_plural else "NOUN", noun
    for length, tokens in _phrases(rest):
        yield from ((length, name, value or " ".join(rest[:length])) for name, value in tokens if name)


def _activity(words: Sequence[str], at: int, vocabulary: Vocabulary) -> tuple[str, int]:
    """Read "somewhere to sit", "i want to lie down", "i m thirsty", and an activity that is all that was said."""
    rest = words[at : at + 12]
    for end in range(min(len(rest), 6), 2, -1):
        if tuple(rest[:end]) in NEEDS:  # "something to eat" is no place
            return NEEDS[tuple(rest[:end])], end
    generic, length = vocabulary.activity(rest)
    if generic:
        return generic, length
    for wish in (*WISHES, ()):
        if tuple(rest[: len(wish)]) != wish:
            continue
        for end in range(min(len(rest), len(wish) + 5), len(wish), -1):
            asked = tuple(rest[len(wish) : end])
            found = NEEDS.get(asked) or (ACTIVITIES.get(asked) if wish else None)
            if found:
                return found, end + (tuple(rest[end : end + 1]) == ("something",))
    alone = next((i for i, word in enumerate(words) if not word.isalpha() or word in ("and", "then")), len(words))
    asked = ACTIVITIES.get(tuple(words[:alone]), "") if at == 0 else ""
    return (asked, alone) if asked else ("", 0)


def _sides(words: Sequence[str]) -> Iterator[tuple[int, str, object]]:
    """Read "leftmost", "left most", "most northerly", and compass words between the main four: "north east"."""
    most = _MOST.fullmatch(words[0])
    if most:
        yield 1, "MOST", most[1]
    for side, other in ((0, 1), (1, 0)):
        found = _SIDE.fullmatch(words[side]) if len(words) > 1 and words[other] == "most" else None
        if found:
            yield 2, "MOST", found[1]
    split = []
    for at, word in enumerate(words[:3]):
        point, one = _POINT.fullmatch(word), _SIDE.fullmatch(word)
        names = [point[1], point[2]] if point else [one[1]] if one else []
        if not names:
            break
        split += [(name, at + 1) for name in names]
    for length in (3, 2):
        degrees = _POINTS.get(tuple(name for name, _ in split[:length]))
        if degrees is not None and len(split) >= length:
            yield split[length - 1][1], "INTER", degrees
            return


def _corrected(pieces: Sequence[tuple[str, str]], vocabulary: Vocabulary, notes: list[str]) -> list[tuple[str, str]]:
    """Replace unknown words by the known ones they are misspellings of."""
    found: list[tuple[str, str]] = []
    words = [piece for _, piece in pieces]
    at = 0
    while at < len(pieces):
        known = [(length, kind) for length, kind, _ in _readings(pieces[at][0], words, at, vocabulary)]
        known += [(length, "") for length, _ in _phrases(words[at : at + MAX_PHRASE])]
        longest = max((length for length, _ in known), default=0)
        name, taken = "", 0
        # Unknown words are compared with the names of things first, then with the words of the grammar.
        if pieces[at][0] == "word" and all(kind in ("NOUN", "NOUNS") for _, kind in known):
            name, taken = vocabulary.correct(words[at : at + 3])
            if known and taken <= longest:
                name, taken = "", 0
            keyword = correct(words[at], _KEYWORDS) if not known and taken < 2 else None
            name, taken = (keyword, 1) if keyword and not name else (name, taken)
        if name:
            notes.append(f'"{" ".join(words[at : at + taken])}" is read as {name}')
            found += [("word", word) for word in name.split()]
        else:
            taken = max(longest, 1)
            found += pieces[at : at + taken]
        at += taken
    return found
