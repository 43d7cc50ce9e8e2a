"""The panel that compares two maps: of other methods or settings, from a file, or the ground truth."""

import contextlib
import functools
import json
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any, cast

import numpy as np
import viser

from simaps_viz.colors.classes import plural
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.compare_picture import (
    KINDS,
    MAX_NAMED,
    Mode,
    TwoPictures,
    difference_text,
    mark_color,
    together,
)
from simaps_viz.drawing.theme import BAD_STYLE, DIM_STYLE, LIGHT, Theme
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.evaluation.space import SpaceScores
from simaps_viz.evaluation.two_maps import TRUTH, Item, MapMaker, MapSide, TwoMaps, compare_two
from simaps_viz.events import Progress
from simaps_viz.io.files import write_whole
from simaps_viz.mapping.file import load_map
from simaps_viz.mapping.in_space import has_voxels
from simaps_viz.mapping.method import percent_text
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import slider_of
from simaps_viz.structures import GridSpec, SIMap
from simaps_viz.viewer.page.page import MAX_RESOLUTION, MIN_RESOLUTION, Page, Worker, cut_of
from simaps_viz.viewer.page.panel import Panel, PanelSpec, button, button_row, by_person
from simaps_viz.viewer.panels.map import MapPanel
from simaps_viz.viewer.scene.annotations import Label
from simaps_viz.viewer.scene.camera import Extent
from simaps_viz.viewer.scene.map_scene import frame_extent

Named = tuple[str, SIMap]
"""The title of a map on the page, and the map."""


class Cancelled(Exception):  # noqa: N818 - not an error
    """A job was cancelled by a person."""


ALL = "all"
PQ_MEANS = "PQ: the share of objects that are found, times how well their outlines agree; 1 is perfect."
_TONES = {"plain": "", "bad": BAD_STYLE}


def item_text(item: Item, maps: TwoMaps) -> str:
    """Describe a difference: "merged · chairs 4 + 5 → 1", "missed · chair 2", "label · chair 1 → couch 2".

    Each object has its name on its own map.
    """
    here, there = _names(item.left, maps.left), _names(item.right, maps.right)
    if maps.reference == "right":
        here, there = there, here
    return difference_text(item.kind, here, there, item.label, item.iou)


def _names(ids: Sequence[int], side: MapSide) -> list[str]:
    return [side.names.get(one, f"instance {one}") for one in ids]


def kind_options(maps: TwoMaps) -> tuple[str, ...]:
    """Return the filters of the list: "all (9)", "merged (2)", ...; only kinds that occur."""
    found = [f"{kind} ({count})" for kind, count in maps.counts.items() if count]
    differences = len(maps.differences)
    return (f"{ALL} ({differences})", *found) if differences or not found else tuple(found)


def of_kind(maps: TwoMaps, option: str) -> list[Item]:
    """Return the differences that pass a filter of ``kind_options``."""
    kind = option.partition(" (")[0]
    return list(maps.differences) if kind == ALL else [item for item in maps.items if item.kind == kind]


def headline_html(maps: TwoMaps) -> str:
    """Describe how many differences there are, and the map's score against the truth where that is known."""
    empty = [escape(side.title) for side in (maps.left, maps.right) if not side.count]
    if len(empty) == 2:
        return note("<b>Neither map has an object:</b> there is nothing to compare.")
    total, edges = len(maps.differences), maps.counts["edge"]
    found = f"<b>{plural(total, 'difference')}</b>"
    if not total:
        some = "other outlines" if edges else "but for small ones"
        found = f"<b>The same objects, {some}</b>" if maps.items else "<b>No differences</b>"
    compared = " of those that are large enough" if maps.left.ignored + maps.right.ignored else ""
    lines = [f"{found} · {plural(maps.same, 'object')}{compared} {'agrees' if maps.same == 1 else 'agree'}"]
    if edges and maps.same_iou is not None:
        lines.append(f"{edges} of them with another outline; {percent_text(maps.same_iou)} alike on average (IoU)")
    lines += [f"<b>{title} has no object.</b>" for title in empty]
    if maps.score is not None:
        pq = "none" if maps.score.pq is None else f"{maps.score.pq:.2f}"
        lines.append(f"<b>PQ {pq}</b> · {maps.score.matched} of {maps.score.true} true objects found")
    if maps.space is not None:
        lines.append(space_line(maps.space, known=maps.score is not None))
    if maps.score is not None or maps.space is not None:
        lines.append(f'<span style="{DIM_STYLE}">{PQ_MEANS}</span>')
    return note(*lines)


