"""Spoken English to the text of a robot program, offline: by a grammar, without a network."""

import keyword
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import islice, pairwise
from typing import Final

from simaps_viz.colors.classes import plain
from simaps_viz.errors import CommandError
from simaps_viz.language.gist import EXCLAIMED, Clause, clauses_of, is_step
from simaps_viz.language.grammar import Chart, InvolvedError
from simaps_viz.language.nouns import ALL, IT, LAST, ONE, SAME, SUCH, THAT, Phrase, quoted, select
from simaps_viz.language.orders import EVERYTHING, GRAMMAR, Choose, Do, Repeat, Steps
from simaps_viz.language.primitives import FUNCTIONS, SELF
from simaps_viz.language.program import ProgramError, parse_program
from simaps_viz.language.questions import plain_question
from simaps_viz.language.tokenizer import PLACING, Sentence, clauses, is_statement, is_wish, plainly, read_words
from simaps_viz.language.words import LACKS, Noun, Vocabulary, plural, singular

MAX_LENGTH: Final = 500
"""Characters of a command."""
_MAX_ALTERNATIVES: Final = 4
_MAX_QUOTED: Final = 60
"""Length to which an error message shortens the command that it quotes, characters."""
_GO_ON: Final = frozenset(
    ["a", "an", "and", "at", "for", "from", "in", "into", "of", "on", "or", "than", "that", "the", "then", "to", "with"]
)
"""Words with which no sentence ends."""
_MAX_NAME: Final = 40
"""Characters of a class that a refusal takes for an example."""
MAX_SUGGESTIONS: Final = 3
"""Commands that are offered instead of one that was refused."""
_AGAIN_AND_AGAIN = re.compile(r"\b(\d\w*)(?:\W+\1\b){15}")
"""Ranks of ranks, say, whose readings grow with every one more."""
_MARGIN: Final = 0.28
"""How much less likely than the program another reading may be."""
_END: Final = re.compile(r"(?:\W|\b(?:and|then|but|next)\b)+$")
_ENDS: Final = ("COMMA", "AND", "THEN", "STOP")
_DRIVEN: Final = frozenset(["GO", "APPROACH", "TURN", "FACE", "CIRCLE", "PASS", "RETURN", "TAKE", "LEAVE"])
"""Tokens of orders: a clause that has one of them is no mere wish."""
_SHORTLY: Final = re.compile(
    r"\b(?:each|both|all(?: of them)?|every one|the (?:nearest )?(?:\w+(?:est|most)|black|white|gr[ea]y|red|green|blue|"
    r"brown|yellow))\W*$"
)
"""The end of an order that names no thing itself: "stop at each", "go to the longest"."""
_JOINING: Final = frozenset({",", ";", ":", "and", "then", "so", "but", "or"})
_JOINED: Final = re.compile(r"^\W*(?:and|but|so)\b,?(?! (?:not|no|never|none|without|only|first|do not|don)\b)")
"""What joined an order to talk that is left out."""
_STARTS: Final = frozenset([".", "!", "?", "because", "while", "until", "i", "we", "my"])
"""Words besides those that join clauses before which a command may end."""
_DETERMINERS: Final = frozenset(["DET", "INDEF", "EVERY"])
_BEGINS: Final = _DRIVEN | {
    "LOOK", "SPIN", "HALT", "BACKUP", "STRAFE", "MAKE", "COUNT", "LIST", "HOWMANY", "WHERE", "WHAT", "WHICH", "HOWFAR",
    "HOWBIG", "EXIST", "SEEQ", "SEEWHAT", "WHATCOLOR", "HOWTOGET", "WHEREAMI", "WHATALL", "FOLLOW", "IS", "IF", "UTURN",
}  # fmt: skip
"""Tokens with which a command that is offered begins: a whole sentence, not "so a piece of cake"."""
_LOST: Final = frozenset(["left", "lost", "put", "forgot", "forgotten", "dropped", "misplaced"])
_FOUND: Final = frozenset(["somebody", "someone"])
"""Who left a thing where it still is: "somebody left a cup on the table"."""
_COMPASS: Final = frozenset(["NORTH", "SOUTH", "EAST", "WEST", "MOST"])
_ALONG: Final = re.compile(r"\W*(?:and |then )?(?:start|begin|work|end|finish|go|mov|head)\w{0,4}ing\b")
"""How a clause begins that says in which order things are visited: "starting west and working east"."""
_BEFORE_ONE: Final = frozenset(["COLOR", "SIZE", "SUPER", "MORE", "ORD", "LEFT", "RIGHT", "OTHER", *_COMPASS])
"""What comes before "one" where it stands for a thing: "the big one"."""
_TELLS: Final = frozenset(["COLOR", "SIZE", "SUPER", "MORE", "SHAPE", "NOUN", "NOUNS", "LEFT", "RIGHT"])
_NAMES: Final = frozenset(["NOUN", "NOUNS", "ROOMKIND", "ROOM", "ROOMS", "PLACE", "SPOT"])
_BARRED: Final = frozenset("🚫❌⛔🙅👎")
"""Pictures that say no, beside which nothing is left out."""


@dataclass(frozen=True)
class Reading:
    """The interpretation of a command."""

    program: str
    notes: tuple[str, ...] = ()
    """Notes on the interpretation, such as synonyms used and words added."""
    alternatives: tuple[str, ...] = ()
    """Programs of the other readings, the likeliest first."""


def read_command(text: str, labels: Sequence[str] | Mapping[str, int]) -> Reading:
    """Read an English command or question.

    A thing that the map lacks is searched for by the words used, so that running the program finds or reports it.

    Args:
        text: one or more sentences.
        labels: class names of the map, best with the number of instances of each: a word like "table" then takes in
            coffee tables where there are too few of the class "table" itself.

    Raises:
        CommandError: naming the word that was not understood, with examples that work.
    """
    if len(text) > MAX_LENGTH:
        raise CommandError(too_long(text))
    if _AGAIN_AND_AGAIN.search(text):
        raise CommandError("the same number is said again and again")
    vocabulary = Vocabulary(labels)
    found: list[Reading] = []
    refusal: CommandError | None = None
    for read in _ways_to_read(text, vocabulary):
        try:
            found.append(read())
        except InvolvedError:  # so it is, however it is read
            raise
        except CommandError as error:
            refusal = refusal or error
        else:
            # "I want toast, go to the toaster": the map has no toast
            if "search(" not in found[-1].program:
                return found[-1]
    if found:
        return min(found, key=lambda reading: reading.program.count("search("))
    suggested = instead(text, labels) or examples(labels)
    said = str(refusal) if str(refusal).endswith(("?", ".")) else f"{refusal}."
    raise CommandError(f"{said} Try: {', '.join(map(quoted, suggested))}.", suggestions=suggested)


