"""The panel about the map: its origin, how it is cut into instances, and what its colours mean."""

import base64
import functools
import json
import threading
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from html import escape
from itertools import chain
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
import viser
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from simaps_viz.colors.classes import CLUTTER, FLOOR, UNSEEN, WALL, ground_kinds, plain, plural
from simaps_viz.drawing.compare_picture import difference_text
from simaps_viz.drawing.legend import counted, counts_of, counts_text, legend_html, not_counted, title_of
from simaps_viz.drawing.texture import TINT, ColorMode, color_modes
from simaps_viz.drawing.theme import BADGE_STYLE, short
from simaps_viz.geometry import shared_cells
from simaps_viz.mapping.in_space import all_instances, has_voxels
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import slider_of
from simaps_viz.structures import Grid, Instance, Room, SIMap
from simaps_viz.viewer.page.page import MAX_RESOLUTION, MIN_RESOLUTION, SELECTED_TAB, Cut, Page, cut_of
from simaps_viz.viewer.page.panel import Panel, button, button_row, by_person
from simaps_viz.viewer.page.shared import Snapshot, cells_by_id
from simaps_viz.viewer.scene.camera import SLANT, TOP, Extent, with_margin
from simaps_viz.viewer.scene.map_scene import FULL_HEIGHT_M, Style

EVERY_CLASS = "all classes"
FINISH = "Show the finished map"
BEFORE = "Before and after"
PEEKING = "Showing before – press again for after"
BEFORE_HINT = "The map as it came, before the sliders were moved, and as it is."
STEP_HINT = "Go to what the slider changed, one after the other; the north arrow shows the whole map."
MAX_MOVED, MAX_CHANGES = 3, 8
"""Classes and changes that are named beside a moved slider; the other changes are folded up."""
MAX_SHOWN = 200
"""Changes that are outlined at once, and listed; where more changed, lines all over the map would take seconds."""
_KINDS = {"missed": "gone", "extra": "new"}
"""What a comparison calls otherwise, as one of its maps is the truth."""
MODE_HINT = "What a colour on the map means; the legend follows."
TINT_HINT = "How much of the objects' colours lies over the photo."
CUT_HINT = "Leave out everything above, as if the roof and then the tables were lifted off."
WALLS_HINT = "Show walls in full height; otherwise they end low, so that one can look in."
DOUBTFUL_HINT = "What has less is doubtful: faint and not counted. Commands and exports have it all the same."
MapState = tuple[ColorMode, int, str | None, bool, tuple[int, float, int], Cut | None]
GROUND_ID = 1 << 23
"""Ids of objects are less, in what the page's script is sent."""
ABOUT = "What a camera with depth saw. Tap or click a thing to ask what it is, and why."
LEGEND_STYLE = "border-block:1px solid rgba(128,128,128,.25);margin-bottom:.4em"
"""Inline style of the legend."""


class Change(NamedTuple):
    """What became of one or several objects of a map, and where that is."""

    text: str
    """In the words of a comparison: "split · chair 211 → 211 + 246"."""
    before: tuple[int, ...]
    after: tuple[int, ...]
    extent_m: Extent


