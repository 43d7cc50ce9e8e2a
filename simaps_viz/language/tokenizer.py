"""Spoken words to tokens: numbers, ranks, things by their longest known name, and the words of the grammar."""

import re
from collections.abc import Sequence
from typing import Final

from lark import Token

from simaps_viz.errors import CommandError
from simaps_viz.language.lexicon import ACTIVITIES, COMPASS_POINTS, MAX_PHRASE, PHRASES
from simaps_viz.language.program import MAX_NUMBER
from simaps_viz.language.words import Vocabulary, correct, read_number, read_rank, singular

_PIECE: Final = re.compile(
    r"(?P<ordinal>\d+)(?:st|nd|rd|th)\b"
    r"|(?P<comma>\d+,\d+)(?=\s*(?:m|cm|met(?:er|re)s?|centimet(?:er|re)s?|feet|ft)\b)"
    r"|(?P<number>(?<![\w.])-?\d+(?:\.\d+)?|\d+(?:\.\d+)?|(?<![\w.])\.\d+)|(?P<poss>['’]s\b)"
    r"|(?P<word>[^\W\d_]+)|(?P<mark>[,.;:!#°&])|(?P<other>[^\s\-_?()\"'’\[\]]+)"
)
_IS: Final = re.compile(r"\b(that|it|there|what|where|here|which|who|let)['’]s\b")
_MOST: Final = re.compile(r"(left|right|north|south|east|west)(?:ern|er)?most")
_MOST_ADJECTIVE: Final = re.compile(r"(left|right|north|south|east|west)(?:ern|erly|ward)?$")
_POINTS: Final = {tuple(name.split()): degrees for name, degrees in COMPASS_POINTS.items() if " " in name}
_POINT_WORD: Final = re.compile(r"(north|south)(east|west)(?:ern|erly|wards?|bound)?$")
_BOUNDS: Final = ("THEN", "STOP")
_VERBS: Final = frozenset([
    "APPROACH", "BACKUP", "CIRCLE", "FACE", "GO", "HALT", "KEEP", "LOOK", "MAKE", "NOT", "PASS", "RETURN", "SPIN",
    "STAND", "STRAFE", "TAKE", "TURN", "UTURN", "WITH",
])  # fmt: skip
"""Tokens a new order starts with, also where only a comma or "and" stands before it."""
_NAMES: Final = ("NOUN", "NOUNS", "PLACE")
_RANKING: Final = ("ORD", "NEAREST", "FARTHEST", "MOST")
_UNITS: Final = ("METRES", "CENTIMETRES", "FEET", "YARDS", "STEPS", "INCHES", "KILOMETRES", "MILLIMETRES")
_STARTERS: Final = ("APPROACH", "BACKUP", "FACE", "GO", "LOOK", "RETURN", "SPIN", "TURN")
_ENDERS: Final = (*_NAMES, "IT", "LEFT", "RIGHT", "DEGREES", "START", "FORWARD", "BACKWARD", *_UNITS)
_WHERE: Final = (
    "LEFT", "RIGHT", "NORTH", "SOUTH", "EAST", "WEST", "INTER", "NEAR", "FRONT", "BEHIND", "BETWEEN", "TO", "ON",
)  # fmt: skip
_KEYWORDS: Final = tuple(sorted(w[0] for w, kind in PHRASES.items() if len(w) == 1 and kind and len(w[0]) >= 4))

Pieces = Sequence[tuple[str, str]]


def tokens(text: str, vocabulary: Vocabulary, *, corrected: list[str] | None = None) -> list[Token]:
    """Split a command into tokens of the grammar; unknown words become WORD, polite ones are left out.

    Args:
        text: what was said.
        vocabulary: of the map.
        corrected: where given, misspelled words are corrected, and a note on each is added to it.

    Raises:
        CommandError: a number larger than a program may hold.
    """
    plainly = _IS.sub(r"\1 is", text.lower())
    pieces = [(str(m.lastgroup), m[m.lastgroup or 0]) for m in _PIECE.finditer(plainly)]
    if corrected is not None:
        pieces = _corrected(pieces, vocabulary, corrected)
    words = [piece for _, piece in pieces]
    found: list[Token] = []
    at = 0
    while at < len(pieces):
        kind, value, length = _token(pieces[at][0], words[at:], vocabulary)
        if kind:
            found.append(Token(kind, value))
        at += length
    return found


