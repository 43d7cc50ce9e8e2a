"""The section that shows the masks of one frame, and how other thresholds would change them."""

import functools
import threading
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.frame_pictures import ColorBy, MaskStyle, confidence_color, named_color, paint_masks
from simaps_viz.drawing.legend import gradient_html
from simaps_viz.drawing.texture import shown_class_colors
from simaps_viz.drawing.theme import BAD_STYLE, DIM_STYLE, SMALL_STYLE, remark_html, working_html
from simaps_viz.errors import SIMapsError
from simaps_viz.segmentation.protocol import Threshold
from simaps_viz.structures import Segmentation
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec, button, button_row, by_person

ABOUT = "what the network saw on a frame, and how other thresholds would change it"
MAX_ROWS = 40
OPTIONS = {
    "score": "--score-threshold",
    "mask": "--mask-threshold",
    "overlap": "--overlap-threshold",
    "iou": "--box-overlap",
}
"""Command-line options of the thresholds, by key."""


def class_counts(masks: Segmentation) -> dict[str, tuple[int, bool]]:
    """Return {class: (how many segments, is it a thing)}: things first, then by name."""
    counts = Counter(s.label for s in masks.segments)
    things = {s.label: s.is_thing for s in masks.segments}
    return {label: (counts[label], things[label]) for label in sorted(counts, key=lambda c: (not things[c], c))}


def masks_legend(masks: Segmentation, color_by: ColorBy, colors: Mapping[str, Color] | None = None) -> str:
    """Explain the colours, and the fills of things and stuff; ``colors`` are those of the map's classes."""
    kinds = (
        f'<div style="opacity:.85">{_chip((150, 150, 150), thing=True)}thing (can be counted)'
        f'<span style="margin-left:1em">{_chip((150, 150, 150), thing=False)}stuff (floor, wall …)</span></div>'
    )
    if color_by == "confidence":
        colors_of_levels = [confidence_color(level) for level in np.linspace(0.0, 1.0, 9)]
        bar = gradient_html("how sure the network is", colors_of_levels, ("0", "0.5", "1"))
        return f'<div style="{SMALL_STYLE}">{bar}{kinds}</div>'
    chips = "".join(
        f'<span style="white-space:nowrap;margin-right:.9em">{_chip(named_color(label, colors or {}), thing=thing)}'
        f"{escape(label)} <b>{count}</b></span>"
        for label, (count, thing) in class_counts(masks).items()
    )
    return f'<div style="{SMALL_STYLE}">{chips}{kinds}</div>'


def segments_html(masks: Segmentation, hidden: Collection[str]) -> str:
    """List the segments, surest first: class, confidence, share of the picture."""
    shown = sorted((s for s in masks.segments if s.label not in hidden), key=lambda s: (not s.is_thing, -s.score))
    if not shown:
        return remark_html("No segment is shown on this frame.")
    areas = np.bincount(masks.ids.reshape(-1), minlength=max(s.id for s in shown) + 1) / masks.ids.size
    cell = '<td style="padding-right:1em;text-align:right">'
    rows = "".join(
        f'<tr><td style="padding-right:1em">{escape(s.label)}</td>{cell}{s.score:.2f}</td>{cell}{_share(areas[s.id])}'
        "</td></tr>"
        for s in shown[:MAX_ROWS]
    )
    rest = f"<div>and {len(shown) - MAX_ROWS} more</div>" if len(shown) > MAX_ROWS else ""
    head = f'<td style="padding-right:1em">segment</td>{cell}confidence</td>{cell}of the picture</td>'
    rows = f'<tr style="{DIM_STYLE}">{head}</tr>{rows}'
    return f'<div style="{SMALL_STYLE}"><table style="border-spacing:0">{rows}</table>{rest}</div>'


def effect_words(before: Segmentation, now: Segmentation) -> str:
    """Describe how the masks of a frame differ from those the map was built from."""
    named = [float(np.count_nonzero(masks.ids) / max(masks.ids.size, 1)) for masks in (before, now)]
    old, new = (Counter(s.label for s in masks.segments) for masks in (before, now))
    text = f"{plural(len(now.segments), 'segment')}, {_share(named[1])} of the picture"
    if now is before:
        return f"As the map was built: {text}."
    parts = [f"+{n} {label}" for label, n in sorted((new - old).items())]
    parts += [f"−{n} {label}" for label, n in sorted((old - new).items())]
    changed = float(np.count_nonzero((before.ids > 0) != (now.ids > 0)) / max(now.ids.size, 1))
    what = ", ".join(parts) if parts else "as many of each class"
    return (
        f"Now {text}. As the map was built: {len(before.segments)}, {_share(named[0])}. Change: {what}; "
        f"{_share(changed)} of the pixels gained or lost their segment."
    )


