"""The gist of free speech: which clauses only talk, and which words of the others say what is to be done.

It is read where the grammar cannot read all that was said. Only words that mean nothing to a robot are left out: not a
thing, room, colour, size, rank, number or direction, nor a negation or condition; and no unknown word within a noun
phrase, where it may tell which thing is meant.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

from simaps_viz.language.grammar import Chart, Edge
from simaps_viz.language.orders import GRAMMAR
from simaps_viz.language.tokenizer import PLACING, Sentence, clauses, is_reason, is_statement, read_words
from simaps_viz.language.words import PHRASES, SYNONYMS, Noun, Vocabulary

_SOFT: Final = frozenset([
    "WORD", "CLAUSE", "DET", "INDEF", "OF", "AMONG", "FROM", "TO", "FOR", "IN", "ON", "AT", "BY", "IS", "FINITE",
    "HERE", "IT", "THAT", "POSS", "MAP", "POINT", "START", "COMMA", "STOP", "ASKED", "AND", "THEN", "BUT", "DOES",
    "THROUGHOUT", "ANYWHERE", "OVER", "WHENEVER", "WITH", "AWAY",
])  # fmt: skip
"""Tokens that mean nothing beside an order or question."""
_GOING: Final = frozenset(["GO", "APPROACH", "NEED", "GOAL", "STAND", "RETURN", "KEEP", "TAKE", "GIVE", "PLACE"])
"""Tokens that send the robot somewhere."""
_HARD: Final = frozenset([
    "NOT", "NEVER", "NEITHER", "WITHOUT", "EXCEPT", "IF", "IFSEE", "IFKNOWN", "IFSO", "UNLESS", "OTHERWISE", "AVOID",
    "ONLY", "BUTNO", "BUTFIRST", "NOTBEFORE", "COLOR", "SIZE", "SUPER", "SHAPE", "ORD", "LEFT", "RIGHT", "NORTH",
    "SOUTH", "EAST", "WEST", "MOST", "NEAREST", "FARTHEST", "OTHER", "BOTH", "EVERY", "BETWEEN", "BEHIND", "FRONT",
    "UNDER", "OPPOSITE", "ROOMKIND", "ROOM", "ROOMS", "METRES", "CENTIMETRES", "DEGREES", "TWICE", "FORWARD",
    "BACKWARD", "NOTHING", "ANYTHING", "ONES", "ONE", "INTER", "MIDDLE",
])  # fmt: skip
"""Tokens that are never left out."""
_DOING: Final = frozenset([
    "HANDS", "MAKE", "LOOK", "TURN", "FACE", "CIRCLE", "PASS", "SPIN", "COUNT", "LIST", "STRAFE", "BACKUP", "HALT",
    "LEAVE", "AVOID",
])  # fmt: skip
"""Tokens of other orders, which are never left out before what can be read."""
_DRIVES: Final = (_DOING | _GOING | {"HOWMANY", "WHERE", "WHICH", "WHAT", "HOWFAR", "HOWBIG"}) - {"HANDS", "PASS"}
_ORDERS: Final = _DOING | (_GOING - {"NEED", "KEEP", "GIVE"})
_TAIL: Final = re.compile(
    r"(?<=\w)(?<!\bmuch)(?<!\bwould)(?<!\bto)(?<!where)\s+(?=(?:like (?:an?|the|my|some)|"
    r"for (?:an?|the|my|our|his|her|their|some)|before (?:the|my|our)|"
    r"until|till|where the|where (?:i|we|one) can|when the|while the|as if|just in case|so (?:i|we|that)|"
    r"(?:i|we) (?:\w+ )?(?:want|need|like|love|prefer|ask|suggest|expect)(?: that)? you)\s+\w|(?:until|till) \w+\W*$)"
)
"""Where a clause may end that says why, how or when."""
_NEGATED: Final = re.compile(
    r"\b(?:not|never|no|cannot|without|unless|if|whether)\b|n['’]?t\b(?<!want)(?<!front)(?<!plant)"
)
_ASIDE: Final = re.compile(r"\W*(?:like|for|before|until|till|where|when|whenever|while|as|because|just in case|so)\b")
EXCLAIMED: Final = re.compile(
    r"\W*(?:oh my \w+|oh no|oh dear|dear me|my \w+ness|what an? [\w ]+|"
    r"if (?:i am not mistaken|i remember (?:right|rightly|correctly)|memory serves(?: me)?)|"
    r"(?:just )?(?:one|an?|half a) (?:second|sec|moment|minute|mo|tick)|(?:(?:oh|ugh|ow|ouch|ah|oof),? )?"
    r"my (?:\w+ ){0,2}(?:feet|legs|back|head|bones|knees?|neck|arms?|poor \w+)|"
    r"(?:(?:and|then|so) )*(?:i|we) (?:will |shall )?follow(?: you)?|"
    r"(?:(?:and|so|now|just|please|come on|go on),? )*(?:(?:get|let us get|start) (?:moving|going|rolling|cracking)|"
    r"lead (?:the way|on)|off (?:you|we) \w+|no (?:dilly\W?dallying|dawdling|loitering|slacking|lingering|faffing)|"
    r"(?:(?:could|can|will|would) )?you (?:go|walk|drive) (?:first|ahead|in front)|"
    r"(?:that is|that will be) (?:all|it|everything)(?: (?:for now|i need|i want|thanks))?|chop\W*chop))\W*"
)
"""A clause that says nothing, only how somebody feels, or that it is time: "oh my goodness,", "get moving"."""
_QUESTION: Final = re.compile(r"\W*(?:(?:and|but|so) )*(?:what|where|which|who|how|is|are|do|does|can|could)\b.*\?\s*$")
_YOU: Final = re.compile(r"\byou\b")
_TO: Final = frozenset(["TO", "TOWARD", "OVER"])
_JOINED: Final = re.compile(
    r"(?:(?:,|and|then|but|also|next|first|second|last|lastly|finally|afterwards|later|after (?:that|which|it)|on|"
    r"straight|back|over|right) )+(?=\S)"
)
"""What joins a further goal to an order: "then | to the harp"."""


@dataclass(frozen=True)
class Clause:
    """A clause of what was said."""

    text: str
    sentence: Sentence
    is_talk: bool
    gist: str = ""
    """What it says is to be done, without the words around; "" where it is to be read as it is."""

    @property
    def left_out(self) -> str:
        """Return the words that its gist does without."""
        words = self.gist.split()
        return " ".join(word for word in self.sentence.words if word not in words)

    def is_told(self, *, names_things: bool) -> bool:
        """Whether it says how things are, and nothing about what is to be done."""
        return not _QUESTION.match(self.text) and is_statement(self.text, names_things=names_things)

    @cached_property
    def is_topic(self) -> bool:
        """Whether it only names one thing, of which more is said after it."""
        sentence, kinds = self.sentence, _kinds(self.sentence)
        if (
            not kinds
            or kinds[0] & (PLACING | {"WHERE", "IS"})
            or any(here & _ORDERS and "IS" not in here for here in kinds)
        ):
            return False
        if is_step(sentence) or _YOU.search(self.text):
            return False
        known = [any(_is_known(edge.value) for edge in here) for here in sentence.edges]
        chart, named = Chart(GRAMMAR, sentence.edges), range(0)
        for at in range(len(kinds)):
            ends = [one.end for one in chart.parse("thing", at) if "search(" not in one.value.text]
            if not named and ends and any(known[at : max(ends)]):
                named = range(at, max(ends))
        others = (at for at in range(len(kinds)) if at not in named)
        if named and named[0] and kinds[named[0] - 1] & (_TO | {"AT", "BY", "NEAR"}):
            return False  # "conclude it at the toaster"
        return bool(named) and not any(known[at] or kinds[at] & _HARD for at in others)


def clauses_of(text: str, vocabulary: Vocabulary, *, tails: bool) -> Iterator[Clause]:
    """Return the clauses of a text in plain words; ``tails``: what says why, how or when is a clause of its own."""
    for whole in clauses(text):
        at = 0
        for end in (*(_TAIL.finditer(whole) if tails else ()), None):
            said = whole[at : end.end() if end else len(whole)]
            at = end.end() if end else at
            sentence = read_words(said, vocabulary)
            negated = _NEGATED.search(said) is not None
            talk = is_reason(said) or EXCLAIMED.fullmatch(said) or (not negated and is_talk(said, sentence))
            yield Clause(said, sentence, bool(talk), gist(sentence) if tails and not (talk or negated) else "")


def is_talk(said: str, sentence: Sentence) -> bool:
    """Whether a clause has nothing of what may not be left out."""
    words, kinds = sentence.words, _kinds(sentence)
    where = re.match(r"\W*where (?:i|we|one) can\b", said) is not None  # "to the couch where I can read"
    if _says_nothing(sentence) or (where and not any(_is_known(e.value) for here in sentence.edges for e in here)):
        return True
    aside = _ASIDE.match(said) is not None and "you" not in words
    alike = re.match(r"\W*like (?!the\b)", said) is not None and bool(sentence.unknown)  # "like musical chairs"
    for at, here in enumerate(kinds):
        told = aside or not here.isdisjoint(_SOFT) or ("", "") in PHRASES.get((words[at],), ())
        wanted = "NEED" in here and "IT" in (*kinds, {""})[at + 1]  # "I need it for class"
        timed = at > 0 and words[at - 1] in ("in", "at")  # "call in ten"
        if (_names(sentence, at) and not alike) or not here.isdisjoint(_HARD) or not (told or wanted or timed):
            return False
        if "NUM" in here and not timed:
            return False
    joined = _JOINED.match(" ".join(words))
    opens = kinds[len(joined[0].split()) if joined else 0 :][:1]
    listed = any(not here.isdisjoint(("DET", "INDEF", "AT", "NEAR", *_TO)) for here in opens) and not aside
    if words[:1] in (("it",), ("they",)):
        return False  # "it wobbles" may tell which one
    if not sentence.unknown:  # "good day to you", but "to that"
        return all(here.isdisjoint(("IT", "THAT", "POINT", "MAP", "NEED", "WHENEVER")) for here in kinds)
    states = any(
        "IS" in here and word != "'s" for word, here in zip(words, kinds, strict=True)
    )  # not "my uncle's harp"
    return states or not listed


def is_step(sentence: Sentence) -> bool:
    """Whether a clause begins as one of several orders does, "then ..." or "first ...", and tells nothing."""
    words, kinds = sentence.words, [*_kinds(sentence), set[str]()]
    at = next((at for at, here in enumerate(kinds) if here.isdisjoint(("AND", "BUT", "COMMA"))), 0)
    if kinds[at].isdisjoint(("THEN", "ORD", "LASTLY")):
        return False
    end = max(edge.end for edge in sentence.edges[at] if edge.kind in ("THEN", "ORD", "LASTLY"))
    rest = " ".join(words[end:])
    does = not kinds[end].isdisjoint(("DET", "INDEF")) or any(
        _names(sentence, i) or here & (_ORDERS | _TO) for i, here in enumerate(kinds[:-1])
    )
    if "ORD" in kinds[at] and not does:
        return False  # "first day"
    return re.search(r"\w", rest) is not None and not is_statement(rest, names_things=False)


_MEANT: Final = frozenset({
    "NOUN", "NOUNS", "ROOMKIND", "ROOM", "ROOMS", "PLACE", "SPOT", "NUM", "IF", "IFSEE", "IFKNOWN", "UNLESS", "NEVER",
    "NOT", "WITHOUT", "EXCEPT", "OTHERWISE", "UNTIL", "NOWAIT", "BEFORE", "AFTER", "HANDS", "NOTHING",
    "BUTFIRST", "BUTNO", "NOTBEFORE", "VIA", "WHENEVER", "AVOID", "GO", "APPROACH", "TURN", "FACE", "LOOK",
    "CIRCLE", "PASS", "SPIN", "STAND", "HALT", "RETURN", "BACKUP", "LEAVE", "STRAFE", "MAKE", "KEEP", "TAKE",
    "STEPS", "UTURN", "HOWMANY", "EXIST", "SEEQ", "COUNT", "WHATCOLOR", "HOWTOGET", "WHERE", "WHICH",
    "WHAT", "HOWFAR", "HOWBIG",
})  # fmt: skip
"""Tokens of what is done, with what, and on what condition: a clause that has one of them is never only talk."""
_DONE: Final = frozenset(
    {"GO", "APPROACH", "TURN", "FACE", "LOOK", "CIRCLE", "PASS", "RETURN", "HANDS", "NEVER", "NOT", "TO"}
)
"""Tokens of what is done: a clause that has one of them is no heading."""
_OPENS: Final = frozenset(["TO", "TOWARD", "NEAR", "AT", "IN", "ON", "BY", "FOR", "FROM", "AND", "THEN"])


def _says_nothing(sentence: Sentence) -> bool:
    """Whether a clause has a word that is not known, and nothing to do, no thing, no place and no condition."""
    words, kinds = sentence.words, {edge.kind for here in sentence.edges for edge in here}
    opens = {edge.kind for edge in sentence.edges[0]} if words else set[str]()
    listed = not opens.isdisjoint(("DET", "INDEF", "EVERY")) and "IS" not in kinds  # "the sofa, the zorgon"
    heads = words[-1:] in (("!",), (":",)) and len(words) <= 4 and kinds.isdisjoint(_DONE)
    labels = words[-1:] == (":",) and len(words) <= 6 and opens.isdisjoint(_DONE)
    if (heads or labels) and sentence.unknown:  # "plant party!", "quick stock check:"
        return True
    return bool(sentence.unknown) and kinds.isdisjoint(_MEANT) and opens.isdisjoint(_OPENS) and not listed


def _kinds(sentence: Sentence) -> list[set[str]]:
    return [{edge.kind for edge in here} for here in sentence.edges[:-1]]


def _is_known(value: object) -> bool:
    """Whether it is a name of things on the map."""
    return isinstance(value, Noun) and value.known


def _names(sentence: Sentence, at: int) -> bool:
    """Whether a word names a thing that may be on the map: not somebody spoken of."""
    nouns = [edge.value for edge in sentence.edges[at] if edge.kind in ("NOUN", "NOUNS")]
    return any(noun.known or "person" not in (noun.label, *SYNONYMS.get(noun.spoken, ())) for noun in nouns)


_CUES: Final = (
    (frozenset(["WHERE"]), "where is"),
    (frozenset(["HOWMANY"]), "how many"),
    (_GOING, "go to"),
)
"""What is to be done with a thing that is named after one of some tokens."""
_THING: Final = frozenset([
    "DET", "INDEF", "NOUN", "NOUNS", "ROOMKIND", "NUM", "ONE", "EVERY", "COLOR", "SIZE", "SUPER", "ORD",
])  # fmt: skip
"""Tokens that begin a noun phrase."""
_BEING: Final = frozenset(["DOES", "IS", "KEEP", "LEAVE", "GIVE", "EXIST", "GO"])
_WANTS: Final = frozenset(["wants", "needs"])
_TO_OTHERS: Final = re.compile(
    r"(?:tell|ask|order|remind|send|instruct|beg) (?!me |us |you |yourself )(?:\w+ ){1,3}to\b"
)
"""How a clause begins that says what somebody else is to do: "tell Tom to go to the fridge"."""


def gist(sentence: Sentence) -> str:
    """Return what a clause says is to be done; "" where the grammar reads it whole, or nothing of it."""
    if not sentence.words or _TO_OTHERS.match(" ".join(sentence.words)):
        return ""
    whole = sentence
    while sentence.words and sentence.words[-1] in ".,;:!?":
        sentence = Sentence(sentence.words[:-1], (*sentence.edges[:-2], ()), ())
    heard, less = (sentence.words, sentence.edges), _without_strange(sentence)
    for words, edges in (heard, less) if less[0] != heard[0] else (heard,):
        short = Sentence(words, edges, ())
        strange, end = set(short.unknown), len(words)
        known = [
            tuple(
                e
                for e in here
                if e.end <= end and e.kind != "CLAUSE" and not (e.kind == "WORD" and words[at] in strange)
            )
            for at, here in enumerate(edges)
        ]
        chart = Chart(GRAMMAR, known)
        for at in range(end):
            if at and any(edge.kind in ("IS", "FINITE", "EXIST", "MORE") for edge in known[at]):
                continue  # "it is any of them" asks nothing, nor does "whichever stands closer to the lamp"
            opening = _opening(short, at) if at else ""
            if opening is None or not any(one.end >= end for one in chart.parse("start", at)):
                continue
            if at == 0:
                if words == sentence.words or (words[0] != sentence.words[0] and _kinds(short)[0].isdisjoint(_DRIVES)):
                    return ""  # "dim the lamp"
                return " ".join(words) + whole.words[-1] * (whole.words[-1] in "?")
            return f"{opening} {' '.join(words[at:])}".strip()
    return ""


def _without_strange(sentence: Sentence) -> tuple[tuple[str, ...], tuple[tuple[Edge, ...], ...]]:
    """Return words and edges without the words that are not known and do not tell which of several things is meant."""
    words, edges, kinds = sentence.words, sentence.edges, [*_kinds(sentence), set[str]()]
    strange, out = set(sentence.unknown), set[int]()
    for at in reversed(range(len(words))):
        after = next((i for i in range(at + 1, len(words) + 1) if i not in out), len(words))
        owned = words[at + 1 : at + 2] == ("'s",) and not kinds[min(at + 2, len(words))].isdisjoint(_THING)
        before = kinds[at - 1] if at else set[str]()
        nouns = [e.value for e in edges[after] if e.kind == "NOUN"] if after < len(words) else []
        lone = any(isinstance(noun, Noun) and noun.count == 1 for noun in nouns)
        if words[at] not in strange:
            continue
        if owned:  # "my grandson's bear"
            out |= {at, at + 1}
        elif lone or (before.isdisjoint(("DET", "INDEF", *_THING)) and not (nouns and not before & _GOING)):
            out.add(at)
    kept = [at for at in range(len(words)) if at not in out]
    place = {at: i for i, at in enumerate([*kept, len(words)])}
    moved = [tuple(replace(e, end=place[e.end]) for e in edges[at] if e.end in place) for at in kept]
    return tuple(words[at] for at in kept), (*moved, ())


def _opening(sentence: Sentence, end: int) -> str | None:
    """Return what the words before what can be read stand for, None where they may not be left out."""
    before, words, kinds = range(end), sentence.words, _kinds(sentence)
    cue, spoken = next(((c, said) for c, said in _CUES if any(kinds[at] & c for at in before)), (_GOING, ""))
    spoken = spoken or ("go to" if not _WANTS.isdisjoint(words[:end]) else "")
    soft = _SOFT | cue | (_BEING if spoken != "go to" else frozenset())
    asked = kinds[0] & {"IS", "DOES", "EXIST", "FINITE"} or words[0] in ("did", "was", "were", "had")
    if asked or words[0].endswith("ing"):
        return None  # "is it there?", "standing by the sofa, what is on your left?"
    for at in before:
        first = at == 0 and "ORD" in kinds[at] and spoken == "go to"  # "first stop of the day: ..."
        if (
            _names(sentence, at)
            or not kinds[at] & soft
            or kinds[at] & (_DOING - cue)
            or (kinds[at] & _HARD and not first)
        ):
            return None
    bare = bool(kinds[end] & _THING)
    if _may_tell(words, kinds, end, bare=bare) or not (spoken or (kinds[end] & _DRIVES and not bare)):
        return None  # "juggle in the kitchen"
    return spoken if bare else ""


def _may_tell(words: Sequence[str], kinds: Sequence[set[str]], end: int, *, bare: bool) -> bool:
    """Whether unknown words before what can be read may tell what is meant, or who is."""
    strange = ["WORD" in here for here in kinds]
    goal = _GOING | {"TO", "AT", "NEAR", "BY", "ON", "IN", "WITH"}
    if bare and kinds[end - 1] & _THING:
        return True  # "the last chairs"
    for at in range(1, end):
        if strange[at] and kinds[at - 1] & {"APPROACH", "NEED"} and not kinds[end] & _TO:
            return True  # "find flobbers in the kitchen"
        taken = "DET" in kinds[at] and strange[at + 1]
        if taken and kinds[at - 1] & {"TAKE", "GIVE", "APPROACH", "NEED"}:
            return True  # "take the parcel to the couch"
        if taken and not kinds[end] & _TO and (kinds[at - 1] & goal or (bare and all(strange[at + 1 : end]))):
            return True  # "go to the flobber by the chair", "the wobbly chair"
    return False