def space_line(scores: SpaceScores, *, known: bool) -> str:
    """Describe the scores in space against the truth, or, if it is not ``known``, how far two maps agree."""
    pq = "none" if scores.overall.pq is None else f"{scores.overall.pq:.2f}"
    hidden, found = scores.hidden, "found" if known else "on both"
    below = f" · {hidden.matched} of {plural(hidden.true, 'hidden object')} {found}" if hidden.true else ""
    return f"<b>In space: PQ {pq}</b> · boxes F1 {scores.boxes.f1_25:.2f}{below}"


def summary_html(maps: TwoMaps, theme: Theme = LIGHT) -> str:
    """Explain the colour of each kind of mark and how often it occurs, and list the other numbers."""
    left, right = maps.left, maps.right
    reference, other = (left, right) if maps.reference == "left" else (right, left)
    lines = []
    if maps.items:
        lines.append(f"What became of the objects of <b>{escape(reference.title)}</b> on {escape(other.title)}:")
    rows = "".join(
        f'<tr><td style="padding-right:.5em">{_ring(mark_color(kind, theme))}</td>'
        f'<td style="text-align:right;padding-right:.6em;white-space:nowrap"><b>{count}</b></td>'
        f"<td><b>{kind}</b> · {KINDS[kind][1]}</td></tr>"
        for kind, count in maps.counts.items()
        if count
    )
    lines.append(f'<table style="border-spacing:0">{rows}</table>')
    truth = reference if maps.score is not None else None
    lines += [
        f"{escape(side.title)}: {plural(side.count, 'instance')} seen from above"
        f"{'' if side is truth else ', the doubtful included'}"
        for side in (left, right)
    ]
    lines += ignored_lines(maps)
    score = maps.score
    if score is not None and (maps.items or score.over or score.under):
        lines.append(
            f"{score.found - score.matched} of {score.found} on {escape(other.title)} match nothing · "
            f"{score.over} split, {score.under} merged"
        )
    lines.append(
        '<span style="opacity:.75">Same colour: same object, by overlap. Grey: on no object of the left.</span>'
    )
    return note(*lines)


def ignored_lines(maps: TwoMaps) -> list[str]:
    """Describe how many objects were too small to compare; empty if there are none."""
    left, right = maps.left, maps.right
    if not left.ignored and not right.ignored:
        return []
    if left.least_cells == right.least_cells:
        small = f"under {left.least_cells} cells"
    else:
        small = f"under {left.least_cells} cells left, {right.least_cells} right"
    return [f"Too small to compare ({small}, or lying on one that is): {left.ignored} left, {right.ignored} right"]


def _box_of(side: MapSide, number: int, spec: GridSpec) -> Extent:
    """Return the extent of an object of one of the maps, metres."""
    row, col = np.nonzero(side.instance == number)
    corners = np.array([col.min(), row.min(), col.max() + 1, row.max() + 1]) * spec.cell_size_m
    x0, y0, x1, y1 = (corners + (spec.x0_m, spec.y0_m) * 2).tolist()
    return x0, y0, x1, y1


def note(*lines: str, tone: str = "plain") -> str:
    """Wrap lines of HTML as a text of the panel."""
    body = "".join(f"<div>{line}</div>" for line in lines)
    style = f"padding:.2em .8em .4em;font-size:.82em;line-height:1.5;overflow-wrap:anywhere;{_TONES[tone]}"
    return f'<div style="{style}">{body}</div>'


def working_note(what: str, done: int, total: int) -> str:
    """Describe how far a map is that has to be made of frames before it can be shown."""
    so_far = f": frame {done} of {total}" if total > 1 else ""
    return note(f"{what.capitalize()}{so_far}.", "What is made is kept: the next time is quick.")


