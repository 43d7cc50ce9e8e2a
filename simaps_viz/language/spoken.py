"""Spoken words to tokens: numbers, ordinals, things by their longest known name, and the words of the grammar."""

import re
from collections.abc import Iterator, Sequence
from typing import Any, Final

from lark import Token
from lark.lexer import Lexer

from simaps_viz.language.words import Vocabulary, singular

_KEYWORDS: Final[dict[str, str]] = {
    "AND": "and, plus",
    "APPROACH": "approach, reach, visit, find, seek",
    "AROUND": "around, round",
    "AT": "at",
    "BACK": "back",
    "BACKUP": "back up, reverse",
    "BACKWARD": "backward, backwards",
    "BETWEEN": "between, in between, inbetween, in the middle of, halfway between, midway between",
    "BY": "by",
    "CENTIMETRES": "cm, centimeter, centimeters, centimetre, centimetres",
    "CLOCKWISE": "clockwise",
    "COUNTERCLOCKWISE": "counterclockwise, anticlockwise, counter clockwise, anti clockwise",
    "COMMA": ",",
    "DEGREES": "degree, degrees, deg, °",
    "DET": "the, a, an, my, your, its, some, any, this, those, these",
    "EAST": "east, eastward, eastwards, eastern",
    "EVERY": "every, each, all, every one, each one, both",
    "FACE": "face, facing",
    "FARTHEST": "farthest, furthest, most distant, remotest, farthest away, furthest away",
    "FEET": "ft, foot, feet",
    "FOR": "for",
    "FORWARD": "forward, forwards, ahead, straight, straight ahead, straight on",
    "FROM": "from",
    "GO": "go, move, drive, walk, navigate, head, travel, proceed, run, roll, come, get, step, ride, continue",
    "HALF": "half",
    "HEADING": "heading, bearing, direction",
    "HERE": "here, me, where you are, where you stand, your position, the robot, your current position",
    "IT": "it, that one, this one",
    "KEEP": "keep, have, put, leave",
    "LEFT": "left, left hand",
    "LOOK": "look, point yourself, orient yourself",
    "METRES": "m, meter, meters, metre, metres",
    "MOST": "leftmost, rightmost, northernmost, southernmost, easternmost, westernmost",
    "NEAR": "near, next to, close to, beside, besides, alongside, adjacent to, up to, over to",
    "NEAREST": "nearest, closest",
    "NORTH": "north, northward, northwards, northern",
    "NUMBER": "number, no, nr, #",
    "OF": "of",
    "ON": "on",
    "POINT": "point, position, coordinates, location",
    "POSS": "'s",
    "RETURN": "return",
    "RIGHT": "right, right hand",
    "SEE": "see, can see",
    "SIDE": "side",
    "SOUTH": "south, southward, southwards, southern",
    "STAND": "stand, stop, wait, park, stay, position yourself, place yourself",
    "START": "start, beginning, origin, home, starting point, starting position, start position, where you started, "
    "where you came from, where you began, where you were",
    "STOP": ". ; ! :",
    "TAKE": "take me, bring me, guide me, lead me, take us, bring us, take yourself, bring yourself",
    "THEN": "then, afterwards, after that, finally, next, lastly, and then, followed by",
    "TO": "to, into",
    "TOWARD": "toward, towards",
    "TURN": "turn, rotate, spin, pivot, swivel",
    "UNTIL": "until, till",
    "VIEW": "in view, in sight, in your view, in your field of view, within view, within sight",
    "VISIBLE": "visible",
    "WEST": "west, westward, westwards, western",
    "WITH": "with",
}
_POLITE: Final = (
    "please could can would will you kindly hey hi hello ok okay robot just now thanks thank also i want like need us "
    "let so that which is are there yourself d ll very much good"
)
_SILENT: Final = frozenset(_POLITE.split())
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
_ORDINALS: Final = {"last": -1, **{word: n for n, word in enumerate(_RANKS.split(), start=1)}}
_PIECE: Final = re.compile(
    r"(?P<ordinal>\d+)(?:st|nd|rd|th)\b|(?P<number>(?<![\w.])-?\d+(?:\.\d+)?|\d+(?:\.\d+)?)|(?P<poss>['’]s\b)"
    r"|(?P<word>[^\W\d_]+)|(?P<mark>[,.;:!#°])|(?P<other>[^\s\-_?()\"'’\[\]]+)"
)


class UnknownWordsLexer(Lexer):
    """Gives the parser the tokens made by ``tokens``."""

    def __init__(self, lexer_conf: Any) -> None:
        pass

    def lex(self, data: Sequence[Token]) -> Iterator[Token]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Pass the tokens on."""
        yield from data


def _phrases() -> dict[tuple[str, ...], str]:
    phrases = {}
    for kind, spoken in _KEYWORDS.items():
        options = spoken.split() if kind == "STOP" else [","] if kind == "COMMA" else spoken.split(", ")
        phrases.update({tuple(option.split()): kind for option in options})
    return phrases


_PHRASES: Final = _phrases()
_LONGEST: Final = max(map(len, _PHRASES))


def tokens(text: str, vocabulary: Vocabulary) -> list[Token]:
    """Split a command into tokens of the grammar; words nobody knows become WORD, polite ones vanish."""
    pieces = [(str(m.lastgroup), m[m.lastgroup or 0]) for m in _PIECE.finditer(text.lower())]
    words = [piece for _, piece in pieces]
    found: list[Token] = []
    at = 0
    while at < len(pieces):
        token, length = _token(pieces, words, at, vocabulary)
        if token is not None:
            found.append(token)
        at += length
    return found


def _token(
    pieces: Sequence[tuple[str, str]], words: Sequence[str], at: int, vocabulary: Vocabulary
) -> tuple[Token | None, int]:
    """Give the token that starts at a piece (None: left out), and how many pieces it takes."""
    kind, piece = pieces[at]
    if kind in ("ordinal", "number"):
        return Token("ORD" if kind == "ordinal" else "NUM", piece), 1
    length, keyword = _keyword(words, at)
    thing = vocabulary.match(words[at : at + 6])
    number, digits = _spoken_number(words, at)
    if thing > 0 and thing >= length:
        name = " ".join(words[at : at + thing])
        return Token("NOUNS" if singular(name) != name else "NOUN", name), thing
    if length > 0:
        return Token(keyword, " ".join(words[at : at + length])), length
    if digits > 0:
        return Token("NUM", str(number)), digits
    if piece in _ORDINALS:
        return Token("ORD", str(_ORDINALS[piece])), 1
    return (None if piece in _SILENT else Token("WORD", piece)), 1


def _keyword(words: Sequence[str], at: int) -> tuple[int, str]:
    for length in range(_LONGEST, 0, -1):
        kind = _PHRASES.get(tuple(words[at : at + length]))
        if kind:
            return length, kind
    return 0, ""


def _spoken_number(words: Sequence[str], at: int) -> tuple[int, int]:
    """Read "two", "forty five", "one hundred eighty", "a hundred"; gives the number and how many words it took."""
    total, taken = 0, 0
    for word in words[at : at + 4]:
        if word == "hundred" and 0 <= total < 10:
            total = max(total, 1) * 100
        elif word in _NUMBERS and (taken == 0 or total % 100 == 0 or (total % 10 == 0 and _NUMBERS[word] < 10)):
            total += _NUMBERS[word]
        else:
            break
        taken += 1
    return total, taken