def _ways_to_read(text: str, vocabulary: Vocabulary) -> Iterator[Callable[[], Reading]]:
    """Return what reads a text to the last word, then without asides, then by what is needed or where it is."""
    yield lambda: _understood(text, vocabulary)
    if not _BARRED.isdisjoint(text):
        return
    tried = set[tuple[str, tuple[str, ...]]]()
    said = cache(lambda tails: [*clauses_of(plainly(text), vocabulary, tails=tails)])
    for tails, short in ((False, False), (True, False), (True, True)):
        for aside in _asides(said(tails), vocabulary, short=short):
            if (aside.text, aside.left_out) not in tried:
                tried.add((aside.text, aside.left_out))
                yield partial(aside.rest, vocabulary, known=tails)
        if not short:
            yield partial(_there if tails else _need, text, vocabulary)


def _asides(said: Sequence[Clause], vocabulary: Vocabulary, *, short: bool) -> "Iterator[_Aside]":
    """Return clauses without those that say nothing about what is to be done, each time without more of them.

    "Netflix and chill: go to the sofa", "my feet hurt, so take me to the sofa", "I lost my handbag. Where is it?"
    First without talk, then without what is told, what somebody wants, and at last what is only named before more is
    said of it; ``short``: also without the words around what is to be done.
    """
    sentences = [one.sentence for one in said]
    # What is there stays, if it can be read: "we have two sofas here; go to the longer one, it fits three".
    there = [any(edge.kind == "EXIST" for here in one.sentence.edges[:2] for edge in here) for one in said]
    told = [
        one.is_talk and not (is_there and one.text.endswith(",")) for one, is_there in zip(said, there, strict=True)
    ]
    stated = [out or one.is_told(names_things=_names_things(one.sentence)) for out, one in zip(told, said, strict=True)]
    less = [out or (one and not is_there) for out, one, is_there in zip(told, stated, there, strict=True)]
    wished = [
        out or (is_wish(one.text) and not _is_driven(one.sentence)) for out, one in zip(stated, said, strict=True)
    ]
    wished[-1] &= stated[-1] or not _names_things(sentences[-1])
    topics = [out or (all(stated[:at]) and said[at].is_topic) for at, out in enumerate(stated)]
    for dropped in (told, less, stated, wished, topics):
        gist = [f"{one.gist} " if short and one.gist else one.text for one in said]
        kept = [one for one, out in zip(said, dropped, strict=True) if not out]
        if (short and any(one.sentence.unknown for one in kept if not one.gist)) or (
            dropped is topics
            and (not any(_refers(one.sentence) for one in kept) or any(is_step(one.sentence) for one in kept))
        ):
            continue
        for aside in _without(gist, sentences, dropped, vocabulary, short=short):
            without = tuple(one.left_out for one in kept if short and one.gist and one.left_out)
            yield replace(aside, left_out=(*aside.left_out, *without))


def _refers(sentence: Sentence) -> bool:
    """Whether a sentence speaks of what was named before it."""
    pairs = zip(("", *sentence.words), sentence.words, sentence.edges, strict=False)
    return any(
        e.kind in ("IT", "THAT", "ONE", "ONES") and not (word == "there" and before in ("is", "are"))
        for before, word, here in pairs
        for e in here
    )


_TO_DO: Final = re.compile(r"\b(?:(?:have|has|need|needs|want|wants|got|like) to|must|should|ought)\b")
"""What says that something is to be done."""
_LACKING: Final = re.compile(
    r"^\W*(?:(?:[\w']+ ){0,6}?(?:i|we|me|he|she|they) (?:\w+ly |really |just |quite |so )*"
    r"(?:wants?|needs?|would|could|fancy|have|must|feel|am|are|should|got|crave|buy|bought|brought)|"
    r"(?:my|our|this|these|the)(?: \w+){1,3} (?:wants?|needs?|must|ought to|has to|have to|is|are|hurts?|aches?))\b"
    r"|^\W*(?:must|time to) |^\W*\w+ (?:break|time)\W*$"
)
"""How a clause begins that says what somebody wants, or what has to be done with a thing."""
_LED: Final = re.compile(
    r"\W*(?:quick|quickly|now|fast|hurry|urgently|please)\W*$|"
    r"\W*(?:(?:and|so|then|please|now|do|just|kindly|(?:can|could|would|will) you|you) )*"
    r"(?:(?:let us |lets )?go|come|take|bring|show|lead|drive|guide|accompany|escort|walk|point|help|get|have|"
    r"head|pop)\b"
)
"""A clause that sends the robot, or who speaks, somewhere: "take me to the right spot", "... where I can warm it"."""

_WHERE: Final = re.compile(
    r"(?<!away )\b(?:for|in|on|at|near|by|under|next to|behind|beside|from|inside)\b (?=(?:the|my|our|one)\b)"
)
_ASKED: Final = re.compile(
    r"\W*(?!.*\b(?:find|see|seen)\b)(?:(?:so|and|but|then) )*(?:where (?:can|could|do|does|should|may|might|would|to)|"
    r"where is (?:the |a )?(?:machine|place|thing|spot)|which way|(?:is|are) there (?:any|some)(?:thing|where)|"
    r"what (?:can|could|should) (?:i|we)|(?:can|could|may) (?:i|we)|(?:any|some)(?:thing|where)|where(?=\W*$)|"
    r"(?:(?:an?|the|any|good|best) )*(?:place|spot) (?:for|to|where|i|we))\b"
)
"""A clause that asks where that is done: "where can I heat it?", "is there something I could put them up on?"."""

_WHERE_ASKED: Final = re.compile(r"\W*(?:(?:so|and|but|then) )*where (?:do|does|can|could|should|would|might|may)\b")
_NOT_THAT: Final = re.compile(r"\W*(?:(?:and|but|just|only) )*(?:not|nor|(?:i|we) (?:am|are) not (?:\w+ing))\b")
"""A clause that says what is not wanted: "not one of those hard chairs"."""
_LEADS: Final = re.compile(
    r"\d|\b(?:left|right(?! (?:place|spot|thing|one|device|machine|room)\b)|north|south|east|west|met(?:re|er)s?|round|"
    r"around|back)\b"
)
"""Words that say where to drive."""
_OPENLY: Final = re.compile(
    r"\b(?:where(?:ver)?|what(?:ever)?|which|(?:some|any)(?:where|thing)|place|spot|thing|device|machine|seat|way)\b"
)
"""Words for a thing that is told by what it is for."""
_NAMELESS: Final = re.compile(r"person|thing|place\b|soft seat")
"""Classes that name nothing on a map."""


