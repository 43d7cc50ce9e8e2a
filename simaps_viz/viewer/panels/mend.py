"""The panel that edits the map: join, cut, rename, delete, undo and redo, with a list of all edits."""

import itertools
import math
from collections.abc import Callable, Sequence
from html import escape
from typing import Any, Literal

import cv2
import numpy as np
import viser

from simaps_viz.colors.instances import take_over
from simaps_viz.drawing.legend import facts_text
from simaps_viz.drawing.theme import BAD_STYLE, BOX_STYLE, DIM_STYLE, STICKY, TEXT_STYLE, note_html, short_html
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.mapping.edits import EditRefused
from simaps_viz.mapping.in_space import all_instances
from simaps_viz.mapping.mending import Entry, Mending
from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec, button, button_row
from simaps_viz.viewer.panels.command import message_html
from simaps_viz.viewer.scene.annotations import draw_lines

Point = tuple[float, float]
"""x and y in metres, map frame."""
UNDER = "It lies under, on or in something else: only what the map shows from above can be changed by hand."
ABOUT = "correct the map by hand: join, cut in two, rename, delete, undo"
CUT = (214, 39, 40)
FLOOR_M = 0.03
CROSS_M = 0.05


def draw_cut(scene: viser.SceneApi, points_m: Sequence[Point], reach_m: float = 0.0) -> None:
    """Draw nothing, a cross at one point, or the line through two points, extended by ``reach_m`` at both ends."""
    z, r = FLOOR_M, CROSS_M
    segments = [[[x - r, y - s, z], [x + r, y + s, z]] for x, y in points_m for s in (r, -r)]
    if len(points_m) == 2:
        a, b = np.asarray(points_m, np.float64)
        along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9) * reach_m
        segments.append([[*(a - along), z], [*(b + along), z]])
    draw_lines(scene, "/cut", np.array(segments).reshape(-1, 2, 3), CUT, 4.0)


def _by_id(simap: SIMap, instance_id: int | None) -> Instance | None:
    return next((one for one in all_instances(simap) if one.id == instance_id), None)


def _offer_buttons(row: viser.GuiButtonGroupHandle, names: Sequence[str]) -> None:
    """Show those buttons of a row that can do something now; viser cannot disable single ones."""
    if names and tuple(row.options) != tuple(names):
        row.options = tuple(names)
    row.visible = bool(names)


NEAREST = 15
"""Objects in the list to join with."""
LISTED = 40
"""Edits in the list; the file has all."""


def nearest(simap: SIMap, one: Instance) -> dict[str, int]:
    """Return {name and distance: id} of the objects nearest to one, those of its class first."""
    here = np.asarray(one.centroid_m[:2])
    others = [other for other in simap.instances if other.id != one.id]
    far = {other.id: float(np.hypot(*(np.asarray(other.centroid_m[:2]) - here))) for other in others}
    others.sort(key=lambda other: (other.label != one.label, far[other.id], other.id))
    return {f"{other.name}, {far[other.id]:.1f} m": other.id for other in others[:NEAREST]}


def classes(simap: SIMap) -> list[str]:
    """Return the map's classes, things first, then by name."""
    named = zip(simap.grid.labels[1:], simap.grid.is_thing[1:], strict=True)
    return [label for label, _ in sorted(named, key=lambda pair: (not pair[1], pair[0]))]


def status_html(simap: SIMap, one: Instance | None, words: str, tone: str, *, known: bool) -> str:
    """Describe the selected object and the outcome of the last edit; it stays in sight while the panel scrolls."""
    if not known:
        head = note_html("This is another map than the one that the edits belong to.")
    elif one in simap.hidden:
        head = note_html(escape(f"{one.name} is selected. {UNDER}"))
    elif one is None:
        head = note_html("Select an object on the map, or in the list under Instance, to mend it.")
    else:
        facts = escape(facts_text(simap, one))
        head = (
            f'<div style="{BOX_STYLE};{TEXT_STYLE};overflow-wrap:anywhere"><b>{short_html(one.name)}</b>'
            f'<br><span style="{DIM_STYLE}">{facts}</span></div>'
        )
    outcome = f'<div role="status">{message_html("", words, tone)}</div>' if words else ""
    return f'<div class="{STICKY}">{head}{outcome}</div>'


def joined_text(simap: SIMap, first: int, second: int) -> str:
    """Report that two objects are joined, and how far apart they are where they do not touch."""
    apart = apart_m(simap, first, second)
    return "Joined." if apart == 0.0 else f"Joined. They do not touch: {apart:.2f} m lie between them. Undo parts them."


