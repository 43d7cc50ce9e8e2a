"""The section "Why is this one object?", which also explains what keeps an object apart from others."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np
import viser

from simaps_viz.colors.classes import plural
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.frame_pictures import named, outlined
from simaps_viz.drawing.legend import CHIP_STYLE, chip, gradient_html
from simaps_viz.drawing.theme import SMALL_STYLE, remark_html, small_html, working_html
from simaps_viz.mapping.explain import (
    Between,
    Joint,
    Why,
    between,
    between_words,
    explain,
    joint_words,
    needed_text,
    score_text,
    summary,
    weakest_name,
)
from simaps_viz.mapping.mending import edits_of
from simaps_viz.mapping.methods import method_of
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, by_person
from simaps_viz.viewer.panels.help import WORDS
from simaps_viz.viewer.panels.instance import FrameGallery, InstancePanel
from simaps_viz.viewer.scene.camera import SLANT
from simaps_viz.viewer.scene.map_scene import Style
from simaps_viz.viewer.scene.why_marks import (
    CUT,
    FLOOR_M,
    LINK,
    RAMP,
    SOURCE,
    TARGET,
    UNKNOWN,
    Marks,
    WhyMarks,
    drawn_links,
    link_text,
    sureness_colors,
    sureness_range,
)


def summary_html(why: Why, *, by_hand: bool = False) -> str:
    """Describe why an instance is one object; ``by_hand``: it was edited."""
    words = escape(summary(why, by_hand=by_hand))
    return (
        '<div style="margin:.1em .8em .6em;padding:.4em .6em;font-size:.82em;line-height:1.45;'
        f'border-left:3px solid rgb(22,110,235);background:rgba(22,110,235,.07)">{words}</div>'
    )


def sureness_legend(why: Why) -> str:
    """Explain the colours of `sureness_colors`."""
    low, high = sureness_range(why)
    if method_of(why.method).weights_per_frame:
        meaning, ends = "mean weight of a cell's edges inside (pixel pairs per frame)", (f"{low:g}", f"{high:.1f}")
    else:
        meaning, ends = "share of sightings with the rest that say one object", (f"{low:g} and less", f"{high:g}")
    rest = ""
    if np.isnan(why.sureness).any():
        rest = f"<div>{CHIP_STYLE}{chip(UNKNOWN)}nothing seen for or against</div>"
    return f'<div style="{SMALL_STYLE}">{gradient_html(meaning, RAMP, ends)}{rest}</div>'


def lines_legend(simap: SIMap, why: Why) -> str:
    """Explain the lines on the map: how strong the weakest joint and the neighbours' links are, and what is needed."""
    bars = [] if why.weakest is None else [(weakest_name(why), why.weakest.score, CUT)]
    drawn = drawn_links(why)
    if method_of(why.method).slider is None:
        return f'<div style="{SMALL_STYLE}">{_stroke(LINK)}neighbours, with their distance</div>' if drawn else ""
    bars += [(link.other.name, link.score, LINK) for link in drawn]
    return bars_html(why, bars)


def bars_html(why: Why, bars: Sequence[tuple[str, float, Color]]) -> str:
    """Draw scores (name, score, colour) as bars, with a mark at the threshold above which parts are one object."""
    if not bars:
        return ""
    most = max(1.0 if why.threshold > 0.25 else 2.0 * why.threshold, *(score for _, score, _ in bars), 1e-9)
    at = 100.0 * why.threshold / most
    rows = "".join(
        f'<div style="overflow-wrap:anywhere">{escape(name)}</div>'
        '<div style="position:relative;height:.75em;align-self:center;background:rgba(128,128,128,.2)">'
        f'<div style="height:100%;width:{100.0 * min(score / most, 1.0):.1f}%;background:rgb{color}"></div>'
        f'<div style="position:absolute;inset:-.2em auto -.2em {at:.1f}%;border-left:2px solid currentColor"></div>'
        f"</div><div>{score_text(why.method, score, why.threshold)}{' ✓' if score > why.threshold else ''}</div>"
        for name, score, color in bars
    )
    needed = f"one object above {needed_text(why.method, why.threshold)} (the upright mark):"
    return (
        f'<div style="{SMALL_STYLE}">{escape(needed[0].upper() + needed[1:])}<div style="display:grid;'
        f'grid-template-columns:minmax(0,8.5em) 1fr max-content;gap:.1em .6em">{rows}</div></div>'
    )