def chosen_html(item: Item, maps: TwoMaps, position: int, total: int, theme: Theme = LIGHT) -> str:
    """Describe the difference that was clicked."""
    sides = [(maps.left, item.left), (maps.right, item.right)]
    where = " · ".join(
        f"{escape(side.title)}: {escape(together(_names(ids, side)) if ids else 'nothing')}" for side, ids in sides
    )
    return note(
        f"{_ring(mark_color(item.kind, theme))} <b>{escape(item_text(item, maps))}</b> ({position} of {total})",
        f"{KINDS[item.kind][1]}",
        f'<span style="opacity:.75">{where}</span>',
    )


def _ring(color: Color) -> str:
    return (
        f'<span style="display:inline-block;width:11px;height:11px;border-radius:2px;border:3px solid rgb{color};'
        'box-sizing:border-box;vertical-align:-1px"></span>'
    )


LEFT, RIGHT = "Left", "Right"
THIS, SETTINGS = "This map", "This map, other settings"
OTHER = 20.0
"""By how many percent the other settings differ at first."""
NO_TRUTH = (
    "No ground truth of this place is known: differences between two maps are shown, not errors. "
    "Tab Errors lists what may be wrong on this map."
)


def load_bytes(name: str, content: bytes) -> SIMap:
    """Read a map file whose content a browser sent.

    Raises:
        InputError: it is no map file.
    """
    with tempfile.TemporaryDirectory(prefix="simaps-") as folder:
        path = Path(folder) / (Path(name).name or "map.npz")
        write_whole(path, content, "the map that was sent")
        try:
            return load_map(path)
        except SIMapsError as error:
            raise InputError(str(error).replace(str(path), path.name)) from error


class SideChooser:
    """The choice of one of the two maps: a drop-down list, and sliders for other settings."""

    def __init__(self, name: str, maker: MapMaker, page: Page, changed: Callable[[], None]) -> None:
        """Fill the open container.

        Args:
            name: LEFT or RIGHT; the right one begins with the truth, other settings, or another map, if there is one.
            maker: makes the maps of other methods, and the truth.
            page: the page.
            changed: called after another map was chosen.
        """
        self._maker, self._page, self._changed, gui = maker, page, changed, page.gui
        self._keys = {THIS: "map"}
        sources = maker.sources(page.simap)
        if page.services.repartition is not None and method_of(page.simap.method).slider is not None:
            self._keys[SETTINGS] = "settings"
        self._keys |= {source.title: source.key for source in sources}
        titles = {key: title for title, key in self._keys.items()}
        others = [titles[key] for key in (TRUTH, "settings", *titles) if key in titles and key != "map"]
        at_first = THIS if name == LEFT else (others or [THIS])[0]
        self._files: dict[str, SIMap] = {}
        own, joining = cut_of(page.simap), slider_of(page.simap)
        self._word = joining.word
        hint = f"The map on the {name.lower()}."
        self._which = gui.add_dropdown(name, tuple(self._keys), initial_value=at_first, hint=hint)
        # The right one begins with other settings than the left one, or there would be nothing to compare.
        percent = own.percent if name == LEFT else own.percent + (OTHER if own.percent + OTHER <= 100.0 else -OTHER)
        self._percent = gui.add_slider(f"{name} {joining.title}", 0.0, 100.0, 0.5, percent, hint=joining.hint)
        self._resolution = gui.add_slider(
            f"{name} resolution", MIN_RESOLUTION, MAX_RESOLUTION, 0.05, own.resolution, hint="Louvain resolution."
        )
        by_person(self._which, self._chose)
        for slider in (self._percent, self._resolution):
            by_person(slider, changed)
        self._show_settings()

    @property
    def key(self) -> str:
        """The choice: map, settings, the key of a source, or the name of a file."""
        return self._keys[str(self._which.value)]

    def map(self, simap: SIMap, report: Progress) -> Named:
        """Return the chosen map with its title; may take long.

        Raises:
            InputError: the map cannot be made.
        """
        key = self.key
        if key == "map":
            cut = f"{self._word} {self._page.cut.percent:g} %" if self._page.cut_here else simap.method
            return f"This map ({cut})", simap
        if key in self._files:
            return key, self._files[key]
        if key == "settings":
            percent, resolution = float(self._percent.value), float(self._resolution.value)
            title = f"{self._word} {percent:g} %, resolution {resolution:g}"
            return title[0].upper() + title[1:], self._page.shared.cut_map(simap, percent, resolution)
        return str(self._which.value), self._maker.make(key, simap, report)

    def add_file(self, name: str, simap: SIMap, *, choose: bool) -> None:
        """Add the map of a file to the list; ``choose`` selects it."""
        self._files[name] = simap
        self._keys[name] = name
        chosen = name if choose else str(self._which.value)
        self._which.options = tuple(self._keys)
        self._which.value = chosen
        self._show_settings()

    def state(self) -> tuple[str, float, float, dict[str, SIMap]]:
        """Return the choice, for a page that is loaded again: title, percent, resolution, and the files read."""
        return str(self._which.value), float(self._percent.value), float(self._resolution.value), self._files

    def restore(self, state: tuple[str, float, float, dict[str, SIMap]]) -> None:
        """Restore a choice without calling ``changed``."""
        title, percent, resolution, files = state
        for name, simap in files.items():
            self.add_file(name, simap, choose=False)
        if title in self._keys:
            self._which.value = title
        self._percent.value, self._resolution.value = percent, resolution
        self._show_settings()

    def _chose(self) -> None:
        self._show_settings()
        self._changed()

    def _show_settings(self) -> None:
        self._percent.visible = self._resolution.visible = self.key == "settings"


