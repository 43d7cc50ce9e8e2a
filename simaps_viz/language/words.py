"""Numbers, spelling, plurals, and which classes of a map a name may mean."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from simaps_viz.language.lexicon import (
    ACTIVITIES,
    AMOUNTS,
    EVERYDAY,
    EVERYTHING,
    FRACTIONS,
    FROM_THE_END,
    KINDS,
    KNOWN_THINGS,
    LAST,
    LINKS,
    NUMBERS,
    ORDINALS,
    PLACES,
    SINGULAR,
    SYNONYMS,
)

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
    if words[taken : taken + 1] == ["point"] and len(words) > taken + 1 and words[taken + 1] in NUMBERS:
        total, taken = total + NUMBERS[words[taken + 1]] / 10.0, taken + 2
    fraction = FRACTIONS.get(tuple(words[taken : taken + 3]))
    return (total + fraction, min(taken + 3, len(words))) if fraction else (float(total), taken)


def _whole(words: Sequence[str]) -> tuple[float, int]:
    total, taken = 0, 0
    for word in words[:4]:
        if word == "hundred" and 0 <= total < 10:
            total = max(total, 1) * 100
        elif word in NUMBERS and (taken == 0 or total % 100 == 0 or (total % 10 == 0 and NUMBERS[word] < 10)):
            total += NUMBERS[word]
        else:
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
        if one == last and many not in ("persons", "tv's"):
            return " ".join([*first, many])
    if last.endswith(("ch", "sh", "s", "x", "z")):
        last += "es"
    elif last.endswith("y") and last[-2:-1] not in "aeiou":
        last = last[:-1] + "ies"
    else:
        last += "s"
    return " ".join([*first, last])


def plain(label: str) -> str:
    """Return a class name as a person says it: "tv_monitor" -> "tv monitor", "table-merged" -> "table"."""
    words = re.split(r"[\s_\-/]+", label.strip().lower())
    return " ".join(w for w in words if w not in ("merged", "other", "stuff")) or label.strip().lower()


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
                if found:
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
