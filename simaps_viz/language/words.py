"""Words for things: synonyms, plurals and generic words, tied to the classes a map really has."""

import difflib
import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Final

SYNONYMS: Final[dict[str, tuple[str, ...]]] = {
    "armchair": ("chair", "couch"),
    "basin": ("sink",),
    "bicycle": ("bike",),
    "bike": ("bicycle", "motorcycle"),
    "bin": ("trash can", "trash bin", "garbage bin"),
    "bookcase": ("bookshelf", "shelf"),
    "bookshelf": ("bookcase", "shelf"),
    "bureau": ("desk",),
    "cellphone": ("cell phone",),
    "cooker": ("stove", "oven"),
    "couch": ("sofa", "settee"),
    "cupboard": ("cabinet", "wardrobe"),
    "desk": ("table", "dining table"),
    "desk chair": ("office chair", "chair"),
    "dining chair": ("chair",),
    "dining table": ("table",),
    "dinner table": ("dining table", "table"),
    "display": ("monitor", "tv"),
    "dustbin": ("trash can", "trash bin", "garbage bin"),
    "flower": ("potted plant", "plant", "vase"),
    "flowerpot": ("potted plant", "plant"),
    "fridge": ("refrigerator",),
    "freezer": ("refrigerator",),
    "garbage can": ("trash can", "trash bin", "garbage bin"),
    "hair dryer": ("hair drier",),
    "handbag": ("bag",),
    "house plant": ("potted plant", "plant"),
    "houseplant": ("potted plant", "plant"),
    "human": ("person",),
    "lavatory": ("toilet",),
    "loo": ("toilet",),
    "loveseat": ("couch", "sofa"),
    "man": ("person",),
    "mobile": ("cell phone",),
    "mobile phone": ("cell phone",),
    "monitor": ("tv", "tv monitor"),
    "motorbike": ("motorcycle",),
    "mug": ("cup",),
    "notebook computer": ("laptop",),
    "office chair": ("chair",),
    "painting": ("picture", "picture frame"),
    "phone": ("cell phone",),
    "photo": ("picture", "picture frame"),
    "plant": ("potted plant", "pot plant"),
    "pot plant": ("potted plant", "plant"),
    "potted plant": ("plant", "pot plant"),
    "refrigerator": ("fridge",),
    "rubbish bin": ("trash can", "trash bin", "garbage bin"),
    "screen": ("tv", "monitor", "tv monitor"),
    "seat": ("chair", "stool", "couch", "bench"),
    "settee": ("couch", "sofa"),
    "sofa": ("couch", "settee"),
    "stool": ("bar stool",),
    "stove": ("oven", "cooker"),
    "table": ("dining table", "coffee table", "side table", "desk"),
    "teddy": ("teddy bear",),
    "telephone": ("cell phone",),
    "television": ("tv", "tv monitor"),
    "television set": ("tv", "tv monitor"),
    "telly": ("tv", "tv monitor"),
    "trash": ("trash can", "trash bin", "garbage bin"),
    "trash bin": ("trash can", "garbage bin"),
    "trash can": ("trash bin", "garbage bin", "bin"),
    "trashcan": ("trash can", "trash bin", "garbage bin"),
    "tv": ("television", "tv monitor", "monitor"),
    "wc": ("toilet",),
    "woman": ("person",),
}
"""{word: classes it may mean, the most fitting first}; a class called exactly so always comes before all of them."""

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
        if one == last and many != "persons":
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


class Vocabulary:
    """What a person may call the classes of one map.

    Args:
        labels: class names of the map; their order breaks ties between equally fitting classes.
    """

    def __init__(self, labels: Iterable[str]) -> None:
        self.labels = tuple(labels)

    def resolve(self, phrase: str) -> tuple[str, ...]:
        """Give the classes a word or phrase may mean, the most fitting first; empty when the map has none of them."""
        spoken = plain(phrase)
        found: list[str] = []
        for name in dict.fromkeys((spoken, singular(spoken))):
            for candidate in (name, *SYNONYMS.get(name, ())):
                found += [label for label in self.labels if plain(label) == candidate and label not in found]
        return tuple(found)

    def match(self, words: Sequence[str]) -> int:
        """Give how many of the first words form the longest known name of anything (0: none)."""
        for length in range(min(self._longest, len(words)), 0, -1):
            spoken = " ".join(words[:length])
            if spoken in self._known or singular(spoken) in self._known:
                return length
        return 0

    def suggest(self, phrase: str) -> str | None:
        """Give the class whose name is spelled most like the phrase, if any is close."""
        near = difflib.get_close_matches(singular(plain(phrase)), [plain(label) for label in self.labels], 1, 0.75)
        return next((label for label in self.labels if near and plain(label) == near[0]), None)

    @cached_property
    def _known(self) -> frozenset[str]:
        spoken = {plain(label) for label in self.labels}
        return frozenset(
            spoken | {singular(s) for s in spoken} | set(SYNONYMS) | {w for v in SYNONYMS.values() for w in v}
        )

    @cached_property
    def _longest(self) -> int:
        return max(len(name.split()) for name in self._known)
