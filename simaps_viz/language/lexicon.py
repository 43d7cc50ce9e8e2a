"""The words of commands, loaded once from the JSON files beside this module.

- ``phrases.json``: {token of the grammar, or token and value: what a person may say for it}; the phrases of token ""
  may be left out, and nothing else is.
- ``things.json``: other names of classes (``names``, ``narrower``), generic words that take several classes together
  (``kinds``, ``like``), classes to try in turn (``first_fit``), what one does somewhere (``activities``, ``places``,
  ``links``), and further things people speak of (``others``).
- ``words.json``: numbers, ordinals, amounts, compass points, irregular plurals, everyday words, words not of names.
"""

import json
import re
from collections.abc import Iterable, Iterator
from importlib.resources import files
from typing import Any, Final

from simaps_viz.colors.classes import COCO_THINGS
from simaps_viz.colors.naming import COLOR_WORDS

Words = tuple[str, ...]
"""A phrase, split at its spaces."""


def load_text(name: str) -> str:
    """Load one text file of this package."""
    return files("simaps_viz.language").joinpath(name).read_text(encoding="utf-8")


def load(name: str) -> Any:
    """Load one JSON file of this package."""
    return json.loads(load_text(name))


_SHORT: Final = re.compile(r"\b(i|you|we|they|he|she|it|that|there|who|what|where|this) (m|d|re|ve|ll)\b")
_LONG: Final = {"m": "am", "d": "would", "re": "are", "ve": "have", "ll": "will"}
_CHOICE: Final = re.compile(r"\(([^()]*)\)")


def written_out(said: str) -> str:
    """Return words with "i m" and "you re" as "i am" and "you are"."""
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
        for name in (kind, *words["words"]):
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
LINKS: Final = _split(_THINGS["links"])
"""Words that join a place and an activity, such as "where i can"."""
NEEDS: Final[dict[Words, str]] = {
    words: kind for kind, phrases in _THINGS["needs"].items() for words in _split(phrases)
}
"""{("i", "m", "thirsty"): generic word}: what a person lacks, and what helps."""
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
NO_NAMES: Final = frozenset(_WORDS["no_names"])
"""Words that no thing is called."""
EVERYDAY: Final = frozenset(_WORDS["everyday"]).union(*PHRASES)
"""Everyday words, and all that occur in phrases: never taken for a misspelling of another."""