ABOUT = "compare this map with another: of another method, other parameters, or the truth"
LISTED = 5
"""Differences on a page of the list."""
BESIDE_M = 0.1
"""How far the dividing line is from the chosen difference."""
HOW: Mapping[str, Mode] = {
    "Swipe": "swipe", "Side by side": "side by side", "One above the other": "stacked", "Errors": "errors"
}  # fmt: skip
SWIPE = "Swipe"
HOW_HINT = "One map left of a line and the other right of it; both complete; or how little of each object agrees (IoU)."
PAGES_HINT = f"{LISTED} at a time, the gravest first, of each kind the worst outline first."
DARK_BUTTON: Color = (74, 80, 92)
"""The button of a missed object on a dark page: its mark is too light for white letters."""
EMPTY: tuple[str, ...] = ("all (0)",)


def compare_panel(maker: MapMaker) -> PanelSpec:
    """Return the tab of a page that has this panel."""
    return PanelSpec("Compare", viser.Icon.ARROWS_DIFF, lambda page: ComparePanel(page, maker), about=ABOUT)


METHOD_HINT = "How the map is made of the frames; that of another method is built once, and then kept."


def method_panel(maker: MapMaker) -> PanelSpec:
    """Return the choice of the method, which stands on the tab of the map beside its sliders."""
    return PanelSpec("Map", viser.Icon.MAP, lambda page: MethodPanel(page, maker))


class MethodPanel(Panel):
    """Shows this page the map of another method; what is published, and all other pages, stay as they are."""

    def __init__(self, page: Page, maker: MapMaker) -> None:
        """Fill the open container."""
        self._page, self._maker, gui = page, maker, page.gui
        self._own = page.simap
        keys = (page.simap.method, *(one.key for one in maker.sources(page.simap) if one.key != TRUTH))
        order = page.panels[MapPanel].order_of_method
        self._which = by_person(
            gui.add_dropdown("Method", keys, initial_value=keys[0], hint=METHOD_HINT, order=order), self._chose
        )
        self._which.visible = len(keys) > 1
        self._status = gui.add_html("", order=order)
        self._cancel = threading.Event()
        self._worker = Worker(self._failed)  # of its own: building a map may take long

    def base_changed(self, base: SIMap) -> None:
        """Name the method of the map that is shown."""
        self._cancel.set()
        self._status.content = ""
        if base.method in self._which.options:
            self._which.value = base.method
        if base.method == self._which.options[0]:
            self._own = base

    def close(self) -> None:
        """Stop building."""
        self._cancel.set()
        self._worker.stop()

    def _chose(self) -> None:
        self._cancel.set()
        key, cancel = str(self._which.value), threading.Event()
        self._cancel = cancel
        if key == self._own.method:
            self._page.take_map(self._own)
            return

        def report(what: str, done: int, total: int) -> None:
            if cancel.is_set():
                raise Cancelled
            self._status.content = working_note(what, done, total)

        def make() -> None:
            with contextlib.suppress(Cancelled):
                made = self._maker.make(key, self._own, report)
                if not cancel.is_set():
                    self._page.take_map(made)

        self._worker.submit("method", make)

    def _failed(self, error: Exception) -> None:
        self._which.value = self._page.base.method
        self._status.content = note("Not built: see the message.", tone="bad")
        self._page.report(error)