def _need(text: str, vocabulary: Vocabulary) -> Reading:
    """Read what somebody needs by what is spoken of: "my shirt is filthy, take me to where I can wash it"."""
    said = [
        one for one in clauses(plainly(text)) if not (re.fullmatch(r"\W*\w{0,4}\W*", one) or EXCLAIMED.fullmatch(one))
    ]
    asked = [one for one in said if _ASKED.match(one) and (text.rstrip().endswith("?") or _WHERE_ASKED.match(one))]
    sent = [one for one in said if _sends(one, vocabulary)]
    not_ = [one for one in said if _NOT_THAT.match(one)]
    wishes = [one for one in said if one not in (*asked, *sent, *not_)]
    more = all(re.match(r"\W*(?:(?:and|so|but) )*(?:they|it|i|we|he|she|must)\b", clause) for clause in wishes[1:])
    # "the baby kept me up all night, I want to lie down": what is told before the wish says why
    told = len(wishes) > 1 and is_statement(wishes[0], names_things=False)
    lacking = (wishes and _LACKING.match(wishes[0])) or ((told or sent) and wishes and _LACKING.match(wishes[-1]))
    spoken, meant = " ".join([*wishes, *asked, *sent]), " ".join([*asked, *sent])
    kind = next((kind for kind, pattern in LACKS.items() if pattern.search(meant)), "") if _OPENLY.search(meant) else ""
    if (
        not (asked or kind or (wishes and more and lacking))
        or re.search(r"\b(?:not|never|n['’]t|if|unless)\b", spoken)
        or re.search(r"\?|\byou\b", " ".join(wish for wish in wishes if not wish.startswith("so ")))
        or any(_names_known(read_words(clause, vocabulary)) for clause in asked)
        or any(is_step(read_words(clause, vocabulary)) for clause in wishes)  # "and from there to the table"
    ):
        raise CommandError("")
    if not kind or re.search(r"\b(?:it|them|this|that)\b", meant):  # "my shirt is filthy, ... where I can wash it"
        kind = next((kind for kind, pattern in LACKS.items() if pattern.search(spoken)), "")
    noun = vocabulary.noun(kind) if kind else None
    if noun is None or not noun.known or noun.count == 0:
        raise CommandError("")
    for here in (here for one in not_ for here in read_words(one, vocabulary).edges):
        if any(isinstance(edge.value, Noun) and quoted(edge.value.label) in select(noun, ()).text for edge in here):
            raise CommandError("")  # "something to sit on, but not the couch"
    place = select(noun, ())
    if asked and not sent:  # a question moves nothing
        step = Do(('tell({0.text}, "where")',), (replace(place, text=place.single, many=False),))
    else:
        step = Do(("robot.move_to_{0.goal}",), (place,))
    brief = _in_brief(spoken.strip(" ,.;:!?"))
    return Reading(Writer().write((step,)), (f'"{brief}" is read as the wish for a {kind}',))


def _sends(clause: str, vocabulary: Vocabulary) -> bool:
    """Whether a clause sends the robot where its own words do not name: not "go to the sofa", not "go left"."""
    if not _LED.match(clause):
        return False
    sentence = read_words(clause, vocabulary)
    named = [edge.value for here in sentence.edges for edge in here if edge.kind in ("NOUN", "NOUNS", "ROOMKIND")]
    told = [one for one in named if not isinstance(one, Noun) or not _NAMELESS.match(one.spoken or one.label)]
    return not (_LEADS.search(clause) or told) and not (
        len(sentence.words) > 3 and sentence.unknown and not _OPENLY.search(clause)
    )


def _names_known(sentence: Sentence) -> bool:
    """Whether a sentence names a thing of the map."""
    named = (edge.value for here in sentence.edges for edge in here if edge.kind in ("NOUN", "NOUNS"))
    return any(n.known and not _NAMELESS.match(n.label) for n in named)


def _there(text: str, vocabulary: Vocabulary) -> Reading:
    """Read "the milk ought to be in the fridge, let us go and see": to where the first clause says that it is."""
    said = [clause for clause in clauses(plainly(text)) if re.search(r"\w", clause)]
    if len(said) != 2 or not _sends(said[1], vocabulary) or _LED.match(said[0]) or _SHORTLY.search(said[1]):
        raise CommandError("")
    where = _WHERE.search(said[0])
    if where is None or re.search(
        r"^\W*there\b|\?|\b(?:i am|we are)\b|\b(?:not|never|you|n['’]t|if|unless|or)\b", said[0]
    ):
        raise CommandError("")
    reading = _understood(f"go to {said[0][where.end() :]}", vocabulary)
    if "search(" in reading.program:
        raise CommandError("")
    return replace(reading, notes=(f'"{_in_brief(said[0].strip(" ,.;:!"))}" is read as where to go', *reading.notes))


def begins_order(text: str, labels: Sequence[str] | Mapping[str, int]) -> bool:
    """Whether the first word is one that orders or asks, and begins no name of a thing."""
    try:
        kinds = {edge.kind for edge in read_words(text[:MAX_LENGTH], Vocabulary(labels)).edges[0]}
    except CommandError:
        return False
    return not kinds.isdisjoint(_BEGINS) and kinds.isdisjoint(("NOUN", "NOUNS"))


def instead(text: str, labels: Sequence[str] | Mapping[str, int]) -> tuple[str, ...]:
    """Return up to three commands that can be read, like one that was refused; none where every word is known.

    A word that is not known, or a thing that the map lacks, gives way to what is spelled like it or of its kind, or is
    left out; or only what comes before it is kept; or the most frequent things take its place.
    """
    vocabulary = Vocabulary(labels)
    try:
        sentence = read_words(text[:MAX_LENGTH], vocabulary)
    except CommandError:
        return ()
    words, (at, end) = sentence.words, _strange(sentence)
    if end - at in (0, len(words)):
        return ()

    def readable(commands: Iterable[Sequence[str]]) -> Iterator[str]:
        for said in (_END.sub("", " ".join(command)) for command in commands):
            with suppress(CommandError):
                if "search(" in _understood(said, vocabulary).program:
                    continue
                if any(edge.kind in _BEGINS for edge in read_words(said, vocabulary).edges[0]):
                    yield said

    name = " ".join(words[at:end])
    kinds = [{edge.kind for edge in here} for here in sentence.edges]
    # only an attribute may be left out: "the double shelf", not "how many ovens do you operate"
    told = at and kinds[at - 1] & {*_DETERMINERS, *_TELLS, "NUM"} and kinds[end] & _TELLS
    near = [*filter(None, [vocabulary.suggest(name)]), *([""] if told else [])] if name in sentence.unknown else []
    frequent = sorted(vocabulary.labels, key=lambda label: -(vocabulary.count(label) or 0))[:MAX_SUGGESTIONS]
    number = str if singular(name) == name else plural
    # Another thing is offered only where a thing was named: "sing me a song" is not "chair me a song".
    is_thing = name not in sentence.unknown or (
        at and not _DETERMINERS.isdisjoint(edge.kind for edge in sentence.edges[at - 1])
    )
    likely, often = (
        [(*words[:at], *(number(plain(other)).split() if other else ()), *words[end:]) for other in others]
        for others in ([*near, *vocabulary.kin(name)], frequent)
    )
    # an order may lose where its goal is; a question would be asked of more than was meant
    joins = {*PLACING, "NEAREST", "FARTHEST", "WITH", "THAT"} if kinds[0] & {*_DRIVEN, "LOOK"} else frozenset[str]()
    ends = (n for n in range(at, 1, -1) if words[n] in {*_JOINING, *_STARTS} or kinds[n] & joins)
    before = readable(words[:n] for n in ends)
    found = [*readable(likely)] or [*islice(before, 1)] or [*readable(often if is_thing else ())]
    return tuple(dict.fromkeys(found))[:MAX_SUGGESTIONS]


