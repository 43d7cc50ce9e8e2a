"""The panel that lists what is wrong on the map, the worst first; where no truth is known, what may be wrong."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import viser

from simaps_viz.colors.classes import plural
from simaps_viz.drawing.theme import remark_html, small_html
from simaps_viz.evaluation.two_maps import NO_DIFFERENCE, TRUTH, Item, Kind, MapMaker, MapSide, compare_two
from simaps_viz.mapping.doubts import doubts
from simaps_viz.mapping.method import percent_text
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec, button, button_row, by_person
from simaps_viz.viewer.panels.instance import FrameGallery, best_pictures
from simaps_viz.viewer.panels.map import MapPanel, doubtful_on
from simaps_viz.viewer.scene.camera import Extent, with_margin

ABOUT = "the worst errors of the map, or, where no truth is known, what may be wrong"
TITLE = "Errors"
LISTED = 6
"""Entries on a page of the list."""
ERRORS, DOUBTS = "Worst errors", "Likely errors"
KNOWN = "What is true in this place is known. Press one: the map goes there, true outlines are pink."
FEW, OFFER = LISTED, "The list can show likely errors instead: what the map itself is least sure of."
END = "No errors from here on: outlines more than half right, and very small things."
UNKNOWN = "Nobody has said what is true in this place. "
LEAST_SURE = (
    "These are the objects that the map itself is least sure of; all reasons and the size count, so of two as unsure "
    "the larger comes first. Press one: the map goes there."
)
RIGHT = "The share is that of the cells on which the map and the truth agree (intersection over union)."
PAGES_HINT = f"{LISTED} at a time, the worst first."


@dataclass(frozen=True)
class Entry:
    """A line of the list."""

    title: str
    more: str
    """What is said of it when it is chosen."""
    selects: int | None
    """The object of the map that it is about."""
    true: tuple[int, ...]
    """Those of the truth."""
    extent_m: Extent
    wrong: bool = False
    """Whether it is an error."""


def errors_panel(maker: MapMaker) -> PanelSpec:
    """Return the tab of a page that has this panel."""
    return PanelSpec(TITLE, viser.Icon.ALERT_TRIANGLE, lambda page: ErrorsPanel(page, maker), about=ABOUT)


class ErrorsPanel(Panel):
    """A list of errors, or of what may be one; pressing one selects it, and looks at it.

    It is made only while its tab is open: comparing takes long.
    """

    _open = False
    _listed: SIMap | None = None
    """The map whose list is shown."""

    def __init__(self, page: Page, maker: MapMaker) -> None:
        """Fill the open container."""
        self._page, self._maker, gui = page, maker, page.gui
        self._truth: SIMap | None = None
        self._entries: list[Entry] = []
        self._first, self._chosen = 0, -1
        self._known = any(source.key == TRUTH for source in maker.sources(page.simap))
        names = (ERRORS, DOUBTS) if self._known else (DOUBTS,)
        self._which = gui.add_dropdown("List", names, initial_value=names[0], visible=self._known, hint=ABOUT)
        by_person(self._which, self._list_other)
        self._about = gui.add_html("")
        # Above the rows, whose heights differ: it stays under the finger that presses it again.
        self._pages = button_row(
            gui, "Listed", {f"Previous {LISTED}": lambda: self._turn(-1), f"Next {LISTED}": lambda: self._turn(1)},
            visible=False, hint=PAGES_HINT,
        )  # fmt: skip
        self._place = gui.add_html("")
        rows = [functools.partial(self._choose, at) for at in range(LISTED)]
        self._rows = [button(gui, "-", do, color="gray", visible=False) for do in rows]
        self._end = gui.add_html(remark_html(END), visible=False)
        self._more = gui.add_html("")
        self._views = FrameGallery(page)

    def map_changed(self, simap: SIMap) -> None:
        """List anew what is wrong with the map, if that is looked at."""
        self._list_if_open()

    def told(self, event: dict[str, Any]) -> None:
        """List what is wrong once the tab is opened; leave what was chosen for the map."""
        if event.get("type") == "tabs":
            tabs = event.get("open")
            tabs = tabs if isinstance(tabs, list) else []
            if self._open and "Map" in tabs:  # whose views would be faded for it
                self._leave_entry(deselect=True)
            self._open = TITLE in tabs
            self._list_if_open()

    def _list_if_open(self) -> None:
        if self._open and self._listed is not self._page.simap:
            self._list()

    def _list_other(self) -> None:
        self._leave_entry(deselect=True)
        self._list()

    def _leave_entry(self, *, deselect: bool = False) -> None:
        """Take away what is shown of the chosen entry."""
        if self._chosen >= 0:
            self._chosen = -1
            self._views.hide()
            self._page.scene.show_changed(self._page.simap, ())
            if deselect:
                self._page.select(None)
            self._fill()

    def _list(self) -> None:
        self._listed = None
        self._page.submit("errors", self._list_now)

    def _list_now(self) -> None:
        simap = self._page.simap
        wants_truth = self._which.value == ERRORS
        if wants_truth:
            self._report("comparing", 0, 1)
            self._truth = self._maker.make(TRUTH, simap, self._report)
            found = compare_two(("This map", simap), ("The truth", self._truth), truth="right")
            entries = [self._with_change(error_entry(item, found.left, found.right), item) for item in found.items]
            wrong = len(found.differences)
            head = f"{plural(wrong, 'error')}{', the worst first' * (wrong > 1)}. {KNOWN}{f' {OFFER}' * (wrong < FEW)}"
        else:
            entries = doubt_entries(simap, doubtful_on(self._page))
            head = f"{'' if self._known else UNKNOWN}{LEAST_SURE if entries else 'The map is sure of every object.'}"
        if simap is self._page.simap:
            self._entries, self._first, self._chosen, self._listed = entries, 0, -1, simap
            self._views.hide()
            self._about.content = small_html(head)
            self._fill()

    def _with_change(self, entry: Entry, item: Item) -> Entry:
        """Return an error with what a moved slider has to do with it."""
        if not entry.wrong or MapPanel not in self._page.panels:
            return entry
        cut, text = self._page.panels[MapPanel].change_of(item.left)
        if not cut:
            return entry
        return replace(
            entry,
            title=f"{entry.title}, by {cut}",
            more=f"{entry.more} What {cut} changed here, small pieces too: {text}.",
        )

    def _report(self, what: str, done: int, total: int) -> None:
        self._about.content = small_html(f"Looking for the truth: {what}, {percent_text(done / max(total, 1))} …")

    def _fill(self) -> None:
        shown = self._entries[self._first : self._first + LISTED]
        for at, row in enumerate(self._rows):
            row.visible = at < len(shown)
            if at < len(shown):
                number = self._first + at
                row.label = f"{'▸ ' * (number == self._chosen)}{number + 1}. {shown[at].title}"
        right = next((at for at, one in enumerate(shown) if not one.wrong), len(shown))
        self._end.visible = right < len(shown) and self._which.value == ERRORS
        if self._end.visible:  # before the first that is none
            self._end.order = self._rows[right].order - 0.5
        self._pages.visible = len(self._entries) > LISTED
        listed = f"{self._first + 1} to {self._first + len(shown)} of {self._all()}." if shown else ""
        self._place.content = remark_html(listed)
        self._more.visible = self._chosen >= 0
        if self._more.visible:  # below its row
            self._more.content = f'<div class="simaps-detail">{small_html(self._entries[self._chosen].more)}</div>'
            self._more.order = self._rows[self._chosen - self._first].order + 0.25

    def _all(self) -> str:
        """Return how many entries and errors there are: "93 not exact: 1 error, the other 92 right or very small"."""
        every, wrong = len(self._entries), sum(one.wrong for one in self._entries)
        rest = f"{plural(wrong, 'error')}, the other {every - wrong} right or very small"
        return f"{every}{f' not exact: {rest}' if self._which.value == ERRORS and wrong < every else ''}"

    def _turn(self, step: int) -> None:
        last = max(0, (len(self._entries) - 1) // LISTED * LISTED)
        first = min(max(0, self._first + step * LISTED), last)
        if first != self._first:
            self._leave_entry(deselect=True)
            self._first = first
            self._fill()

    def _choose(self, at: int) -> None:
        number, page = self._first + at, self._page
        if number >= len(self._entries):
            return
        self._chosen, entry = number, self._entries[number]
        self._fill()
        page.finish()
        page.select(entry.selects)
        self._views.hide()
        page.submit("error views", lambda: self._show_views(entry))
        if self._truth is not None:
            page.scene.show_changed(self._truth, entry.true)
        page.viewpoints.look_at(with_margin(entry.extent_m, share=1.0, least_m=1.5))

    def selection_changed(self, instance_id: int | None) -> None:
        """Take away the true outlines once another object is selected."""
        entry = self._entries[self._chosen] if self._chosen >= 0 else None
        if entry is not None and instance_id != entry.selects:
            self._leave_entry()

    def _show_views(self, entry: Entry) -> None:
        """Show how the object of an entry looked, unless another is chosen meanwhile."""
        if entry.selects is None or entry not in self._entries:
            return
        pictures, _, frames = best_pictures(self._page.simap, entry.selects, self._page.view)
        if self._chosen >= 0 and self._entries[self._chosen] is entry:
            self._views.show(pictures, frames)


def doubt_entries(simap: SIMap, doubtful: frozenset[int]) -> list[Entry]:
    """Return a line for each object that may be wrong; the doubtful are left out, for they do not count."""
    entries = []
    for doubt in doubts(simap, doubtful):
        one = doubt.instance
        (x0, y0, _), (x1, y1, _) = one.aabb_m
        more, others = f"{one.name}: {' '.join(doubt.reasons)}", len(doubt.reasons) - 1
        area = f"{one.area_m2(simap.spec.cell_size_m):.2f} m²"
        also = f", and {plural(others, 'other reason')}" if others else ""
        title = f"{one.name}, {area}: {doubt.brief}{also}"
        entries.append(Entry(title, more, one.id, (), (x0, y0, x1, y1)))
    return entries


def error_entry(item: Item, here: MapSide, truth: MapSide) -> Entry:
    """Return the line of a difference between a map and the truth."""
    names = _joined([here.names[one] for one in item.left])
    true = plural(len(item.right), item.label)
    titles = {
        "merged": f"{names}: really {true}",
        "split": f"{names}: really one {item.label}",
        "missed": f"{item.label} missing here",
        "extra": f"{names}: no {item.label} is there",
        "label": f"{names}: really a {item.label}",
        "outline": f"{names}: outline {percent_text(item.iou)} right",
        "edge": f"{names}: outline {percent_text(item.iou)} right",
        "small": f"{names}: nothing like it is there" if item.left else f"small {item.label} missing here",
    }
    means = {
        "merged": f"{true} were joined to one object.",
        "split": f"One {item.label} was cut into {plural(len(item.left), 'object')}.",
        "missed": f"There is a {item.label} that the map does not have.",
        "extra": "The map has an object where there is none of its class.",
        "label": f"The object is a {item.label}, and the map says {item.other_label}.",
        "outline": RIGHT,
        "edge": RIGHT,
        "small": "It is so small that it does not count as an error.",
    }
    title = titles[item.kind]
    more, wrong = f"{title}. {means[item.kind]}", Kind(item.kind) not in NO_DIFFERENCE
    return Entry(title, more, next(iter(item.left), None), item.right, item.extent_m, wrong)


def _joined(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
