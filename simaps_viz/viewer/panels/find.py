"""Finds an object by what it is called, "chair 214" or "214", on maps with more objects than a list can hold."""

import difflib
import re
from collections.abc import Callable
from html import escape

import viser

from simaps_viz.colors.classes import plural
from simaps_viz.drawing.legend import object_name
from simaps_viz.drawing.theme import BOX_STYLE, DIM_STYLE
from simaps_viz.structures import Instance, SIMap

FIND = "Find"
HINT = "A class, a class and a number, or the number of an object, such as: chair, chair 7, 214. Enter goes there."
_TYPED = re.compile(r"(?P<name>.*?)\s*#?(?P<number>\d{1,9})?(?:\s+of\s+\d+)?")


class NotFound(Exception):  # noqa: N818 - what was typed is not on the map
    """What was typed means no object; says why not, in words."""


def find(simap: SIMap, typed: str, *, after: int | None = None) -> Instance:
    """Return the object that what was typed means.

    Args:
        simap: the map.
        typed: a class, a class and a number among its objects, or the number of an object on the map.
        after: id of the selected object; a class alone means the next of its objects after that one.

    Raises:
        NotFound: it means none.
    """
    text = " ".join(typed.lower().split())
    match = _TYPED.fullmatch(text)
    name, digits = (match["name"].strip(), match["number"]) if match is not None else ("", None)
    number = None if digits is None else int(digits)
    if name:
        return _of_class(simap, _class_of(simap, name), number, after)
    if number is None:
        raise NotFound("Type a class or a number, such as: chair 7.")
    one = next((one for one in simap.instances if one.id == number), None)
    if one is None:
        raise NotFound(f"No object has number {number}. This map has {plural(len(simap.instances), 'object')}.")
    return one


def _of_class(simap: SIMap, label: str, number: int | None, after: int | None) -> Instance:
    """Return an object of a class by its number among them, or the next one."""
    ones = simap.of_class(label)
    if number is None:
        return next((one for one in ones if after is not None and one.id > after), ones[0])
    if not 1 <= number <= len(ones):
        raise NotFound(f"There is no {label} {number}. This map has {plural(len(ones), label)}.")
    return ones[number - 1]


def _class_of(simap: SIMap, name: str) -> str:
    """Return the class that a name means: as it is called, in the plural, or by a part that no other class has."""
    known = {label.lower(): label for label in simap.counts()}
    known |= {plural(2, label).removeprefix("2 ").lower(): label for label in known.values()}
    if name in known:
        return known[name]
    fitting = sorted({label for text, label in known.items() if name in text})
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise NotFound(f"Several classes fit: {', '.join(fitting[:6])}.")
    near = difflib.get_close_matches(name, known, n=1)
    more = f" Did you mean {known[near[0]]}?" if near else ""
    raise NotFound(f"There is no {name} on this map.{more}")


class FindBox:
    """A box to type in, and a line that says what Enter would do."""

    def __init__(
        self,
        gui: viser.GuiApi,
        simap: Callable[[], SIMap],
        go: Callable[[Instance], None],
        selected: Callable[[], int | None] = lambda: None,
    ) -> None:
        """Fill the current container.

        Args:
            gui: where.
            simap: gives the map shown now.
            go: selects an object and looks at it.
            selected: gives the id of the selected object.
        """
        self._simap, self._go, self._selected = simap, go, selected
        # Of several lines, for Enter is seen in the text: the page sends only the last change of any 50 ms.
        self._box = gui.add_text(FIND, "", multiline=True, hint=HINT)
        self._box.on_update(self._typed)
        self._said = gui.add_html("", visible=False)

    def _typed(self, event: viser.GuiEvent) -> None:
        if event.client_id is None:
            return
        text = str(self._box.value)
        entered = "\n" in text
        if entered:
            self._box.value = text = " ".join(text.split())
        if not text.strip():
            self._say("")
            return
        try:
            simap = self._simap()
            one = find(simap, text, after=self._selected())
        except NotFound as error:
            self._say(str(error))
            return
        if entered:
            self._go(one)
            self._say("Key T shows the whole map again.")
        else:
            self._say(f"Enter: {object_name(simap, one)}")

    def _say(self, text: str) -> None:
        self._said.content = f'<div role="status" style="{BOX_STYLE};{DIM_STYLE}">{escape(text)}</div>'
        self._said.visible = bool(text)
