"""The panel about the whole map: where it is from, how it is cut into instances, what its colours mean."""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import PurePath
from typing import cast

import viser

from simaps_viz.drawing.legend import counts_text, legend_html
from simaps_viz.drawing.texture import COLOR_MODES, ColorMode
from simaps_viz.drawing.theme import BADGE_STYLE, LIGHT, Theme
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import joining_percent, slider_of
from simaps_viz.structures import SIMap
from simaps_viz.viewer.scene.camera import SLANT, TOP

EVERY_CLASS = "all classes"
DEFAULT_RESOLUTION = 1.0
FINISH = "Show the finished map"
MODE_HINT = "What a colour on the map means; the legend follows."
LEGEND_STYLE = "border-block:1px solid rgba(128,128,128,.25);margin-bottom:.4em"
"""How long it is, `viser_page` says, by the page's height."""


@dataclass(frozen=True)
class MapActions:
    """Whom the panel tells; none of these may take long."""

    partition: Callable[[float, float], None]
    """(K or evidence in percent, Louvain resolution) were chosen."""
    restyle: Callable[[], None]
    """The colour mode or the class to emphasise changed."""
    look: Callable[[str], None]
    """TOP or SLANT was asked for."""
    finish: Callable[[], None] = lambda: None
    """The finished map was asked for."""