class MapPanel(Panel):
    """The map's origin, the sliders that cut it into instances, and the legend of its colours."""

    _in_space = _outlined = False
    _outlined_at: tuple[float, float] | None = None
    """The position that was selected when what changed was outlined."""
    _changed: tuple[Change, ...] = ()
    """What a moved slider changed, the largest first."""
    _said = _said_of_it = ""
    """What is counted on the map, and what is said of that which a moved slider changed."""
    _looked = 0
    """Which of it is looked at, counted from 1."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page = page
        self._rooms_shown: tuple[Room, ...] = ()
        self.faded: frozenset[str] = frozenset()
        """Classes that are dimmed."""
        self._other_mode: ColorMode = "photo"
        self._describing, self._undescribed = threading.Lock(), False
        gui, simap, services = page.gui, page.base, page.services
        self._with_k, self._with_resolution = services.repartition is not None, services.recommunity is not None
        own, joining = cut_of(simap), slider_of(simap)
        # What the map is, and a way back from an earlier time step.
        self._origin = gui.add_html(origin_html(simap))
        self._past = gui.add_html("", visible=False)
        self._finish = button(gui, FINISH, page.finish, icon=viser.Icon.PLAYER_TRACK_NEXT, color="gray", visible=False)
        self._counts = gui.add_html("")
        self._busy, self._counts_before = False, ""
        views = {name: functools.partial(page.look, name) for name in (TOP, SLANT)}
        button_row(gui, "View", views, hint="From above, or the room in 3-D (keys T and 3).")
        self._mode = gui.add_dropdown("Colours", color_modes(simap), initial_value=_first_mode(simap), hint=MODE_HINT)
        self._tint = gui.add_slider("Over photo (%)", 0, 100, 5, round(100 * TINT), hint=TINT_HINT, visible=False)
        # What of the surface is shown in the 3-D view.
        self._cut_m = gui.add_slider(
            "Cut at height", 0.1, FULL_HEIGHT_M, 0.1, FULL_HEIGHT_M, hint=CUT_HINT, visible=False
        )
        self._walls = gui.add_checkbox("Whole walls", False, hint=WALLS_HINT, visible=False)
        for widget in (self._cut_m, self._walls):
            by_person(widget, self._cut_surface)
        # The sliders that cut it into instances.
        self._k = gui.add_slider(joining.title, 0.0, 100.0, 0.5, own.percent, hint=joining.hint)
        self.order_of_method = (self._cut_m.order + self._k.order) / 2.0
        """Where the choice of the method goes, above the sliders; see `MethodPanel`."""
        self._resolution = gui.add_slider(
            "Resolution",
            MIN_RESOLUTION,
            MAX_RESOLUTION,
            0.05,
            own.resolution,
            hint="The higher, the smaller the parts that are found before they are merged (Louvain's resolution).",
        )
        for slider in (self._k, self._resolution):
            by_person(slider, self._cut)
        # What has always one height comes first, so that nothing slides away from under the pointer.
        self._peek = button(gui, BEFORE, self.peek, color="gray", visible=False, hint=BEFORE_HINT)
        icon = viser.Icon.ARROW_BACK_UP
        self._reset = button(gui, "Reset", self.reset, icon=icon, color="gray", visible=False)
        self._step = button(gui, "", self._show_next, color="gray", visible=False, hint=STEP_HINT)
        self._change = gui.add_html("", visible=False)
        self._legend = gui.add_html("")
        self._was: tuple[SIMap, Cut] | None = None
        """The map as it came, before any slider was moved, and its cut; while that is looked at, the one after."""
        self._after: Cut | None = None
        """How the map is to be cut after the map before was looked at; None = that is not looked at."""
        self._shown, self._shown_cut = simap, own
        # What is painted.
        self._class = gui.add_dropdown(
            "Show", (EVERY_CLASS, *simap.counts()), initial_value=EVERY_CLASS, hint="Emphasise one class."
        )
        self._rooms = gui.add_checkbox("Rooms", False, hint="Outline the rooms, with their names.")
        with gui.add_folder("Doubtful", expand_by_default=False):
            self._least_frames = gui.add_slider("Frames at least", 0, 20, 1, simap.frames_to_count, hint=DOUBTFUL_HINT)
            self._least_score = gui.add_slider("Score at least", 0.0, 1.0, 0.05, 0.0, hint=DOUBTFUL_HINT)
            self._least_cells = gui.add_slider("Cells at least", 0, 100, 1, 0, hint=DOUBTFUL_HINT)
        limits = self._least_frames, self._least_score, self._least_cells
        for widget in (self._mode, self._tint, self._class, self._rooms, *limits):
            widget.on_update(lambda _: page.repaint())
        self.base_changed(simap)

    @property
    def percent(self) -> float:
        """K or evidence of the slider, percent."""
        return float(self._k.value)

    @property
    def resolution(self) -> float:
        """Louvain resolution of the slider."""
        return float(self._resolution.value)

    @property
    def mode(self) -> ColorMode:
        """What the colours mean."""
        return cast(ColorMode, self._mode.value)

    @property
    def shown_class(self) -> str | None:
        """The class to emphasise, or None for all."""
        return None if self._class.value == EVERY_CLASS else self._class.value

    def base_changed(self, base: SIMap) -> None:
        """Set the sliders to the cut of the page."""
        self._was = self._after = None
        self._shown_cut = self._page.cut
        joining = slider_of(base)
        self._origin.content = origin_html(base)
        self._k.label, self._k.hint = joining.title, joining.hint
        self._k.visible = self._with_k and joins(base)
        self._resolution.visible = self._with_resolution and "resolution" in base.parameters
        self._reset.label = f"Reset {joining.word} and resolution"
        self.set_sliders(self._page.cut.percent, self._page.cut.resolution)

    def view_changed(self, name: str) -> None:
        """Offer to cut the surface while it is shown; each view keeps its colours, at first 3-D those of a photo."""
        surface = name == SLANT and has_voxels(self._page.simap)
        self._cut_m.visible = self._walls.visible = surface
        if surface != self._in_space:
            before, now = self.mode, self._other_mode
            self._in_space, self._other_mode = surface, before
            self._mode.value = now if now in self._mode.options else "instance"
            self._offer_tint()
            self._page.repaint()  # also where both views have one mode: the legend says what is outlined

    def _offer_tint(self) -> None:
        on_photo = self.mode == "photo" and not self._in_space
        if self._tint.visible != on_photo:
            self._tint.visible = on_photo

    def map_changed(self, simap: SIMap) -> None:
        """Offer the colours that the map has; what a moved slider changed is described once the map is painted."""
        base, own, cut = self._page.base, cut_of(self._page.base), self._page.cut
        self._shown, self._shown_cut = simap, cut
        if after := self._after:
            self._was = self._page.shared.cut_map(base, after.percent, after.resolution), after
        else:
            self._was = (base, own) if cut != own and simap is not base else None  # as the map came: nothing is moved
        self._reset.visible = self._page.cut_here or self._was is not None  # also while the map before is looked at
        self._undescribed = True
        if color_modes(simap) != tuple(self._mode.options):
            self._mode.options = color_modes(simap)

    def peek(self) -> None:
        """Show the map as it came, before the sliders were moved; called again, as it is after."""
        if self._was is not None:
            after, self._after = self._after, None if self._after else self._page.cut
            cut = after or cut_of(self._page.base)
            self.set_sliders(cut.percent, cut.resolution)
            self._cut_anew()

    def _describe_change(self) -> None:
        """Describe and outline what a moved slider changed, once for each cut."""
        with self._describing:
            if self._undescribed:
                self._undescribed = False
                self._describe_now()
                if self._was is not None and not self._outlined and self._page.selected is not None:
                    self._page.repaint()  # nothing is outlined after all

    def _describe_now(self) -> None:
        was, now, peeking = self._was, self._shown, self._after is not None
        self._peek.label = PEEKING if peeking and was is not None else BEFORE
        self._change.visible = self._peek.visible = was is not None
        if was is None:
            self._step.visible, self._looked = False, 0
            self._outline(now, ())
            return
        before, after = (now, was[0]) if peeking else (was[0], now)
        changes, edges = changes_between(before, after)
        at = self._which_of_two(was[1])
        said = change_text(self._counted(before), self._counted(after), changes, len(edges))
        other = cut_text(now, was[1], self._shown_cut)
        said = f"{at}. After, {other}: {said}" if peeking else f"{at}, instead of {other} as it came: {said}"
        self._said_of_it, self._change.content = said, _change_html(at, said)
        found = changes or edges
        same = [one.text for one in found] == [one.text for one in self._changed]
        self._changed = found
        if same and self._looked:  # before and after: the same change is looked at
            self._outline_looked()
            return
        self._looked = 0
        self._outline(now, [self._ids_now(change) for change in found] if len(found) <= MAX_SHOWN else ())
        if found:
            what = ("change" if changes else "changed outline") + "s" * (len(found) > 1)
            self._step.label = f"Show {'the' if len(found) == 1 else f'each of {len(found)}'} {what}"
        self._step.visible = bool(found)

    def _which_of_two(self, other: Cut) -> str:
        """Return which map is shown, and how it is cut, unlike the other: "Now: evidence 75 %"."""
        return f"{'Now' if self._after is None else 'Before'}: {cut_text(self._shown, self._shown_cut, other)}"

    def _ids_now(self, change: Change) -> tuple[int, ...]:
        """Return the objects of a change that are on the map that is shown."""
        return change.after if self._after is None else change.before

    def change_of(self, ids: Collection[int]) -> tuple[str, str]:
        """Return how a moved slider cuts the map, and what it changed of objects, in words; both empty if nothing."""
        self._describe_change()
        changed = self._changed if self._was is not None else ()
        mine = next((one for one in changed if not set(ids).isdisjoint(self._ids_now(one))), None)
        if mine is None or self._was is None:
            return "", ""
        return cut_text(self._shown, self._shown_cut, self._was[1]), mine.text

    def _show_next(self) -> None:
        """Look at the next change that a moved slider made, and outline it, as it was where nothing is there now."""
        if self._was is None or not self._changed:
            return
        change = self._changed[self._looked % len(self._changed)]
        self._looked = self._looked % len(self._changed) + 1
        self._step.label = f"{change.text} ({self._looked} of {len(self._changed)}): show the next"
        self._outline_looked()
        self._page.viewpoints.look_at(with_margin(change.extent_m, share=1.0, least_m=1.5))

    def _outline_looked(self) -> None:
        """Outline the change that is looked at, on the map where it is."""
        change = self._changed[self._looked - 1]
        now = self._ids_now(change)
        simap = self._shown if now or self._was is None else self._was[0]
        self._outline(simap, [now or change.before or change.after])

    def _outline(self, simap: SIMap, changes: Sequence[Sequence[int]]) -> None:
        """Outline the objects of changes, each of one in a colour of its own, and name those of one that is alone.

        They stay so until something else is selected, or Escape is pressed.
        """
        ids, parts = [one for ones in changes for one in ones], [part for ones in changes for part in range(len(ones))]
        self._outlined, self._outlined_at = bool(ids), self._page.picked
        self._page.scene.show_changed(simap, ids, parts, named=len(changes) == 1 and len(ids) > 1)

    def _end_outlines(self) -> None:
        if self._outlined:
            self._outline(self._shown, ())
            self._page.repaint()

    def _cut_surface(self) -> None:
        self._page.scene.cut_at(float(self._cut_m.value), whole_walls=bool(self._walls.value))

    def set_sliders(self, percent: float, resolution: float) -> None:
        """Move the sliders without cutting the map."""
        self._k.value = percent
        self._resolution.value = min(max(resolution, MIN_RESOLUTION), MAX_RESOLUTION)

    def set_look(self, mode: ColorMode, shown_class: str | None) -> None:
        """Set what the colours mean, and the class to emphasise."""
        self._mode.value = mode
        if shown_class is None or shown_class in self._class.options:
            self._class.value = shown_class or EVERY_CLASS

    def style(self, simap: SIMap, style: Style) -> Style:
        """Paint in the chosen colours, and emphasise the chosen class unless an instance is selected."""
        shown, faded = self.shown_class, self.faded
        if self._outlined or (self._undescribed and self._was is not None):
            style = replace(style, lit=None)  # what changed is seen all over the map, whatever is selected
        if style.lit is None and (shown is not None or faded):
            lit = simap.of_class(shown) if shown is not None else simap.instances
            style = replace(style, lit=frozenset(one.id for one in lit if one.label == shown or one.label not in faded))
        elif style.lit is not None and shown is not None:  # the class stays shown beside the selected one
            style = replace(style, lit=style.lit | {one.id for one in simap.of_class(shown)})
        style = replace(style, mode=self.mode, tint=self._tint.value / 100.0)
        if self.mode not in ("instance", "class"):
            return style
        return replace(style, faint=self.doubtful(simap) - (style.lit or frozenset()))

    def doubtful(self, simap: SIMap) -> frozenset[int]:
        """Return the ids of the objects that were seen too little, by the thresholds that the person has set."""
        return doubtful_of(simap, self._least_frames.value, self._least_score.value, self._least_cells.value)

    def _counted(self, simap: SIMap) -> dict[str, int]:
        """Return how many objects of each class count."""
        return counted(simap, self.doubtful(simap))

    def told(self, event: dict[str, Any]) -> None:
        """Show a class of the legend alone, or all again; or fade it, or show it again."""
        name = event.get("name")
        if event.get("type") != "class" or name not in self._class.options:
            return
        if event.get("do") == "fade":
            self.faded ^= {name}
            self._class.value = EVERY_CLASS  # beside a class that is shown alone nothing is seen of it
            self._page.repaint()
        else:
            self._class.value = EVERY_CLASS if name == self._class.value else name

    def show_only(self, label: str | None) -> bool:
        """Show a class alone, or all again, also those that are faded; return whether one is."""
        self._end_outlines()
        self._class.value = label if label in self._class.options else EVERY_CLASS
        if label is None and self.faded:
            self.faded = frozenset()
            self._page.repaint()
        return self.shown_class is not None

    def selection_changed(self, instance_id: int | None) -> None:
        """Show all again, if an object of another class is selected than the one shown alone; end what is outlined."""
        if self._page.picked != self._outlined_at:  # not by the map that was cut anew
            self._end_outlines()
        if instance_id is not None and self.shown_class not in (None, self._page.simap.by_id(instance_id).label):
            self._class.value = EVERY_CLASS

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """Describe the painted map, with a badge unless it is the finished one."""
        self._busy = False
        other = bool(snapshot.badge) and snapshot.until is None  # an earlier map, with ids of its own
        doubtful = frozenset() if other else self.doubtful(simap)
        self._said, self._counts.content = counts_text(simap, doubtful=doubtful), counts_html(simap, doubtful)
        self._show_rooms(simap)
        self._offer_tint()
        for widget in (self._k, self._resolution, self._reset):
            widget.disabled = not simap.instances and not simap.graphs
        moved = self._page.cut_here or self._was is not None  # also while the map before is looked at
        self._reset.disabled |= not moved
        seen = self.mode == "instance" or not self._in_space  # on a photo of the floor plan, objects are outlined
        legend = legend_html(simap, self.mode, self._page.theme, buttons=True, doubtful=doubtful, colored=seen)
        legend = f'<div class="simaps-legend" style="{LEGEND_STYLE}">{legend}</div>'
        if self._legend.content != legend:  # sent again, it would lose the focus of its buttons
            self._legend.content = legend
        shown = simap.counts()
        options = (EVERY_CLASS, *(label for label in counts_of(simap, doubtful) if label in shown))
        if options != tuple(self._class.options):
            self._class.options = options  # viser keeps the chosen class if it is still there
        words = f'<span style="{BADGE_STYLE}">{escape(snapshot.badge)}</span>'
        content = f'<div style="padding:.2em .8em .4em;font-size:.85em">{words}</div>'
        past = bool(snapshot.badge)
        if past and self._past.content != content:
            self._past.content = content
        if self._past.visible != past:
            self._past.visible = self._finish.visible = past
        if self._undescribed:  # the map is seen first: what changed takes longer to say
            was = self._was
            if was is not None:
                at = self._which_of_two(was[1])
                self._change.content = _change_html(at, f"{at}. Looking for what changed …", over=self._said_of_it)
                self._change.visible = True
            self._page.worker.submit("changes", self._describe_change, later=True)

    def _show_rooms(self, simap: SIMap) -> None:
        rooms = simap.rooms if self._rooms.value else ()
        if rooms != self._rooms_shown:
            self._rooms_shown = rooms
            self._page.scene.show_rooms(rooms)

    def failed(self) -> None:
        """Show the counts again: cutting the map may be what failed."""
        if self._busy:
            self._busy = False
            self._counts.content = self._counts_before

    def state(self) -> MapState:
        """Return colours, their share over a photo, the class to emphasise, rooms, limits, and the cut if set here."""
        least = self._least_frames.value, self._least_score.value, self._least_cells.value
        cut = self._page.cut if self._page.cut_here else None
        return self.mode, int(self._tint.value), self.shown_class, bool(self._rooms.value), least, cut

    def restore(self, state: MapState) -> None:
        """Restore the colours, the rooms, the limits and the cut."""
        mode, self._tint.value, shown_class, self._rooms.value, least, cut = state
        self._least_frames.value, self._least_score.value, self._least_cells.value = least
        self.set_look(mode, shown_class)
        if cut is not None:
            self.set_sliders(cut.percent, cut.resolution)
            self._page.cut_map(cut.percent, cut.resolution)

    def reset(self) -> None:
        """Go back to the K and resolution the map came with."""
        own = cut_of(self._page.base)
        self.set_sliders(own.percent, own.resolution)
        self._cut()

    def _cut(self) -> None:
        """Cut the map as the sliders are now; what was after, if the map before is looked at, is let go."""
        if self._after is not None:
            self._was = self._after = None
        self._cut_anew()

    def _cut_anew(self) -> None:
        if not self._busy:
            self._busy, self._counts_before = True, str(self._counts.content)
            self._counts.content = _line("Cutting the map anew; until then all shows the map before …", over=self._said)
        self._page.cut_map(self.percent, self.resolution)


def doubtful_of(simap: SIMap, frames: int, score: float = 0.0, cells: int = 0) -> frozenset[int]:
    """Return the ids of the objects that do not count: of which there is less than any of these, or hidden ones."""
    few = (one for one in simap.instances if one.frames < frames or one.score < score or one.cells < cells)
    return frozenset(one.id for one in few) | (simap.doubtful & {one.id for one in simap.hidden})


def doubtful_on(page: Page) -> frozenset[int]:
    """Return the ids of the objects that a page does not count."""
    return page.panels[MapPanel].doubtful(page.simap) if MapPanel in page.panels else page.simap.doubtful


def show_only(page: Page, label: str | None) -> bool:
    """Show a class of a page alone, or all again; return whether one is."""
    return MapPanel in page.panels and page.panels[MapPanel].show_only(label)


def without(simap: SIMap, ids: Collection[int]) -> SIMap:
    """Return a map without some instances."""
    return replace(simap, instances=tuple(one for one in simap.instances if one.id not in ids)) if ids else simap


def counts_html(simap: SIMap, doubtful: Collection[int]) -> str:
    """Set the number of objects of each class in a line."""
    return _line(counts_text(simap, doubtful=doubtful))


def changes_between(before: SIMap, after: SIMap) -> tuple[tuple[Change, ...], tuple[Change, ...]]:
    """Return what became of the objects of a map on another of its grid; as many seen from either of the two.

    Objects belong to one change if more than half of the smaller one is in the other.

    Returns:
        the changes, the largest first; and those of objects that are the same, in cells that are not quite the same.
    """
    # The pairs of objects that share enough cells are links, and what they connect is one change.
    areas = [cells_by_id(one) for one in (before, after)]
    then, now, shared = shared_cells(before.instance, after.instance)
    linked = 2 * shared > np.minimum(areas[0][then], areas[1][now])
    then, now, shared = then[linked], now[linked], shared[linked]
    first = 0, len(areas[0])  # of each map's ids among both maps'
    links = coo_matrix((shared, (then, first[1] + now)), shape=(sum(map(len, areas)),) * 2)
    group = connected_components(links, directed=False)[1]
    # How alike the best pair of each is (IoU), and which objects of both maps take part.
    alike = np.zeros(len(group))
    np.maximum.at(alike, group[then], shared / (areas[0][then] + areas[1][now] - shared))
    sides: dict[int, tuple[list[Instance], list[Instance]]] = {}
    for side, simap in enumerate((before, after)):
        for one in simap.instances:
            sides.setdefault(group[first[side] + one.id], ([], []))[side].append(one)
    # What is said of each, and where it is.
    changes, edges = [], []
    for at, (here, there) in sorted(sides.items(), key=lambda entry: -sum(one.cells for one in chain(*entry[1]))):
        kind = _kind_of_change(here, there, float(alike[at]))
        if kind:
            were, are = ([one.name for one in ones] for ones in (here, there))
            text = difference_text(_KINDS.get(kind, kind), were, are, (here or there)[0].label, float(alike[at]))
            corners = np.array([[corner[:2] for corner in one.aabb_m] for one in (*here, *there)])
            x0, y0, x1, y1 = (*corners[:, 0].min(axis=0).tolist(), *corners[:, 1].max(axis=0).tolist())
            change = Change(text, tuple(one.id for one in here), tuple(one.id for one in there), (x0, y0, x1, y1))
            (edges if kind == "edge" else changes).append(change)
    return tuple(changes), tuple(edges)


def _kind_of_change(here: Sequence[Instance], there: Sequence[Instance], alike: float) -> str:
    """Return which of a comparison's kinds of difference there is between objects of two maps; empty if none."""
    if len(here) != len(there):
        several = "merged" if len(here) > len(there) else "split"
        return several if here and there else "missed" if here else "extra"
    if len(here) > 1 or alike <= 0.5:
        return "outline"
    if here[0].label != there[0].label:
        return "label"
    return "edge" if alike < 1.0 else ""


