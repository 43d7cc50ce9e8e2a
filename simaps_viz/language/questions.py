"""Questions by what they name: how it is asked around that does not matter.

"Have you any idea how many of the cups ended up in the kitchen?" asks for a number, names cups and a place, and its
other words are of a closed class: it is put as "how many cups in the kitchen are there?".
"""

from collections.abc import Sequence
from typing import Final

from simaps_viz.language.grammar import Chart
from simaps_viz.language.nouns import IT, ONE, SAME, Phrase
from simaps_viz.language.orders import EVERYTHING, GRAMMAR
from simaps_viz.language.tokenizer import PLACING, Sentence
from simaps_viz.language.words import AROUND_QUESTIONS, NUMBERS

_PUT_AS: Final = {
    "HOWMANY": "how many {} are there?",
    "WHERE": "where is {}?",
    "ROOM": "in which room is {}?",
    "WHATCOLOR": "what colour is {}?",
    "HOWFAR": "how far is it to {}?",
    "EXIST": "is there {}?",
    "WHAT": "what is {}?",
}
"""{what is asked: how it is put}; of EXIST and WHAT only where nothing else is asked."""
_CALLED: Final[dict[str, str]] = {word: kind for kind, words in AROUND_QUESTIONS["asked"].items() for word in words}
_MOVING: Final = frozenset(AROUND_QUESTIONS["moving"])
_LIGHT: Final = frozenset(AROUND_QUESTIONS["light"])
"""Words that name nothing and limit nothing."""
_PLACING: Final = PLACING | {"NEAREST", "WITH", "WITHOUT"}
_STRANDED: Final = frozenset(["from", "with", "up", "of", "by", "at", "in"])
"""What a question may end with."""
_PUTTING: Final = frozenset(["leave", "put", "keep", "hide", "store", "place", "drop", "lay", "set", "go", "get"])
"""What was done with what is looked for; said of today, it asks where to put it."""
_FINDING: Final = tuple((verb,) for verb in ("find", "get", "see", "look", "have", "go", "keep", "might", "may"))
"""What one does."""
_LEFT: Final = frozenset(["left", "forgot", "forgotten"])
_WISHED: Final = frozenset(["need", "want", "like"])
_PRONOUNS: Final = frozenset(["it", "them", "him", "her"])
_PREPOSITIONS: Final = frozenset(
    ["round", "around", "to", "from", "of", "with", "for", "on", "in", "at", "by", "under"]
)
_OPEN: Final = (("which",), ("what",))
_GENERAL: Final = frozenset(["", "EXIST", "WHAT"])
_ARTICLES: Final = frozenset(["the", "a", "an", "any", "some", "all", "my", "our", "your", "these", "those", "of"])
_EACH: Final = frozenset(["every", "each", "both"])
_SOMEWHERE: Final = frozenset(["somewhere", "anywhere", "place", "spot", "seat"])
"""What "where" after it only tells of: "somewhere soft where I can sit"."""
_INDEFINITE: Final = frozenset(["a", "an", "any", "some", "another"])


def plain_question(sentence: Sentence) -> str:
    """Return a question in plain words, "" where it has any word that may tell something else."""
    words, chart = sentence.words, Chart(GRAMMAR, sentence.edges)
    asked, at = "EXIST" if words[0] in AROUND_QUESTIONS["opening"] else "", 0
    things, places = dict[str, str](), list[str]()  # {phrase as program text: its words}
    subject = list[str]()  # who left it there, or what went there
    while at < len(words):
        # What is asked: of two things one is the more exact, or the sentence is none of these questions.
        kind, end = _asks(sentence, at)
        if kind == "WHERE" and not _SOMEWHERE.isdisjoint(words[:at]):
            return ""
        if kind:
            if kind == asked == "HOWMANY" or (not {asked, kind} & _GENERAL and asked != kind):
                return ""
            asked, at = kind if kind not in _GENERAL or not asked else asked, end
            continue
        # What it names: the longest place or noun phrase here; any other word must say nothing of its own.
        placing = any(edge.kind in _PLACING for edge in sentence.edges[at])
        place = _longest(chart, words, "relation", at)[0] if placing and words[at + 1 : at + 2] not in _OPEN else at
        end, phrase = _longest(chart, words, "np", at)
        said, is_light = " ".join(words[at : max(place, end)]), _is_light(sentence, at, asked)
        if place > max(end, at + 1):
            places.append(said)
        elif phrase is None or (is_light and end == at + 1):
            if not is_light:
                return ""
            end = at + 1
        elif words[at - 1] == "did" and asked in ("WHERE", "ROOM", "HOWMANY"):
            subject = [said]
        elif phrase.is_room and (phrase.text != "rooms()" or asked != "HOWMANY"):
            places.append(f"in {said}")
        else:
            things[phrase.text] = said
        at = max(place, end, at + 1)
    if asked == "EXIST" and words[-1] != "?" and (words[0] not in ("is", "are", "do", "does") or "." in words[:-1]):
        return ""  # "somebody left a cup on the table", "is rubbish. Show me a bin."
    return _put(asked, [*things.values()] or subject, places)


