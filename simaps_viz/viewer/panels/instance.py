"""The panel about one instance: finding it, what it is, where, how often it was seen, and how it looked."""

import difflib
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.drawing.frame_pictures import best_views, gallery, named, outlined
from simaps_viz.drawing.legend import count_text, facts_html, not_counted, object_names
from simaps_viz.drawing.surface import stack_at
from simaps_viz.drawing.theme import BOX_STYLE, DIM_STYLE, small_html
from simaps_viz.errors import CommandError, InputError
from simaps_viz.language.commands import begins_order, read_command
from simaps_viz.language.words import Vocabulary
from simaps_viz.mapping.in_space import all_instances
from simaps_viz.mapping.method import percent_text
from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, button, by_person
from simaps_viz.viewer.page.shared import Snapshot
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.map import FINISH, doubtful_on, show_only

FIND = "Find"
FIND_HINT = "A class, a name, or what a thing is for: chair, chair 18, somewhere to sit. Or a command."
MAX_RANKS = 5
"""Objects that free words find."""
_TYPED = re.compile(r"(?P<name>.*?)\s*#?(?P<number>\d{1,9})?(?:\s+of\s+\d+)?")
HERE, HERE_HINT = "Here, from the top", "Everything at this place, from the top to the floor: select what lies below."
NOTHING: str = "(none)"
MAX_LISTED = 1000
"""The list offers this many instances, the largest; all can be clicked on the map or found by name."""
_ID = re.compile(r"#(\d+)")
"""Edit logs write "chair #18"."""
LIST_HINT = f"Select an object. Of more than {MAX_LISTED} only the largest are listed; Find finds them all."
NO_VIEWS = "Its best views would come from the frames of this map, which are not on this machine."
RECORDED_VIEWS = "The frames are not on this machine; Map at frame goes to its best views in the recorded build."
WHOLE_MAP = "The north arrow shows the whole map."
STEPS = "".join(
    f'<button type="button" data-find="{by}" title="{name}" aria-label="{name}">{sign}</button>'
    for by, name, sign in ((-1, "Previous", "‹"), (1, "Next", "›"))
)
"""Buttons that the page's script answers."""
HELP = f'<div style="{BOX_STYLE}">Click an object on the map, choose it from the list, or type its name in Find.</div>'


class NotFound(Exception):  # noqa: N818 - what was typed is not on the map
    """No object fits what was typed; the message explains why."""


def matches(simap: SIMap, typed: str) -> tuple[Instance, ...]:
    """Return the objects whose name a person typed, in the order of their numbers; at least one.

    Args:
        simap: the map.
        typed: a class, a name ("chair 18"), or the number alone, which no other object has.

    Raises:
        NotFound: no object fits.
    """
    text = " ".join(typed.lower().split())
    match = _TYPED.fullmatch(text)
    name, digits = (match["name"].strip(), match["number"]) if match is not None else ("", None)
    if not name and digits is None:
        raise NotFound("Type a class or a number, such as: chair 18.")
    label = _class_of(simap, name) if name else None
    # A class is what counts count; by its number any object is found.
    named = simap.objects if digits is None else all_instances(simap)
    ones = tuple(one for one in named if label in (None, one.label))
    found = tuple(one for one in ones if digits is None or one.id == int(digits))
    if found:
        return found
    if label is None:
        raise NotFound(f"No object has number {digits}. This map has {plural(len(ones), 'object')}.")
    raise NotFound(f"There is no {label} {digits}. This map has {plural(len(ones), label)}.")


def _class_of(simap: SIMap, name: str) -> str:
    """Return the class of a name: the class itself, its plural, or a part that only one class has."""
    known = {label.lower(): label for label in dict.fromkeys(one.label for one in all_instances(simap))}
    known |= {plural(2, label).removeprefix("2 ").lower(): label for label in known.values()}
    if name in known:
        return known[name]
    fitting = sorted({label for text, label in known.items() if name in text})
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise NotFound(f"Several classes fit: {', '.join(fitting[:6])}.")
    meaning = Vocabulary(simap.counts()).resolve(name)
    if meaning is not None and len(meaning.labels) == 1:  # as a command reads it: "fridge"
        return meaning.labels[0]
    near = difflib.get_close_matches(name, known, n=1)
    more = f" Did you mean {known[near[0]]}?" if near else ""
    raise NotFound(f"No class of this map is called {name}.{more}")


