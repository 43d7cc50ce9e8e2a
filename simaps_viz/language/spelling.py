"""Words that were misspelled: which known word is meant, if exactly one is close."""

from collections.abc import Iterable
from typing import Final

_SHORTEST: Final = 4
_ONE_SLIP: Final = 4
_TWO_SLIPS: Final = 8
_ORDINARY: Final = frozenset(
    [
        "black",
        "brown",
        "white",
        "green",
        "blue",
        "grey",
        "gray",
        "yellow",
        "purple",
        "pink",
        "small",
        "large",
        "wooden",
        "metal",
        "plastic",
        "round",
        "square",
        "short",
        "tall",
        "clean",
        "dirty",
        "empty",
        "broken",
        "pick",
        "grab",
        "open",
        "close",
        "lock",
        "cook",
        "bake",
        "make",
        "sing",
        "dance",
        "jump",
        "push",
        "pull",
        "lift",
        "carry",
        "play",
        "cut",
        "clear",
        "write",
        "call",
        "drop",
        "throw",
        "feed",
        "fill",
        "pour",
        "book",
        "boot",
        "boat",
        "coat",
        "goat",
        "when",
        "where",
        "what",
        "why",
        "whom",
        "whose",
        "some",
        "same",
        "time",
        "than",
        "them",
        "they",
        "this",
        "with",
        "from",
        "form",
        "work",
        "word",
        "fast",
        "slow",
        "quick",
        "quickly",
        "slowly",
        "cheap",
        "heavy",
        "light",
        "dark",
        "cold",
        "warm",
        "hot",
        "water",
        "coffee",
        "food",
        "money",
        "paper",
        "wood",
        "glass",
        "stone",
        "brick",
        "high",
        "lower",
        "higher",
        "bigger",
        "smaller",
        "taller",
        "pretty",
        "nice",
        "best",
        "worst",
        "five",
        "four",
        "nine",
        "fire",
        "wire",
        "hand",
        "head",
        "foot",
        "feet",
        "face",
        "lake",
        "cake",
        "take",
        "bake",
        "tree",
        "three",
        "free",
        "each",
        "such",
        "much",
        "more",
        "most",
        "less",
        "least",
        "many",
        "only",
        "even",
        "ever",
        "never",
        "every",
        "other",
        "mother",
        "brother",
        "sister",
        "father",
        "door",
        "floor",
        "poor",
        "fish",
        "cheer",
        "hair",
        "clap",
        "wave",
        "sell",
        "tell",
        "wash",
        "brush",
        "sweep",
        "paint",
        "build",
        "kick",
        "catch",
        "serve",
        "fetch",
        "load",
        "unload",
        "hide",
        "wake",
    ]
)
"""Everyday words that are no slip of another."""


def slips(a: str, b: str, limit: int) -> int:
    """Give how many letters were left out, added, changed or swapped with the next; ``limit`` + 1 if more than limit.

    The optimal string alignment distance, Levenshtein's with swaps of neighbours.
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
    """Give the known word that a word is a slip of, or None when none is close or the word is an everyday one.

    One slip from 4 letters on (with the same first or last letter), two from 8 on; of equally close words, the first.
    """
    if len(word) < _SHORTEST or word in _ORDINARY:
        return None
    limit = 2 if len(word) >= _TWO_SLIPS else 1
    best, fewest = None, limit + 1
    for candidate in known:
        if len(candidate) < _ONE_SLIP or (candidate[0] != word[0] and candidate[-1] != word[-1]):
            continue
        found = slips(word, candidate, fewest - 1)
        if found < fewest:
            best, fewest = candidate, found
    return best
