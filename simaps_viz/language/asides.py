"""What is said around orders and questions: how speech is spelled, politeness, reasons, and small talk."""

import re
from collections.abc import Iterator
from typing import Final

from simaps_viz.colors.naming import COLOR_WORDS
from simaps_viz.language.lexicon import KNOWN_THINGS, ORDINALS, PHRASES, SPELLED, written_out

_WHO: Final = r"(?:you|u|ya|we|i|somebody|someone|anybody|anyone|the robot)"
_SOFTLY: Final = r"(?:(?:please|kindly|possibly|perhaps|maybe|just|really|simply|also|by any chance|even|\w+ly)\s+)*"
_ASKS: Final = r",? (?:(?:on|in|at|to|from|under) )?(?:how|where|what|which|whether|if|who)\b"
_POLITE: Final = re.compile(
    r"\b(?:"
    # "I would be most grateful if you could", "I was just wondering whether you might perhaps"
    rf"(?:i|we|it) would (?:{_SOFTLY})(?:be|appreciate|love|like)\b(?:\s+\w+){{0,5}}? if {_WHO} "
    r"(?:would|could|can|might|were to|went ahead and)|"
    rf"(?:i|we) (?:was |am |were |are )?{_SOFTLY}(?:wonder|wondered|wondering|asking|hope|hoping|curious)"
    rf"(?: (?:if|whether|that)(?: {_WHO} (?:would|could|can|might|may))?|(?={_ASKS}))|"
    # "my boss wants to know", "the manager is asking"
    rf"(?:(?:my|the|our) )?\w+ (?:(?:wants|needs|would like) to know|asks|wonders|is (?:asking|wondering))(?={_ASKS})|"
    # "what I need you to do is", "here is the plan:"
    rf"(?:here is )?what (?:i|we|you) (?:would |have |should |could )?{_SOFTLY}(?:like|need|want|do|have)"
    r"(?: you)?(?: to)?(?: do)?(?: with)?(?: now)?(?: is|\s*:\s*)(?: to)?|"
    r"be (?:an?|my|so|very) (?:\w+ )?\w+ (?:and|enough to|as to)|do (?:me|us) an? (?:\w+ )?favou?r and|"
    rf"(?:why (?:do not|don['’]?t|not)|how about)(?: {_WHO}\b)?(?! (?:is|are)\b)|"
    r"would it be (?:\w+ ){1,3}?(?:to ask you to|for you to|if you (?:would|could))|"
    r"(?:could|can|may|might) (?:i|we) (?:ask|trouble|bother|persuade|get|have|convince|request|invite|tempt) "
    r"you (?:to|for)|"
    r"(?:is there )?any chance (?:that )?you (?:can|could|might)|before (?:we|you|i) do anything else|"
    # "I can't for the life of me remember how many ..."
    r"(?:i|we) (?:\w+ )?(?:can(?:['’]?t|\s?not)|(?:could|do|did)(?:n['’]?t| not))(?: \w+){0,6}? "
    rf"(?:remember|recall|know|tell|see|think|figure out|work out|make out)(?: of)?(?={_ASKS})|"
    rf"(?:i|we) (?:have |am |are )?(?:\w+ly )?(?:forgot|forgotten|not sure|unsure)(?={_ASKS})"
    rf")\b ?{_SOFTLY}"
)
"""Openings that only ask for what comes after them."""
_KINDLY: Final = re.compile(
    r"[,\s]*\bif (?:that|it|this)(?: is|['’]s| would be| were)(?:n['’]?t| not)? (?:not |no |too much |any |all )?"
    r"(?:\w+ )?(?:alright|right|ok|okay|fine|trouble|bother|possible|convenient|good|asking)\b"
    r"(?: (?:with|for|to) you| to ask)?"
)
_INDIFFERENT: Final = re.compile(
    r"[,.;]?\s*\b(?:(?:i|we) (?:really |honestly )?(?:do(?:n['’]?t| not)) (?:really )?(?:care|mind)|"
    r"(?:the |its |their )?(?:order|sequence|rest|reason|way|how|which(?: one)?|it|that) (?:really )?"
    r"(?:is(?:n['’]?t| not)|do(?:es)?(?:n['’]?t| not)) (?:really )?(?:important|relevant|matter|of importance)|"
    r"(?:no matter|never mind|regardless of)(?= the\b)|in (?:whatever|whichever|any) order)\b[^,.;!?]*"
    r"|[,.;]?\s*\b(?:you (?:may |can )?(?:choose|pick|decide)(?: which(?: ones?)?| the order)?|"
    r"(?:which (?:\w+ )?|the order )?(?:is )?(?:entirely )?up to you)(?=\s*(?:[,.;!?]|$))"
)
"""What leaves something open: "I don't care about the order"."""
_TAG: Final = re.compile(
    r",\s*(?:(?:is|are|do|does|have|has|can|could|will|would|did|was|were|should)(?:n['’]?t)? "
    r"(?:it|you|they|we|i|there|he|she)|(?:\w+ )?(?:is|was) it|alright|all right|ok|okay|right|yes|"
    r"no(?=\s*\?)|eh|hm+|please)"
    r"\s*(?=\?|,)"
)
"""Small questions at the end: "..., would you?"."""
_HEADING: Final = re.compile(
    r"^\W*(?:[\w'’]+ ){0,3}(?:tour|tour time|rounds?|plan|route|mission|task|errand|job|trip|schedule|lap|"
    r"circuit|loop|zigzag|itinerary|things|stops|places|errands|stations)(?: for (?:me|us))?\s*[:!]"
    r"|^\W*before (?:we|you|i) (?:leave|go|start|begin)\s*[:,]"
)
"""What only names what follows: "evening tour:"."""
_ATTRIBUTE: Final = re.compile(
    r"\b(?:(?:please )?(?:give|tell|say|state|report|name|measure|determine|calculate|estimate|find out|work "
    r"out|read|let me know|"
    r"show|read out|(?:i|we) (?:need|want|would like)(?: to know| you to tell me)?|do you know)(?: me| us| to me)?)"
    r"(?: (?:about|for|of))? (?:what )?(?:(?:the|its|their) (?:\w+ )?)?"
    r"(?=(?:distance|colou?r|height|width|length of|size|area of|footprint|breadth|dimensions|number of|count "
    r"of|position|location|whereabouts)\b)"
)
"""How an attribute is asked for: "tell me the colour of", "I need the distance to"."""
_GOT: Final = re.compile(r"\b(?:has|have) ((?:the|my|our|your|this|that|any|an?) [\w ]{2,30}?) got\b")
_PAST: Final = {
    "went": "go", "came": "come", "drove": "drive", "took": "take", "brought": "bring", "told": "tell",
    "stood": "stand",
    "moved": "move", "rolled": "roll", "headed": "head", "stopped": "stop", "turned": "turn", "looked": "look",
    "waited": "wait", "parked": "park", "showed": "show", "walked": "walk", "faced": "face", "visited": "visit",
}  # fmt: skip
_WISHED: Final = re.compile(rf"\bif you (?:{_SOFTLY})({'|'.join(_PAST)})\b")
"""What is wished for in the past tense: "I would be glad if you went"."""
_MODAL: Final = re.compile(
    r"\b(?:would|could|might|can|will) (?=(?:the|my|our|your|there|an?|any|this|that|these|those)\b)"
    r"([^,.;:!?]{2,60}?)\b(?:happen to |possibly |perhaps |by any chance )?be\b"
)
"""What is asked by way of a possibility: "might the bag be under the bench"."""
_ALL_OF: Final = re.compile(
    r",\s*(?:every (?:single )?one|all|each(?: and every)?(?: one)?|the lot) of (?:them|those)(?=\s*(?:[,.;!?]|$))"
)
"""What only repeats that all are meant: "the bins, every one of them"."""
_WHO_PUT: Final = re.compile(
    r"(?<=\w) (?:that |which )?(?:somebody|someone|people|they|we|i|you|he|she)(?: had| have)? (?:stuck|put|"
    r"left|hid|set|laid|"
    r"kept|placed|stored|stashed|shoved|tucked|dropped|parked|forgot|stuffed|chucked|dumped)(?: down| away| up)? "
    r"(?=(?:in|on|under|underneath|beneath|below|at|by|near|next to|behind|between|beside|inside|against)\b)"
)
"""Who put there what is spoken of: "the bag I left under the bench"."""
_NEGATIVE: Final = re.compile(
    r"(?:(?<=^)|(?<=[,.;:!?] ))(is|are|does|do|has|have)n['’]t (?=(?:there|it|the|this|they|we|you)\b[^,.;:!?]*\?)()"
)
"""What is asked by way of its denial: "isn't there a lamp on the table?"."""
_OPENING: Final = re.compile(
    r"^\W*(?:(?:right so|right(?: then)?(?=\s*,\s*(?!left|right|then|forward|back|straight|and|turn|go)|\s*:)|"
    r"so|and|um+|uh+|okay|ok|yeah|well|hmm+|er+|uhm)\b[\s,]*)+"
)
_IS: Final = re.compile(r"\b(that|it|there|what|where|here|which|who|how)['’]s\b")
_SHORT: Final = re.compile(r"\b(i|you|we|they|he|she|it|that|there|who|what|where|this)['’](m|d|re|ve|ll)\b")
_LEFT: Final = re.compile(r"\b((?:(?:is|are) there|there (?:is|are)) (?:\w+ ){1,3})left\b(?! of| side| hand)")
"""What is there still, as in "is there any cake left on the counter?"."""
_PUT: Final = re.compile(
    r"\bwhat (?:do|does|did|has|have) (?:they|people|somebody|someone|anybody|anyone|he|she) \w+(?: down| away)? "
    r"(?=under|on\b|in\b|inside|into|onto|below|beneath|behind|between|beside|next|near)"
)
"""Who put what is asked for where it is: "what did they put under the bench?"."""
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
    r"(?:(?<!\d)[.,]|[.,](?!\d)|[;:!?])+"
    r"|\s(?=(?:because|cause|cos|so(?! (?:that (?:it|the|you)|far|much|many)))\b)"
)
"""Where a clause ends; the second kind of end takes no letter."""
_PURPOSE: Final = re.compile(
    rf"{_ENDS.pattern}|\s(?=to (?!the\b|an?\b|my\b|our\b|your\b|this\b|that\b)\w+ \w+|where (?:i|we|one) can \w+)"
)
"""Where a clause or "to get rid of this cup" begins."""
_SUBJECT: Final = (
    r"he|she|they|it|this|that|there|here|some(?:body|one|thing)|every(?:body|one)|people|my|our|his|her|their|the|an?|some|"
    r"these|those|all|your eyes|you (?:are|were|have been|look|seem)"
)
_STATEMENT: Final = re.compile(
    r"^\W*(?:(?:and|but|so|well|oh|now|then|look|see|right|as|since|honestly|you know)\s+)*(?:"
    r"(?:i|we)\s+(?:\w+ly\s+|just\s+|also\s+)*"
    r"(?!want|need|would|like|wish|should|must|mean|meant|can\b|could|go\b|visit|see\b|"
    r"(?:am|are) (?:looking|searching|after))\w+"
    rf"|(?:{_SUBJECT})\b.*\b(?:is|are|was|were|am|has|have|had|been|wants?|needs?|looks?|seems?|smells?|said|says|told|hurts?|aches?|feels?|asked|will|"
    r"can|could|did|does|left|lost|came|went|forgot|put|dropped|fell|hid|sat|slept|stood|took|threw|bought|brought|broke|thought|"
    r"knew|met|made|saw|gave|got|found|kept|ate|drank|wrote|ran|hung|meant|sold|spilt|\w+n['’]?t|\w{2,}ed)\b"
    r"|(?:my|our|his|her) \w+ \w+s\b|(?:he|she) \w+s\b|\w+s (?:are|were|have)\b|.*\bwrong (?:way|direction|side)\b"
    r"|(?:here is|there is) .*)"
)
"""A clause that says how things are."""
_REASON: Final = re.compile(
    r"^\W*(?:so(?: that)?|because|cause|cos|as|since)\s+(?:i|we|he|she|they|my|our|his|her|people|somebody|someone)\b"
    r"(?!\s+(?:want|need|would like)\b)"
)
_LIMITS: Final = re.compile(
    r"\b(?:not|no|never|none|nothing|without|only|except|but|avoid|unless|if|when|rather|instead|until|before|after|must|"
    r"should|ought|(?:has|have|had|needs?|wants?|supposed|got) to|other|ones?|cannot|keep|stay|\w+n['’]?t|how|whether"
    r")\b|\?|\b(?:i am|we are) (?:\w+ing )?(?:right |just |over )?(?:at|in|on|by|near|next|under|behind|beside)\b"
)
"""Words that say what is to be done, or not to be, also in a statement."""


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