def _is_light(sentence: Sentence, at: int, asked: str) -> bool:
    """Whether a word names nothing and limits nothing where it is."""
    word, before, words = sentence.words[at], sentence.words[at - 1] if at else ",", sentence.words
    if word in _PRONOUNS:  # "the chairs round it"
        return before not in _PREPOSITIONS or (before == "of" and "".join(words[at + 1 : at + 2]).isalnum())
    if word in _STRANDED and words[at + 1 :] in ((), ("?",)):
        return before != "been"  # "how many rooms have I been in?"
    if word in _LEFT:  # "I left it on the table" is not where it is
        return asked in ("WHAT", "HOWMANY") or before in ("been", "is", "are", "was", "were")
    if word in _MOVING and word not in _LIGHT:  # "where can I throw it? Drive to a bin."
        return asked in ("WHERE", "ROOM", "HOWFAR") and before.isalnum()
    if word in _WISHED and asked == "EXIST":
        return False
    return (
        word in _LIGHT
        or not word.isalnum()
        or any(edge.kind == "IS" for edge in sentence.edges[at])
        or (word in _PUTTING and not {"did", "map"}.isdisjoint(words))
        or (word == "out" and before in ("find", "figure", "work", "make", "point"))
        or (word == "one" and words[at + 1 : at + 2] in _FINDING)
    )


def _asks(sentence: Sentence, at: int) -> tuple[str, int]:
    """Return what is asked for by the words at a place, "" for nothing, and where they end."""
    words = sentence.words
    ends = {edge.kind: edge.end for edge in sentence.edges[at]}
    if words[at] in ("which", "what"):
        of = next((i for i in range(at + 1, len(words)) if words[i] not in ("of", "the", "all", *NUMBERS)), at)
        if words[of] in ("room", "rooms"):
            return "ROOM", of + 1
    if words[at] in _CALLED:
        return _CALLED[words[at]], at + 1 + (words[at + 1 : at + 2] in (("of",), ("on",), ("for",)))
    return max(((kind, ends[kind]) for kind in _PUT_AS if kind in ends), key=lambda ask: ask[1], default=("", at))


def _longest(chart: Chart, words: Sequence[str], name: str, at: int) -> tuple[int, Phrase | None]:
    """Return where the longest reading of a rule ends, and its value: of phrases one that names a thing itself."""
    for found in chart.parse(name, at):
        if name != "np":
            if IT in str(found.value):
                continue
            return found.end, None
        if {"have", "got"} & {*words[at : found.end]} and {"you", "we", "i"} & {*words[at : found.end]}:
            continue  # "how many cups have you got | recorded"
        if not (found.value.free or found.value.base in (ONE, SAME, EVERYTHING.base) or IT in found.value.text):
            return found.end, found.value
    return at, None


def _put(asked: str, things: list[str], places: list[str]) -> str:
    """Return the question for a thing somewhere."""
    if not things and asked in ("WHERE", "HOWFAR") and len(places) == 1 and places[0].startswith("in "):
        things, places = [places[0][3:]], []
    if not asked or len(things) != (asked != "WHAT") or (asked == "WHAT" and not places):
        return ""
    first, *more = things[0].split() if things else [""]
    if asked == "EXIST" and first in (_ARTICLES - _INDEFINITE) | _EACH:
        return ""
    bare = " ".join(more) if asked == "HOWMANY" and first in _ARTICLES else " ".join([first, *more])
    return _PUT_AS[asked].format(" ".join([bare, *places]).strip())