def apart_m(simap: SIMap, first: int, second: int) -> float:
    """Return the distance between the nearest edges of two objects, metres; 0 where cells of theirs touch."""
    both = np.isin(simap.instance, (first, second))
    row, col = np.flatnonzero(both.any(axis=1)), np.flatnonzero(both.any(axis=0))
    if first == second or not (simap.instance == first).any() or not (simap.instance == second).any():
        return 0.0
    part = simap.instance[row[0] : row[-1] + 1, col[0] : col[-1] + 1]
    away = cv2.distanceTransform((part != first).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    cells = float(away[part == second].min())
    return 0.0 if cells < 1.5 else (cells - 1.0) * simap.spec.cell_size_m


def edits_html(entries: Sequence[tuple[str, Entry]], undone: int, refused: Sequence[str]) -> str:
    """List the edits, each with its description, the last one first; then those that could not be applied."""
    lost = "".join(f'<li style="{BAD_STYLE}">{escape(why)}</li>' for why in refused)
    if not entries and not lost:
        return note_html(f"No edits; {undone} taken back." if undone else "No edits yet.")
    rows = [
        f"<li>{escape(what)}<br>"
        f'<span style="{DIM_STYLE}">{escape(entry.who)}, {escape(entry.when[:16].replace("T", " "))} UTC</span></li>'
        for what, entry in list(reversed(entries))[:LISTED]
    ]
    rest = f"<li>and {len(entries) - LISTED} before</li>" if len(entries) > LISTED else ""
    back = note_html(f"{undone} taken back.") if undone else ""
    return (
        f'<ol reversed start="{len(entries)}" aria-label="Edits" style="{BOX_STYLE};{TEXT_STYLE};margin:0;'
        f'padding-left:2.6em;overflow-wrap:anywhere">{"".join(rows)}{rest}</ol>{back}'
        + (f'<ul aria-label="Not done" style="{BOX_STYLE};margin:0;padding-left:2.6em">{lost}</ul>' if lost else "")
    )


def saved_html(path: str, saved: bool) -> str:
    """Describe where the edits are saved, or will be."""
    verb = "Saved to" if saved else "Edits will be saved to"
    return note_html(f'{verb} <span style="overflow-wrap:anywhere">{escape(path)}</span>')


NEW_CLASS = "new class …"
ON_MAP = "click it on the map"
CLICKS, NORTH, EAST = "line through 2 clicks", "north to south, middle", "west to east, middle"
ONLY_NEW: tuple[str, ...] = (NEW_CLASS,)
ONLY_ON_MAP: tuple[str, ...] = (ON_MAP,)
Waiting = Literal["join", "cut"] | None


def mend_panel(mending: Mending, who: str) -> PanelSpec:
    """Return the spec of the panel; ``who`` is the default signature of edits."""
    make = lambda page: MendPanel(page, mending, who)  # noqa: E731
    return PanelSpec("Mend", viser.Icon.TOOL, make, about=ABOUT, right="edit")


class MendPanel(Panel):
    """The widgets of one page; the edits themselves are shared by all pages."""

    clicks_first = True  # a join or a cut that another panel's click ended would have to be begun again

    def __init__(self, page: Page, mending: Mending, who: str) -> None:
        """Fill the open container; ``mending`` keeps the edits, ``who`` signs them unless another name is typed."""
        self._page, self._mending, self._default_who = page, mending, who
        self.waiting: Waiting = None
        """What the next click on the map is for."""
        self._points: list[Point] = []
        self._shown: int | None = None
        self._words, self._tone = "", "plain"
        self._of_map = False
        """Whether the next selection follows a new map, where the selected object may have another id, or be gone."""
        self._numbers = itertools.count(1)
        self._others: dict[str, int] = {}
        self._fill(page.gui)
        self.map_changed(page.simap)
        self._of_map = False

    def map_changed(self, simap: SIMap) -> None:
        """List the edits of the new map, and end what waits for a click."""
        self.stop_waiting()
        self._list()
        self._of_map = True
        self._take_selected(self._page.selected)

    def selection_changed(self, instance_id: int | None) -> None:
        """Describe the selected object and offer what can be done with it."""
        self._take_selected(instance_id)
        self._of_map = False

    def _take_selected(self, instance_id: int | None) -> None:
        simap = self._page.simap
        one = _by_id(simap, instance_id)
        if instance_id != self._shown:
            self.stop_waiting()
            if self._tone == "plain" or not self._of_map:  # otherwise the message is the outcome of an edit
                self._say("")  # the message was about the other object
        self._shown = None if one is None else one.id
        known = self._mending.covers(simap)
        if one in simap.hidden:
            one = None  # nothing that could be changed
        self._show_status()
        for widget in (self._class, self._new, self._other, self._how):
            widget.disabled = one is None or not known
        possible = () if one is None or not known else ("Rename", "Join") if len(simap.instances) > 1 else ("Rename",)
        _offer_buttons(self._change, possible)
        _offer_buttons(self._remove, ("Cut in two", "Delete") if possible else ())
        if one is not None:
            self._offer(simap, one)

    def waits_for_click(self) -> bool:
        """Whether a join or a cut waits for one."""
        return self.waiting is not None

    def waits_for_place(self) -> bool:
        """Whether a cut waits for the next point of its line."""
        return self.waiting == "cut"

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Use a click that a join or a cut waits for."""
        if self.waiting is None:
            return False
        if self.waiting == "join":
            other = self._page.simap.at(x_m, y_m)
            if other is None:
                self._say("There is nothing there. Click the other object.", "bad")
            else:
                self._join(other.id)
            return True
        self._points.append((x_m, y_m))
        self._draw(self._points)
        if len(self._points) == 1:
            self._say("Now click the second point. The line continues beyond both points.")
        else:
            self._cut(*self._points)
        return True

    def stop_waiting(self) -> None:
        """Stop waiting for a click."""
        if self.waiting is not None:
            self.waiting = None
            self._say("")
        self._points = []
        self._draw(())
        self._cancel.visible = False

    def state(self) -> dict[str, str]:
        """Return the name that signs edits."""
        return {"who": str(self._who.value)}

    def restore(self, state: dict[str, str]) -> None:
        """Restore the name that signs edits."""
        self._who.value = state.get("who", self._default_who)

    def _fill(self, gui: viser.GuiApi) -> None:
        self._status = gui.add_html("")
        self._cancel = button(gui, "Cancel", self.stop_waiting, icon=viser.Icon.X, color="gray", visible=False)
        self._change = button_row(
            gui, "Change", {"Rename": self.rename, "Join": self.join}, hint="Name it anew, or make it one with another."
        )
        hint = "Make two of it, or take it off the map."
        self._remove = button_row(gui, "Divide, remove", {"Cut in two": self.cut, "Delete": self.delete}, hint=hint)
        undo = {"Undo": self.undo, "Redo": self.redo}
        self._last = button_row(gui, "Last edit", undo, hint="Take the last edit back, or make it again.")
        self._class = gui.add_dropdown(
            "Class", ONLY_NEW, initial_value=NEW_CLASS, hint="The class that Rename gives the object."
        )
        self._class.on_update(lambda _: self._show_new())
        self._new = gui.add_text("New class", "", visible=False, hint="A class that is not on the map yet.")
        self._other = gui.add_dropdown("Join with", ONLY_ON_MAP, initial_value=ON_MAP, hint="The other half, for Join.")
        self._how = gui.add_dropdown("Cut along", (CLICKS, NORTH, EAST), initial_value=CLICKS, hint="For Cut in two.")
        self._who = gui.add_text("Your name", self._default_who, hint="Edits are signed with it.")
        self._saved = gui.add_html("")
        self._edits = gui.add_html("")
        self._add_keys(gui)

    def _add_keys(self, gui: viser.GuiApi) -> None:
        keys: tuple[tuple[str, Any, Any, Callable[[], None]], ...] = (
            ("Mend: join with …", "J", None, self.join),
            ("Mend: cut in two", "X", None, self.cut),
            ("Mend: delete", "delete", None, self.delete),
            ("Mend: undo", "Z", "cmd/ctrl", self.undo),
            ("Mend: redo", "Z", "cmd/ctrl+shift", self.redo),
            ("Mend: wait for no click", "escape", None, self.stop_waiting),
        )
        for label, key, modifier, action in keys:
            command = gui.add_command(label, hotkey=key, modifier=modifier)
            command.on_trigger(lambda _, action=action: action())

    def rename(self) -> None:
        """Assign the chosen class to the selected object."""
        one, who = self._target(), str(self._who.value)
        label = str(self._new.value if self._class.value == NEW_CLASS else self._class.value)
        if one is not None:
            self._do(lambda simap: self._mending.do(simap, "relabel", one, label, who=who), "Renamed.")

    def join(self) -> None:
        """Join the selected object with the chosen one, or with the one that is clicked next."""
        if self._target() is None:
            return
        other = self._others.get(str(self._other.value))
        if other is not None:
            self._join(other)
        else:
            self._wait("join", "Click the other object on the map. The class of the selected one stays.")

    def cut(self) -> None:
        """Cut the selected object: by two clicks, or through its middle."""
        one = self._target()
        if one is None:
            return
        x, y, _ = self._page.simap.by_id(one).centroid_m
        if self._how.value == NORTH:
            self._cut((x, y + 1.0), (x, y - 1.0))
        elif self._how.value == EAST:
            self._cut((x - 1.0, y), (x + 1.0, y))
        else:
            self._wait("cut", "Click two points on the map: the line through them cuts the object.")

    def delete(self) -> None:
        """Delete the selected object."""
        one, who = self._target(), str(self._who.value)
        if one is not None:
            self._do(lambda simap: self._mending.do(simap, "delete", one, who=who), "Deleted. Undo brings it back.")

    def undo(self) -> None:
        """Undo the last edit, whoever made it."""
        self._do(self._mending.undo, "The last edit is taken back.")

    def redo(self) -> None:
        """Redo the edit that was undone last."""
        self._do(self._mending.redo, "The edit is made again.")

    def _join(self, other: int) -> None:
        one, who = self._target(), str(self._who.value)
        if one is None:
            return
        done = joined_text(self._page.simap, one, other)

        def merge(simap: SIMap) -> SIMap:
            mended = self._mending.do(simap, "merge", one, other, who=who)
            take_over(mended, simap, one)
            return mended

        self._do(merge, done)

    def _cut(self, start_m: Point, end_m: Point) -> None:
        one, who = self._target(), str(self._who.value)
        if one is not None:
            self._draw((start_m, end_m))
            self._do(lambda simap: self._mending.do(simap, "split", one, start_m, end_m, who=who), "Cut in two.")

    def _target(self) -> int | None:
        """Return the object that this panel describes; None if another one, or none, is selected."""
        selected = self._page.selected
        if selected is None:
            self._say("Select an object first.", "bad")
        elif selected != self._shown:
            self.selection_changed(selected)
            name = self._page.simap.by_id(selected).name
            self._say(f"{name} is selected now. Do it again to change this one.", "bad")
            return None
        elif self._page.simap.by_id(selected) in self._page.simap.hidden:
            self._say(UNDER, "bad")
            return None
        return selected

    def _do(self, change: Callable[[SIMap], SIMap], done: str) -> None:
        """Queue a change of the map, which is then shown on all pages."""
        simap = self._page.simap

        def job() -> None:
            try:
                if not self._mending.covers(simap):
                    raise InputError("This is another map than the one that the edits belong to.")
                mended = change(simap)
            except SIMapsError as error:
                self.stop_waiting()
                self._say(error.plain if isinstance(error, EditRefused) else str(error), "bad")
                return
            self.stop_waiting()
            self._say(done, "good")
            self._page.publish(mended)  # the object at the same position is then selected

        self._page.submit(f"mend {next(self._numbers)}", job)  # under one name an edit would replace a waiting one

    def _wait(self, what: Waiting, text: str) -> None:
        self.stop_waiting()
        self.waiting = what
        self._cancel.visible = True
        self._say(text)

    def _say(self, text: str, tone: str = "plain") -> None:
        self._words, self._tone = text, tone
        self._show_status()

    def _show_status(self) -> None:
        simap = self._page.simap
        one = _by_id(simap, self._shown)
        self._status.content = status_html(simap, one, self._words, self._tone, known=self._mending.covers(simap))

    def _draw(self, points_m: Any) -> None:
        one = _by_id(self._page.simap, self._shown)
        # The line extends so far beyond its two points that it crosses the object.
        reach_m = 0.0 if one is None else math.dist(one.aabb_m[0][:2], one.aabb_m[1][:2])
        draw_cut(self._page.client.scene, tuple(points_m), reach_m)

    def _show_new(self) -> None:
        self._new.visible = self._class.value == NEW_CLASS

    def _offer(self, simap: SIMap, one: Instance) -> None:
        """Fill the lists of classes and of objects to join with."""
        names = classes(simap)
        self._class.options = (*names, NEW_CLASS)
        self._class.value = one.label
        self._show_new()
        self._others = nearest(simap, one)
        self._other.options = (ON_MAP, *self._others)
        self._other.value = ON_MAP

    def _list(self) -> None:
        mending, log = self._mending, self._mending.log
        known = mending.covers(self._page.simap)
        last = (("Undo", log.entries), ("Redo", log.undone))
        _offer_buttons(self._last, tuple(name for name, edits in last if edits and known))
        entries = list(zip(mending.descriptions(), log.entries, strict=False))
        self._edits.content = edits_html(entries, len(log.undone), mending.refused())
        self._saved.content = saved_html(str(mending.path), mending.saved)