def cut_text(simap: SIMap, cut: Cut, other: Cut) -> str:
    """Return how a map is cut, as far as another cut differs: "evidence 75 %"."""
    parts = [f"{slider_of(simap).word} {cut.percent:g} %"] if cut.percent != other.percent else []
    return ", ".join([*parts, *([f"resolution {cut.resolution:g}"] if cut.resolution != other.resolution else [])])


def change_text(old: Mapping[str, int], new: Mapping[str, int], changes: Sequence[Change], edges: int) -> str:
    """Describe how many objects of which classes there are instead, and a line each, the changes.

    Args:
        old: how many objects of each class there were.
        new: how many there are instead.
        changes: which objects are others.
        edges: how many are the same, in cells that are not quite the same.
    """
    moved = sorted(
        (name for name in {**old, **new} if old.get(name, 0) != new.get(name, 0)),
        key=lambda name: (-abs(new.get(name, 0) - old.get(name, 0)), name),
    )
    parts = [f"{plural(new.get(name, 0), name)} ({old.get(name, 0)} before)" for name in moved[:MAX_MOVED]]
    rest = [f"other numbers of {plural(len(moved) - MAX_MOVED, 'more class')}"] if len(moved) > MAX_MOVED else []
    same = [f"{plural(edges, 'outline')} {'is' if edges == 1 else 'are'} slightly different"] if edges else []
    others = [plural(len(changes), "change")] if changes else []
    first = ", ".join((*parts, *rest, *others, *same)) or "nothing changed"
    return "\n".join((first, *(change.text for change in changes)))


