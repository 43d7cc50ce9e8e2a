"""Numbers and ranks as they are spoken."""

from collections.abc import Sequence
from typing import Final

_UNITS: Final = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen "
    "eighteen nineteen"
)
_TENS: Final = "twenty thirty forty fifty sixty seventy eighty ninety"
_RANKS: Final = (
    "first second third fourth fifth sixth seventh eighth ninth tenth eleventh twelfth thirteenth fourteenth fifteenth "
    "sixteenth seventeenth eighteenth nineteenth twentieth"
)
_NUMBERS: Final = {
    **{word: n for n, word in enumerate(_UNITS.split())},
    **{word: 10 * n for n, word in enumerate(_TENS.split(), start=2)},
}
_ORDINALS: Final = {word: n for n, word in enumerate(_RANKS.split(), start=1)}
_SOME: Final = {
    ("a", "couple", "of"): 2.0,
    ("couple", "of"): 2.0,
    ("a", "couple"): 2.0,
    ("a", "pair", "of"): 2.0,
    ("a", "few"): 3.0,
    ("half", "a", "dozen"): 6.0,
    ("a", "dozen"): 12.0,
}
"""Amounts by word; "a few" is read as three."""
_FRACTIONS: Final[dict[tuple[str, ...], float]] = {
    ("and", "a", "half"): 0.5,
    ("and", "one", "half"): 0.5,
    ("and", "a", "quarter"): 0.25,
    ("and", "three", "quarters"): 0.75,
}
_FROM_THE_END: Final = {
    ("to", "last"): 0,
    ("from", "last"): 0,
    ("last",): 0,
    ("to", "the", "last"): 0,
    ("from", "the", "last"): 0,
    ("from", "the", "end"): 0,
    ("to", "the", "end"): 0,
}
_LAST: Final = {
    ("last",): -1,
    ("very", "last"): -1,
    ("penultimate",): -2,
    ("next", "to", "last"): -2,
    ("last", "but", "one"): -2,
    ("last", "but", "two"): -3,
}


def read_rank(words: Sequence[str], digits: int | None = None) -> tuple[int, int]:
    """Read "third", "twenty first", "last", "second to last" at the start of some words.

    Args:
        words: the words, at least one.
        digits: the rank, where the first word is one in digits ("3rd").

    Returns:
        The rank (-1 the last, -2 the one before it), and how many words it took; (0, 0) when there is none.
    """
    for taken in (3, 2, 1):
        rank = _LAST.get(tuple(words[:taken]))
        if rank is not None:
            return rank, taken
    rank, taken = (digits, 1) if digits is not None else (_ORDINALS.get(words[0], 0), 1)
    if digits is None and words[0] in _NUMBERS and _NUMBERS[words[0]] >= 20 and len(words) > 1:
        rank, taken = _ORDINALS.get(words[1], 0), 2
        rank = _NUMBERS[words[0]] + rank if 0 < rank < 10 else 0
    if not rank and digits is None:
        return 0, 0
    for length in (3, 2, 1):
        if tuple(words[taken : taken + length]) in _FROM_THE_END:
            return -rank, taken + length
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
        if tuple(words[:length]) in _SOME:
            return _SOME[tuple(words[:length])], length
    total, taken = (digits, 1) if digits is not None else _whole(words)
    if taken == 0:
        return 0.0, 0
    if words[taken : taken + 1] == ["point"] and len(words) > taken + 1 and words[taken + 1] in _NUMBERS:
        total, taken = total + _NUMBERS[words[taken + 1]] / 10.0, taken + 2
    fraction = _FRACTIONS.get(tuple(words[taken : taken + 3]))
    return (total + fraction, taken + 3) if fraction else (float(total), taken)


def _whole(words: Sequence[str]) -> tuple[float, int]:
    total, taken = 0, 0
    for word in words[:4]:
        if word == "hundred" and 0 <= total < 10:
            total = max(total, 1) * 100
        elif word in _NUMBERS and (taken == 0 or total % 100 == 0 or (total % 10 == 0 and _NUMBERS[word] < 10)):
            total += _NUMBERS[word]
        else:
            break
        taken += 1
    return float(total), taken