class ComparePanel(Panel):
    """Two chosen maps, their picture in place of the page's map, and the list of their differences."""

    def __init__(self, page: Page, maker: MapMaker) -> None:
        """Fill the open container."""
        self._page, self._maker = page, maker
        self.maps: TwoMaps | None = None
        """The comparison that is shown."""
        self._pictures: TwoPictures | None = None
        self._items: list[Item] = []
        self._chosen: Item | None = None
        self._first = 0
        self._wanted = self._restored = False
        self._lock = threading.RLock()
        """Lock for changing maps and pictures together."""
        self._cancel = threading.Event()
        self._worker = Worker(self._failed)  # of its own: building a map may take long
        self._add_choice(page.gui, maker)
        self._add_view(page.gui)
        self._add_list(page.gui)
        self._show_parts()

    @property
    def active(self) -> bool:
        """Whether two maps are shown in place of the page's own."""
        return self.maps is not None

    def map_changed(self, simap: SIMap) -> None:
        """Compare again, as the page's map may be one of the two."""
        if self._wanted:
            self.start()

    def theme_changed(self) -> None:
        """Paint the pictures again in the colours of the theme."""
        if self.maps is not None:
            self._page.submit("compare theme", self._paint_anew)

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Choose the clicked difference; while two maps are shown no click is passed on."""
        maps, pictures = self.maps, self._pictures
        if maps is None or pictures is None:
            return False
        east, north = pictures.shift_m(self._mode)
        moved = (east > 0.0 and x_m > maps.spec.x0_m + east) or (north < 0.0 and y_m < maps.spec.y0_m)
        row, col = maps.spec.cell_of(x_m - east * moved, y_m - north * moved)
        if maps.spec.contains(row, col):
            ids = (int(maps.left.instance[row, col]), int(maps.right.instance[row, col]))
            sides = self._sides_under(moved, x_m)
            hit = [i for i in self._items if any(ids[s] and ids[s] in (i.left, i.right)[s] for s in sides)]
            self.choose(hit[0] if hit else None)
        return True

    def told(self, event: dict[str, Any]) -> None:
        """Move the line between both maps to where its handle was dragged."""
        share = event.get("share")
        if event.get("type") == "divide" and isinstance(share, int | float) and 0 <= share <= 100:
            self._line.value = round(share)

    def state(self) -> dict[str, Any]:
        """Return the choices, for a page that is loaded again."""
        return {
            "sides": [side.state() for side in self._sides], "how": self._how.value, "divide": self._line.value,
            "kind": self._kind_name, "mark_all": self._mark_all.value, "wanted": self._wanted,
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """Restore the choices and compare again; the camera stays where it is."""
        for side, kept in zip(self._sides, state["sides"], strict=True):
            side.restore(kept)
        self._how.value, self._line.value, self._mark_all.value = state["how"], state["divide"], state["mark_all"]
        self._kind.options = (*EMPTY, *([] if state["kind"] == ALL else [f"{state['kind']} (0)"]))
        self._kind.value = self._kind.options[-1]
        if state["wanted"]:
            self._restored = True
            self.start()

    def close(self) -> None:
        """Cancel the running comparison."""
        self._cancel.set()
        self._worker.stop()

    def start(self) -> None:
        """Get both maps and compare them; a running comparison is cancelled."""
        self._cancel.set()
        self._cancel = cancel = threading.Event()
        self._wanted = True
        self._progress.visible, self._progress.value = True, 0.0
        self._stop.visible = True
        self._status.content = note("Getting both maps …")
        self._worker.submit("compare", functools.partial(self._compare, self._page.simap, cancel))

    def stop(self) -> None:
        """End the comparison, or the wait for it, and show the page's own map again."""
        with self._lock:
            self._cancel.set()
            self._wanted, self._pictures, self._chosen = False, None, None
            self._status.content = ""
            self._progress.visible = False
            self._page.submit("compare picture", self._draw)
            if self.active:
                self._page.look_at(None)
            self.maps = None
            self._show_parts()

    def choose(self, item: Item | None) -> None:
        """Outline a difference boldly on both maps and move the camera there; None chooses none."""
        self._chosen = item
        if item is not None and item in self._items:
            self._first = self._items.index(item) // LISTED * LISTED
        self._fill_list()
        self._page.submit("compare marks", self._remark)
        if item is not None:
            self._divide(item)
            self._page.look_at(self._around(item))

    @property
    def _kind_name(self) -> str:
        return str(self._kind.value).partition(" (")[0]

    @property
    def _mode(self) -> Mode:
        return HOW[str(self._how.value)]

    def _add_choice(self, gui: viser.GuiApi, maker: MapMaker) -> None:
        self._sides = tuple(SideChooser(name, maker, self._page, self._changed) for name in (LEFT, RIGHT))
        if all(source.key != TRUTH for source in maker.sources(self._page.simap)):
            gui.add_html(note(NO_TRUTH))
        self._begin = button(gui, "Compare", self.start, icon=viser.Icon.ARROWS_DIFF)
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._status = gui.add_html("")
        self._stop = button(gui, "End comparison", self.stop, color="gray", visible=False)

    def _add_view(self, gui: viser.GuiApi) -> None:
        self._how = gui.add_dropdown("Show as", tuple(HOW), initial_value=SWIPE, hint=HOW_HINT)
        by_person(self._how, self._moved_mode)
        self._line = gui.add_slider(
            "Divide (%)", 0, 100, 1, 50, hint="How much of the map, from the west, shows the left one."
        )
        self._line.on_update(lambda _: self._page.submit("compare picture", self._draw))
        self._handle = gui.add_html("")
        self._headline = gui.add_html("")

    def _add_list(self, gui: viser.GuiApi) -> None:
        self._kind = gui.add_dropdown("List", EMPTY, hint="Which differences are listed and marked on the map.")
        by_person(self._kind, self._narrow)
        clicked = [functools.partial(self._row_clicked, at) for at in range(LISTED)]
        self._rows = [button(gui, "-", do, visible=False) for do in clicked]
        turns = {"Previous": lambda: self._turn(-1), "Next": lambda: self._turn(1)}
        self._pages = button_row(gui, "Listed", turns, visible=False, hint=PAGES_HINT)
        self._detail = gui.add_html("")
        self._mark_all = gui.add_checkbox("Mark all listed", True, hint="Outline all differences that are listed.")
        self._mark_all.on_update(lambda _: self._page.submit("compare marks", self._remark))
        self._summary = gui.add_html("")
        upload = gui.add_upload_button("Add a map file (.npz) …", color="gray", mime_type=".npz")
        upload.on_upload(lambda event: self._page.submit("map file", functools.partial(self._read, event.target)))

    def _read(self, upload: viser.GuiUploadButtonHandle) -> None:
        name = upload.value.name
        simap = load_bytes(name, upload.value.content)
        for side, chosen in zip(self._sides, (False, True), strict=True):
            side.add_file(name, simap, choose=chosen)
        self._page.say("Map file read", f"{name} has {len(simap.instances)} instances.")
        self._changed()

    def _changed(self) -> None:
        if self._wanted:
            self.start()

    def _compare(self, simap: SIMap, cancel: threading.Event) -> None:
        def report(what: str, done: int, total: int) -> None:
            if cancel.is_set():
                raise Cancelled
            if self._progress.visible:  # no longer once the comparison is there, of which the bar told
                self._progress.value = 100.0 * done / max(total, 1)
            self._status.content = working_note(what, done, total)

        try:
            left, right = (side.map(simap, report) for side in self._sides)
            maps, judged = self._compared(left, right)
            theme = self._page.theme
            pictures = TwoPictures(maps, theme)
        except Cancelled:
            return
        except Exception:
            if cancel.is_set():
                return
            raise
        with self._lock:
            if cancel.is_set():
                return
            self._show(maps, pictures)
        if theme is not self._page.theme:  # switched while these were painted
            self.theme_changed()
        if judged is not None and has_voxels(judged):
            with contextlib.suppress(Cancelled):
                self._add_scores(maps, judged, report)

    def _add_scores(self, maps: TwoMaps, judged: SIMap, report: Progress) -> None:
        """Add the scores in space, for which all frames are read, to a comparison that is shown already."""
        scores = self._maker.scores_in_space(judged, report)
        with self._lock:
            if self.maps is maps:
                self.maps = replace(maps, space=scores)
                self._headline.content = headline_html(self.maps)
                self._status.content = ""

    def _compared(self, left: Named, right: Named) -> tuple[TwoMaps, SIMap | None]:
        """Compare two maps; returns also the one that is judged by the other, if that is the truth."""
        keys = [side.key for side in self._sides]
        if keys[0] == keys[1] == TRUTH or left[1] is right[1]:
            raise InputError(f"comparison: expected two different maps, found {left[0]} twice")
        truth = {(True, False): "left", (False, True): "right"}.get((keys[0] == TRUTH, keys[1] == TRUTH))
        judged = {"left": right[1], "right": left[1]}.get(truth or "")
        self._status.content = note("Comparing the two maps, object by object …")
        return compare_two(left, right, truth=truth), judged  # pyright: ignore[reportArgumentType]

    def _show(self, maps: TwoMaps, pictures: TwoPictures) -> None:
        begins = self.maps is None
        self.maps, self._pictures, self._chosen, self._first = maps, pictures, None, 0
        self._progress.visible = False
        self._status.content = ""
        move, self._restored = begins and not self._restored, False
        options = kind_options(maps)
        kept = self._kind_name
        self._kind.options = options
        self._kind.value = next((o for o in options if o.partition(" (")[0] == kept), options[0])
        self._headline.content, self._summary.content = headline_html(maps), summary_html(maps, self._page.theme)
        self._narrow()
        self._show_parts()
        if move:
            self._look_at_all(pictures)

    def _failed(self, error: Exception) -> None:
        self._progress.visible = False
        self._wanted = self.active
        self._stop.visible = self.active
        self._status.content = note("Not compared: see the message.", tone="bad")
        self._page.report(error)

    def _show_parts(self) -> None:
        on = self.active
        for widget in (self._how, self._headline, self._summary, self._detail):
            widget.visible = on
        self._mark_all.visible = on and bool(self.maps and self.maps.items)
        self._line.visible = on and self._mode == "swipe"
        self._begin.visible = not on
        self._stop.visible = on
        self._kind.visible = on and bool(self.maps and self.maps.items)
        self._fill_list()

    def _narrow(self) -> None:
        maps = self.maps
        self._items = [] if maps is None else of_kind(maps, str(self._kind.value))
        self._first, self._chosen = 0, None
        self._fill_list()
        self._page.submit("compare marks", self._remark)

    def _fill_list(self) -> None:
        maps = self.maps
        shown = self._items[self._first : self._first + LISTED] if maps is not None else []
        for at, row in enumerate(self._rows):
            row.visible = at < len(shown)
            if maps is not None and at < len(shown):
                item = shown[at]
                mark = "▸ " if item is self._chosen else ""
                row.label = f"{mark}{item_text(item, maps)}"
                row.color = DARK_BUTTON if self._page.theme.dark and item.kind == "missed" else KINDS[item.kind][0]
        self._pages.visible = maps is not None and len(self._items) > LISTED
        if maps is None or self._chosen is None:
            self._detail.content = ""
        else:
            position = self._items.index(self._chosen) + 1 if self._chosen in self._items else 0
            self._detail.content = chosen_html(self._chosen, maps, position, len(self._items), self._page.theme)

    def _turn(self, step: int) -> None:
        last = max(0, (len(self._items) - 1) // LISTED * LISTED)
        self._first = min(max(0, self._first + step * LISTED), last)
        self._fill_list()

    def _row_clicked(self, at: int) -> None:
        if self._first + at < len(self._items):
            self.choose(self._items[self._first + at])

    def _moved_mode(self) -> None:
        self._line.visible = self.active and self._mode == "swipe"
        self._page.submit("compare picture", self._draw)
        if self._pictures is not None:
            self._look_at_all(self._pictures)

    def _paint_anew(self) -> None:
        maps = self.maps
        if maps is None:
            return
        pictures = TwoPictures(maps, self._page.theme)
        with self._lock:
            if maps is not self.maps:
                return  # ended meanwhile, or a newer comparison has painted its own
            self._pictures = pictures
            self._summary.content = summary_html(maps, self._page.theme)
            self._fill_list()
        self._remark()

    def _remark(self) -> None:
        pictures = self._pictures
        if pictures is not None:
            pictures.mark(self._items if self._mark_all.value else (), self._chosen)
            self._draw()

    def _draw(self) -> None:
        pictures, share = self._pictures, float(self._line.value) / 100.0
        self._page.show_picture(None if pictures is None else pictures.picture(self._mode, share))
        self._page.scene.texts.show("compare", self._labels())
        maps, content = self.maps, ""
        if pictures is not None and maps is not None and self._mode == "swipe":  # the page's script draws the handle
            told = json.dumps({"extent": maps.spec.extent_m, "share": self._line.value})
            content = f'<i class="simaps-divide" hidden data-divide="{escape(told)}"></i>'
        if self._handle.content != content:
            self._handle.content = content

    def _sides_under(self, moved: bool, x_m: float) -> tuple[int, ...]:
        """Return the indices of the maps under the pointer: 0 = left, 1 = right."""
        maps = cast(TwoMaps, self.maps)
        if self._mode == "errors":
            return (0, 1)
        if self._mode != "swipe":
            return (1,) if moved else (0,)
        xmin, _, xmax, _ = maps.spec.extent_m
        return (0,) if x_m < xmin + float(self._line.value) / 100.0 * (xmax - xmin) else (1,)

    def _divide(self, item: Item) -> None:
        """Move the dividing line to just beside a difference, so that it is whole on the map that has it."""
        if self._mode == "swipe" and self.maps is not None:
            xmin, _, xmax, _ = self.maps.spec.extent_m
            x = item.extent_m[2] + BESIDE_M if item.left else item.extent_m[0] - BESIDE_M
            share = 100.0 * min(max((x - xmin) / (xmax - xmin), 0.0), 1.0)
            self._line.value = np.ceil(share) if item.left else np.floor(share)

    def _labels(self) -> list[Label]:
        """Name the objects of the chosen difference, each on its map."""
        maps, item, pictures = self.maps, self._chosen, self._pictures
        if maps is None or item is None or pictures is None:
            return []
        labels = []
        sides = ((maps.left, item.left, (0.0, 0.0)), (maps.right, item.right, pictures.shift_m(self._mode)))
        for at, (side, ids, (east, north)) in enumerate(sides):
            names = [f"{side.names.get(one, f'instance {one}')} · {side.title}" for one in ids]
            boxes = [_box_of(side, one, maps.spec) for one in ids]
            if not ids:
                names, boxes = [f"nothing · {side.title}"], [item.extent_m]
            for name, (x0, y0, x1, y1) in list(zip(names, boxes, strict=True))[:MAX_NAMED]:
                middle = (x0 + x1) / 2.0 + east, (y0 + y1) / 2.0 + north
                labels.append(Label(name, *middle, (x1 - x0) / 2.0, (y1 - y0) / 2.0, 0.0, -1.0 if at else 1.0))
        return labels

    def _look_at_all(self, pictures: TwoPictures) -> None:
        self._page.look_at(frame_extent(pictures.extent_m(self._mode)))

    def _around(self, item: Item) -> Extent:
        """Return the part of the floor around a difference, on both maps."""
        xmin, ymin, xmax, ymax = item.extent_m
        margin = max(2.0, 0.8 * max(xmax - xmin, ymax - ymin))
        if self._mode != "swipe" and self._pictures is not None:
            east, north = self._pictures.shift_m(self._mode)
            return xmin - margin, ymin + north - margin, xmax + east + margin, ymax + margin
        return xmin - margin, ymin - margin, xmax + margin, ymax + margin
