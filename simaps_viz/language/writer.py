"""Steps to program text: loops over several things, variables for what is named again, indents."""

import keyword
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from simaps_viz.errors import CommandError
from simaps_viz.language.nouns import IT, LAST, ONE, SAME, Phrase
from simaps_viz.language.orders import Choose, Do, Repeat, Steps
from simaps_viz.language.primitives import FUNCTIONS, SELF

_INDENT: Final = "    "
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
        self._line: _Line | None = None
        self._block: list[_Line] | None = None
        """The last line of the program, and the lines it stands among."""
        self._verb = "go"
        self._bare = self._told = False
        """Whether things were named without a verb, and whether anything was asked."""
        self.notes: list[str] = []
        self.others: dict[tuple[str, str], None] = {}

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
        for step in steps:
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
                    for line, inner in ((f"if {test}:", then), ("else:", otherwise)):
                        if inner:
                            lines.append(_Line(line, mentions, before=first))
                            self._last = (*first, *mentions, self._last)[0]
                            self._add(inner, lines[-1].body)

    def _do(self, step: Do, lines: list[_Line]) -> None:
        if not step.verb:
            self._bare = True
            call = "robot.face({0})" if self._verb == "face" else "robot.move_to_{0.goal}"
            step = Do((call,), step.phrases, step.notes, self._verb)
        self._told |= step.lines[0].startswith("tell(")
        if self._bare and self._told:  # a question moves nothing but what an order beside it moves
            raise CommandError("what is to be told or done with the last things was not said")
        self._verb = step.verb
        self._note(step.notes)
        again = self._last if any(IT in phrase.text or phrase.again for phrase in step.phrases) else None
        if again is not None and again.body is not None:
            lines = again.body
        before = self._last
        mentions = tuple(self._mention(phrase) for phrase in step.phrases)
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
                loop = _Line(f"for {mention.name} in {mention.phrase.text}:", tuple(mentions[1:]), [])
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

    def _mention(self, phrase: Phrase) -> _Mention:
        """Return what a phrase means after those before it."""
        self._note(phrase.notes)
        self.others.update(dict.fromkeys(phrase.others))
        last = self._last
        if phrase.text == IT:
            return self._named("it")
        if phrase.again and not (phrase.lone and (last is None or last.phrase.base != phrase.base)):
            within = [one for one in last.phrase.inner if _is_called(one, phrase)] if last else []
            if within:
                # "if there is a laptop on the desk, go to that desk"
                base = within[0].whole or within[0].text
                self._last = _Mention(replace(phrase, base=base, text=f"having({base}, {self._named('it').name})"))
                return self._last
            if last is None or not _is_called(last.phrase, phrase):
                raise CommandError(f"which {phrase.word} is meant was not said")
            return self._named("it")
        text, base, word = phrase.text, phrase.base, phrase.word
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
                self._note((f"the other {word} is read as all but the closest",))
            text = text.replace(LAST, self._named("it").name if same else f"nearest({base})")
        text = text.replace(ONE, before.base) if ONE in text and (before := last and last.phrase) else text
        if ONE in text or LAST in text:
            raise CommandError('"one" was not understood: which things are meant was not said before it')
        self._last = _Mention(replace(phrase, text=text, base=base, word=word))
        return self._last

    def _named(self, word: str, *, name: bool = True) -> _Mention:
        if self._last is None:
            raise CommandError(f'"{word}" was not understood: nothing was named before it')
        if name and not self._last.name:
            self._last.name = self._fresh(_identifier(self._last.phrase.word))
        return self._last

    def _fresh(self, name: str) -> str:
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name}_{self._names[name]}"

    def _note(self, notes: Sequence[str]) -> None:
        self.notes += [note for note in notes if note not in self.notes]


def _is_called(thing: Phrase, phrase: Phrase) -> bool:
    """Whether a phrase names what a thing is, as "that table" does a coffee table."""
    return thing.base == phrase.base or thing.word.endswith(f" {phrase.word}")


def _contrasts(before: Phrase, mentions: Sequence[_Mention]) -> bool:
    """Whether a thing is told from the one named before it by its place among the things of that name."""
    if len(mentions) != 1 or mentions[0].phrase.base != before.base or before.many:
        return False
    return mentions[0].phrase.text.startswith(("nth(", "first(", "last(", "farthest("))


def _text(lines: Sequence[_Line], indent: str) -> list[str]:
    found = []
    for line in lines:
        # What is named again gets its variable before the line that names it first.
        for mention in (*line.before, *line.mentions):
            if mention.name and not mention.assigned:
                mention.assigned = True
                tested = line.text.startswith("if ") and mention not in line.before
                value = mention.phrase.text if tested else mention.phrase.single
                found.append(f"{indent}{mention.name} = {value}")
        found.append(indent + (line.text.format(*line.mentions) if line.mentions else line.text))
        found += _text(line.body, indent + _INDENT)
    return found


def _identifier(word: str) -> str:
    """Return a name a program can use for a thing."""
    name = re.sub(r"\W+", "_", word.lower()).strip("_")
    if not (name.isidentifier() and name.isascii()) or keyword.iskeyword(name) or name in FUNCTIONS or name == SELF:
        return "thing"
    return name