def command_words(source: str, thresholds: Mapping[str, float]) -> str:
    """Return the command line that builds a map with these thresholds; empty where none has an option."""
    chosen = " ".join(f"{OPTIONS[key]} {value:g}" for key, value in thresholds.items() if key in OPTIONS)
    return f"To build a map so: simaps build … --segmentation {source} {chosen}" if chosen else ""


def has_confidence(masks: Segmentation) -> bool:
    """Whether the things on a frame have a confidence; in masks without one every score is 1."""
    scores: Sequence[float] = [s.score for s in masks.segments if s.is_thing]
    return not scores or any(score < 1.0 for score in scores)


def _share(share: float) -> str:
    return f"{100 * share:.1f} %"


def _chip(color: Color, *, thing: bool) -> str:
    solid = f"rgb{color}"
    fill = solid if thing else f"repeating-linear-gradient(135deg,{solid} 0 3px,transparent 3px 6px)"
    return (
        f'<span style="display:inline-block;width:12px;height:12px;border-radius:2px;margin-right:5px;'
        f'background:{fill};box-shadow:inset 0 0 0 1px rgba(0,0,0,.3)"></span>'
    )


LARGE_PX = 1400
"""Width of the enlarged picture."""
MAX_NAMES = 6
"""How many segments, the largest, are named in the small picture."""
FRAME_HINT = "Counted from 0; the map and the recorded build go to the same frame."
OPACITY_HINT = "0: only outlines; 1: masks hide the picture."
NO_SCORES = "These masks have no confidence: each score is 1."


