"""The words of commands: numbers, spelling, plurals, and which classes of a map a name may mean.

They are loaded once from the JSON files beside this module:

- ``phrases.json``: {token of the grammar, or token and value: what a person may say for it}; the phrases of token ""
  may be left out, and nothing else is.
- ``things.json``: other names of classes (``names``, ``narrower``), generic words that take several classes together
  (``kinds``, ``like``), classes to try in turn (``first_fit``), what one does somewhere (``activities``, ``places``,
  ``links``), what a wish speaks of (``lacks``, the first that fits), and further things people speak of (``others``).
- ``rewordings.txt``: what is said in other words, rewritten before tokens are read (``tokenizer.plainly``).
- ``words.json``: numbers, ordinals, amounts, compass points, irregular plurals, everyday words, words not of names.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import Any, Final

from simaps_viz.colors.classes import COCO_THINGS, plain
from simaps_viz.colors.naming import COLOR_WORDS

Words = tuple[str, ...]
"""A phrase, split at its spaces."""


def load_text(name: str) -> str:
    """Load one text file of this package."""
    return files("simaps_viz.language").joinpath(name).read_text(encoding="utf-8")


def load(name: str) -> Any:
    """Load one JSON file of this package."""
    return json.loads(load_text(name))


_SHORT: Final = re.compile(r"\b(i|you|we|they|he|she|it|that|there|who|what|where|this)[ '’](m|d|re|ve|ll)\b")
_LONG: Final = {"m": "am", "d": "would", "re": "are", "ve": "have", "ll": "will"}
_CHOICE: Final = re.compile(r"\(([^()]*)\)")


def written_out(said: str) -> str:
    """Return words with "i'm" or "i m" and "you're" or "you re" as "i am" and "you are"."""
    return _SHORT.sub(lambda found: f"{found[1]} {_LONG[found[2]]}", said)


def _spoken(phrase: str) -> Iterator[str]:
    """Return all that a phrase with choices stands for: "go (over|) there" is "go over there" and "go there"."""
    choice = _CHOICE.search(phrase)
    if choice is None:
        yield written_out(phrase)
        return
    for one in choice[1].split("|"):
        yield from _spoken(f"{phrase[: choice.start()]}{one}{phrase[choice.end() :]}")


def _split(phrases: Iterable[str]) -> tuple[Words, ...]:
    return tuple(dict.fromkeys(tuple(spoken.split()) for phrase in phrases for spoken in _spoken(phrase)))


def _synonyms(things: dict[str, Any]) -> dict[str, tuple[str, ...]]:
    """Return {name: the class it names first, then that class's other names}; narrower names have only the class."""
    classes: dict[str, list[str]] = {}
    names: dict[str, list[str]] = {}
    for name, same in things["names"].items():
        for word in (*same, *things["narrower"].get(name, ())):
            classes.setdefault(word, []).append(name)
        for word in (name, *same):
            names.setdefault(word, []).extend(other for other in same if other != word)
    for word, others in things["first_fit"].items():
        classes.setdefault(word, []).extend(others)
    words = dict.fromkeys([*names, *classes])
    return {word: tuple(dict.fromkeys([*classes.get(word, ()), *names.get(word, ())])) for word in words}


_THINGS: Final = load("things.json")
_WORDS: Final = load("words.json")


_VERBS: Final = ("APPROACH", "CIRCLE", "FACE", "GO", "LEAVE", "LIST", "LOOK", "PASS", "RETURN", "TAKE", "TURN")
"""Kinds of verbs that are also said as gerunds."""
_NO_GERUND: Final = (
    "be", "start", "begin", "finish", "end", "stop", "continue", "conclude", "i", "we", "let", "show", "see", "is",
    "are", "stand", "find",
)  # fmt: skip
"""Words that open phrases of these kinds and have no such form, or another meaning in it."""


def _gerund(verb: str) -> str:
    """Return the form in -ing of a verb: "drive" -> "driving", "swim" -> "swimming"."""
    if verb.endswith("e") and not verb.endswith(("ee", "ye")):
        verb = verb[:-1]
    elif re.fullmatch(r"[^aeiou]*[aeiou][bdgmnprt]", verb):
        verb += verb[-1]
    return verb if verb.endswith("ing") else f"{verb}ing"


def third_person(verb: str) -> str:
    """Return what a verb is called where one does it: "sit" -> "sits", "carry" -> "carries"."""
    if re.search(r"(?:ch|sh|s|x|z|o)$", verb):
        return f"{verb}es"
    return f"{verb[:-1]}ies" if re.search(r"[^aeiou]y$", verb) else f"{verb}s"


def _tokens(phrases: dict[str, list[str]]) -> dict[Words, list[tuple[str, str]]]:
    found: dict[Words, list[tuple[str, str]]] = {}
    for token, spoken in phrases.items():
        kind, _, value = token.partition(" ")
        for words in _split(spoken):
            found.setdefault(words, []).append((kind, value))
            if kind in _VERBS and words[0] not in _NO_GERUND:  # "would you mind going there"
                found.setdefault((_gerund(words[0]), *words[1:]), []).append((kind, value))
    for color in COLOR_WORDS - {"light", "bright"}:  # a light is a lamp
        for shade in ("{}", "{} colored", "{} coloured", "bright {}", "deep {}", "pale {}"):
            found.setdefault(tuple(shade.format(color).split()), []).append(("COLOR", color))
    # The names of rooms are those that a map may give them; "bedrooms" are asked for too.
    for kind, words in _ROOMS.items():
        names = (kind, *words["words"])
        for name in (*names, *(one.replace("room", " room") for one in names if " " not in one)):
            for spoken in (tuple(name.split()), tuple(f"{name}s".split())):
                found.setdefault(spoken, []).append(("ROOMKIND", kind))
    return found


_ROOMS: Final = json.loads(files("simaps_viz.mapping").joinpath("room_kinds.json").read_text(encoding="utf-8"))
PHRASES: Final = _tokens(load("phrases.json"))
"""{words: the tokens they may be, each a kind and a value}; of kind "" where they may be left out."""
MAX_PHRASE: Final = max(map(len, PHRASES))
"""The number of words in the longest phrase."""

SYNONYMS: Final = _synonyms(_THINGS)
"""{word: classes it may mean, the most fitting first}; a class of exactly that name always comes before all of them."""
KINDS: Final[dict[str, tuple[str, ...]]] = {kind: tuple(classes) for kind, classes in _THINGS["kinds"].items()}
"""{generic word: classes it takes together}."""
KINDS.update({word: KINDS[kind] for word, kind in _THINGS["like"].items()})
EVERYTHING: Final = ("object", "thing", "item", "piece")
"""Words for any class."""
KNOWN_THINGS: Final = frozenset(
    {*SYNONYMS, *KINDS, *COCO_THINGS, *EVERYTHING, *_THINGS["others"]}.union(*SYNONYMS.values(), *KINDS.values())
)
"""Names of things on any map: known words, refused by name where a map lacks them."""
ACTIVITIES: Final[dict[Words, str]] = {
    doing: kind
    for kind, phrases in _THINGS["activities"].items()
    for words in _split(phrases)
    for doing in (words, (_gerund(words[0]), *words[1:]))
}
"""{("sit", "down"): generic word}, as in "somewhere to sit down"."""
PLACES: Final = _split(_THINGS["places"])
"""Words that refer to the place of an activity, such as "somewhere"."""
_BEGIN_PLACES: Final = frozenset(words[0] for words in PLACES)
LINKS: Final = _split(_THINGS["links"])
"""Words that join a place and an activity, such as "where i can"."""
NEEDS: Final[dict[Words, str]] = {
    words: kind for kind, phrases in _THINGS["needs"].items() for words in _split(phrases)
}
"""{("i", "m", "thirsty"): generic word}: what a person lacks, and what helps."""
LACKS: Final = {kind: re.compile(pattern) for kind, pattern in _THINGS["lacks"].items()}
"""{generic word: what is spoken of by who needs it}, the first that fits."""
WISHES: Final = _split(_THINGS["wishes"])
"""Words before an activity that say that somebody wants it, such as "i want to"."""

NUMBERS: Final[dict[str, int]] = _WORDS["numbers"]
ORDINALS: Final[dict[str, int]] = _WORDS["ordinals"]
AMOUNTS: Final[dict[Words, float]] = {tuple(words.split()): n for words, n in _WORDS["amounts"].items()}
"""Amounts by words; "a few" is read as three."""
FRACTIONS: Final[dict[Words, float]] = {tuple(words.split()): n for words, n in _WORDS["fractions"].items()}
LAST: Final[dict[Words, int]] = {tuple(words.split()): rank for words, rank in _WORDS["last"].items()}
"""Ranks from the end; -1 is the last."""
FROM_THE_END: Final = frozenset(_split(_WORDS["from_the_end"]))
"""Words after an ordinal that counts from the end, as in "second to last"."""
COMPASS_POINTS: Final[dict[str, float]] = _WORDS["compass"]
"""Degrees clockwise from north."""
SINGULAR: Final[dict[str, str]] = _WORDS["singular"]
"""Irregular plurals, and words that only look like plurals."""
SPELLED: Final[dict[str, str]] = _WORDS["spelled"]
"""How words are written that are spelled as they are spoken or typed in haste."""
VERBS: Final = frozenset(_WORDS["verbs"])
"""What people and things do, as told around an order: "my uncle sits there", "it leaks"."""
AROUND_QUESTIONS: Final[dict[str, Any]] = _WORDS["around_questions"]
"""Words of which the rest of a question is made, see `questions`."""
NO_NAMES: Final = frozenset(_WORDS["no_names"])
"""Words that no thing is called."""
EVERYDAY: Final = frozenset(_WORDS["everyday"]).union(map(third_person, VERBS), *PHRASES)
"""Everyday words, and all that occur in phrases: never taken for a misspelling of another."""

ANY: Final = "any "
"""Before a name: all classes of that kind, where a class of exactly that name would be meant otherwise."""
_NO_KIND: Final = ("hot dog", "teddy bear")
"""Names whose last word is not their kind: a hot dog is not a dog."""
_MAX_NAME: Final = max(len(name.split()) for name in KNOWN_THINGS)
_STRANDED: Final = (("with",), ("on",), ("in",), ("at",), ("from",), ("into",))
"""What may end "something to heat a meal with"."""
_MIN_LETTERS: Final = 4
"""Shorter words are too close to one another to be corrected."""
_TWO_SLIPS_LETTERS: Final = 8


def read_rank(words: Sequence[str], digits: int | None = None) -> tuple[int, int]:
    """Read "third", "twenty first", "last", "second to last" at the start of some words.

    Args:
        words: the words, at least one.
        digits: the rank, where the first word is one in digits ("3rd").

    Returns:
        The rank (-1 the last, -2 the one before it), and how many words it took; (0, 0) when there is none.
    """
    for taken in (3, 2, 1):
        rank = LAST.get(tuple(words[:taken]))
        if rank is not None:
            return rank, min(taken, len(words))
    rank, taken = (digits, 1) if digits is not None else (ORDINALS.get(words[0], 0), 1)
    if digits is None and words[0] in NUMBERS and NUMBERS[words[0]] >= 20 and len(words) > 1:
        rank, taken = ORDINALS.get(words[1], 0), 2
        rank = NUMBERS[words[0]] + rank if 0 < rank < 10 else 0
    if not rank and digits is None:
        return 0, 0
    for length in (3, 2, 1):
        if tuple(words[taken : taken + length]) in FROM_THE_END:
            return -rank, min(taken + length, len(words))
    return rank, taken


def read_number(words: Sequence[str], digits: float | None = None) -> tuple[float, int]:
    """Read "two", "forty five", "a hundred", "one point five", "two and a half", "a couple of" at the start of words.

    Args:
        words: the words, at least one.
        digits: the number, where the first word is one in digits.

    Returns:
        The number, and how many words it took; (0, 0) when there is none.
    """
    for length in (3, 2):
        if tuple(words[:length]) in AMOUNTS:
            return AMOUNTS[tuple(words[:length])], min(length, len(words))
    total, taken = (digits, 1) if digits is not None else _whole(words)
    if taken == 0:
        return 0.0, 0
    if len(words) > taken + 1 and words[taken] == "point" and words[taken + 1] in NUMBERS:
        total, taken = total + NUMBERS[words[taken + 1]] / 10.0, taken + 2
    fraction = FRACTIONS.get(tuple(words[taken : taken + 3]))
    return (total + fraction, min(taken + 3, len(words))) if fraction else (float(total), taken)


def _whole(words: Sequence[str]) -> tuple[float, int]:
    total, taken = 0, 0
    for at, word in enumerate(words[:5]):
        if word == "hundred" and 0 <= total < 10:
            total = max(total, 1) * 100
        elif taken == 1 and 0 < total < 10 and 20 <= NUMBERS.get(word, 0) < 100:  # "two seventy"
            total = total * 100 + NUMBERS[word]
        elif word in NUMBERS and (taken == 0 or total % 100 == 0 or (total % 10 == 0 and NUMBERS[word] < 10)):
            total += NUMBERS[word]
        elif word != "and" or not total or total % 100 or at + 1 == len(words) or words[at + 1] not in NUMBERS:
            break
        taken += 1
    return float(total), taken


def slips(a: str, b: str, limit: int) -> int:
    """Return how many letters were left out, added, changed or swapped with the next; ``limit`` + 1 if more than limit.

    This is the optimal string alignment distance: Levenshtein's with swaps of neighbours. The ratio of difflib is no
    substitute: it is not symmetric, and does not count single letters.
    """
    if abs(len(a) - len(b)) > limit:
        return limit + 1
    before: list[int] = []
    last = list(range(len(b) + 1))
    for i, x in enumerate(a, start=1):
        row = [i]
        for j, y in enumerate(b, start=1):
            cost = min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                cost = min(cost, before[j - 2] + 1)
            row.append(cost)
        before, last = last, row
        if min(last) > limit:
            return limit + 1
    return last[-1]


def correct(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that a word is a misspelling of, or None when none is close or the word is an everyday one.

    One slip from 4 letters on (with the same first or last letter), two from 8 on; of equally close words, the first.
    """
    if len(word) < _MIN_LETTERS or word in EVERYDAY:
        return None
    limit = 2 if len(word) >= _TWO_SLIPS_LETTERS else 1
    best, fewest = None, limit + 1
    for candidate in known:
        if len(candidate) < _MIN_LETTERS or word[0] not in candidate[:2]:
            continue
        # Of four letters one is seldom changed: "live" is not "lime", but "lmap" and "lap" are a lamp.
        if len(word) == len(candidate) == _MIN_LETTERS and sorted(word) != sorted(candidate):
            continue
        found = slips(word, candidate, fewest - 1)
        if found < fewest:
            best, fewest = candidate, found
    return best


def singular(phrase: str) -> str:
    """Return a phrase with its last word in the singular: "dining tables" -> "dining table"."""
    *first, last = phrase.split() or [""]
    return " ".join([*first, _singular_word(last)])


def _singular_word(word: str) -> str:
    if word in SINGULAR:
        return SINGULAR[word]
    if len(word) > 4 and word.endswith("ies"):
        return word[:-3] + "y"
    if len(word) > 4 and word.endswith(("ches", "shes", "sses", "xes", "zes")):
        return word[:-2]
    if len(word) > 2 and word.endswith("s") and not word.endswith(("ss", "us")):
        return word[:-1]
    return word


def plural(phrase: str) -> str:
    """Return a phrase with its last word in the plural: "couch" -> "couches"."""
    *first, last = phrase.split() or [""]
    if first[:1] == ["place"]:
        return " ".join(["places", *first[1:], last])
    for many, one in SINGULAR.items():
        if one == last and many not in ("persons", "tv's") and not many.endswith(("one", "body")):
            return " ".join([*first, many])
    if last.endswith(("ch", "sh", "s", "x", "z")):
        last += "es"
    elif last.endswith("y") and last[-2:-1] not in "aeiou":
        last = last[:-1] + "ies"
    else:
        last += "s"
    return " ".join([*first, last])


@dataclass(frozen=True)
class Meaning:
    """A possible meaning of a word on one map."""

    labels: tuple[str, ...]
    """The classes it takes together, at least one."""
    others: tuple[str, ...] = ()
    """Other classes it may mean, the likeliest first."""


@dataclass(frozen=True)
class Noun:
    """A name of things as it was said, on one map."""

    spoken: str
    """In the singular."""
    label: str
    """The name a program gives them: a class of the map, a generic word, or what was said."""
    known: bool = True
    """Whether the map has such things."""
    is_plural: bool = False
    note: str = ""
    """How the word was read, where that is not plain."""
    others: tuple[str, ...] = ()
    """Names of other things that it may mean."""
    wide: str = ""
    """A name that takes more classes together, for when more than ``count`` are needed."""
    count: int | None = None
    """How many of the class the map has, if that is known."""
    base: str = ""
    """All of them as program text, where they are no things: rooms."""

    @property
    def penalty(self) -> float:
        """How unlikely it is that a name is meant which the map lacks, where the words can be read otherwise."""
        return 0.0 if self.known else 0.3


class Vocabulary:
    """The words that refer to the classes of one map.

    Args:
        labels: class names of the map, or {class name: number of instances}; their order breaks ties between
            equally fitting classes.
    """

    def __init__(self, labels: Iterable[str] | Mapping[str, int]) -> None:
        self.labels = tuple(labels)
        self._counts = labels if isinstance(labels, Mapping) else None

    def count(self, label: str) -> int | None:
        """Return how many instances of a class the map has; None when only the class names are known."""
        return None if self._counts is None else self._counts.get(label, 0)

    def resolve(self, phrase: str) -> Meaning | None:
        """Return the meaning of a word or phrase; None when no class of the map fits it.

        A class of exactly that name comes first, then all classes of a kind together, then the first synonym.
        """
        spoken = plain(phrase)
        names = tuple(dict.fromkeys((spoken, singular(spoken))))
        wide = tuple(name.removeprefix(ANY) for name in names if name.startswith(ANY))
        if wide:
            family = self._family(wide)
            return Meaning(family) if family else None
        exact = self._called(names)
        family = self._family(names)
        if exact:
            return Meaning(exact[:1], tuple(label for label in family if label not in exact))
        fitting = self._called([other for name in names for other in SYNONYMS.get(name, ())])
        if family:
            return Meaning(family, tuple(label for label in fitting if label not in family))
        return Meaning(fitting[:1], fitting[1:]) if fitting else None

    def noun(self, phrase: str) -> Noun:
        """Return what a name means on this map."""
        spoken = plain(phrase)
        one = singular(spoken)
        is_plural = one != spoken
        meaning = self.resolve(phrase)
        if meaning is None:
            return Noun(one, one, False, is_plural)
        if len(meaning.labels) != 1:
            taken = f"{', '.join(meaning.labels[:-1])} and {meaning.labels[-1]} together"
            taken = "everything on the map" if len(meaning.labels) == len(self.labels) else taken
            note = f'"{one}" takes {taken}'
            return Noun(one, one, True, is_plural, note, (*meaning.labels, *meaning.others))
        (label,) = meaning.labels
        exact = plain(label) in (one, spoken)
        if exact:
            wide = f"{ANY}{one}" if meaning.others else ""
            return Noun(one, label, True, is_plural, "", (wide,) if wide else (), wide, self.count(label))
        also = f"; this map also has {', '.join(meaning.others)}" if meaning.others else ""
        note = f'"{one}" is read as {label}{also}'
        return Noun(one, label, True, is_plural, note, meaning.others, count=self.count(label))

    def match(self, words: Sequence[str]) -> int:
        """Return how many of the first words form the longest known name of anything (0: none)."""
        for length in range(min(self._longest, len(words)), 0, -1):
            spoken = " ".join(words[:length])
            if spoken in self._known or singular(spoken) in self._known:
                return length
        return 0

    def activity(self, words: Sequence[str]) -> tuple[str, int]:
        """Read "somewhere to sit" at the start of some words; returns the generic word and the length ("", 0: none)."""
        if not words or words[0] not in _BEGIN_PLACES:
            return "", 0
        for place in PLACES:
            if tuple(words[: len(place)]) != place:
                continue
            for link in LINKS:
                end = len(place) + len(link)
                if tuple(words[len(place) : end]) != link:
                    continue
                for length in range(min(4, len(words) - end), 0, -1):
                    kind = ACTIVITIES.get(tuple(words[end : end + length]))
                    if kind:
                        end += length
                        ends = not "".join(words[end + 1 : end + 2]).isalpha()
                        return kind, end + (ends and tuple(words[end : end + 1]) in _STRANDED)
        return "", 0

    def correct(self, words: Sequence[str]) -> tuple[str, int]:
        """Read a misspelled name at the start of some words; returns the name and its length ("", 0: none is close)."""
        for length in (3, 2, 1):
            spoken = " ".join(words[:length])
            if len(words) >= length and all(word.isalpha() for word in words[:length]):
                found = correct(spoken, self._here) or correct(singular(spoken), self._here)
                found = found or (correct(singular(spoken), self._sorted) if len(spoken) > 5 else None)
                if found and (length == 1 or EVERYDAY.isdisjoint({*words[:length]} - {*found.split()})):
                    return (plural(found) if singular(spoken) != spoken else found), length
        return "", 0

    def suggest(self, phrase: str) -> str | None:
        """Return the class whose name is spelled most like the phrase, if any is close."""
        near = correct(singular(plain(phrase)), [plain(label) for label in self.labels])
        return next((label for label in self.labels if near and plain(label) == near), None)

    def kin(self, phrase: str) -> tuple[str, ...]:
        """Return the classes of the map that are of a kind with a thing."""
        name = singular(plain(phrase))
        return self._called(one for members in KINDS.values() if name in members for one in members)

    def _called(self, names: Iterable[str]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(label for name in names for label in self.labels if plain(label) == name))

    def _family(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return the classes of a kind: those listed, and those whose name ends so ("kitchen counter" is a counter)."""
        members = [m for name in names for m in KINDS.get(name, ())]
        found = list(self._called(members))
        if any(name in EVERYTHING for name in names):
            return self.labels
        for name in names:
            ending = [label for label in self.labels if plain(label).endswith(f" {name}")]
            found += [label for label in ending if label not in found and plain(label) not in _NO_KIND]
        return tuple(found)

    @cached_property
    def _here(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys([plain(label) for label in self.labels]))

    @cached_property
    def _known(self) -> frozenset[str]:
        spoken = set(self._here)
        heads = {name.split()[-1] for name in spoken}
        return KNOWN_THINGS | spoken | heads | {singular(s) for s in spoken}

    @cached_property
    def _sorted(self) -> tuple[str, ...]:
        return tuple(sorted(self._known))

    @cached_property
    def _longest(self) -> int:
        return max([_MAX_NAME, *(len(name.split()) for name in self._here)])