def _strange(sentence: Sentence) -> tuple[int, int]:
    """Return where the first words are that are unknown or name what the map lacks, and where they end, else (0, 0)."""
    for at, edges in enumerate(sentence.edges[:-1]):
        named = [edge for edge in edges if edge.kind in ("NOUN", "NOUNS")]
        if sentence.words[at] in sentence.unknown or (named and not any(edge.value.known for edge in named)):
            return at, max([at + 1, *(edge.end for edge in named)])
    return 0, 0


def _understood(text: str, vocabulary: Vocabulary, named: Phrase | None = None) -> Reading:
    """Read a command to the last word; ``named`` is what was spoken of before it."""
    sentence = read_words(text, vocabulary)
    if not sentence.words:
        raise CommandError("nothing to do was said")
    # Where words are unknown, spelling is corrected, if the command can be read then.
    if sentence.unknown:
        with suppress(CommandError):
            better = read_words(text, vocabulary, correcting=True)
            if better.words != sentence.words:
                return _read(better, vocabulary, named)
    try:
        return _read(sentence, vocabulary, named)
    except CommandError:
        if plain := plain_question(sentence):
            with suppress(CommandError):
                reading = _read(read_words(plain, vocabulary), vocabulary, named)
                if reading.program.startswith("tell("):
                    return replace(reading, notes=(f'read as "{plain}"', *reading.notes))
        raise


@dataclass(frozen=True)
class _Aside:
    """A text without clauses that say nothing about what is to be done."""

    text: str
    left_out: tuple[str, ...]
    sentences: tuple[Sentence, ...] = ()
    """The clauses that are left out."""
    named: Phrase | None = None
    """What they name."""

    def rest(self, vocabulary: Vocabulary, *, known: bool = False) -> Reading:
        """Read the text; ``known``: only where the map has the things that the robot is sent to.

        Raises:
            CommandError: it cannot be read, or what is left out tells which of several things is meant.
        """
        reading = _understood(self.text, vocabulary, self.named)
        if unsaid := self._unsaid(reading.program, vocabulary):
            raise CommandError(f'Not understood: "{_in_brief(unsaid)}". What it says of a thing was not heard')
        if "search(" in reading.program and any(map(_names_known, self.sentences)):
            raise CommandError("")  # "how many portholes, windows I should say, are there"
        if known and "search(" in reading.program and not re.search(r"^(?:tell\(|if )", reading.program, re.MULTILINE):
            raise CommandError("")
        said = re.findall(r'"([^"]*)"', reading.program)
        if any((vocabulary.count(label) or 0) > 1 or vocabulary.count(label) is None for label in said):
            for clause in self.sentences:
                if _tells_apart(clause, reading.program):
                    raise CommandError(f'"{" ".join(clause.words)}"')
        if any(_is_step(clause, reading.program) for clause in self.sentences):
            raise CommandError("")
        notes = [f'"{_in_brief(one)}" is left out: it names nothing to do' for one in self.left_out]
        return replace(reading, notes=(*notes, *reading.notes))

    def _unsaid(self, program: str, vocabulary: Vocabulary) -> str:
        """Return the first of what is left out that says which of the things meant are, or in which order; else ""."""
        for clause in self.sentences:
            said = " ".join(clause.words)
            compass = any(edge.kind in _COMPASS for here in clause.edges for edge in here)
            if compass and _ALONG.match(said):
                return said
            if _SHORTLY.search(self.text) and _names_things(clause) and _more_named(clause, program, vocabulary):
                return said
        return ""


def _more_named(clause: Sentence, program: str, vocabulary: Vocabulary) -> bool:
    """Whether a clause names a room or thing of the map that a program does not have."""
    for here in clause.edges[:-1]:
        rooms = [edge for edge in here if edge.kind == "ROOMKIND"]
        nouns = [edge.value for edge in here if edge.kind in ("NOUN", "NOUNS") and isinstance(edge.value, Noun)]
        if (rooms and "room(" not in program) or (
            nouns and all(n.known and n.count and not _is_place_or_in(n, program) for n in nouns)
        ):
            return True
    return False


def _tells_apart(clause: Sentence, program: str) -> bool:
    """Whether a clause has a colour and a program none, or speaks of "the big one", "it" or "they" and how it is."""
    if clause.words[:1] == ("forget",):  # "actually the big one, forget the little one"
        return False
    if re.search(r"\bthe \w+(?:er|est) (?:of|one)\b", " ".join(clause.words)):
        return True
    back, before = False, set[str]()
    for at, here in enumerate(clause.edges[:-1]):
        kinds = {edge.kind for edge in here}
        # "The red chair is broken, go to the yellow one" has a colour of its own.
        if kinds == {"COLOR"} and "colored(" not in program:
            return True
        placed = clause.words[max(at - 2, 0) : at] in (("was", "the"), ("is", "the")) and not PLACING.isdisjoint(
            edge.kind for edge in clause.edges[at + 1]
        )  # "it was the one in the bedroom"
        if at and not kinds.isdisjoint(("ONE", "ONES")) and (before & _BEFORE_ONE or placed):
            return True
        if back and not kinds.isdisjoint(_TELLS) and not any(_is_place_or_in(edge.value, program) for edge in here):
            return True
        back |= at < 2 and clause.words[at] in ("it", "they", "that", "this", "these", "those") and "IT" in kinds
        before = kinds
    return False