class MapPanel:
    """The widgets; the map they speak of comes with ``show``."""

    def __init__(
        self, gui: viser.GuiApi, simap: SIMap, actions: MapActions, *, with_k: bool, with_resolution: bool
    ) -> None:
        """Fill the current container.

        Args:
            gui: where.
            simap: the map that the sliders cut.
            actions: whom to tell.
            with_k: whether maps can be cut with another K or evidence.
            with_resolution: whether communities can be found anew.
        """
        self._actions, self._with_k, self._with_resolution = actions, with_k, with_resolution
        joining = slider_of(simap)
        self._k0 = joining_percent(simap)
        self._resolution0 = float(simap.parameters.get("resolution", DEFAULT_RESOLUTION))
        self._origin = gui.add_html(origin_html(simap))
        self._past = gui.add_html("", visible=False)
        self._finish = gui.add_button(FINISH, icon=viser.Icon.PLAYER_TRACK_NEXT, color="gray", visible=False)
        self._finish.on_click(lambda _: actions.finish())
        self._counts = gui.add_html("")
        self._busy, self._said = False, ""
        self._legend = gui.add_html("")
        view = gui.add_button_group("View", (TOP, SLANT), hint="From above, or objects as blocks (keys T and 3).")
        view.on_click(lambda event: actions.look(event.target.value))
        self._k = gui.add_slider(
            joining.title,
            0.0,
            100.0,
            0.5,
            self._k0,
            hint=joining.hint,
        )
        self._resolution = gui.add_slider(
            "Resolution",
            0.05,
            5.0,
            0.05,
            min(max(self._resolution0, 0.05), 5.0),
            hint="Louvain resolution: higher values cut objects into more communities before they are merged.",
        )
        for slider in (self._k, self._resolution):
            slider.on_update(self._chosen)
        self._reset = gui.add_button(
            f"Reset {joining.word} and resolution",
            icon=viser.Icon.ARROW_BACK_UP,
            color="gray",
        )
        self._reset.on_click(lambda _: self.reset())
        self._mode = gui.add_dropdown("Colours", COLOR_MODES, initial_value=COLOR_MODES[0], hint=MODE_HINT)
        self._class = gui.add_dropdown(
            "Show", (EVERY_CLASS, *simap.counts()), initial_value=EVERY_CLASS, hint="Emphasise one class."
        )
        for widget in (self._mode, self._class):
            widget.on_update(lambda _: actions.restyle())
        self.come_from(simap)

    @property
    def percent(self) -> float:
        """K or evidence, percent, as the slider stands."""
        return float(self._k.value)

    @property
    def resolution(self) -> float:
        """Louvain resolution, as the slider stands."""
        return float(self._resolution.value)

    @property
    def touched(self) -> bool:
        """Whether the sliders are not where the map has them."""
        return (self.percent, self.resolution) != (self._k0, min(max(self._resolution0, 0.05), 5.0))

    @property
    def mode(self) -> ColorMode:
        """What the colours shall mean."""
        return cast(ColorMode, self._mode.value)

    @property
    def shown_class(self) -> str | None:
        """The class to emphasise, or None for all."""
        return None if self._class.value == EVERY_CLASS else self._class.value

    def come_from(self, base: SIMap) -> None:
        """Another map is the one that the sliders cut: set them to how it was cut."""
        joining = slider_of(base)
        self._k0 = joining_percent(base)
        self._resolution0 = float(base.parameters.get("resolution", DEFAULT_RESOLUTION))
        self._origin.content = origin_html(base)
        self._k.label, self._k.hint = joining.title, joining.hint
        self._k.visible = self._with_k and joins(base)
        self._resolution.visible = self._with_resolution and "resolution" in base.parameters
        self._reset.label = f"Reset {joining.word} and resolution"
        self._reset.visible = self._k.visible or self._resolution.visible
        self.set_sliders(self._k0, self._resolution0)

    def set_sliders(self, percent: float, resolution: float) -> None:
        """Put the sliders somewhere, without a word to anyone."""
        self._k.value = percent
        self._resolution.value = min(max(resolution, 0.05), 5.0)

    def set_look(self, mode: ColorMode, shown_class: str | None) -> None:
        """Choose what the colours mean, and the class to emphasise."""
        self._mode.value = mode
        if shown_class is None or shown_class in self._class.options:
            self._class.value = shown_class or EVERY_CLASS

    def show(self, simap: SIMap, theme: Theme = LIGHT) -> None:
        """Describe what is on the map now."""
        self._busy = False
        self._counts.content = counts_html(simap)
        for widget in (self._k, self._resolution, self._reset):
            widget.disabled = not simap.instances and not simap.graphs
        legend = legend_html(simap, self.mode, theme)
        self._legend.content = f'<div class="simaps-legend" style="{LEGEND_STYLE}">{legend}</div>'
        options = (EVERY_CLASS, *simap.counts())
        if options != tuple(self._class.options):
            self._class.options = options  # of the same classes in another order the chosen one stays

    def tell_past(self, badge: str) -> None:
        """Report that the map is not the finished one, and offer that; nothing when the text is empty."""
        words = f'<span style="{BADGE_STYLE}">{escape(badge)}</span>'
        content = f'<div style="padding:.2em .8em .4em;font-size:.85em">{words}</div>'
        if badge and self._past.content != content:
            self._past.content = content
        if self._past.visible != bool(badge):
            self._past.visible = self._finish.visible = bool(badge)

    def reset(self) -> None:
        """Go back to the K and resolution the map came with."""
        self.set_sliders(self._k0, self._resolution0)
        self._cut()

    def calm(self) -> None:
        """The map could not be cut: say no longer that it is."""
        if self._busy:
            self._busy = False
            self._counts.content = self._said

    def _chosen(self, event: viser.GuiEvent) -> None:
        if event.client_id is not None:
            self._cut()

    def _cut(self) -> None:
        if not self._busy:
            self._busy, self._said = True, str(self._counts.content)
            self._counts.content = _line("Cutting the map anew …")
        self._actions.partition(self.percent, self.resolution)


def origin_html(simap: SIMap) -> str:
    """Describe where a map comes from, and that it is simulated where it is."""
    sequence = PurePath(str(simap.provenance.get("sequence", "unknown sequence")))
    folder = sequence.parent.name if sequence.suffix == ".json" and sequence.parent.name else sequence.name
    name = str(simap.provenance.get("name") or folder)
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
    """Put the counts in a line of their own."""
    return _line(counts_text(simap))


def _line(text: str) -> str:
    return (
        '<div role="status" style="padding:.2em .8em .4em;font-size:.88em;font-weight:600;line-height:1.4;'
        'overflow-wrap:anywhere">'
        f"{escape(text)}</div>"
    )


def joins(simap: SIMap) -> bool:
    """Return whether the map has a merge log that a slider can follow."""
    slider = method_of(simap.method).slider
    return slider is not None and slider.parameter in simap.parameters
