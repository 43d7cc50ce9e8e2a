"""Words to tokens: at each place of a sentence, every way to read the words there.

What is said around orders and questions, such as politeness, reasons and small talk, is left out before.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

from simaps_viz.colors.naming import COLOR_WORDS
from simaps_viz.errors import CommandError
from simaps_viz.language.grammar import Edge
from simaps_viz.language.program import MAX_NUMBER
from simaps_viz.language.words import (
    ACTIVITIES,
    COMPASS_POINTS,
    KNOWN_THINGS,
    MAX_PHRASE,
    NEEDS,
    NUMBERS,
    ORDINALS,
    PHRASES,
    PLACES,
    SPELLED,
    VERBS,
    WISHES,
    Vocabulary,
    correct,
    load_text,
    read_number,
    read_rank,
    third_person,
    written_out,
)

_SOFTLY: Final = r"(?:(?:please|kindly|possibly|perhaps|maybe|just|really|simply|also|by any chance|even|\w+ly)\s+)*"
_PAST: Final = {
    "went": "go", "came": "come", "drove": "drive", "took": "take", "brought": "bring", "told": "tell",
    "stood": "stand",
    "moved": "move", "rolled": "roll", "headed": "head", "stopped": "stop", "turned": "turn", "looked": "look",
    "waited": "wait", "parked": "park", "showed": "show", "walked": "walk", "faced": "face", "visited": "visit",
}  # fmt: skip
_WISHED: Final = re.compile(rf"\b(if|rather|sooner|time|wish) you (?:{_SOFTLY})({'|'.join(_PAST)})\b")
"""What is wished for in the past tense: "I would be glad if you went"."""
_IS: Final = re.compile(r"\b(that|it|there|what|where|here|which|who|how)['’]s\b")
_YOURSELF: Final = re.compile(
    r"(?:^|(?<=[,.;!] )|(?<=then ))(\w+) yourself(?= (?:right |directly |down |just )?"
    r"(?:in|into|between|beside|next|near|by|at|under|behind|on|to|over|along|across)\b)"
)
_KNOWN: Final = frozenset(
    words for words, found in PHRASES.items() if len(words) == 1 and any(kind for kind, _ in found)
)
"""Words that say something of their own, as "turn" and "clean" do; "plonk yourself" only says where to go."""
_WORD: Final = re.compile(r"[a-z]+(?:['’][a-z]+)?")

_ENDS: Final = re.compile(
    r"(?:(?<!\d)[.,]|[.,](?!\d)|[;:!?])+(?!\s+the ones? (?:that|which|with|on|in|at|by|near|next|under|behind)\b)"
    r"|(?<!\bis)(?<!\bam)(?<!\bare)(?<!\bwas)\s(?=so\b(?! (?:that (?:it|the|you)|far|much|many)))"
    r"|\s(?=(?:because|cause|cos|"
    r"(?:until|till|while|whilst|before|after|in case|when)(?= (?:i|we|he|she|they|my \w+) (?!am\b|are\b)\w+)|"
    r"(?:and|but|for|though|although|as|since)(?= (?:i|he|she|they|somebody|someone|nobody|people|(?:my|our) \w+) \w+)"
    r")\b)"
)
"""Where a clause ends; the second kind of end takes no letter."""
_NOT: Final = r"\w+n['’]t|(?:do|does|did|is|are|was|were|ca|wo|could|would|should|has|have|had)nt"
"""A verb that is negated, with its apostrophe or without: not "plant", "want"."""
_SUBJECT: Final = (
    r"he|she|they|it|this|that|there|here|some(?:body|one|thing)|every(?:body|one|thing)|nobody|no one|people|mine|"
    r"ours|my|our|his|her|their|its|the|an?|some|these|those|all|no|both|many|most|two|three|four|your eyes"
)
_PAST_VERBS: Final = (
    r"said|told|left|lost|came|went|forgot|put|fell|hid|sat|slept|stood|took|threw|bought|brought|broke|thought|knew|"
    r"met|made|saw|gave|got|found|kept|ate|drank|wrote|ran|built|lent|spent|felt|heard|won|paid|hung|meant|sold|spilt|"
    r"fed|rang|bit|blew|rode|drew|flew|grew|hit|lit|sang|shook|shut|spoke|stole|stuck|swore|tore|wore|woke|burnt|"
    r"\w{2,}ed"
)
_NO_SUBJECTS: Final = {
    *(words[0] for words in PHRASES if len(words) == 1 and words[0].isalpha()), *ORDINALS, *NUMBERS,
    "let", "did", "had", "may", "might",
}  # fmt: skip
"""Words that open a clause and are no name of somebody: "mum says" is told, and "first comes the fridge" is not."""
_NOW: Final = rf"(?:{'|'.join(sorted(third_person(verb) for verb in VERBS))})"
_FINITE_VERB: Final = (
    r"(?:is|are|was|were|am|has|have|had|been|will|can|could|would|may|might|did|does|do|ought|"
    rf"{_NOT}|{_NOW}|{_PAST_VERBS})\b"
)
_DRIVING: Final = (
    r"(?:go|head|driv|com|mov|roll|travel|turn|fac|circl|pass|visit|stop|park|leav|start|end|return)\w{0,4}ing\b"
)
"""What is done by driving, as an order may begin in a hurry: "heading for the fridge"."""
_STATEMENT: Final = re.compile(
    r"^\W*(?:(?:and|but|so|well|oh|now|then|look|see|right|as|since|for|though|although|honestly|you know)\s+)*(?:"
    r"(?:i|we)\s+(?:\w+ly\s+|just\s+|also\s+)*"
    r"(?!want|need|would|like|wish|should|must|mean|meant|can\b(?!['’]t|not)|could\b(?!n['’]?t| not)|go\b|visit|see\b|"
    r"(?:am|are) (?:looking|searching|after))\w+"
    rf"|(?:{_SUBJECT})\b(?:.*\b(?:is|are|was|were|am|has|have|had|been|will|can|could|did|does|{_NOT}|{_PAST_VERBS}|"
    r"wants?|needs?|looks?|seems?|smells?|says|hurts?|aches?|feels?)\b"
    rf"|(?:[ -](?!that\b|which\b|who\b|whose\b|where\b)[\w'’]+){{0,4}} {_NOW}\b"
    rf"|(?: \w+){{0,3}} (?:\w+s|people|children|they) (?:{'|'.join(sorted(VERBS))})\b)"
    rf"|(?:\w+ ){{1,3}}(?:is|are|was|were) (?:\w+ )?\w{{2,}}ing\b"
    rf"|(?!(?:{'|'.join(sorted(_NO_SUBJECTS))})\b)[\w'’]+(?: [\w'’]+){{0,2}} {_FINITE_VERB}"
    r"|(?:my|our|his|her) \w+ \w+s\b|(?:he|she|it) \w+s\b|they (?!should|must)\w+|\w+s (?:are|were|have)\b"
    r"|you (?:are|were|have(?! to\b)|look|seem|did|had)\b"
    r"|(?:i|we) (?:would|could) \w+ (?:it |that |there )?(?:myself|ourselves)\b"
    r"|.*\bwrong (?:way|direction|side)\b|(?:here is|there is) .*"
    r"|(?:the |my |our |this )?\w+['’]s (?:all |still |too |so |very |quite |just |a bit )?"
    r"(?:\w{2,}ed|\w{2,}ing|\w+wn|\w+y|\w+t)\b"
    rf"|(?!{_DRIVING}|bring\b|\w*thing\b)\w{{2,}}ing (?:an?|the|my|our|some|up|out|off|for|over|dark|late)\b)"
)
"""A clause that says how things are."""
_REASON: Final = re.compile(
    r"^\W*(?:so(?: that)?|because|cause|cos|as|since|until|till|while|whilst|before|after|in case|when)"
    r"\s+(?:i|we|he|she|they|my|our|his|her|people|somebody|someone)\b"
    rf"(?!\s+(?:want|need|would like)\b)|^\W*(?:before|while|until|as) (?:the|an?|our) \w+ {_NOW}\b|"
    r"^\W*(?:because|cause|cos)\b(?! (?:i|we) (?:want|need|would like)\b)"
    r"|^\W*(?:i|we) (?:want|need|would like|have) to (?:see|check|inspect) "
    r"(?:which ones|whether|if|how (?!many|much|far))\b"
)
_WISH: Final = re.compile(
    r"^(?!.*\b(?:not|no|never|nor|except|but|only|unless|avoid|without|instead|you|ones?|other|first|last|then|"
    r"\w+n['’]t)\b)"
    r"\W*(?:let us (?:see|check|find out) (?:if|whether)\b|(?:(?!if\b|when\b|unless\b|go\b|where\b|which\b)\w+ ){1,4}?"
    r"(?:wants?|needs?|would (?:like|love|enjoy|prefer)|should|must|"
    r"ha(?:s|ve) (?:got )?to|(?:am|are|is) (?:dying|longing|starving))\b)"
)
"""A clause that says what somebody wants, or what has to be done."""
_KEPT_TO: Final = r"(?:(?:and|but|so|then|please|you|we|i|to) |^\W*)(?:keep|stay)"
"""That somebody is to keep to something, or away from it."""
_TOLD_OFF: Final = (
    r"(?:\b(?:not|never|no)\b|n['’]?t\b).*\byou\b|"
    r"\b(?:you|said|says|told|asked|warned)\b.*(?:\b(?:not|never|no)\b|n['’]?t\b)"
)
"""What somebody does not want of the robot."""
_LIMITS: Final = re.compile(
    r"\b(?:not|no|never|none|nothing|without|only|except|but|avoid|unless|if|when|rather|instead|until|before|after|"
    rf"must|should|ought|(?:has|have|had|needs?|wants?|supposed|got) to|other|ones?|cannot|{_KEPT_TO}|{_NOT}|how|"
    r"whether|(?:is|are|comes?|goes?) (?:first|next|last))\b|\?|"
    r"\b(?:i am|we are) (?:\w+ing )?(?:right |just |over )?(?:at|in|on|by|near|next|under|behind|beside)\b"
)
"""Words that say what is to be done, or not to be, also in a statement."""

_PAST_TOLD: Final = re.compile(
    rf"\W*(?:\w+ ){{0,4}}(?:i|we|{_SUBJECT})\b[^,]*\b(?:(?:was|were|had|did|could)(?:n['’]?t)?|{_PAST_VERBS}|"
    r"(?:have|has) (?:been|\w{2,}ed))\b"
)
"""What is told of a time before limits less: "my wife was not in when I came to the kitchen"."""
_LIMITS_NOW: Final = re.compile(
    rf"{_KEPT_TO}|"
    r"\b(?:must|should|ought|may not|(?:has|have|needs?|wants?|supposed|got) to|only|except|rather|instead|avoid|other|"
    rf"(?:not|never) to|forb\w+|allowed|banned|cannot|(?:do|does|is|are|ca|wo|must)(?: not|n['’]?t))\b|\?|"
    rf"{_TOLD_OFF}"
)
"""What limits in a clause about the past."""
_BY_OTHERS: Final = re.compile(
    r"\W*(?:(?:and|but|so|well|oh|since|for|though|although) )*"
    r"(?!(?:i|we|you|it|they|this|that|these|those|there|here|n?either|nothing|the other)\b)"
)
"""How a clause begins whose subject is named, and neither who speaks nor what was spoken of."""
_LIMITS_OTHERS: Final = re.compile(
    rf"{_KEPT_TO}|\b(?:(?:must|should|ought|shall|may)(?: never| ?not|n['’]?t)|"
    r"(?:nobody|no one|no \w+) (?:must|should|may|can|is)|only|except|rather|instead|avoid\w*|other|ones?|"
    rf"(?:not|never) to|forb\w+|allowed|banned|if|unless|(?:needs?|wants?|has|have) to be)\b|\?|{_TOLD_OFF}"
)
"""What limits in a clause about somebody else."""
_MISSED: Final = re.compile(r"\b(?:can|could)(?:not|n?['’]?t| not) (?:find|see|locate|spot|remember)\b")
"""Of a statement that says what somebody does not find: no limit on what is to be done."""

_NAMED: Final = (KNOWN_THINGS | COLOR_WORDS | set(ORDINALS)) - {
    "thing",
    "person",
    "boy",
    "girl",
    "man",
    "room",
    "place",
}


def _left_out(pattern: re.Pattern[str], said: str, instead: str = "") -> str:
    """Return what was said without what matches a pattern, but for what names a thing, a colour or a rank."""
    return pattern.sub(lambda found: instead if _NAMED.isdisjoint(_WORD.findall(found[0])) else found[0], said)


_NAME: Final = re.compile(r"%([A-Z_]+)")


def _rewordings() -> Iterator[tuple[re.Pattern[str], str, bool]]:
    """Load what is said in other words: patterns, what they are read as, and whether that is told by no name."""
    names = {"NUMBERS": "|".join([*NUMBERS][1:])}
    for line in load_text("rewordings.txt").replace("\n    ", "").splitlines():
        if line.startswith("%") and " = " in line:
            name, _, pattern = line[1:].partition(" = ")
            names[name] = _NAME.sub(lambda found: names[found[1]], pattern)
        elif line and not line.startswith("#"):
            pattern, _, instead = _NAME.sub(lambda found: names[found[1]], line).partition(" =>")
            guarded = pattern.startswith("?")
            yield re.compile(pattern[guarded:]), instead[1:].replace("_", " "), guarded


_REWORDINGS: Final = tuple(_rewordings())


_FEELING: Final = re.compile(
    r"\s*[\U0001F600-\U0001F637\U0001F64B\U0001F64C\U0001F64F\U0001F44B-\U0001F44D\U0001F44F\U0001F4AA]"
    r"[\U0001F3FB-\U0001F3FF\uFE0F]?\s*(?=(\w)?)"
)
"""Pictures of faces and hands that name no thing, way or negation."""


def plainly(text: str) -> str:
    """Return what was said in lower case and spelled out, without the politeness around it."""
    said = _FEELING.sub(lambda found: ", " if found[1] else "", text.lower())
    said = re.sub(r"\bu[- ]turn", "uturn", re.sub(r"\blet['’]s\b", "let us", said))
    said = re.sub(r"\bwhere['’]d\b", "where did", _IS.sub(r"\1 is", said))
    said = re.sub(r"\b(the|an?|my|our|to|at|by)\s*\.{2,}", r"\1 …", said)
    said = re.sub(r"\b(?:might|may|could|would) be(?=\W*$)", "is", said)
    said = re.sub(r"\s[-–—]+\s", ", ", re.sub(r"\s*(?:[-=]*>|→)\s*", ", then ", said))
    said = written_out(said)
    said = _WORD.sub(lambda found: SPELLED.get(found[0].replace("’", "'"), found[0]), said)
    said = _WISHED.sub(lambda found: f"{found[1]} you would {_PAST[found[2]]}", said)
    said = _YOURSELF.sub(lambda found: found[0] if (found[1],) in _KNOWN else "go", said)
    for pattern, instead, guarded in _REWORDINGS:
        said = _left_out(pattern, said, instead) if guarded else pattern.sub(instead, said)
    return said


def clauses(text: str) -> Iterator[str]:
    """Return the clauses of a text, each with the mark that ends it."""
    at = 0
    for end in _ENDS.finditer(text):
        yield text[at : end.end()]
        at = end.end()
    yield text[at:]


_WANTED: Final = re.compile(
    r"\b(?:want|need|would like|would love|wish|expect) you\b|\byou (?:should|must|shall|can "
    r"go|will|(?:have|need|are) to)\b|"
    r"\band you (?!are\b|know\b)\w+|\b(?:not|n['’]?t) (?:be )?(?:count|includ)\w*|\bexclud\w+"
)
"""What is asked of the robot, in any clause."""


def is_reason(clause: str) -> bool:
    """Whether a clause only says why."""
    return _REASON.match(clause) is not None


def is_wish(clause: str) -> bool:
    """Whether a clause only says what somebody wants, without a limit on what is to be done."""
    return _WISH.match(clause) is not None


def is_statement(clause: str, *, names_things: bool) -> bool:
    """Whether a clause says how things are, and nothing about what is to be done."""
    others = _LIMITS_OTHERS if _BY_OTHERS.match(clause) else _LIMITS
    limits = _LIMITS_NOW if _PAST_TOLD.match(clause) else others
    limited = _WANTED.search(clause) or (names_things and limits.search(_MISSED.sub("", clause)))
    return _STATEMENT.match(clause) is not None and not limited


_PIECE: Final = re.compile(
    r"(?P<ordinal>\d+)(?:st|nd|rd|th)\b"
    r"|(?P<comma>\d+,\d+)(?=\s*(?:m|cm|met(?:er|re)s?|centimet(?:er|re)s?|feet|ft)\b)"
    r"|(?P<number>(?<![\w.])-?\d+(?:\.\d+)?|\d+(?:\.\d+)?|(?<![\w.])\.\d+)|(?P<poss>['’]s\b)"
    r"|(?P<word>[^\W\d_]+)|(?P<mark>[,.;:!?#°&])|(?P<other>[^\s\-_()\"'’\[\]]+)"
)
_STOPS: Final = (",", ".", ";", ":", "!", "?")
_MOST: Final = re.compile(r"(left|right|north|south|east|west)(?:ern|er)?most")
_SIDE: Final = re.compile(r"(left|right|north|south|east|west)(?:ern|erly|ward)?$")
_ON_PAPER: Final = re.compile(r"\b(top|upper|bottom|lower)[\s-]+(left|right)\b")
"""A corner of the map as it is drawn, north up."""
_PAPER: Final = {"top": "north", "upper": "north", "bottom": "south", "lower": "south", "left": "west", "right": "east"}
_POINT: Final = re.compile(r"(north|south)(east|west)(?:ern|erly|wards?|bound)?$")
_POINTS: Final = {tuple(name.split()): degrees for name, degrees in COMPASS_POINTS.items() if " " in name}
_KEYWORDS: Final = (
    *sorted(
        w[0] for w, found in PHRASES.items() if len(w) == 1 and len(w[0]) >= (4 if any(k for k, _ in found) else 6)
    ),
    *(word for word in (*ORDINALS, *NUMBERS, *(words[0] for words in PLACES)) if len(word) >= 4),
)
_BEFORE_ORDERS: Final = (*_STOPS, "then")
_MOTION: Final = re.compile(
    r"(?:(?:yourself|yourselves|your \w+) )?(?:(?:right |straight )?"
    r"(?:over|across|along|down|up|round|around|back|out|off|on|in|through) )*"
    r"(?:(?:to|onto|into|towards?|between|in between|up against)\b(?! (?:the |your )?(?:left|right)\b)|"
    r"(?:an?|one|two|three|half an?|\d+) (?:(?:centi)?met(?:re|er)s?|c?m|steps?)\b)"
)
"""What mostly a verb of motion is followed by: "squeeze in between", "skedaddle over to", "plant yourself next to"."""
_PUT: Final = re.compile(r"sat|stood|laid|set|hung|put|left|kept")
_PLACED: Final = re.compile(rf"\w{{2,}}(?:ed|ing)|{_PUT.pattern}")
_PLACE: Final = re.compile(
    r"((?:(?:up|down|out|right|just|away|all|around|about|in|off) )*)(?:on|in|at|by|near|next to|close to|beside|"
    r"under|underneath|beneath|behind|between|against|inside|above|below|over|opposite|alongside|atop|around|"
    r"in front of)\b"
)
"""What follows a word that only says how a thing is there: "propped up against", "dangling over"."""
_ADVERB: Final = re.compile(
    r"(?!(?:fami|assemb|jel|but?ter|bel|pars|ho|li|bul|daff?odi|rely|ap|sup|mono|anoma|part|near|hard|bare|scarce|"
    r"alternate|repeated|continual|endless|dai|hour|week|month|year|diagonal|simultaneous|separate|backward|"
    r"exclusive|sole)ly)\w{3,}ly"
)
"""How something is done or said, "gracefully", but not how much, how often or which way."""
_COST_OF_WORD: Final = 0.3
"""Of a token, for each word by which another one that begins there is longer."""
_COST_OF_HOMONYM: Final = 0.05
_COST_OF_KNOWN: Final = 0.5
"""Of a word that is known, but may stand before a noun without telling anything of it."""
_FINITE: Final = re.compile(r"is|are|was|ha[sd]|have|hasn|haven|lacks|holds|(?:stand|sit|lie|hang)s?")
"""What makes a statement of "the desk has a plant on it"."""
_PARTICLES: Final = re.compile(r"out|over|up|down|back|along|off|around")
PLACING: Final = frozenset(["IN", "AT", "BY", "NEAR", "ON", "UNDER", "BEHIND", "BETWEEN", "FRONT", "OPPOSITE"])
"""Where something is: a particle before it says no more."""
_RELATIVES: Final = frozenset(["that", "which", "who", "where"])
_BEFORE_NOUNS: Final = frozenset(["the", "a", "an", "my", "your", "our", "this", "that", "these", "those"])
_TELLING: Final = re.compile(
    r"COLOR|SHAPE|SIZE|SUPER|MORE|ORD|NUM|ONE|NEAREST|FARTHEST|OTHER|EMPTY|FREE|TAKEN|ALONE|MOST|LEFT|RIGHT|NORTH|"
    r"SOUTH|EAST|WEST|MIDDLE|INTER|NOUNS?|ROOMKIND|ROOM|NOT|ONLY|SEEN|SAME|EVERY|DET|BOTH|MOSTLY|FEWEST|EITHER|NEARBY|"
)
"""Kinds of tokens that tell which thing is meant, or join what does."""
_COST_OF_ROOM: Final = 0.2


@dataclass(frozen=True)
class Sentence:
    """What was said: its words without the polite ones, and the tokens that begin at each."""

    words: tuple[str, ...]
    edges: tuple[tuple[Edge, ...], ...]
    """One more than words."""
    notes: tuple[str, ...]

    @property
    def unknown(self) -> tuple[str, ...]:
        """Words that are not known at all."""
        known = [(here, edge) for here, edges in enumerate(self.edges) for edge in edges if edge.kind != "CLAUSE"]
        within = {at for here, edge in known for at in range(here + 1, edge.end)}
        words = enumerate(zip(self.words, self.edges, strict=False))
        found = [w for at, (w, edges) in words if at not in within and all(e.kind in ("WORD", "CLAUSE") for e in edges)]
        return tuple(dict.fromkeys(found))


def read_words(text: str, vocabulary: Vocabulary, *, correcting: bool = False) -> Sentence:
    """Return the tokens of a command.

    Args:
        text: what was said.
        vocabulary: of the map.
        correcting: replace misspelled words by known ones, with a note on each.

    Raises:
        CommandError: a number larger than a program may hold.
    """
    said = _ON_PAPER.sub(lambda found: f"{_PAPER[found[1]]} {_PAPER[found[2]]}", plainly(text))
    pieces = [(str(m.lastgroup), m[m.lastgroup or 0]) for m in _PIECE.finditer(said)]
    notes: list[str] = []
    if correcting:
        pieces = _corrected(pieces, vocabulary, notes)
    pieces = list(_without_fillers(pieces, vocabulary, notes))
    pieces = [
        one for one, after in zip_longest(pieces, pieces[1:]) if one[1] != "," or not after or after[1] not in _STOPS
    ]
    words = tuple(piece for _, piece in pieces)
    edges = [tuple(_edges(pieces[at][0], words, at, vocabulary)) for at in range(len(words))]
    return Sentence(words, (*edges, ()), tuple(notes))


_OPEN: Final = frozenset({"something", "anything", "somewhere", "anywhere"})
_KINDLY_AFTER: Final = frozenset({"please", "now", "for", "just", "too", "then", "if", "thanks", "today"})
"""What follows words of `_OPEN` without saying which: other kind words, such as "sweet", do."""


def _without_fillers(
    pieces: Sequence[tuple[str, str]], vocabulary: Vocabulary, notes: list[str]
) -> Iterator[tuple[str, str]]:
    """Leave out polite phrases, and how to drive, unless the words are part of something longer."""
    words = [piece for _, piece in pieces]
    at = 0
    while at < len(pieces):
        phrases = list(_phrases(words[at : at + MAX_PHRASE]))
        length = max([vocabulary.match(words[at : at + 6]), _activity(words, at, vocabulary)[1], 1])
        longest, found = phrases[-1] if phrases else (0, [])
        kinds = {kind for kind, _ in found}
        if at and words[at - 1] in ("the", "a", "that") and words[at + longest - 1] == "one":  # "the little one"
            kinds.add("ONE")
        adverb = (
            not longest
            and length == 1
            and _ADVERB.fullmatch(words[at]) is not None
            and not vocabulary.match(words[at : at + 1])
        )
        longest = 1 if adverb else longest
        if at and words[at - 1] in _BEFORE_NOUNS and vocabulary.match(words[at : at + 1]):
            kinds.add("NOUN")  # "the can"
        if at and words[at - 1] in _OPEN and words[at] not in _KINDLY_AFTER:
            kinds.add("SAID")  # "something sweet" is not any thing
        if longest >= length and kinds <= {"", "MANNER"}:
            if "MANNER" in kinds:
                said = " ".join(words[at : at + longest])
                notes.append(f'"{said}" is left out: the robot has one way to drive')
            at += longest
            continue
        for _ in range(max(length, longest)):
            yield pieces[at]
            at += 1


def _phrases(words: Sequence[str]) -> Iterator[tuple[int, list[tuple[str, str]]]]:
    """Return the phrases of the grammar at the start of some words, the shortest first, with their lengths."""
    for length in range(1, min(MAX_PHRASE, len(words)) + 1):
        found = PHRASES.get(tuple(words[:length]))
        if found is not None:
            yield length, found


def _edges(kind: str, words: Sequence[str], at: int, vocabulary: Vocabulary) -> Iterator[Edge]:
    found = list(_readings(kind, words, at, vocabulary))
    longest = max((length for length, _, _ in found), default=0)
    for length, name, value in found:
        homonym = _COST_OF_HOMONYM * (length == longest and name in ("NOUN", "NOUNS") and len(found) > 1)
        # A toilet is a thing where the map has one, and otherwise the room of that name.
        room = _COST_OF_ROOM * (name == "ROOMKIND" and any(other in ("NOUN", "NOUNS") for _, other, _ in found))
        yield Edge(name, value, at + length, _COST_OF_WORD * (longest - length) + homonym + room)
    after = " ".join(words[at + 1 : at + 6])
    plainly_put = _PUT if found and not words[at].endswith("ing") else _PLACED
    placed = _PLACE.match(after) if at and plainly_put.fullmatch(words[at]) else None
    for particles in {0, placed[1].count(" ")} if placed else ():
        yield Edge("IS", words[at], at + 1 + particles, _COST_OF_HOMONYM)
    if _FINITE.fullmatch(words[at]):
        yield Edge("FINITE", words[at], at + 1)
    before_noun = at and words[at - 1] in _BEFORE_NOUNS and vocabulary.match(words[at + 1 : at + 7])
    if found and before_noun and not any(_TELLING.fullmatch(name) for _, name, _ in found):
        yield Edge("WORD", words[at], at + 1, _COST_OF_KNOWN)  # "the standing lamp"
    if _PARTICLES.fullmatch(words[at]):  # "over by the door", "back in the kitchen"
        for length, tokens in _phrases(words[at + 1 : at + 1 + MAX_PHRASE]):
            placing = [(name, value) for name, value in tokens if name in PLACING]
            yield from (Edge(name, value, at + 1 + length, _COST_OF_HOMONYM) for name, value in placing)
    if at and words[at] in _RELATIVES:
        end = next((i for i in range(at, len(words)) if words[i] in _STOPS), len(words))
        said = words[at + 1 + (words[at + 1 : at + 2] == ("one",)) : end]
        strange = (i for i in range(at + 1, end) if not any(_readings("word", words, i, vocabulary)))
        if not _LIMITS.search(" ".join(said)) and any((words[i],) not in PHRASES for i in strange):
            yield Edge("CLAUSE", " ".join(words[at:end]), end)
    if not found:
        yield Edge("WORD", words[at], at + 1)
        if (at == 0 or words[at - 1] in _BEFORE_ORDERS) and _MOTION.match(after):
            yield Edge("GO", "go", at + 1, _COST_OF_HOMONYM)


def _readings(kind: str, words: Sequence[str], at: int, vocabulary: Vocabulary) -> Iterator[tuple[int, str, object]]:
    """Return each token that begins at a place: its length in words, its kind and its value."""
    rest = words[at : at + MAX_PHRASE]
    digits = float(words[at].replace(",", ".")) if kind in ("number", "comma") else None
    if digits is not None and digits > MAX_NUMBER:
        raise CommandError(f"numbers go up to {MAX_NUMBER:.0f}, found {words[at][:30]}")
    rank, length = read_rank(rest, int(words[at]) if kind == "ordinal" else None)
    if length:
        yield length, "ORD", rank
    number, length = read_number(rest, digits)
    if length:
        yield length, "ONE" if list(rest[:length]) == ["one"] else "NUM", number
    yield from _sides(rest)
    wanted, length = _activity(words, at, vocabulary)
    if wanted:
        yield length, "NOUN", vocabulary.noun(wanted)
        yield length, "PLACE", vocabulary.noun(wanted)
    length = vocabulary.match(rest[:6])
    if length and not (rest[0] == "can" and (at == 0 or words[at - 1] not in _BEFORE_NOUNS)):
        noun = vocabulary.noun(" ".join(rest[:length]))
        yield length, "NOUNS" if noun.is_plural else "NOUN", noun
    for length, tokens in _phrases(rest):
        if rest[length - 1] == "that" and tokens[0][0] == "NOWAIT" and vocabulary.match(rest[length : length + 6]):
            continue  # "not that sofa" takes nothing back
        yield from ((length, name, value or " ".join(rest[:length])) for name, value in tokens if name)


def _activity(words: Sequence[str], at: int, vocabulary: Vocabulary) -> tuple[str, int]:
    """Read "somewhere to sit", "i want to lie down", "i m thirsty", and an activity that is all that was said."""
    rest = words[at : at + 12]
    for end in range(min(len(rest), 6), 2, -1):
        if tuple(rest[:end]) in NEEDS:  # "something to eat" is no place
            return NEEDS[tuple(rest[:end])], end
    generic, length = vocabulary.activity(rest)
    if generic:
        return generic, length
    for wish in (*WISHES, ()):
        if tuple(rest[: len(wish)]) != wish or (at and wish in (("where", "i", "can"), ("where", "we", "can"))):
            continue
        for end in range(min(len(rest), len(wish) + 5), len(wish), -1):
            asked = tuple(rest[len(wish) : end])
            found = NEEDS.get(asked) or (ACTIVITIES.get(asked) if wish else None)
            # "a dirty cup" is a cup, and nothing to wash
            if found and (wish or not vocabulary.match(rest[end : end + 6])):
                return found, end + (tuple(rest[end : end + 1]) == ("something",))
    alone = next((i for i, word in enumerate(words) if not word.isalpha() or word in ("and", "then")), len(words))
    asked = ACTIVITIES.get(tuple(words[:alone]), "") if at == 0 else ""
    if asked and any(kind == "HANDS" for _, tokens in _phrases(words[:2]) for kind, _ in tokens) and "my" not in words:
        asked = ""  # "wash the dishes" is nothing that a robot can do
    return (asked, alone) if asked else ("", 0)


def _sides(words: Sequence[str]) -> Iterator[tuple[int, str, object]]:
    """Read "leftmost", "left most", "most northerly", and compass words between the main four: "north east"."""
    most = _MOST.fullmatch(words[0])
    if most:
        yield 1, "MOST", most[1]
    for side, other in ((0, 1), (1, 0)):
        found = _SIDE.fullmatch(words[side]) if len(words) > 1 and words[other] == "most" else None
        if found:
            yield 2, "MOST", found[1]
    split = []
    for at, word in enumerate(words[:3]):
        point, one = _POINT.fullmatch(word), _SIDE.fullmatch(word)
        names = [point[1], point[2]] if point else [one[1]] if one else []
        if not names:
            break
        split += [(name, at + 1) for name in names]
    for length in (3, 2):
        degrees = _POINTS.get(tuple(name for name, _ in split[:length]))
        if degrees is not None and len(split) >= length:
            yield split[length - 1][1], "INTER", degrees
            return


def _corrected(pieces: Sequence[tuple[str, str]], vocabulary: Vocabulary, notes: list[str]) -> list[tuple[str, str]]:
    """Replace unknown words by the known ones they are misspellings of."""
    found: list[tuple[str, str]] = []
    words = [piece for _, piece in pieces]
    at = 0
    while at < len(pieces):
        known = [(length, kind) for length, kind, _ in _readings(pieces[at][0], words, at, vocabulary)]
        known += [(length, "") for length, _ in _phrases(words[at : at + MAX_PHRASE])]
        longest = max((length for length, _ in known), default=0)
        name, taken = "", 0
        # Unknown words are compared with the names of things first, then with the words of the grammar.
        if pieces[at][0] == "word" and all(kind in ("NOUN", "NOUNS") for _, kind in known):
            name, taken = vocabulary.correct(words[at : at + 3])
            if known and taken <= longest:
                name, taken = "", 0
            keyword = correct(words[at], _KEYWORDS) if not known and taken < 2 else None
            name, taken = (keyword, 1) if keyword and not name else (name, taken)
            apart = "" if known or name else _apart(words[at], vocabulary)
            name, taken = (apart, 1) if apart else (name, taken)
        if name:
            notes.append(f'"{" ".join(words[at : at + taken])}" is read as {name}')
            found += [("word", word) for word in name.split()]
        else:
            taken = max(longest, 1)
            found += pieces[at : at + taken]
        at += taken
    return found


_RUN_TOGETHER: Final = frozenset(
    ["a", "the", "to", "go", "my", "how", "then", "at", "in", "on", "and", "from", "is", "what", "where", "of", "it"]
)


def _apart(word: str, vocabulary: Vocabulary) -> str:
    """Return the words that were written together: "gotothe" -> "go to the"; "" where there are none."""
    for at in range(len(word) - 1, 0, -1):
        first, rest = word[:at], word[at:]
        known = (rest,) in PHRASES or rest in _RUN_TOGETHER or (len(rest) > 2 and vocabulary.match([rest]))
        if (first, rest) in PHRASES or vocabulary.match([first, rest]) == 2:
            return f"{first} {rest}"
        if first in _RUN_TOGETHER and (more := rest if known else _apart(rest, vocabulary)):
            return f"{first} {more}"
    return ""