def joint_html(why: Why, joint: Joint, position: int, recorded: bool | None) -> str:
    """Describe one step that made an instance; ``position`` counts from 1, ``recorded`` is None without a recording."""
    more = " The recorded build was cut into other communities and has no such step." if recorded is False else ""
    return (
        f'<div style="{SMALL_STYLE}"><b>Step {position} of {len(why.joints)}</b>: '
        f"{_stroke(TARGET)}{plural(joint.target_cells, 'cell')} + "
        f"{_stroke(SOURCE)}{plural(joint.source_cells, 'cell')}: "
        f"{escape(joint_words(why, joint))}.{escape(more)}</div>"
    )


def joint_name(why: Why, position: int) -> str:
    """Name a step on a button: "Step 12 of 40: 30 and 14 cells, 83 %"; ``position`` counts from 1."""
    joint = why.joints[position - 1]
    weakest = f", {weakest_name(why).removesuffix(' joint')}" if joint is why.weakest else ""
    parts = f"{joint.target_cells} and {plural(joint.source_cells, 'cell')}"
    return (
        f"Step {position} of {len(why.joints)}: {parts}, {score_text(why.method, joint.score, why.threshold)}{weakest}"
    )


def words_html(simap: SIMap) -> str:
    """Explain the words that the section uses of a map of that method, folded up."""
    slider = method_of(simap.method).slider
    own = {"Mask", "Community"} if slider is None else {*WHY_WORDS, slider.title}
    rows = "".join(f"<div><b>{escape(word)}</b>: {escape(means)}</div>" for word, means in WORDS if word in own)
    return f'<details class="simaps-words" style="{SMALL_STYLE}"><summary>What the words mean</summary>{rows}</details>'


def _stroke(color: Color) -> str:
    return (
        '<span style="display:inline-block;width:14px;height:4px;border-radius:2px;margin-right:5px;'
        f'vertical-align:middle;background:rgb{color}"></span>'
    )


WHY_WORDS = ("Cell", "Mask", "Community", "Merge step", "Joint", "Sighting", "Imagined")
ROWS = 6
"""Rows of the table of merge steps."""
MAX_NEIGHBOURS = 8
APART_HINT = "What keeps this object apart from another: a neighbour, with the number on its line, or one you click."
_ROW = re.compile(r"Step (\d{1,8}) of ")
ASK = "Click another object …"
STOP_ASKING = "Cancel"