def is_command(simap: SIMap, text: str) -> bool:
    """Whether words are a command or a question, as "turn left" is, and not what one could go to, as "red chair" is."""
    labels = simap.counts(hidden=True)

    def reads(text: str) -> bool:
        try:
            return bool(read_command(text, labels))
        except CommandError:
            return False

    return reads(text) and (begins_order(text, labels) or not reads(f"go to {text}"))


class FindBox(Panel):
    """A box that finds instances by name, and a line that says how many fit and steps through them.

    The line is always there, so that nothing below it moves.
    """

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page, gui = page, page.gui
        # Multiline, so that Enter becomes part of the text: the browser sends only the last change of any 50 ms.
        self._box = gui.add_text(FIND, "", multiline=True, hint=FIND_HINT)
        by_person(self._box, self._typed)
        self._status = gui.add_html("")
        self._typing = threading.Lock()
        self._words = ""
        """What was found."""
        self._found: tuple[Instance, ...] = ()
        self._scores: tuple[float, ...] = ()
        """How well each fits free words."""
        self._lit = False
        """Whether the class of what was found is shown alone for that."""
        self._went = False
        """Whether one of what was found was gone to."""
        self._report("")

    def map_changed(self, simap: SIMap) -> None:
        """Forget what was found on another map."""
        if self._found:
            self._forget()

    def selection_changed(self, instance_id: int | None) -> None:
        """Describe which of what was found is shown, if one still is."""
        if self._went:
            self._tell()

    def told(self, event: Mapping[str, Any]) -> None:
        """Step with the arrow keys, or the line's buttons."""
        if event.get("type") == "find" and self._found:
            self._step(-1 if event.get("step") == -1 else 1)

    def _typed(self) -> None:
        with self._typing:  # a change is told by a thread of its own: the last one is to have the last word
            self._find()

    def _find(self) -> None:
        """Look up what the box says now."""
        text = str(self._box.value)
        entered = "\n" in text
        if entered:
            self._box.value = text = " ".join(text.split())
        if not text.strip() or text != self._words:
            self._forget()
        simap = self._page.simap
        try:
            if text.strip() and not self._found:
                self._list(text, matches(simap, text))
        except NotFound as error:
            why = str(error)  # free words: they are looked for on Enter, as a network may have to read them
            if self._page.services.ask is not None and is_command(simap, text):
                self._report("" if entered else "Enter gives the robot this command.")
                if entered:
                    self._box.value = ""
                    self._page.reveal("Command")
                    self._page.panels[CommandPanel].give(text)
            elif entered:
                self._page.worker.submit("find", lambda: self._search(simap, text, why))
            else:
                self._report("Nothing has this name. Enter searches for what fits.")
            return
        if entered:
            self._step(1)

    def _search(self, simap: SIMap, text: str, why: str) -> None:
        """Find what fits free words, the best first, and go there."""
        try:
            ranked = simap.search(text, MAX_RANKS)
        except (CommandError, InputError) as error:
            found, said = self._asked(simap, text)
            if not found:
                self._report(str(error) if simap.described else f"{said} {why.partition('. ')[2]}" if said else why)
                return
            self._words, self._found, self._scores, self._went = text, found, (), False
        else:
            self._list(text, tuple(one.instance for one in ranked), tuple(one.score for one in ranked))
        self._go_to(0)

    def _asked(self, simap: SIMap, text: str) -> tuple[tuple[Instance, ...], str]:
        """Return what a question for words commands know finds ("red cup", "books on the desk"), and its answer."""
        ask = self._page.services.ask
        try:
            answer = None if ask is None else ask(simap, f"is there any {text}?", self._page.pose)
        except CommandError:
            return (), ""
        if answer is None or answer.answer is None:
            return (), ""
        return tuple(map(simap.by_id, answer.answer["instances"])), answer.answer["text"]

    def _list(self, text: str, found: tuple[Instance, ...], scores: tuple[float, ...] = ()) -> None:
        self._words, self._found, self._scores, self._went = text, found, scores, False
        first, *others = found
        if others and not scores:  # all of them are lit, as the legend does it
            if self._page.selected not in {one.id for one in found}:
                self._page.select(None)
            self._lit = show_only(self._page, first.label)
        self._report(self._count() if others else f"Enter: {first.name}")

    def _count(self) -> str:
        labels = {one.label for one in self._found}
        return f"{labels.pop() if len(labels) == 1 else 'objects'}: {count_text(self._found, doubtful_on(self._page))}."

    def _forget(self) -> None:
        self._words, self._found, self._scores, self._went = "", (), (), False
        if self._lit:
            self._lit = False
            show_only(self._page, None)
        self._report("")

    def _step(self, by: int) -> None:
        """Go to the object after the selected one, or before it; to the first, or the last, if none is selected."""
        ids, here = [one.id for one in self._found], min(-by, 0)
        if self._page.selected in ids:
            here = ids.index(self._page.selected)
        if ids:
            self._go_to((here + by) % len(ids))

    def _go_to(self, at: int) -> None:
        self._went = True
        self._page.go_to(self._found[at])
        self._tell()

    def _tell(self) -> None:
        """Describe which of what was found is selected, or how many there are."""
        found, scores = self._found, self._scores
        at = next((place for place, one in enumerate(found) if one.id == self._page.selected), None)
        if scores:
            names = [
                f"{n}. {one.name} (fits {percent_text(score)}){', shown' * (n - 1 == at)}"
                for n, (one, score) in enumerate(zip(found, scores, strict=True), 1)
            ]
            said = "; ".join(names) + "."
        elif len(found) > 1:
            said = self._count() if at is None else f"{found[at].name}: {at + 1} of {len(found)}."
        else:
            said = ""
        self._report(said, "" if at is None else WHOLE_MAP)

    def _report(self, text: str, then: str = "") -> None:
        said = f'<span role="status">{escape(f"{text} {then}".strip())}</span>'
        steps = STEPS if len(self._found) > 1 else ""
        self._status.content = f'<div class="simaps-found" style="{DIM_STYLE}">{said}{steps}</div>'