def _is_step(clause: Sentence, program: str) -> bool:
    """Whether a clause says of a thing that the program lacks that it is meant, not meant, or comes next."""
    kinds = [{edge.kind for edge in here} for here in clause.edges[:-1]]
    while kinds and kinds[-1] <= {"STOP", "COMMA"}:
        kinds.pop()
    if not kinds or not (kinds[0] & {"NOWAIT", "AVOID"} or kinds[-1] & {"AFTER", "THEN", "LASTLY", "ORD"}):
        return False
    nouns = [edge.value for here in clause.edges for edge in here if edge.kind in ("NOUN", "NOUNS")]
    return any(one.known and not _is_place_or_in(one, program) for one in nouns)


def _is_place_or_in(value: object, program: str) -> bool:
    """Whether a noun is what somebody lacks ("it looks thirsty") or one that a program names."""
    return isinstance(value, Noun) and (value.label.startswith("place ") or quoted(value.label) in program)


def _without(
    said: Sequence[str],
    sentences: Sequence[Sentence],
    dropped: Sequence[bool],
    vocabulary: Vocabulary,
    *,
    short: bool = False,
) -> Iterator[_Aside]:
    """Return what is left of a text, if anything is left out and anything is left."""
    torn = any(
        out and clause.endswith(",") and not {edge.kind for edge in after.edges[0]}.isdisjoint(PLACING)
        for clause, out, after, kept in zip(said, dropped, sentences[1:], dropped[1:], strict=False)
        if not kept
    )  # "the backpack was on the floor, near the table" is one thing told
    torn |= any(
        out
        and not kept
        and _TO_DO.search(clause)
        and re.match(r"\W*(?:and |but )*(?:then|after that|afterwards)\b", after)
        for clause, after, out, kept in zip(said, said[1:], dropped, dropped[1:], strict=False)
    )  # "I have to print something, after that I need a coffee": the first of two steps
    kept = [one for one, out in zip(sentences, dropped, strict=True) if not out]
    torn |= any(
        _names_things(before) and any(edge.kind == "ON" for edge in after.edges[0]) for before, after in pairwise(kept)
    )  # "I want to sit at the table, on the chair by the fridge, it hums"
    torn |= any(
        out and not kept and after.startswith("for ") and clause.rstrip()[-1:].isalnum()
        for clause, after, out, kept in zip(said, said[1:], dropped, dropped[1:], strict=False)
    )  # "order new paper for the printer"
    torn |= any(out and is_step(sentence) for sentence, out in zip(sentences, dropped, strict=True))
    left = _carried(said, sentences, dropped, vocabulary) if (short or any(dropped)) and not torn else None
    if left and left.strip():
        left = _JOINED.sub("", left)
        left_out = [at for at, out in enumerate(dropped) if out and sentences[at].words]
        told = ""
        for at in left_out:  # one note on all that is left out in a row
            told += said[at] + ("" if at + 1 in left_out and not re.search(r"[.!?]\s*$", said[at]) else "\n")
        brief = tuple(one.strip(" ,.;:!") for one in told.split("\n") if re.search(r"\w", one))
        clauses_out = tuple(sentences[at] for at in left_out)
        named = next((found for clause in clauses_out if (found := _first_named(clause))), None)
        yield _Aside(left, brief, clauses_out, named)


def _is_driven(sentence: Sentence) -> bool:
    """Whether a sentence speaks of driving somewhere: not "I want to pass"."""
    kinds = {edge.kind for here in sentence.edges for edge in here if edge.kind not in ("STOP", "COMMA", "WORD", "TO")}
    driven = any(
        edge.kind in _DRIVEN and edge.value != "be" and not any(e.kind == "HANDS" and e.end >= edge.end for e in here)
        for before, here in zip(((), *sentence.edges), sentence.edges, strict=False)
        for edge in here
        if not any(e.kind in _DETERMINERS for e in before)  # "the view"
    )
    return driven and not kinds <= _DRIVEN


def _names_things(sentence: Sentence) -> bool:
    """Whether a sentence names a room, or a thing that may be on the map."""
    named = (edge for here in sentence.edges for edge in here if edge.kind in _NAMES)
    return any(not isinstance(edge.value, Noun) or edge.value.known for edge in named)


def _carried(
    said: Sequence[str], sentences: Sequence[Sentence], dropped: Sequence[bool], vocabulary: Vocabulary
) -> str | None:
    """Return what is left of a text, in which "the chair" is the one that what is left out told of.

    None where several of that name were told of, or it was not told which one.
    """
    clauses_of = [*zip(said, sentences, dropped, strict=True)]
    told: dict[str, dict[str, bool]] = {}
    for clause, sentence, out in clauses_of:
        for label, spoken, is_bare in _named_in(sentence) if out and not is_wish(clause) else ():
            told.setdefault(label, {})[spoken] = is_bare
    left, is_begun = "", False
    for clause, sentence, out in clauses_of:
        here = "" if out else f"{clause} "
        if not out:
            goes_on = not {edge.kind for edge in sentence.edges[0]}.isdisjoint(("TO", "TOWARD", "OVER", *PLACING))
            if is_begun and goes_on:  # "drive, nice and easy, to the desk"
                left = left.rstrip(" ,") + " "
            is_begun = clause.endswith(",") and not _names_things(sentence)
        for label, spoken, is_bare in () if out or not told else _named_in(sentence):
            if label in told and is_bare and vocabulary.count(label) != 1:
                if len(told[label]) > 1 or any(told[label].values()) or spoken.split()[0] in ("a", "an", "any"):
                    return None
                here = re.sub(rf"\b{re.escape(spoken)}\b", next(iter(told[label])), here)
        left += here
    return left


def _named_in(sentence: Sentence) -> Iterator[tuple[str, str, bool]]:
    """Return the class of each single thing that is named, the words for it, and whether these do not say which."""
    chart, noun_at = Chart(GRAMMAR, sentence.edges), -1
    for at, edges in enumerate(sentence.edges[:-1]):
        kinds = {edge.kind for edge in edges}
        if at <= noun_at or kinds.isdisjoint(("NOUN", "THAT", "ONE", *_DETERMINERS)):
            continue
        found = (one for one in chart.parse("thing", at) if "search(" not in one.value.text)
        ends = [one for one in found if ALL.search(one.value.base) and not one.value.many]
        if ends:
            one = max(ends, key=lambda one: one.end)
            nouns = (i for i in range(at, one.end) if any(edge.kind == "NOUN" for edge in sentence.edges[i]))
            noun_at = next(nouns, at)
            is_bare = ALL.fullmatch(one.value.text) or "only(" in one.value.text or THAT.match(one.value.text)
            yield one.value.base[8:-2], " ".join(sentence.words[at : one.end]), bool(is_bare)