class WhyPanel(Panel):
    """The section "Why is this one object?". The explanation is computed on the page's worker."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page = page
        self._marks = WhyMarks(page.client, page.scene.texts)
        self._simap: SIMap | None = None
        self.why: Why | None = None
        """The explanation that is shown."""
        self._joint: Joint | None = None
        self._pointed: Joint | None = None
        """The step that the pointer is on."""
        self._between: Between | None = None
        self._asking = False
        gui = page.gui
        self._folder = gui.add_folder("Why is this one object?", visible=False)
        with self._folder:
            self._words = gui.add_html("")
            self._add_drawing(gui)
            self._add_neighbours(gui)
            self._add_steps(gui)

    @property
    def lit(self) -> frozenset[int]:
        """Instances that keep their colour, besides the selected one."""
        return frozenset() if self._between is None else frozenset({self._between.second.id})

    def selection_changed(self, instance_id: int | None) -> None:
        """Queue the explanation of the selected instance."""
        simap = self._page.simap
        if self.why is None or self.why.instance.id != instance_id:
            self._forget(instance_id)
        self._page.worker.submit("why", lambda: self._explain(simap, instance_id))

    def style(self, simap: SIMap, style: Style) -> Style:
        """Emphasise the compared instance, and colour cells by evidence if that is switched on."""
        if self._page.selected is not None and style.lit is not None:
            style = replace(style, lit=style.lit | self.lit)
        why = self.why
        if why is None or simap is not self._simap or not self._color.value:
            return style
        return replace(style, paint=(why.cells, sureness_colors(why)), faint=frozenset())

    def view_changed(self, name: str) -> None:
        """Draw the lines above the object's block in the slanted view, and on the floor in the top view."""
        self._page.worker.submit("why marks", self._draw)

    def waits_for_click(self) -> bool:
        """Whether another object is to be clicked, to compare with."""
        return self._asking and self.why is not None

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Compare with the clicked instance, if the panel waits for one."""
        if not self._asking or self.why is None:
            return False
        self._ask(False)
        instance = self._page.simap.at(x_m, y_m)
        if instance is None or instance.id == self.why.instance.id:
            self._apart.content = remark_html("That is not another object. Nothing compared.")
        else:
            self.compare(instance.id)
        return True

    def told(self, event: Mapping[str, Any]) -> None:
        """Outline both parts of the step that the pointer is on, by its number; 0: of the chosen one again."""
        number = event.get("number")
        if event.get("type") == "step" and isinstance(number, int):
            self._page.worker.submit("why pointed", lambda: self._point_to(number))

    def compare(self, other_id: int) -> None:
        """Describe what keeps the explained instance and another apart."""
        self._apart.content = working_html("Comparing")
        self._page.worker.submit("compare", lambda: self._compare_now(other_id))

    def _forget(self, instance_id: int | None) -> None:
        """Take away what was said of the object before, which does not hold for this one, until it is explained."""
        self._folder.visible = instance_id is not None
        self._lines_legend.content = self._color_legend.content = ""
        self._apart_of, self._near.options = {}, (ASK,)
        self._apart.content = working_html("Explaining")
        self._step.visible = self._rows.visible = self._step_text.visible = False
        self._views.hide()

    def _explain(self, simap: SIMap, instance_id: int | None) -> None:
        """Show why an instance is one object, here and in short on the panel about the instance."""
        try:
            self._asking, self._between, self._joint, self._pointed = False, None, None, None
            # What no cell shows has no communities that were joined.
            on_top = any(one.id == instance_id for one in simap.instances)
            self._simap, self.why = simap, explain(simap, instance_id) if instance_id is not None and on_top else None
            why = self.why
            self._folder.visible = why is not None
            if why is not None:
                self._fill(simap, why)
            self._draw()
            edits = () if instance_id is None else edits_of(simap, instance_id)
            summary = None if why is None else summary_html(why, by_hand=bool(edits))
            self._page.panels[InstancePanel].explain(summary, edits)
        finally:
            self._page.repaint()

    def _add_drawing(self, gui: viser.GuiApi) -> None:
        self._lines = gui.add_checkbox(
            "Draw joints", True, hint="Draw the weakest joint inside, and the links to neighbours with their numbers."
        )
        self._lines_legend = gui.add_html("")
        self._color = gui.add_checkbox(
            "Colour by evidence", False, hint="Colour the object's cells by how sure the map is that they belong."
        )
        self._color_legend = gui.add_html("", visible=False)
        for box in (self._lines, self._color):
            box.on_update(lambda _: self._page.worker.submit("why marks", self._toggled))

    def _add_neighbours(self, gui: viser.GuiApi) -> None:
        self._apart_of: dict[str, int] = {}
        self._near = gui.add_button_group("Apart from", (ASK,), hint=APART_HINT)
        self._near.on_click(lambda event: self._chose_neighbour(str(event.target.value)))
        self._apart = gui.add_html("")
        self._views = FrameGallery(self._page)

    def _add_steps(self, gui: viser.GuiApi) -> None:
        self._step = gui.add_slider(
            "Merge step", 0, 1, 1, 0, hint="The merge steps that made the object, in order; 0 shows none."
        )
        by_person(self._step, lambda: self._choose_step(int(self._step.value)))
        self._rows = gui.add_button_group("Steps", ("-",))
        self._rows.on_click(lambda event: self._choose_row(str(event.target.value)))
        self._step_text = gui.add_html("")

    def _fill(self, simap: SIMap, why: Why) -> None:
        words = words_html(simap)
        if self._words.content != words:  # sent again, it would be folded up
            self._words.content = words
        self._lines_legend.content = lines_legend(simap, why)
        self._color_legend.content = sureness_legend(why)
        self._color_legend.visible = bool(self._color.value)
        names = {
            f"{link.other.name} · {link_text(why, link)}": link.other.id for link in why.neighbours[:MAX_NEIGHBOURS]
        }
        self._apart_of = names
        self._near.options = (*names, ASK)
        near = "" if names else "No other object of its class is near."
        self._apart.content = remark_html(near)
        self._views.hide()
        steps = len(why.joints)
        self._step.visible = self._rows.visible = self._step_text.visible = steps > 0
        if steps:
            self._step.max = steps
            self._step.value = 0
            weakest = next(i for i, joint in enumerate(why.joints, 1) if joint is why.weakest)
            self._rows.options = _window(why, weakest)
            self._step_text.content = remark_html(_steps_words(why))

    def _choose_row(self, row: str) -> None:
        """Choose the step named at the beginning of a row; a browser may send rows that do not exist."""
        found = _ROW.match(row)
        if found is not None:
            self._choose_step(int(found[1]))

    def _choose_step(self, position: int) -> None:
        self._page.worker.submit("why step", lambda: self._show_step(position))

    def _point_to(self, number: int) -> None:
        joints = () if self.why is None else self.why.joints
        self._pointed = joints[number - 1] if 1 <= number <= len(joints) else None
        self._draw()

    def _show_step(self, position: int) -> None:
        """Show step ``position`` (from 1); 0 shows none."""
        why, simap = self.why, self._simap
        if why is None or simap is None or not 0 <= position <= len(why.joints):
            return
        if self._step.value != position:
            self._step.value = position
        self._joint = why.joints[position - 1] if position else None
        if self._joint is None:
            self._step_text.content = remark_html(_steps_words(why))
        else:
            self._rows.options = _window(why, position)
            self._step_text.content = joint_html(why, self._joint, position, self._page.recording.has_steps_of(simap))
            self._leave_neighbour()
            self._page.show_joint(self._joint)
        self._draw()

    def _leave_neighbour(self) -> None:
        """End the comparison with another object."""
        if self._between is not None:
            self._between = None
            self._apart.content = ""
            self._views.hide()
            self._page.repaint()

    def _chose_neighbour(self, name: str) -> None:
        if name in self._apart_of:
            self._ask(False)
            self.compare(self._apart_of[name])
        else:
            self._ask(name == ASK)

    def _ask(self, asking: bool) -> None:
        """Start or stop waiting for a click on another object."""
        self._asking = asking
        self._near.options = (*self._apart_of, STOP_ASKING if asking else ASK)
        self._apart.content = small_html("Now click the other object on the map.") if asking else ""

    def _compare_now(self, other_id: int) -> None:
        simap, why = self._simap, self.why
        if simap is None or why is None:
            return
        self._show_step(0)
        self._between = found = between(simap, why.instance.id, other_id)
        first, second = found.first.name, found.second.name
        self._apart.content = f'<div class="simaps-apart">{small_html(between_words(found, first, second))}</div>'
        self._draw()
        self._page.repaint()
        self._show_both(simap, found)

    def _show_both(self, simap: SIMap, found: Between) -> None:
        """Show the frames with the strongest evidence for two objects, and for one."""
        chosen = [(frame, "two") for frame in found.together.as_two[:2]]
        chosen += [(frame, "one") for frame in found.together.as_one[: 3 - len(chosen)]]
        pictures, names = [], {}
        for frame, verdict in chosen:
            name, seen = str(frame.frame), self._page.view(frame.frame)
            if seen is not None:
                pictures.append(named(outlined(*seen, frame.first, frame.second), f"frame {name} as {verdict}"))
            names[name] = frame.frame
        if self._between is found:
            self._views.show(pictures, names)

    def _toggled(self) -> None:
        self._color_legend.visible = bool(self._color.value)
        self._lines_legend.visible = bool(self._lines.value)
        self._draw()
        self._page.repaint()

    def _draw(self) -> None:
        simap, why, found = self._simap, self.why, self._between
        if simap is None or why is None:
            self._marks.draw(None)
            return
        other = None if found is None else found.second.id
        link = None if found is None else found.link
        z_m = why.instance.aabb_m[1][2] + FLOOR_M if self._page.viewpoints.name == SLANT else FLOOR_M
        self._marks.draw(Marks(simap, why, bool(self._lines.value), self._pointed or self._joint, other, link), z_m)


def _steps_words(why: Why) -> str:
    steps = plural(len(why.joints), "merge step")
    return f"Made in {steps}. Each: the two parts that became one, and how sure that was. Point at one or tap it."


def _window(why: Why, position: int) -> tuple[str, ...]:
    """Return the rows of the table around a step (from 1)."""
    first = min(max(position - ROWS // 2, 1), max(len(why.joints) - ROWS + 1, 1))
    return tuple(joint_name(why, i) for i in range(first, min(first + ROWS, len(why.joints) + 1)))