def plainly(text: str) -> str:
    """Return what was said in lower case and spelled out, without the politeness around it."""
    said = _IS.sub(r"\1 is", re.sub(r"\blet['’]s\b", "let us", text.lower()))
    said = re.sub(r"\s[-–—]+\s", ", ", re.sub(r"\s*(?:[-=]*>|→)\s*", ", then ", said))
    said = written_out(_SHORT.sub(r"\1 \2", said))
    said = _WORD.sub(lambda found: SPELLED.get(found[0].replace("’", "'"), found[0]), said)
    said = _LEFT.sub(r"\1", re.sub(r"\bam i\b", "are you", said))
    said = _WISHED.sub(lambda found: f"if you would {_PAST[found[1]]}", said)
    said = _TAG.sub("", _left_out(_KINDLY, _left_out(_INDIFFERENT, said), " "))
    said = _YOURSELF.sub(lambda found: found[0] if (found[1],) in _KNOWN else "go", said)
    said = re.sub(r"(?<!what )\bis that (?=in\b|on\b|at\b|under\b)", "is it ", _PUT.sub("what is ", said))
    said = re.sub(r"\bsomewhere (?=in\b)", "", re.sub(r"^(\W*\w+) first(?:ly)?(?= (?:to|the|into)\b)", r"\1", said))
    said = re.sub(r"\b(is|are|does|do|you|we|i|to|they|it) actually\b", r"\1", _left_out(_POLITE, said, " "))
    said = re.sub(r"(?<!have )\b(i|we) got (?=some\b|an?\b|my\b)", r"\1 have ", said)
    said = re.sub(r"[,;]?\s*\bforget (?:about )?the [\w ]{2,25},\s*", ", no, ", said)
    said = _GOT.sub(r"does \1 have", said)
    said = _MODAL.sub(r"is \1", said)
    said = _ATTRIBUTE.sub("what is the ", said)
    said = _NEGATIVE.sub(r"\1 \2", said)
    said = re.sub(r"\b(is|are) (?:their|they re) (?=an?\b|any\b|no\b)", r"\1 there ", said)
    said = re.sub(r"\b(is|are|do|does) not no\b", r"\1 no", said.replace("how is many", "how many"))
    said = re.sub(r"\b2(?= (?:the|my|your|our|this|that)\b)", "to", said)
    said = re.sub(r"(^\W*|[,.;:!] *|then )off to\b", r"\1go to", said)
    said = re.sub(r"\bw/\s*", "with ", _ALL_OF.sub("", _WHO_PUT.sub(" ", said)))
    said = re.sub(r"\b(?:any|either|whichever)(?: one)? of (?=(?:the|my|our|your|these|those|them)\b)", "one of ", said)
    said = re.sub(r"\bits (?=(?:the|an?|not|in|on|at|under|near|next|behind)\b)", "it is ", said)
    said = re.sub(
        r"[,\s]+(?:roughly|approximately|more or less|give or take|or so|or thereabouts)(?=\s*[?.!]*\s*$)", "", said
    )
    said = re.sub(r",\s*so\s+(?!that\b|i\b|we\b)", ", ", said)
    return re.sub(r"\b[xy]\s*=?\s*(?=[-.\d])", "", _left_out(_HEADING, _OPENING.sub("", said)))


def clauses(text: str, *, purposes: bool = False) -> Iterator[str]:
    """Return the clauses of a text, each with the mark that ends it; ``purposes`` begin clauses of their own."""
    at = 0
    for end in (_PURPOSE if purposes else _ENDS).finditer(text):
        yield text[at : end.end()]
        at = end.end()
    yield text[at:]


_WANTED: Final = re.compile(
    r"\b(?:want|need|would like|would love|wish|expect) you\b|\byou (?:should|must|shall|can "
    r"go|will|(?:have|need|are) to)\b|"
    r"\band you (?!are\b|know\b)\w+"
)
"""What is asked of the robot, in any clause."""


def is_reason(clause: str) -> bool:
    """Whether a clause only says why."""
    return _REASON.match(clause) is not None


def is_statement(clause: str, *, names_things: bool) -> bool:
    """Whether a clause says how things are, and nothing about what is to be done."""
    limited = _WANTED.search(clause) or (names_things and _LIMITS.search(clause))
    return _STATEMENT.match(clause) is not None and not limited