def _first_named(sentence: Sentence) -> Phrase | None:
    """Return the first thing that a clause names, with all that is said of it unless it is no longer there."""
    chart = Chart(GRAMMAR, sentence.edges)
    lost = not _LOST.isdisjoint(sentence.words) and _FOUND.isdisjoint(sentence.words)
    for at in range(len(sentence.words)):
        found = [one.value for name in ("thing", "room") for one in chart.parse(name, at)]
        if sentence.words[at : at + 3] == ("the", "thing", "that"):
            return None  # "the thing that tells the time in the office" is not the office
        found = [
            one
            for one in found
            if not re.search(r"‹|\b(?:search|only)\(|\brooms?\(\)", one.text)
            and one.base != EVERYTHING.base
            and one.word != "thing"
        ]
        if found:
            return found[-1 if lost else 0]
        lost = lost and _DETERMINERS.isdisjoint(edge.kind for edge in sentence.edges[at])
        # "I left my glasses on the desk with the lamp": that desk
    return None


def too_long(text: str) -> str:
    """Return the error for a command that is too long, with a way to shorten it."""
    return (
        f"This command has {len(text)} characters, and at most {MAX_LENGTH} can be read. "
        "Say it in fewer words, or give one command after the other."
    )


def examples(labels: Iterable[str]) -> tuple[str, ...]:
    """Return commands that work on a map with these classes."""
    names = [plain(label) for label in labels if len(label) <= _MAX_NAME] or ["chair"]
    first, other = names[0], names[min(1, len(names) - 1)]
    return f"go to the {first}", f"go to the {first} nearest the {other}", "turn right, then go forward 1 m"


def _read(sentence: Sentence, vocabulary: Vocabulary, named: Phrase | None) -> Reading:
    chart = Chart(GRAMMAR, sentence.edges)
    try:
        readings = [found for found in chart.parse("start") if found.end == len(sentence.words)]
    except RecursionError:
        raise CommandError("Too much is said in one sentence; say it in several.") from None
    if not readings:
        raise CommandError(_refusal(sentence, chart, vocabulary))
    # The likeliest reading that makes sense is the program; the others and the other meanings of words come after it.
    programs: dict[str, Writer] = {}
    refusal: CommandError | None = None
    for reading in sorted(readings, key=lambda r: r.cost):
        if programs and reading.cost > readings[0].cost + _MARGIN:
            break
        writer = Writer(named)
        try:
            program = writer.write(reading.value)
            parse_program(program)
            if unheard := _unheard(sentence, program):
                raise CommandError(f'Not understood: "{unheard}". What it says of a thing was not heard')
            if _goes_again(sentence, program, listed=writer.listed):
                raise CommandError("which of the things named are to be visited, in which order, was not understood")
            programs.setdefault(program, writer)
        except ProgramError:
            said = _in_brief(" ".join(sentence.words))
            refusal = refusal or CommandError(f'Not understood: "{said}". Say it in other words, or in several steps')
        except CommandError as error:
            refusal = refusal or error
    if not programs:
        raise refusal or CommandError("nothing to do was said")
    program, writer = next(iter(programs.items()))
    others = list(programs)[1:]
    others += [program.replace(quoted(one), quoted(other)) for one, other in writer.others]
    kept = tuple(dict.fromkeys(other for other in others if other != program))
    return Reading(program, (*sentence.notes, *writer.notes), kept[:_MAX_ALTERNATIVES])


_AGAIN: Final = frozenset(["again", "back", "return", "home", "twice", "once", "times", "lap", "laps", "more"])
_FIRST_OF: Final = re.compile(
    r'^for (\w+) in order\(.*?things\(("[^"]+")\).*, "first", .*:\n +robot\.move_to_object\(\1\)\n'
    r"robot\.move_to_object\((?:first|nearest|colored)\(.*things\(\2\)",
    re.MULTILINE,
)
"""All of some things, one of them first, and then one of them again: "the left one first, then the right one"."""
_COLORED: Final = re.compile(r'colored\(things\(("[^"]+")\), ("[^"]+")\)')

_BARE: Final = re.compile(r'tell\(side\(things\("[^"]+"\), "(?:north|south|east|west)"\)')
"""A question about a side of the robot."""


def _goes_again(sentence: Sentence, program: str, *, listed: bool) -> bool:
    """Whether a program goes again to what it has been to, though nobody said "again"; ``listed``: without a verb.

    Also whether it leaves out those after "the grey ones first", or asks of a side of the robot
    after "at the table".
    """
    if not _AGAIN.isdisjoint(sentence.words):
        return False
    before, _, last = program.rpartition("\n")
    been = listed and any(
        f"things({thing})" in last and f", {color})" in last for thing, color in _COLORED.findall(before)
    )
    halved = sentence.words[0] in ("at", "around", "round") and _BARE.search(program)
    rest = sentence.words[-3:-1] == ("ones", "first") and '"first"' not in program
    return bool(been or rest or halved or _FIRST_OF.search(program))


_STRUCK: Final = frozenset(["NOWAIT", "NEVER", "NOT", "NEITHER", "EXCEPT", "MEANT"])


def _unheard(sentence: Sentence, program: str) -> str:
    """Return the first colour or thing that was said and that a program says nothing of; "" where there is none."""
    if any(edge.kind in _STRUCK for here in sentence.edges for edge in here):
        return ""
    at = 0
    while at < len(sentence.words):
        here = sentence.edges[at]
        end = max(edge.end for edge in here)
        longest = [edge for edge in here if edge.end == end]
        kinds = {edge.kind for edge in longest}
        asked = '"color"' in program  # "is the couch red or blue?"
        if kinds == {"COLOR"} and not asked and not any(quoted(edge.value) in program for edge in longest):
            return " ".join(sentence.words[at:end])
        if kinds <= {"NOUN", "NOUNS"}:
            noun = longest[0].value
            seats = ("seat",) if noun.label == "person" else ()  # "a table for six people"
            names = (noun.label, noun.spoken, noun.wide, *noun.others, *seats)
            within = f' {noun.spoken}")'  # of search("pool table")
            if within not in program and not any(quoted(name) in program for name in names):
                return " ".join(sentence.words[at:end])
        at = end
    return ""