@dataclass(frozen=True, eq=False)
class SegmentationServices:
    """Plain functions behind the section. Frames are numbered as those of the map."""

    frame_names: tuple[str, ...] = ()
    look: Callable[[int], tuple[NDArray, Segmentation]] | None = None
    """frame -> (uint8 [H, W, 3] RGB, the masks the map was built from); None if they are not at hand."""
    retry: Callable[[int, Mapping[str, float]], Segmentation] | None = None
    """(frame, thresholds by key) -> masks; None if thresholds cannot be tried."""
    runs_network: bool = False
    """Whether the first ``retry`` of a frame runs the network, which takes a while."""
    knobs: tuple[Threshold, ...] = ()
    """Thresholds with the values the map was built with; each gets a slider."""
    source: str = ""
    """Describes where the masks come from."""
    network: str = ""
    """File of the network, for the command line."""
    notes: tuple[str, ...] = ()
    """Remarks, such as on what is missing."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """The frame that was read last."""

    frame: int
    rgb: NDArray
    before: Segmentation
    """The masks the map was built from."""
    now: Segmentation
    """The masks with the thresholds of the sliders."""


def masks_panel(services: SegmentationServices) -> PanelSpec:
    """Return the tab of a page that has this section."""
    return PanelSpec("Masks", viser.Icon.PHOTO, lambda page: SegmentationPanel(page, services), about=ABOUT)


class SegmentationPanel(Panel):
    """The masks of one frame: that of the page until another one is chosen here."""

    def __init__(self, page: Page, services: SegmentationServices) -> None:
        """Fill the open container."""
        self._page, self._services = page, services
        self._seen: _Seen | None = None
        self._closed = False
        self._lock = threading.Lock()
        self._class_boxes: dict[str, Any] = {}
        self._knobs: dict[str, Any] = {}
        self._effect: viser.GuiHtmlHandle | None = None
        gui = page.gui
        source = f"Masks: {services.source}." if services.source else ""
        self._status = gui.add_html("")
        about = "".join(map(remark_html, (source, *services.notes)))
        if services.look is None:
            gui.add_html(about)
        else:
            self._add_frame(gui)
            gui.add_html(about)
            self._add_knobs(gui)
            self._classes = gui.add_folder("Classes", expand_by_default=False)
            with self._classes:
                switches = {"All": lambda: self._switch_all(True), "None": lambda: self._switch_all(False)}
                button_row(gui, "Show", switches, hint="Switch all classes on or off.")
            self._add_drawing(gui)
            self._segments = gui.add_html("")
            self.refresh()

    @property
    def masks(self) -> Segmentation | None:
        """The masks that are shown."""
        return None if self._seen is None else self._seen.now

    @property
    def frame(self) -> int:
        """The frame that is shown."""
        return 0 if self._services.look is None else int(self._frame.value)

    @property
    def hidden(self) -> frozenset[str]:
        """The classes that are switched off."""
        return frozenset(label for label, box in self._class_boxes.items() if not box.value)

    def time_changed(self, frame: int, step: int | None) -> None:
        """Follow the page to a frame, if that has masks."""
        if self._services.look is not None and 0 <= frame < len(self._services.frame_names) and frame != self.frame:
            self._frame.value = frame
            self.refresh()

    def state(self) -> dict[str, Any]:
        """Return the settings, for a page that is loaded again."""
        if self._services.look is None:
            return {}
        knobs = {key: float(slider.value) for key, slider in self._knobs.items()}
        look = {"color_by": self._color_by.value, "opacity": self._opacity.value, "names": self._names.value}
        return {"frame": self.frame, **look, "knobs": knobs, "hidden": sorted(self.hidden)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore the settings."""
        if self._services.look is None or not state:
            return
        self._frame.value = min(int(state["frame"]), len(self._services.frame_names) - 1)
        self._color_by.value, self._opacity.value, self._names.value = (
            state["color_by"],
            state["opacity"],
            state["names"],
        )
        for key, value in state["knobs"].items():
            if key in self._knobs:
                self._knobs[key].value = value
        for label in state["hidden"]:
            self._box(label).value = False
        self.refresh()

    def close(self) -> None:
        """Stop drawing."""
        self._closed = True

    def refresh(self) -> None:
        """Queue drawing the frame again."""
        self._page.submit("segmentation", self._update)

    def _add_frame(self, gui: viser.GuiApi) -> None:
        last = max(len(self._services.frame_names) - 1, 0)
        self._frame = gui.add_slider("Masks of frame", 0, max(last, 1), 1, last, disabled=last == 0, hint=FRAME_HINT)
        by_person(self._frame, lambda: self._chose(self.frame))
        steps = {"Previous": lambda: self._step(-1), "Next": lambda: self._step(1)}
        button_row(gui, "Step", steps, disabled=last == 0, hint="One frame back or forward.")
        self._picture = gui.add_image(np.full((4, 6, 3), 235, np.uint8), format="jpeg", jpeg_quality=85)
        self._legend = gui.add_html("")
        enlarge = functools.partial(self._page.submit, "enlarge masks", self._enlarge)
        button(gui, "Enlarge", enlarge, icon=viser.Icon.MAXIMIZE, color="gray")

    def _add_drawing(self, gui: viser.GuiApi) -> None:
        self._color_by = gui.add_dropdown("Mask colour", ("class", "confidence"), hint="What a mask's colour means.")
        self._opacity = gui.add_slider("Mask opacity", 0.0, 1.0, 0.05, MaskStyle.opacity, hint=OPACITY_HINT)
        self._names = gui.add_checkbox("Names", True, hint="Write class and confidence on each segment.")
        for widget in (self._color_by, self._opacity, self._names):
            by_person(widget, self.refresh)

    def _add_knobs(self, gui: viser.GuiApi) -> None:
        services = self._services
        if services.retry is None or not services.knobs:
            return
        with gui.add_folder("Thresholds, on this frame only"):
            for knob in services.knobs:
                low, high = min(0.02, knob.value), max(0.98, knob.value)
                slider = gui.add_slider(knob.label, low, high, 0.01, knob.value, hint=knob.hint)
                self._knobs[knob.key] = by_person(slider, self.refresh)
            button(gui, "As the map was built", self._reset, icon=viser.Icon.ARROW_BACK_UP, color="gray")
            self._effect = gui.add_html("")

    def _step(self, by: int) -> None:
        frame = min(max(self.frame + by, 0), len(self._services.frame_names) - 1)
        if frame != self.frame:
            self._frame.value = frame
            self._chose(frame)

    def _chose(self, frame: int) -> None:
        self.refresh()
        self._page.show_frame(frame)

    def _reset(self) -> None:
        for knob in self._services.knobs:
            self._knobs[knob.key].value = knob.value
        self.refresh()

    def _switch_all(self, on: bool) -> None:
        for box in self._class_boxes.values():
            box.value = on
        self.refresh()

    def _values(self) -> dict[str, float]:
        """Return the thresholds that differ from those the map was built with."""
        now = {knob.key: float(self._knobs[knob.key].value) for knob in self._services.knobs if self._knobs}
        built = {knob.key: knob.value for knob in self._services.knobs}
        return {key: value for key, value in now.items() if abs(value - built[key]) > 1e-6}

    def _update(self) -> None:
        """Read the frame and show it; called on a worker thread."""
        if self._closed or self._services.look is None:
            return
        frame = self.frame
        try:
            with self._lock:
                seen = self._read(frame)
        except SIMapsError as error:
            alert = f'<div role="alert" style="{SMALL_STYLE};{BAD_STYLE}">{escape(str(error))}</div>'
            self._status.content = alert
            return
        self._seen = seen
        self._show_classes(seen.now)
        style = self._style()
        self._picture.image = paint_masks(seen.rgb, seen.now, style)
        self._legend.content = masks_legend(seen.now, self._color_by.value, style.colors)
        self._segments.content = segments_html(seen.now, self.hidden)
        names = self._services.frame_names
        name = f"Frame {frame}, the last is {len(names) - 1}: picture {names[frame]} of the sequence."
        self._status.content = remark_html(name) + remark_html("" if has_confidence(seen.now) else NO_SCORES)
        if self._effect is not None:
            self._effect.content = remark_html(effect_words(seen.before, seen.now)) + remark_html(self._command())

    def _read(self, frame: int) -> _Seen:
        look, retry, values = self._services.look, self._services.retry, self._values()
        assert look is not None
        seen = self._seen
        if seen is None or seen.frame != frame:
            self._status.content = working_html("Reading the frame")
            rgb, before = look(frame)
            seen = _Seen(frame, rgb, before, before)
        if not values or retry is None:
            return replace(seen, now=seen.before)
        if self._services.runs_network:
            self._status.content = working_html("Reading the network's output anew")
        return replace(seen, now=retry(frame, {**{k.key: k.value for k in self._services.knobs}, **values}))

    def _style(self) -> MaskStyle:
        return MaskStyle(
            self._color_by.value,
            float(self._opacity.value),
            bool(self._names.value),
            self.hidden,
            colors=shown_class_colors(self._page.simap),
            most_names=MAX_NAMES,
        )

    def _show_classes(self, masks: Segmentation) -> None:
        """Show a switch for each class of the frame, and for each class that is switched off."""
        counts = class_counts(masks)
        for label, (count, thing) in counts.items():
            self._box(label).label = f"{label} ({count})" if thing else f"{label} ({count}, stuff)"
        for label, box in self._class_boxes.items():
            if label not in counts:
                box.label = f"{label} (0)"
            box.visible = label in counts or not box.value
        shown = sum(count for label, (count, _) in counts.items() if self._class_boxes[label].value)
        self._classes.label = f"Classes: {shown} of {plural(len(masks.segments), 'segment')} shown"

    def _box(self, label: str) -> Any:
        """Return the switch of a class; it is made on first use."""
        if label not in self._class_boxes:
            with self._classes:
                box = self._page.gui.add_checkbox(label, True)
            self._class_boxes[label] = by_person(box, self.refresh)
        return self._class_boxes[label]

    def _command(self) -> str:
        return command_words(self._services.network, self._values()) if self._services.network else ""

    def _enlarge(self) -> None:
        seen = self._seen
        if self._closed or seen is None:
            return
        modal = self._page.gui.add_modal(f"Frame {seen.frame}: {plural(len(seen.now.segments), 'segment')}")
        with modal:
            large = replace(self._style(), width=LARGE_PX, font_px=18, most_names=None)
            self._page.gui.add_image(paint_masks(seen.rgb, seen.now, large), format="jpeg", jpeg_quality=85)
            self._page.gui.add_button("Close").on_click(lambda _: modal.close())