class FrameGallery:
    """Pictures of frames side by side, and a row of buttons that go to these frames."""

    def __init__(self, page: Page) -> None:
        """Add both to the open container, hidden."""
        self._page = page
        self._picture = page.gui.add_image(np.full((2, 2, 3), 255, np.uint8), visible=False)
        self._frames: dict[str, int] = {}
        self._went: tuple[int | None, int] | None = None
        """The object, and the frame, that a button has gone to."""
        hint = "Show the map as it was after that frame; the recorded build, where there is one, shows the frame."
        self._jump = page.gui.add_button_group("Map at frame", ("-",), visible=False, hint=hint)
        self._jump.on_click(lambda event: self._go(str(event.target.value)))

    def show(self, pictures: Sequence[NDArray], frames: dict[str, int]) -> None:
        """Show thumbnails, uint8 [h, w, 3], and buttons for frames, {name: index}, where the frames can be seen."""
        frames = self._frames = frames if pictures or self._page.recording.url is not None else {}
        if pictures:
            self._picture.image = gallery(pictures)
        self._picture.visible = bool(pictures)
        if frames:
            self._jump.options = tuple(frames)
        self._jump.visible = bool(frames)

    def hide(self) -> None:
        """Hide pictures and buttons; a frame that was shown of another object than the selected one is left."""
        self._picture.visible = self._jump.visible = False
        went, page = self._went, self._page
        if went is not None and went[0] != page.selected:
            self._went = None
            if page.frame == went[1]:
                page.finish()

    def _go(self, name: str) -> None:
        if name in self._frames:
            self._page.unfold_recording()
            self._page.show_frame(self._frames[name])
            self._went = self._page.selected, self._page.frame