def _refusal(sentence: Sentence, chart: Chart, vocabulary: Vocabulary) -> str:
    """Name the one word that was not understood, or what the order lacks."""
    words, edges, at = sentence.words, sentence.edges, min(chart.furthest, len(sentence.words))
    if chart.refusal is not None and chart.refusal[0] >= at:
        return f"Not understood: {chart.refusal[1]}."
    starts = [i for i in range(len(words)) if i == 0 or any(e.kind in _ENDS for e in edges[i - 1])]
    begins = max((i for i in starts if i <= at), default=0)
    kinds = {edge.kind for edge in edges[begins]}
    clause = _in_brief(" ".join(words[begins:]))
    if any(edge.kind in ("AVOID", "NEVER") for here in edges[begins : at + 1] for edge in here):
        return f'Not understood: "{clause}". A command says what to do, not what to leave out.'
    if kinds & {"HANDS", "TAKE"}:
        can = "The robot has no hands and carries nothing: it can drive, turn, look, and answer questions."
        return f'Not understood: "{clause}". {can}'
    if sentence.unknown:
        unknown = next((word for word in (words[begins], *words[at:]) if word in sentence.unknown), sentence.unknown[0])
        near = vocabulary.suggest(unknown)
        hint = f" Did you mean {near}?" if near else ""
        return f'Not understood: "{_in_brief(unknown)}".{hint}'
    if at >= len(words):
        or_else = "" if len(words) - begins == 1 or words[-1] in _GO_ON else ", or is no order that is known"
        return f'Not understood: "{clause}" seems to be cut short{or_else}.'
    return f'Not understood: "{_in_brief(words[at])}" in "{clause}".'


def _in_brief(said: str) -> str:
    return said if len(said) <= _MAX_QUOTED else f"{said[: _MAX_QUOTED - 1].rstrip()}…"


# ---- steps to program text

_INDENT: Final = "    "
_AT_LEAST: Final = re.compile(r"count\(\{0\.text\}\) >= (\d+)")
_ROOM_OF: Final = re.compile(r'inside\(.*, (room\("[^"]+"\))\)')
_IT: Final = Phrase(IT, ONE, "thing")


@dataclass
class _Mention:
    """A thing, or several, named in a program."""

    phrase: Phrase
    name: str = ""
    """Its variable: set where it is named again, and for each thing of a loop."""
    body: "list[_Line] | None" = None
    """The lines of its loop."""
    assigned: bool = False
    line: "_Line | None" = None
    """The line that names it first."""
    needs: "tuple[_Mention, ...]" = ()
    """What its phrase refers to by a variable."""
    absent: bool = False
    """Whether there is none where it is spoken of again."""
    first: "_Line | None" = None
    """The line before which it gets its variable, where that is an earlier one."""

    def __getattr__(self, attribute: str) -> str:
        """Return ``text``, ``argument``, ``arguments`` or ``goal`` of its phrase, or the same of its variable."""
        named = f"object({self.name})" if attribute == "goal" else self.name
        return named if self.name else getattr(self.phrase, attribute)

    def __str__(self) -> str:
        return self.arguments


@dataclass
class _Line:
    text: str
    mentions: tuple[_Mention, ...] = ()
    body: "list[_Line]" = field(default_factory=list)
    before: tuple[_Mention, ...] = ()
    """Things that need their variables before this line."""