def _change_html(shown: str, text: str, over: str = "") -> str:
    """Describe what changed; ``shown`` is said on the map, ``over`` as for `_line`."""
    return f'<div class="simaps-change" data-shown="{escape(shown)}">{_line(text, over, fold=MAX_CHANGES)}</div>'


def _first_mode(simap: SIMap) -> ColorMode:
    """Return what a page shows at first: a real place as it looked, where that is known, else its objects."""
    return "photo" if "photo" in color_modes(simap) and not simap.provenance.get("simulated") else "instance"


def origin_html(simap: SIMap) -> str:
    """Describe the origin of a map, with a badge if it is simulated."""
    name = title_of(simap)
    source = str(simap.provenance.get("segmentation", "unknown"))
    badge, masks = "", f"masks of {escape(source)}"
    if simap.provenance.get("simulated"):
        name, errors, _ = name.partition(", ") if name.endswith(" errors") else (name, "", "")
        badge = f'<span style="{BADGE_STYLE}">simulated</span> '
        masks = "masks with simulated errors" if "errors" in source or errors else "simulated masks"
    return (
        '<div style="padding:.5em .8em 0;font-size:.85em;line-height:1.5;overflow-wrap:anywhere">'
        f'<div style="font-size:1.15em;font-weight:600">{escape(name)}</div>'
        f"<div>{ABOUT}</div>"
        f'<div title="method {escape(simap.method)}; segmentation: {escape(source)}">{badge}{masks} on '
        f"{len(simap.frame_names)} frames · {simap.spec.cell_size_m * 100:g} cm cells</div></div>"
    )


