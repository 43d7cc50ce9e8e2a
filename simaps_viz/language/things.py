"""Turns phrases for things to program text: one method for each such rule of ``commands.lark``."""
# ruff: noqa: D102 - the grammar says what each rule means

from collections.abc import Mapping, Sequence

from lark import Token, Transformer

from simaps_viz.errors import CommandError
from simaps_viz.language.meanings import Measure, Noun, Pair, Part, Side, Thing, first, maybe, quoted, tidy, token
from simaps_viz.language.selection import MAX_RANK, Selection, identifier, select
from simaps_viz.language.words import ANY, Vocabulary, plain, plural, singular

Children = Sequence[object]


class ThingBuilder(Transformer):
    """Builds program text for things, noting how words were read.

    Args:
        vocabulary: of the map.
        choices: {spoken word: class}, overrides what an ambiguous word means.
    """

    def __init__(self, vocabulary: Vocabulary, choices: Mapping[str, str] | None = None) -> None:
        super().__init__()
        self._vocabulary = vocabulary
        self._choices = choices or {}
        self._last: Thing | None = None
        self._before: Thing | None = None
        self._names: dict[str, int] = {"start": 1, "robot": 1}
        self.notes: list[str] = []
        self.ambiguous: dict[str, tuple[str, ...]] = {}
        """{spoken word: the other classes it may mean}."""

    # ---- names of things

    def noun(self, children: Children) -> Noun:
        spoken = " ".join(str(child) for child in children)
        one = singular(plain(spoken))
        is_plural = one != plain(spoken)
        meaning = self._vocabulary.resolve(spoken)
        if meaning is None:
            return Noun(one, is_plural)
        if one in self._choices:
            self._note_reading(one, self._choices[one])
            return Noun(self._choices[one], is_plural)
        if len(meaning.labels) != 1:
            self.ambiguous[one] = (*meaning.labels, *meaning.others)
            everything = len(meaning.labels) == len(self._vocabulary.labels)
            taken = "everything on the map" if everything else f"{_listed(meaning.labels)} together"
            self._note(f'"{one}" takes {taken}')
            return Noun(one, is_plural)
        (label,) = meaning.labels
        exact = plain(label) in (one, plain(spoken))
        wide = f"{ANY}{one}" if exact and meaning.others else ""
        if meaning.others and not exact:
            self.ambiguous[one] = meaning.others
            self._note(f'"{one}" is read as {label}; this map also has {", ".join(meaning.others)}')
        elif not exact:
            self._note_reading(one, label)
        elif wide:
            self.ambiguous[one] = (wide,)
        return Noun(label, is_plural, wide, self._vocabulary.count(label))

    nouns = known = place = noun

    def _note_reading(self, spoken: str, label: str) -> None:
        if plain(label) != spoken:
            self._note(f'"{spoken}" is read as {label}')

    def _widened(self, noun: Noun, needed: int) -> Noun:
        """Take all classes of a kind where the one of that very name has too few."""
        if not noun.wide or (noun.count if noun.count is not None else 1) >= needed:
            return noun
        meaning = self._vocabulary.resolve(noun.wide)
        if meaning is None:
            return noun
        one = noun.wide.removeprefix(ANY)
        self.ambiguous[one] = (noun.label,)
        self._note(f'"{one}" takes {_listed(meaning.labels)} together')
        return Noun(noun.wide, noun.is_plural)

    # ---- parts of phrases

    def pre(self, children: Children) -> Part:
        side = maybe(Side, children)
        if side:
            return Part("from_side", side=side.name)
        kinds = {"NEAREST": "nearest", "FARTHEST": "farthest", "SEEN": "view"}
        word = first_token(children)
        if word.type == "MOST":
            return Part("outermost", side=str(word))
        return Part("ranked", _rank(children)) if word.type == "ORD" else Part(kinds[word.type])

    def numbered(self, children: Children) -> Part:
        number = first(Measure, children).text
        if "." in number or not 1 <= int(number) <= MAX_RANK:
            raise CommandError(f"the number of a thing is a whole number from 1, found {number}")
        return Part("numbered", int(number))

    def _part(self, kind: str, children: Children) -> Part:
        side, word = maybe(Side, children), token("MOST", children)
        other = maybe(Thing, children) or maybe(Pair, children)
        name = str(word) if word else side.name if side else ""
        if isinstance(other, Thing) and other.loop:
            raise CommandError(f"each of the {plural(other.label)} was said where one thing is needed")
        return Part(kind, _rank(children) if token("ORD", children) else None, name, other)

    def from_here(self, children: Children) -> Part:
        return self._part("from_here", children)

    def nearest(self, children: Children) -> Part:
        return self._part("nearest", children)

    def farthest(self, children: Children) -> Part:
        return self._part("farthest", children)

    def farthest_side(self, children: Children) -> Part:
        return self._part("farthest_side", children)

    def outermost(self, children: Children) -> Part:
        return self._part("outermost", children)

    def from_side(self, children: Children) -> Part:
        return self._part("from_side", children)

    def on_side(self, children: Children) -> Part:
        return self._part("on_side", children)

    def from_side_of(self, children: Children) -> Part:
        return self._part("from_side_of", children)

    def side_of(self, children: Children) -> Part:
        return self._part("side_of", children)

    def view(self, children: Children) -> Part:
        return self._part("view", children)

    def away_from(self, children: Children) -> Part:
        return self._part("away_from", children)

    def swept(self, children: Children) -> Part:
        return Part("from_side", side=first(Side, children).name)

    def near(self, children: Children) -> Part:
        return self._part("near", children)

    def between(self, children: Children) -> Part:
        return self._part("between", children)

    def in_front(self, children: Children) -> Part:
        return self._part("in_front", children)

    def behind(self, children: Children) -> Part:
        return self._part("behind", children)

    def side(self, children: Children) -> Side:
        word = first_token(children)
        if word.type == "INTER":
            return Side("", float(word))
        return Side({"CLOCKWISE": "right", "COUNTERCLOCKWISE": "left"}.get(word.type, word.type.lower()))

    lateral = compass = way = side

    def amount(self, children: Children) -> Measure:
        return Measure(tidy(float(first_token(children))))

    # ---- one thing

    def described(self, children: Children) -> Thing:
        parts = [child for child in children if isinstance(child, Part)]
        noun = first(Noun, children)
        selection = select(noun, parts)
        selection.label = self._widened(noun, selection.needs).label
        return self._one(selection)

    somewhere = described

    def another_one(self, children: Children) -> Thing:
        """Read "the second one": of the class named last."""
        noun = Noun(self._named_before("one").label)
        return self._one(select(noun, [child for child in children if isinstance(child, Part)]))

    def compound(self, children: Children) -> Thing:
        """Read "the desk chair": the chair nearest the desk."""
        of, noun = [child for child in children if isinstance(child, Noun)]
        self._note(f'"{of.label} {noun.label}" is read as the {noun.label} nearest the {of.label}')
        parts = [child for child in children if isinstance(child, Part)]
        return self._one(select(noun, [Part("near", other=Thing(of.label)), *parts]))

    def object(self, children: Children) -> Thing:
        return first(Thing, children)

    target = object

    def it(self, _: Children) -> Thing:
        return self._named_last("it")

    def other(self, children: Children) -> Thing:
        """Read "the other chair": the closest that is not the one named last."""
        noun = maybe(Noun, children)
        last = self._before
        label = noun.label if noun else self._named_before("one").label
        if last is None or last.label != label or last.loop or not last.which or last.which == "1":
            if last is None or last.label != label:
                self._note(f"the other {label} is read as the second closest")
            return self._mean(Thing(label, "2"))
        if last.which.isdigit():
            return self._mean(Thing(label, "1"))
        name = self._fresh(f"other_{identifier(label)}")
        lines = (
            f"{name} = robot.instances({quoted(label)})[0]",
            f"if {name} == {last.which}:",
            f"    {name} = robot.instances({quoted(label)})[1]",
        )
        return self._mean(Thing(label, name, lines))

    def pair(self, children: Children) -> Pair:
        a, b = [child for child in children if isinstance(child, Thing)]
        return Pair(a, b)

    def pair_elided(self, children: Children) -> Pair:
        """Read "the first and the third chair"."""
        at = next(i for i, child in enumerate(children) if isinstance(child, Token) and child.type == "AND")
        noun = first(Noun, children)
        behind = next(i for i, child in enumerate(children) if isinstance(child, Noun))
        shared = [child for child in children[behind:] if isinstance(child, Part)]
        noun = self._widened(noun, 2)
        halves = (children[:at], children[at:behind])
        a, b = [self._one(select(noun, [*(c for c in half if isinstance(c, Part)), *shared])) for half in halves]
        return Pair(a, b)

    def pair_of_two(self, children: Children) -> Pair:
        number = maybe(Measure, children)
        if number and number.text != "2":
            raise CommandError(f"between takes two things, not {number.text}")
        noun = self._widened(first(Noun, children), 2)
        parts = [child for child in children if isinstance(child, Part)]
        if all(part.kind in ("nearest", "from_here") and part.other is None for part in parts):
            return Pair(Thing(noun.label), Thing(noun.label))
        a, b = [self._one(select(noun, [*parts, Part("ranked", rank)])) for rank in (1, 2)]
        return Pair(a, b)

    # ---- several things

    def group(self, children: Children) -> Thing:
        noun, number = first(Noun, children), maybe(Measure, children)
        if number and "." in number.text:
            raise CommandError(f"things are counted in whole numbers, found {number.text}")
        count = 2 if token("BOTH", children) else int(number.text) if number else None
        selection = select(noun, [child for child in children if isinstance(child, Part)])
        selection.label = self._widened(noun, count or 2).label
        thing = selection.each(self._fresh, count)
        for note in selection.notes:
            self._note(note)
        return self._mean(thing)

    def others(self, children: Children) -> Thing:
        """Read "the other chairs": all but the one named last."""
        label, last = first(Noun, children).label, self._before
        name = self._fresh(identifier(label))
        if last is None or last.label != label or last.loop:
            self._note(f"the other {plural(label)} are read as all but the closest")
            last = Thing(label)
        loop = (f"for {name} in robot.instances({quoted(label)}):",)
        known = self._fresh("known")
        value = last.value if last.which else f"robot.instances({quoted(label)})[0]"
        before = (*last.before, f"{known} = {value}")
        return self._mean(Thing(label, name, before, (*loop, f"    if {name} != {known}:"), "        "))

    # ---- helpers

    def _one(self, selection: Selection) -> Thing:
        thing = selection.one(self._fresh)
        for note in selection.notes:
            self._note(note)
        return self._mean(thing)

    def _mean(self, thing: Thing) -> Thing:
        self._last = thing
        return thing

    def _named_last(self, word: str) -> Thing:
        if self._last is None:
            raise CommandError(f'"{word}" was not understood: nothing was named before it')
        # What was set up for it is there already.
        return Thing(self._last.label, self._last.which, indent=self._last.indent)

    def _named_before(self, word: str) -> Thing:
        """Return what was named last in the steps before this one."""
        self._last = self._before
        return self._named_last(word)

    def _fresh(self, name: str) -> str:
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name}_{self._names[name]}"

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)


def first_token(children: Children) -> Token:
    """Return the first token; the grammar promises there is one."""
    return next(child for child in children if isinstance(child, Token))


def _rank(children: Children) -> int:
    return int(token("ORD", children) or 1)


def _listed(labels: Sequence[str]) -> str:
    return f"{', '.join(labels[:-1])} and {labels[-1]}"