def clauses(spoken: Sequence[Token]) -> list[list[Token]]:
    """Split the tokens of a command into one list for each thing to do."""
    spoken = _shortened(spoken)
    found: list[list[Token]] = [[]]
    in_pair = False
    for at, word in enumerate(spoken):
        # The next word that is no separator decides whether a comma or "and" ends the clause.
        after = next((w for w in spoken[at + 1 :] if w.type not in ("COMMA", "AND", *_BOUNDS)), None)
        verb = after is not None and _starts_an_order(after, found[-1])
        ends = after is None or after is not spoken[at + 1]
        if (
            word.type in _STARTERS
            and found[-1]
            and found[-1][-1].type in _ENDERS
            and not (ends or found[-1][0].type == "MAKE")
        ):
            found.append([])  # "turn left go ahead": two orders without a separator
            in_pair = False
        # "then", a full stop, or a comma or "and" before a new order.
        if word.type in _BOUNDS or (word.type in ("COMMA", "AND") and _splits(found[-1], word, after, in_pair, verb)):
            _lend_noun(found[-1], spoken[at + 1 :])
            found.append([])
            in_pair = False
            continue
        if word.type == "AND" and in_pair:
            in_pair = False
        in_pair |= word.type == "BETWEEN"
        found[-1].append(word)
    kept = [part for clause in found for part in _apart(_without_rank(clause))]
    return [clause for clause in kept if clause]


def _apart(clause: list[Token]) -> list[list[Token]]:
    """Split "go ahead with the table on your left" and "with the table on your left go ahead"; the turn comes first."""
    kinds = [word.type for word in clause]
    at = kinds.index("WITH") if "WITH" in kinds else -1
    end = next((i + 1 for i in range(at + 1, len(kinds)) if kinds[i] in ("LEFT", "RIGHT")), 0) if at >= 0 else 0
    if not end or not {"ON", "TO", "AT"} & set(kinds[at:end]):
        return [clause]
    end += kinds[end : end + 1] == ["SIDE"]
    before = [] if at and kinds[at - 1] in ("TURN", "SPIN") else clause[:at]
    if not before and not (at == 0 and kinds[end : end + 1] and kinds[end] in _VERBS | {"FORWARD", "STEPS", "COMMA"}):
        return [clause]
    return [clause[at:end], _without_rank(before + clause[end:])]


def _shortened(spoken: Sequence[Token]) -> list[Token]:
    """Leave out words that add nothing: "chair of the chairs in view", "the chair that is the farthest"."""
    kept: list[Token] = []
    at = 0
    while at < len(spoken):
        ahead = [word.type for word in spoken[at : at + 3]]
        names = [str(word) for word in kept if word.type in _NAMES]
        skip = 3 if ahead in (["OF", "DET", "NOUNS"], ["OF", "EVERY", "NOUNS"]) else 0
        if skip and names and singular(names[-1]) == singular(str(spoken[at + 2])):
            at += skip
            continue
        if skip == 0 and _adds_half(kept, spoken[at : at + 3]):
            before = 1.0 if kept[-2].type == "DET" else float(kept[-2])
            kept[-2] = Token("NUM", f"{before + 0.5:.12g}")
            at += ahead.index("HALF") + 1
            continue
        if ahead[:2] == ["DET", "POINT"] and ahead[2:3] and ahead[2] in _WHERE:
            at += 2  # "a spot left of the bed"
            continue
        after_name = bool(kept) and kept[-1].type in (*_NAMES, "ONE")
        if not (ahead[0] == "DET" and after_name and ahead[1:2] and ahead[1] in _RANKING):
            kept.append(spoken[at])
        at += 1
    return kept


def _adds_half(before: Sequence[Token], ahead: Sequence[Token]) -> bool:
    """Return whether "and a half" follows "one metre"."""
    kinds = [word.type for word in ahead]
    half = kinds[:2] == ["AND", "HALF"] or kinds == ["AND", "DET", "HALF"]
    return half and len(before) > 1 and before[-1].type in _UNITS and before[-2].type in ("NUM", "ONE", "DET")


def _lend_noun(clause: list[Token], rest: Sequence[Token]) -> None:
    """Name the thing of "go to the first and the third chair" in the first half too."""
    if clause and clause[-1].type in _RANKING and not any(word.type in (*_NAMES, "WORD", "ONE") for word in clause):
        until = next((i for i, word in enumerate(rest) if word.type in _VERBS), len(rest))
        clause += [word for word in rest[:until] if word.type in _NAMES][:1]


def _splits(clause: Sequence[Token], word: Token, after: Token | None, in_pair: bool, verb: bool) -> bool:
    """Return whether a comma or "and" ends what is to be done."""
    if not clause or after is None or verb:
        return True
    if in_pair and word.type == "AND":
        return False
    return not (clause[-1].type == "NUM" and after.type == "NUM")


def _starts_an_order(word: Token, before: Sequence[Token]) -> bool:
    return word.type in _VERBS and not (word.type == "WITH" and not before)


def _without_rank(clause: list[Token]) -> list[Token]:
    """Leave out the rank of "first, go to …", and commas at either end."""
    while clause and clause[0].type in ("COMMA", "AND", "AFTER"):
        clause = clause[1:]
    while clause and clause[-1].type in ("COMMA", "AND"):
        clause = clause[:-1]
    if clause and clause[0].type == "ORD" and (len(clause) == 1 or clause[1].type in (*_VERBS, "COMMA", "TO")):
        return _without_rank(clause[1:])
    return clause