def _line(text: str, over: str = "", fold: int = 0) -> str:
    """Set a text in a line; ``over`` is what it replaces for a while, whose height it keeps.

    Of a text of several lines those after the first and ``fold`` others are folded up, where that is not 0.
    """
    kept = f'<div style="visibility:hidden">{escape(over)}</div>' if over else ""
    lines = text.split("\n")
    text, rest = ("\n".join(lines[: fold + 1]), lines[fold + 1 :]) if fold else (text, [])
    place = f'<div style="position:absolute">{escape(text)}</div>{kept}' if over else escape(text)
    if rest:
        left_out = [f"and {len(rest) - MAX_SHOWN} smaller"] if len(rest) > MAX_SHOWN else []
        more = escape("\n".join([*rest[:MAX_SHOWN], *left_out]))
        place += f'<details class="simaps-rest"><summary>and {len(rest)} more</summary>{more}</details>'
    return (
        '<div role="status" style="position:relative;padding:.2em .8em .4em;font-size:.88em;font-weight:600;'
        'line-height:1.4;overflow-wrap:anywhere;white-space:pre-line">'
        f"{place}</div>"
    )


def joins(simap: SIMap) -> bool:
    """Whether the map has a merge log that a slider can follow."""
    slider = method_of(simap.method).slider
    return slider is not None and slider.parameter in simap.parameters