class InstancePanel(Panel):
    """The list of instances, and the facts about the selected one."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page, gui = page, page.gui
        self._ids: dict[str, int] = {}
        self._list = gui.add_dropdown("Object", tuple([NOTHING]), initial_value=NOTHING, hint=LIST_HINT)
        by_person(self._list, lambda: page.select(self._ids.get(str(self._list.value))))
        self._here = gui.add_button_group(HERE, ("-",), hint=HERE_HINT, visible=False)
        self._here.on_click(lambda event: self._go_down(str(event.target.value)))
        self._stack: dict[str, tuple[float, float, float]] = {}
        self._text = gui.add_html(HELP)
        self._why = gui.add_html("", visible=False)
        self._views = FrameGallery(page)
        icon = viser.Icon.PLAYER_TRACK_NEXT
        self._finish = button(gui, FINISH, page.finish, icon=icon, color="gray", visible=False)
        self._note = gui.add_html("", visible=False)
        self._listed = page.simap, doubtful_on(page)
        """The map whose objects are listed, and the doubtful ones."""
        self._list_objects()

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """List the objects of the map, the doubtful called so, once the map is seen."""
        now = simap, doubtful_on(self._page)
        if not snapshot.badge and now != self._listed:
            self._listed = now
            self._page.worker.submit("list", self._list_objects, later=True)

    def _list_objects(self) -> None:
        simap, doubtful = self._listed
        names = object_names(simap, MAX_LISTED, not_counted(simap, doubtful))
        if names == self._ids:
            return
        chosen = self._ids.get(str(self._list.value))
        self._ids = names
        self._list.options = (NOTHING, *names)
        kept = next((name for name, number in names.items() if number == chosen), None)
        if kept is not None:
            self._list.value = kept

    def time_changed(self, frame: int, step: int | None) -> None:
        """Offer a way back from an earlier frame."""
        past = frame < self._page.last_frame or step is not None
        if self._finish.visible != past:
            self._finish.visible = past

    def selection_changed(self, instance_id: int | None) -> None:
        """Describe the selected instance, or how to select one; its pictures follow once they are read."""
        simap = self._page.simap
        instance = None if instance_id is None else simap.by_id(instance_id)
        self._views.hide()
        self._list_stack()
        self._note.visible = instance is not None
        self._note.content = small_html("Loading its best views …")
        self._why.visible = False
        self._text.content = HELP if instance is None else facts_html(simap, instance, doubtful_on(self._page))
        listed = (name for name, number in self._ids.items() if number == instance_id)
        name = NOTHING if instance is None else next(listed, instance.name)
        if name not in self._list.options:
            self._ids = {name: instance.id, **self._ids} if instance is not None else self._ids
            self._list.options = (NOTHING, *self._ids)
        if self._list.value != name:
            self._list.value = name
        if instance_id is not None:
            self._page.worker.submit("pictures", lambda: self._show_pictures(simap, instance_id))

    def _list_stack(self) -> None:
        """List what lies at the selected position, where it is more than one thing."""
        simap, at = self._page.simap, self._page.picked
        self._stack = {}
        if at is not None:
            x_m, y_m = simap.spec.centre_of(*simap.spec.cell_of(*at))  # where the points of the cell are
            self._stack = {simap.by_id(number).name: (x_m, y_m, z) for number, z in stack_at(simap, x_m, y_m).items()}
        self._here.visible = len(self._stack) > 1
        if len(self._stack) > 1 and tuple(self._stack) != tuple(self._here.options):
            self._here.options = tuple(self._stack)

    def _go_down(self, name: str) -> None:
        """Select what a name in the list is of: what is on top as a click does, the rest by its height."""
        if name in self._stack:
            x_m, y_m, z_m = self._stack[name]
            on_top = self._page.simap.at(x_m, y_m)
            if on_top is not None and on_top.name == name:
                self._page.pick((x_m, y_m))
            else:
                self._page.pick_in_space((x_m, y_m, z_m))

    def explain(self, summary: str | None, edits: Sequence[Mapping[str, Any]] = ()) -> None:
        """Show why the selected instance is one object (HTML), and who edited it; None = nothing is selected."""
        self._why.content = (summary or "") + edits_html(edits)
        self._why.visible = summary is not None

    def _show_pictures(self, simap: SIMap, instance_id: int) -> None:
        """Show the best views, a note and buttons for their frames, unless another instance is selected meanwhile."""
        pictures, note, frames = best_pictures(simap, instance_id, self._page.view)
        if frames and not pictures and self._page.recording.url is not None:
            note = RECORDED_VIEWS
        if instance_id == self._page.selected:
            self._views.show(pictures, frames)
            self._note.content, self._note.visible = small_html(note), True


def edits_html(edits: Sequence[Mapping[str, Any]]) -> str:
    """List the edits of an object, the last one first; empty if there are none."""
    if not edits:
        return ""
    lines = ""
    for edit in reversed(edits):
        what = _ID.sub(r"\1", str(edit.get("what")))
        when = str(edit.get("when"))[:16].replace("T", " ")
        lines += f"<div>{escape(what)}, by {escape(str(edit.get('who')))}, {escape(when)} UTC</div>"
    return f'<div style="{BOX_STYLE}"><b>Edited by hand</b>{lines}</div>'


def best_pictures(
    simap: SIMap, instance_id: int, view: Callable[[int], tuple[NDArray, NDArray] | None]
) -> tuple[list[NDArray], str, dict[str, int]]:
    """Return an instance's best views (none when the sequence is not at hand), a note, and the frames."""
    views = best_views(simap, instance_id)
    names = {str(one.frame): one.frame for one in views}
    pictures = []
    for one in views:
        seen = view(one.frame)
        if seen is not None:
            pictures.append(named(outlined(*seen, one.segments), f"frame {one.frame}"))
    if pictures:
        return pictures, "Its best views, the object's mask outlined.", names
    seen = simap.by_id(instance_id).frames
    kept = f"Seen in {plural(seen, 'frame')}; which show it best is kept of what the map shows from above only."
    return [], NO_VIEWS if views else kept if seen else "No frame named this object.", names
