"""Names of things: plurals, synonyms and generic words, tied to the classes a map really has."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from simaps_viz.labels import COCO_THINGS
from simaps_viz.language.spelling import correct
from simaps_viz.language.synonyms import ACTIVITIES, KINDS, LINKS, OTHER_THINGS, PLACES, SYNONYMS

ANY: Final = "any "
"""Before a name: all classes of that kind, where a class of exactly that name would be meant otherwise."""
_NO_KIND: Final = ("hot dog", "teddy bear")
"""Names whose last word misleads: a hot dog is no dog."""
EVERYTHING: Final = ("object", "thing", "item")
"""Words for whatever there is."""
_EVERYWHERE: Final = frozenset(
    {w for names in (*SYNONYMS.values(), *KINDS.values()) for w in names}
    | {*SYNONYMS, *KINDS, *COCO_THINGS, *EVERYTHING, *(word.replace("_", " ") for word in OTHER_THINGS.split())}
)
"""Names of things on any map."""
_LONGEST: Final = max(len(name.split()) for name in _EVERYWHERE)
_IRREGULAR = {
    "people": "person",
    "persons": "person",
    "men": "man",
    "women": "woman",
    "mice": "mouse",
    "knives": "knife",
    "shelves": "shelf",
    "bookshelves": "bookshelf",
    "loaves": "loaf",
    "children": "child",
    "tvs": "tv",
    "tv's": "tv",
    "buses": "bus",
    "vases": "vase",
    "suitcases": "suitcase",
    "bookcases": "bookcase",
    "cases": "case",
    "horses": "horse",
    "skis": "skis",
    "scissors": "scissors",
    "stairs": "stairs",
    "cookies": "cookie",
    "ties": "tie",
    "bus": "bus",
    "tableware": "tableware",
    "stoves": "stove",
    "sheep": "sheep",
    "dresses": "dress",
    "glasses": "glass",
    "gas": "gas",
    "shears": "shears",
    "places": "place",
}


def singular(phrase: str) -> str:
    """Give a phrase with its last word in the singular: "dining tables" -> "dining table"."""
    *first, last = phrase.split() or [""]
    return " ".join([*first, _singular_word(last)])


def _singular_word(word: str) -> str:
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    if len(word) > 4 and word.endswith("ies"):
        return word[:-3] + "y"
    if len(word) > 4 and word.endswith(("ches", "shes", "sses", "xes", "zes")):
        return word[:-2]
    if len(word) > 2 and word.endswith("s") and not word.endswith(("ss", "us")):
        return word[:-1]
    return word


def plural(phrase: str) -> str:
    """Give a phrase with its last word in the plural: "couch" -> "couches"."""
    *first, last = phrase.split() or [""]
    for many, one in _IRREGULAR.items():
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
    """Give a class name as a person says it: "tv_monitor" -> "tv monitor", "table-merged" -> "table"."""
    words = re.split(r"[\s_\-/]+", label.strip().lower())
    return " ".join(w for w in words if w not in ("merged", "other", "stuff")) or label.strip().lower()


@dataclass(frozen=True)
class Meaning:
    """What a word may mean on one map."""

    labels: tuple[str, ...]
    """The classes it takes together, at least one."""
    others: tuple[str, ...] = ()
    """Other classes it may mean, the likeliest first."""


class Vocabulary:
    """What a person may call the classes of one map.

    Args:
        labels: class names of the map, or {class name: number of instances}; their order breaks ties between
            equally fitting classes.
    """

    def __init__(self, labels: Iterable[str] | Mapping[str, int]) -> None:
        self.labels = tuple(labels)
        self._counts = labels if isinstance(labels, Mapping) else None

    def count(self, label: str) -> int | None:
        """Give how many instances of a class the map has; None when only the class names are known."""
        return None if self._counts is None else self._counts.get(label, 0)

    def resolve(self, phrase: str) -> Meaning | None:
        """Give what a word or phrase means; None when the map has nothing it may mean.

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

    def match(self, words: Sequence[str]) -> int:
        """Give how many of the first words form the longest known name of anything (0: none)."""
        for length in range(min(self._longest, len(words)), 0, -1):
            spoken = " ".join(words[:length])
            if spoken in self._known or singular(spoken) in self._known:
                return length
        return 0

    def activity(self, words: Sequence[str]) -> tuple[str, int]:
        """Read "somewhere to sit" at the start of some words; gives the generic word and the length ("", 0: none)."""
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
                        return kind, end + length
        return "", 0

    def correct(self, words: Sequence[str]) -> tuple[str, int]:
        """Read a misspelled name at the start of some words; gives the name and its length ("", 0: none is close)."""
        for length in (3, 2, 1):
            spoken = " ".join(words[:length])
            if len(words) >= length and all(word.isalpha() for word in words[:length]):
                found = correct(spoken, self._here) or correct(singular(spoken), self._here)
                found = found or (correct(singular(spoken), self._sorted) if len(spoken) > 5 else None)
                if found:
                    return (plural(found) if singular(spoken) != spoken else found), length
        return "", 0

    def suggest(self, phrase: str) -> str | None:
        """Give the class whose name is spelled most like the phrase, if any is close."""
        near = correct(singular(plain(phrase)), [plain(label) for label in self.labels])
        return next((label for label in self.labels if near and plain(label) == near), None)

    def _called(self, names: Iterable[str]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(label for name in names for label in self.labels if plain(label) == name))

    def _family(self, names: Iterable[str]) -> tuple[str, ...]:
        """Give the classes of a kind: those listed, and those whose name ends so ("kitchen counter" is a counter)."""
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
        return _EVERYWHERE | spoken | heads | {singular(s) for s in spoken}

    @cached_property
    def _sorted(self) -> tuple[str, ...]:
        return tuple(sorted(self._known))

    @cached_property
    def _longest(self) -> int:
        return max([_LONGEST, *(len(name.split()) for name in self._here)])