MAX_SIDE = 1024
"""Cells of the picture of ids a side; of a larger map every second cell is sent, or every third."""
MAX_AWAY_M = 1e6
"""What is told to be farther away is nowhere."""
MAX_NAMED = 3000
"""Objects that the page names: the largest."""


class NamesPanel(Panel):
    """Three hidden pieces of HTML that ``map.js`` reads; nothing of the panel is seen."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page = page
        self._objects, self._state, self._under = (page.gui.add_html("") for _ in range(3))
        self._shown: SIMap | None = None
        self._show_state()

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """Send the objects of the map, none of an earlier one: its objects have no names yet."""
        shown = None if snapshot.badge else simap
        if shown is not self._shown:
            self._shown = shown
            if shown is None or not self._objects.content:
                self._name_objects()
            else:
                self._page.worker.submit("names", self._name_objects, later=True)
        self._show_state()

    def _name_objects(self) -> None:
        shown = self._shown
        self._objects.content = "" if shown is None else self._page.shared.names(shown, names_html)

    def selection_changed(self, instance_id: int | None) -> None:
        """Send which object is selected."""
        self._show_state()

    def view_changed(self, name: str) -> None:
        """Send whether the map is seen from above."""
        self._show_state()

    def built(self) -> None:
        """Send the state of a page that was loaded again."""
        self._show_state()

    def told(self, event: dict[str, Any]) -> None:
        """Turn to the north, select what was clicked or nothing, tell more of it, name what a ray in 3-D meets."""
        if event.get("type") == "north":
            self._page.look(self._page.viewpoints.name)
        elif event.get("type") == "deselect":
            self._page.select(None)
        elif event.get("type") == "about":
            self._page.reveal(SELECTED_TAB)
        elif event.get("type") == "under":
            ray = event.get("ray")
            if isinstance(ray, list) and len(ray) == 6 and all(map(_is_length, ray)):
                self._page.worker.submit("under", lambda: self._name_under(event.get("number"), ray))
        elif event.get("type") == "named":
            number, place = event.get("id"), (event.get("x"), event.get("y"))
            if all(map(_is_length, place)) and any(one.id == number for one in all_instances(self._page.simap)):
                self._page.click_name(cast(int, number), cast(tuple[float, float], place))

    def _name_under(self, number: Any, ray: list[float]) -> None:
        """Send what is where the pointer rests in the 3-D view, with the number of that rest."""
        one, told = self._page.under_ray(ray[:3], ray[3:]) if any(ray[3:]) else None, {}
        if one is not None:
            told = {"number": number, "id": one.id, "facts": hint_text(one, self._page.simap.spec.cell_size_m)}
        self._under.content = f'<div class="simaps-under" hidden data-under="{escape(json.dumps(told))}"></div>'

    def _show_state(self) -> None:
        page, only, faded = self._page, None, ()
        if MapPanel in page.panels:
            shown = page.panels[MapPanel]
            only, faded = shown.shown_class, sorted(shown.faded)
        xmin, ymin, xmax, ymax = page.simap.spec.extent_m
        state = {"view": page.viewpoints.name, "selected": page.selected, "only": only, "faded": faded}
        state["only_text"] = f"Only {plural(2, short(only))[2:]} are shown" if only else ""
        state["doubtful"] = not_counted(page.simap, doubtful_on(page))
        chosen = next((one for one in all_instances(page.simap) if one.id == page.selected), None)
        state["facts"] = "" if chosen is None else hint_text(chosen, page.simap.spec.cell_size_m)
        state["tab"] = SELECTED_TAB
        state["map"] = id(self._shown)
        state["middle"] = (xmin + xmax) / 2.0, (ymin + ymax) / 2.0
        content = f'<div class="simaps-state" hidden data-state="{escape(json.dumps(state))}"></div>'
        if self._state.content != content:
            self._state.content = content


def _is_length(value: Any) -> bool:
    """Whether what was told is a number of metres, and no absurd one."""
    return isinstance(value, int | float) and abs(value) < MAX_AWAY_M


def hint_text(one: Instance, cell_m: float) -> str:
    """Return what is said of the object under the pointer: "chair 18 · 0.22 m² · confidence 0.86"."""
    area = one.area_m2(cell_m)
    return f"{one.name} · {area:.{2 if area >= 0.01 else 4}f} m² · confidence {one.score:.2f}"


def names_html(simap: SIMap) -> str:
    """Write the objects of a map for the page's script.

    Their ids are a PNG, one pixel a cell, row 0 at the south: red + 256 * green + 65536 * blue; from `GROUND_ID` on
    what is there instead. The rest is JSON: the map's extent and the side of a pixel, metres; the names of what is
    there instead; of each object, the largest first, id, name, class and what is said of it; and which map it is.
    """
    step = -(-max(simap.spec.shape) // MAX_SIDE)
    ground, ground_of = _ground(simap.grid)
    ids = np.where(simap.instance > 0, simap.instance, GROUND_ID + ground_of)[::step, ::step]
    picture = np.stack([ids >> 16, ids >> 8 & 255, ids & 255], axis=2).astype(np.uint8)  # OpenCV's order: blue first
    png = base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode()
    cell_m = simap.spec.cell_size_m
    largest = sorted(simap.instances, key=lambda one: (-one.cells, one.id))[:MAX_NAMED]
    rows = [(one.id, one.name, one.label, hint_text(one, cell_m)) for one in largest]
    (xmin, ymin, xmax, ymax), size_m = simap.spec.extent_m, step * cell_m
    told = {"extent": (xmin, ymin, xmax, ymax), "cell": size_m, "objects": rows, "ground": ground, "map": id(simap)}
    return (
        f'<div class="simaps-objects" hidden data-objects="{escape(json.dumps(told))}">'
        f'<img alt="" src="data:image/png;base64,{png}"></div>'
    )


def _ground(grid: Grid) -> tuple[list[str], NDArray]:
    """Return what cells may be that belong to no object, and of each cell its place there, int32 [rows, cols]."""
    kinds = {UNSEEN: "never seen", FLOOR: "floor", CLUTTER: "not named", WALL: "wall"}
    things = zip(grid.labels, grid.is_thing, strict=True)
    classes = [f"{plain(name)}, no object" if is_thing else plain(name) for name, is_thing in things]
    place = np.where(grid.label > 0, len(kinds) + grid.label, ground_kinds(grid))
    return [*(kinds[kind] for kind in sorted(kinds)), *classes], place.astype(np.int32)
