"""The panel about the map: its origin, how it is cut into instances, and what its colours mean."""

import functools
from dataclasses import replace
from html import escape
from typing import Any, cast

import viser

from simaps_viz.drawing.legend import counts_text, legend_html, title_of
from simaps_viz.drawing.texture import ColorMode, color_modes
from simaps_viz.drawing.theme import BADGE_STYLE
from simaps_viz.mapping.in_space import has_voxels
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import slider_of
from simaps_viz.structures import Room, SIMap
from simaps_viz.viewer.page.page import MAX_RESOLUTION, MIN_RESOLUTION, Cut, Page, cut_of
from simaps_viz.viewer.page.panel import Panel
from simaps_viz.viewer.page.timeline import Snapshot
from simaps_viz.viewer.page.widgets import button, button_row, by_person
from simaps_viz.viewer.scene.camera import SLANT, TOP
from simaps_viz.viewer.scene.map_scene import FULL_HEIGHT_M, Style

EVERY_CLASS = "all classes"
FINISH = "Show the finished map"
MODE_HINT = "What a colour on the map means; the legend follows."
CUT_HINT = "Leave out everything above, as if the roof and then the tables were lifted off."
WALLS_HINT = "Show walls in full height; otherwise they end low, so that one can look in."
LEGEND_STYLE = "border-block:1px solid rgba(128,128,128,.25);margin-bottom:.4em"
"""Inline style of the legend; the page's script sets its height to fit the page."""


class MapPanel(Panel):
    """The map's origin, the sliders that cut it into instances, and the legend of its colours."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page = page
        self._rooms_shown: tuple[Room, ...] = ()
        self._in_space = False
        self.faded: frozenset[str] = frozenset()
        """Classes that are dimmed."""
        self._other_mode: ColorMode = "photo"
        gui, simap, services = page.gui, page.base, page.services
        self._with_k, self._with_resolution = services.repartition is not None, services.recommunity is not None
        own, joining = cut_of(simap), slider_of(simap)
        # What the map is, and a way back from an earlier time step.
        self._origin = gui.add_html(origin_html(simap))
        self._past = gui.add_html("", visible=False)
        self._finish = button(gui, FINISH, page.finish, icon=viser.Icon.PLAYER_TRACK_NEXT, color="gray", visible=False)
        self._counts = gui.add_html("")
        self._busy, self._counts_before = False, ""
        self._legend = gui.add_html("")
        views = {name: functools.partial(page.look, name) for name in (TOP, SLANT)}
        button_row(gui, "View", views, hint="From above, or the room in 3-D (keys T and 3).")
        # What of the surface is shown in the 3-D view.
        self._cut_m = gui.add_slider(
            "Cut at height", 0.1, FULL_HEIGHT_M, 0.1, FULL_HEIGHT_M, hint=CUT_HINT, visible=False
        )
        self._walls = gui.add_checkbox("Whole walls", False, hint=WALLS_HINT, visible=False)
        for widget in (self._cut_m, self._walls):
            by_person(widget, self._cut_surface)
        # The sliders that cut it into instances.
        self._k = gui.add_slider(joining.title, 0.0, 100.0, 0.5, own.percent, hint=joining.hint)
        self._resolution = gui.add_slider(
            "Resolution",
            MIN_RESOLUTION,
            MAX_RESOLUTION,
            0.05,
            own.resolution,
            hint="Louvain resolution: higher values cut objects into more communities before they are merged.",
        )
        for slider in (self._k, self._resolution):
            by_person(slider, self._cut)
        self._reset = button(gui, "Reset", self.reset, icon=viser.Icon.ARROW_BACK_UP, color="gray")
        # What is painted.
        self._mode = gui.add_dropdown("Colours", color_modes(simap), initial_value=_first_mode(simap), hint=MODE_HINT)
        self._class = gui.add_dropdown(
            "Show", (EVERY_CLASS, *simap.counts()), initial_value=EVERY_CLASS, hint="Emphasise one class."
        )
        self._rooms = gui.add_checkbox("Rooms", False, hint="Outline the rooms, with their names.")
        for widget in (self._mode, self._class, self._rooms):
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
        joining = slider_of(base)
        self._origin.content = origin_html(base)
        self._k.label, self._k.hint = joining.title, joining.hint
        self._k.visible = self._with_k and joins(base)
        self._resolution.visible = self._with_resolution and "resolution" in base.parameters
        self._reset.label = f"Reset {joining.word} and resolution"
        self._reset.visible = self._k.visible or self._resolution.visible
        self.set_sliders(self._page.cut.percent, self._page.cut.resolution)

    def view_changed(self, name: str) -> None:
        """Offer to cut the surface while it is shown; each view keeps its colours, at first 3-D those of a photo."""
        surface = name == SLANT and has_voxels(self._page.simap)
        self._cut_m.visible = self._walls.visible = surface
        if surface != self._in_space:
            before, now = self.mode, self._other_mode
            self._in_space, self._other_mode = surface, before
            self._mode.value = now if now in self._mode.options else "instance"

    def map_changed(self, simap: SIMap) -> None:
        """Offer the colours that the map has."""
        if color_modes(simap) != tuple(self._mode.options):
            self._mode.options = color_modes(simap)

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
        if style.lit is None and (shown is not None or faded):
            lit = simap.of_class(shown) if shown is not None else simap.instances
            style = replace(style, lit=frozenset(one.id for one in lit if one.label == shown or one.label not in faded))
        return replace(style, mode=self.mode)

    def told(self, event: dict[str, Any]) -> None:
        """Show a class of the legend alone, or all again; or fade it, or show it again."""
        name = event.get("name")
        if event.get("type") != "class" or name not in self._class.options:
            return
        if event.get("do") == "fade":
            self.faded ^= {name}
            self._page.repaint()
        else:
            self._class.value = EVERY_CLASS if name == self._class.value else name

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """Describe the painted map, with a badge unless it is the finished one."""
        self._busy = False
        self._counts.content = counts_html(simap)
        self._show_rooms(simap)
        for widget in (self._k, self._resolution, self._reset):
            widget.disabled = not simap.instances and not simap.graphs
        legend = legend_html(simap, self.mode, self._page.theme, buttons=True)
        legend = f'<div class="simaps-legend" style="{LEGEND_STYLE}">{legend}</div>'
        if self._legend.content != legend:  # sent again, it would lose the focus of its buttons
            self._legend.content = legend
        options = (EVERY_CLASS, *simap.counts())
        if options != tuple(self._class.options):
            self._class.options = options  # viser keeps the chosen class if it is still there
        words = f'<span style="{BADGE_STYLE}">{escape(snapshot.badge)}</span>'
        content = f'<div style="padding:.2em .8em .4em;font-size:.85em">{words}</div>'
        past = bool(snapshot.badge)
        if past and self._past.content != content:
            self._past.content = content
        if self._past.visible != past:
            self._past.visible = self._finish.visible = past

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

    def state(self) -> tuple[ColorMode, str | None, bool, Cut | None]:
        """Return the colours, the class to emphasise, whether rooms are shown, and the cut if not the map's own."""
        return self.mode, self.shown_class, bool(self._rooms.value), self._page.cut if self._page.cut_here else None

    def restore(self, state: tuple[ColorMode, str | None, bool, Cut | None]) -> None:
        """Restore the colours, the rooms and the cut."""
        mode, shown_class, self._rooms.value, cut = state
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
        if not self._busy:
            self._busy, self._counts_before = True, str(self._counts.content)
            self._counts.content = _line("Cutting the map anew …")
        self._page.cut_map(self.percent, self.resolution)