class Writer:
    """Writes one program, step by step.

    Args:
        named: what was spoken of before.
    """

    def __init__(self, named: Phrase | None = None) -> None:
        self._lines: list[_Line] = []
        self._names: dict[str, int] = {"robot": 1}
        self._last: _Mention | None = _Mention(named) if named else None
        self._all: list[_Mention] = [self._last] if self._last else []
        self._line: _Line | None = None
        self._block: list[_Line] | None = None
        """The last line of the program, and the lines it stands among."""
        self._verb = "go"
        self._bare = self._told = False
        """Whether things were named without a verb, and whether anything was asked."""
        self.notes: list[str] = []
        self.others: dict[tuple[str, str], None] = {}

    @property
    def listed(self) -> bool:
        """Return whether things were named without a verb."""
        return self._bare

    def write(self, steps: Steps) -> str:
        """Return the program of some steps.

        Raises:
            CommandError: "it" or "one" was said, and nothing before.
        """
        before = self._last
        self._add(steps, self._lines)
        if before is not None:
            self._lines[0].before += (before,)
        return "\n".join(_text(self._lines, ""))

    def _add(self, steps: Steps, lines: list[_Line]) -> None:
        tested: _Mention | None = None
        for step, after in zip(steps, (*steps[1:], None), strict=True):
            match step:
                case Do():
                    self._do(step, lines)
                case Repeat(times=times, steps=inner):
                    numbers = ", ".join(str(n + 1) for n in range(times))
                    loop = _Line(f"for {self._fresh('turn')} in [{numbers}]:")
                    lines.append(loop)
                    self._add(inner, loop.body)
                case Choose(test=test, phrases=phrases, then=then, otherwise=otherwise):
                    first: tuple[_Mention, ...] = ()
                    head = then[0]
                    more = _AT_LEAST.fullmatch(test)
                    if (
                        more
                        and isinstance(after, Choose)
                        and after.phrases[0].base == SAME
                        and int(after.test.split()[-1]) > int(more[1])
                    ):  # "if there are two, ...; if there are three, ..."
                        test = test.replace(">=", "==")
                    if tested and phrases[0].base == SAME:  # "if there are two beds, ...; if there is only one, ..."
                        self._last = tested
                    if (
                        step.after
                        and isinstance(head, Do)
                        and head.phrases
                        and any(IT in phrase.text for phrase in phrases)
                    ):
                        # "go to the sofa if it is free": the sofa is named in what is done.
                        self._mention(head.phrases[0])
                        first = (self._named("it"),)
                        then = (replace(head, phrases=(_IT, *head.phrases[1:])), *then[1:])
                    mentions = tuple(self._mention(phrase) for phrase in phrases)
                    tested = mentions[0]
                    for line, inner in ((f"if {test}:", then), ("else:", otherwise)):
                        if inner:
                            lines.append(_Line(line, mentions, before=first))
                            for one in mentions:
                                one.absent = test.endswith("== 0") and inner is then
                            self._last = (*first, *mentions, self._last)[0]
                            self._add(inner, lines[-1].body)

    def _do(self, step: Do, lines: list[_Line]) -> None:
        if not step.lines:  # what is only spoken of
            self._mention(step.phrases[0])
            return
        if not step.verb:
            self._bare = True
            call = "robot.face({0})" if self._verb == "face" else "robot.move_to_{0.goal}"
            step = Do((call,), step.phrases, step.notes, self._verb)
        self._told |= step.lines[0].startswith("tell(")
        if self._bare and self._told:  # a question moves nothing but what an order beside it moves
            raise CommandError("what is to be told or done with the last things was not said")
        self._verb = step.verb
        self._note(step.notes)
        again = self._last if any(IT in p.text or THAT.search(p.text) for p in step.phrases) else None
        if again is not None and again.body is not None:
            lines = again.body
        before = self._last
        each = not step.lines[0].startswith("tell(")
        mentions = tuple(self._mention(phrase, several=each and not phrase.any) for phrase in step.phrases)
        at_once = before is not None and before.line is not None and before.line is self._line and lines is self._block
        if before is not None and before.line and at_once and _contrasts(before.phrase, mentions):
            # "the left chair and then the right one": both are meant from where the robot is before the first.
            mentions[0].name = self._fresh(_identifier(mentions[0].phrase.word))
            mentions[0].first = before.first or before.line
            mentions[0].first.before += mentions
        for mention in mentions[:1]:
            if mention.phrase.many and not mention.name:
                mention.name = self._fresh(_identifier(mention.phrase.word))
                mention.assigned = True
                loop = _Line(f"for {mention.name} in {mention.phrase.text}:", tuple(mentions[1:]), [], mention.needs)
                lines.append(loop)
                lines = mention.body = loop.body
        # A line that ends in a colon takes the indented lines after it.
        for line in step.lines:
            inner = lines[-1].body if line.startswith(_INDENT) else lines
            self._line = _Line(line.strip(), mentions)
            inner.append(self._line)
        self._block = lines
        for mention in mentions:
            mention.line = mention.line or self._line

    def _mention(self, phrase: Phrase, *, several: bool = False) -> _Mention:
        """Return what a phrase means after those before it; ``several``: each of them, where several were meant."""
        self._note(phrase.notes)
        self.others.update(dict.fromkeys(phrase.others))
        last = self._last
        if phrase.text == IT:
            return self._it(phrase, several=several)
        that = THAT.fullmatch(phrase.text)
        if that:
            return self._called(that[1], that[2], lone=phrase.lone)
        text, base, word = phrase.text, phrase.base, phrase.word
        text = self._with_such(text)
        for that in THAT.finditer(text):
            text = text.replace(that[0], self._name_of(self._called(that[1], that[2], lone=False)))
        if IT in text:
            text = text.replace(IT, self._named("it").name)
        if base in (SAME, ONE):
            before = self._named("one", name=False).phrase
            # "if there are two chairs at the desk ...; if there is only one", "... go to the one on the left"
            alone = base == ONE and not (phrase.among and before.together)
            meant = before.base if alone else before.whole or before.text
            if base == SAME != text and not (before.many or before.together):
                raise CommandError(f"which {before.word} is meant was not said")
            text, base, word = text.replace(base, meant), before.base, before.word
        text = text.replace(ONE, base)
        if LAST in text:
            same = last is not None and last.phrase.base == base and last.body is None
            if not same:
                if phrase.many:  # "every other chair" may be the second, the fourth and so on
                    raise CommandError(f"which {word} the other ones are not was not said")
                self._note((f"the other {word} is read as all but the closest",))
            text = text.replace(LAST, self._named("it").name if same else f"nearest({base})")
        text = text.replace(ONE, before.base) if ONE in text and (before := last and last.phrase) else text
        if ONE in text or LAST in text:
            raise CommandError('"one" was not understood: which things are meant was not said before it')
        return self._new(replace(phrase, text=text, base=base, word=word))

    def _it(self, phrase: Phrase, *, several: bool) -> _Mention:
        last = self._last
        if phrase.word == "it" and last and last.phrase.together and len(last.phrase.inner) == 1:
            return self._new(last.phrase.inner[0])  # "if there are two chairs at the table, go to it"
        if several and last and last.phrase.many and not (last.line or last.name):
            return self._new(last.phrase)  # "there are two beds: go to each of them"
        return self._named("it")

    def _with_such(self, text: str) -> str:
        """Return text with what the sentence before named, or the room it was said to be in."""
        if SUCH in text:
            text = text.replace(SUCH, self._named("one", name=False).phrase.base)
        said_in = _ROOM_OF.search(self._last.phrase.text) if self._last else None
        # "if nobody is in the kitchen, go into that room"
        return said_in[1] if said_in and text == f"room({IT})" else text

    def _new(self, phrase: Phrase) -> _Mention:
        """Return a new mention, which is what "it" means from now on."""
        self._last = _Mention(phrase, needs=tuple(one for one in self._all if one.name and one.name in phrase.text))
        self._all.append(self._last)
        return self._last

    def _called(self, word: str, base: str, *, lone: bool) -> _Mention:
        """Return what was named last by a word, as "that desk" was, or the desk that what was named last is at."""
        for one in reversed(self._all):
            if one.phrase.base == base or f" {one.phrase.word}".endswith(f" {word}"):
                self._name_of(one)
                self._last = one
                return one
            for inner in one.phrase.inner:
                if inner.base == base or f" {inner.word}".endswith(f" {word}"):
                    things = inner.whole or inner.text
                    if one.absent:  # "unless there is a dog on the sofa, go to that sofa"
                        return self._new(inner)
                    within = f"having({things}, {self._name_of(one)})"
                    return self._new(replace(inner, base=things, text=within, whole="", many=False))
        if not lone:
            raise CommandError(f"which {word} is meant was not said")
        return self._new(Phrase(base, base, word, lone=True))

    def _named(self, word: str, *, name: bool = True) -> _Mention:
        if self._last is None:
            raise CommandError(f'"{word}" was not understood: nothing was named before it')
        if name:
            self._name_of(self._last)
        return self._last

    def _name_of(self, mention: _Mention) -> str:
        """Return the variable of a mention; it gets one where it has none."""
        mention.name = mention.name or self._fresh(_identifier(mention.phrase.word))
        return mention.name

    def _fresh(self, name: str) -> str:
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name}_{self._names[name]}"

    def _note(self, notes: Sequence[str]) -> None:
        self.notes += [note for note in notes if note not in self.notes]


def _contrasts(before: Phrase, mentions: Sequence[_Mention]) -> bool:
    """Whether a thing is told from the one named before it by its place among the things of that name."""
    if len(mentions) != 1 or mentions[0].name or mentions[0].phrase.base != before.base or before.many:
        return False
    return mentions[0].phrase.text.startswith(("nth(", "first(", "last(", "farthest("))


def _text(lines: Sequence[_Line], indent: str) -> list[str]:
    found: list[str] = []

    def assign(mention: _Mention, line: _Line) -> None:
        """Assign what is named again to a variable, before the line that names it first."""
        for other in mention.needs:
            assign(other, line)
        if mention.name and not mention.assigned:
            mention.assigned = True
            tested = line.text.startswith("if ") and mention not in line.before
            found.append(f"{indent}{mention.name} = {mention.phrase.text if tested else mention.phrase.single}")

    for line in lines:
        for mention in (*line.before, *line.mentions):
            assign(mention, line)
        found.append(indent + (line.text.format(*line.mentions) if line.mentions else line.text))
        found += _text(line.body, indent + _INDENT)
    return found


def _identifier(word: str) -> str:
    """Return a name a program can use for a thing."""
    name = re.sub(r"\W+", "_", word.lower()).strip("_")
    if not (name.isidentifier() and name.isascii()) or keyword.iskeyword(name) or name in FUNCTIONS or name == SELF:
        return "thing"
    return name