def _token(kind: str, words: list[str], vocabulary: Vocabulary) -> tuple[str, str, int]:
    """Return the token that starts here, its value, and how many pieces it takes; token "" is left out.

    Raises:
        CommandError: a number larger than a program may hold.
    """
    piece = words[0]
    if kind == "ordinal":
        rank, length = read_rank(words, int(piece))
        return "ORD", str(rank), length
    if kind in ("number", "comma"):
        number, length = read_number(words, float(piece.replace(",", ".")))
        if number > MAX_NUMBER:
            raise CommandError(f"numbers go up to {MAX_NUMBER:.0f}, found {piece[:30]}")
        return "NUM", f"{number:.12g}", length
    rank, rank_words = read_rank(words)
    if rank:
        return "ORD", str(rank), rank_words
    side, side_words = _superlative(words)
    if side:
        return "MOST", side, side_words
    degrees, point_words = _compass_point(words)
    if point_words:
        return "INTER", f"{degrees:.12g}", point_words
    return _word(words, vocabulary)


def _word(words: list[str], vocabulary: Vocabulary) -> tuple[str, str, int]:
    piece = words[0]
    length, keyword = _keyword(words)
    activity, activity_words = vocabulary.activity(words[:10])
    if activity:
        return "PLACE", activity, activity_words
    alone = next((i for i, word in enumerate(words) if not word.isalpha() or word in ("and", "then")), len(words))
    if tuple(words[:alone]) in ACTIVITIES:
        return "PLACE", ACTIVITIES[tuple(words[:alone])], alone
    thing = vocabulary.match(words[:6])
    if thing > 0 and thing >= length:
        name = " ".join(words[:thing])
        return ("NOUNS" if singular(name) != name else "NOUN"), name, thing
    number, digits = read_number(words)
    if digits > length:
        return ("ONE" if words[:digits] == ["one"] else "NUM"), f"{number:.12g}", digits
    if length > 0:
        return keyword, " ".join(words[:length]), length
    return "WORD", piece, 1


def _keyword(words: Sequence[str]) -> tuple[int, str]:
    for length in range(min(MAX_PHRASE, len(words)), 0, -1):
        kind = PHRASES.get(tuple(words[:length]))
        if kind is not None:
            return length, kind
    return 0, ""


def _superlative(words: Sequence[str]) -> tuple[str, int]:
    """Read "leftmost", "left most", "most northerly" at the start of some words."""
    found = _MOST.fullmatch(words[0])
    if found:
        return found[1], 1
    if len(words) > 1 and words[1] == "most":
        found = _MOST_ADJECTIVE.fullmatch(words[0])
    elif len(words) > 1 and words[0] == "most":
        found = _MOST_ADJECTIVE.fullmatch(words[1])
    return (found[1], 2) if found else ("", 0)


def _compass_point(words: Sequence[str]) -> tuple[float, int]:
    """Read a compass word between the main four: "north east", "northeastern", "north-north-east"."""
    split = []
    for at, word in enumerate(words[:3]):
        found = _POINT_WORD.fullmatch(word)
        one = _MOST_ADJECTIVE.fullmatch(word)
        names = [found[1], found[2]] if found else [one[1]] if one else []
        if not names:
            break
        split += [(name, at + 1) for name in names]
    for length in (3, 2):
        degrees = _POINTS.get(tuple(name for name, _ in split[:length]))
        if degrees is not None and len(split) >= length:
            return degrees, split[length - 1][1]
    return 0.0, 0


def _corrected(pieces: Pieces, vocabulary: Vocabulary, corrected: list[str]) -> list[tuple[str, str]]:
    """Replace unknown words by the known ones they are misspellings of."""
    found: list[tuple[str, str]] = []
    words = [piece for _, piece in pieces]
    at = 0
    while at < len(pieces):
        # Unknown words are compared with the names of things first, then with the words of the grammar.
        kind, _, length = _token(pieces[at][0], words[at:], vocabulary)
        name, taken, end = "", 0, at + length
        if pieces[at][0] == "word":
            name, taken = vocabulary.correct(words[at : at + 3]) if kind in ("WORD", "NOUN", "NOUNS") else ("", 0)
            if kind != "WORD" and taken <= length:
                name, taken = "", 0
            keyword = correct(words[at], _KEYWORDS) if kind == "WORD" and taken < 2 else None
            name, taken = (keyword, 1) if keyword and not name else (name, taken)
        if name:
            corrected.append(f'"{" ".join(words[at : at + taken])}" is read as {name}')
            found += [("word", word) for word in name.split()]
            end = at + taken
        else:
            found += pieces[at:end]
        at = end
    return found