def _first_mode(simap: SIMap) -> ColorMode:
    """Return what a page shows at first: a real place as it looked, where that is known, else its objects."""
    return "photo" if "photo" in color_modes(simap) and not simap.provenance.get("simulated") else "instance"


def origin_html(simap: SIMap) -> str:
    """Describe the origin of a map, with a badge if it is simulated."""
    name = title_of(simap)
    source = str(simap.provenance.get("segmentation", "unknown"))
    badge = ""
    if simap.provenance.get("simulated"):
        badge = f'<span style="{BADGE_STYLE}">simulated</span> '
    return (
        '<div style="padding:.5em .8em 0;font-size:.85em;line-height:1.5;overflow-wrap:anywhere">'
        f'<div style="font-size:1.15em;font-weight:600">{escape(name)}</div>'
        f"<div>method <b>{escape(simap.method)}</b> · {len(simap.frame_names)} frames · "
        f"{simap.spec.cell_size_m * 100:g} cm cells</div><div>{badge}segmentation: {escape(source)}</div></div>"
    )


def counts_html(simap: SIMap) -> str:
    """Set the number of objects of each class in a line."""
    return _line(counts_text(simap))


def _line(text: str) -> str:
    return (
        '<div role="status" style="padding:.2em .8em .4em;font-size:.88em;font-weight:600;line-height:1.4;'
        'overflow-wrap:anywhere">'
        f"{escape(text)}</div>"
    )


def joins(simap: SIMap) -> bool:
    """Whether the map has a merge log that a slider can follow."""
    slider = method_of(simap.method).slider
    return slider is not None and slider.parameter in simap.parameters
