"""Keys of the page, its help, and the switch between light and dark."""

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib.resources import files

from viser._gui_handles import CommandHandle, GuiModalHandle

from simaps_viz.drawing.legend import not_counted, object_names
from simaps_viz.drawing.theme import BRAND, DARK, DIM_STYLE, LIGHT, Theme, note_html
from simaps_viz.mapping.in_space import all_instances
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, button, button_row
from simaps_viz.viewer.page.shared import Snapshot
from simaps_viz.viewer.panels.build import BuildPanel
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.map import doubtful_on, show_only
from simaps_viz.viewer.scene.camera import SLANT, TOP
from simaps_viz.viewer.server.viser_page import PAGE_SCRIPT

MEND = "Mend"
_TEXTS = json.loads(files(__name__.rpartition(".")[0]).joinpath("help.json").read_text("utf-8"))
BOX_KEYS, MEND_KEYS, MOUSE, TABS, WORDS = (
    [(str(left), str(right)) for left, right in _TEXTS[name]]
    for name in ("box_keys", "mend_keys", "mouse", "tabs", "words")
)
"""(key, mouse action, tab or word; what it does or means).

MEND_KEYS are for pages where the map can be mended, TABS those that our own panels have; others bring their words.
"""
GRID_STYLE = "display:grid;grid-template-columns:max-content 1fr;gap:.1em 1em;font-size:.95em;line-height:1.45"


def help_html(keys: Sequence[tuple[str, str]], tabs: Sequence[tuple[str, str]] = TABS) -> str:
    """Write the help.

    Args:
        keys: (key, what it does).
        tabs: (tab, what it is for).
    """
    parts = (("On the map", MOUSE), ("Tabs", tabs), ("Keys", keys), ("Words", WORDS))
    about = f'<div style="max-width:60ch">{escape(_TEXTS["about"])}</div>'
    return about + "".join(
        f'<div class="simaps-{title.split()[-1].lower()}">'
        f'<div style="font-weight:650;margin:.6em 0 .2em">{escape(title)}</div>'
        f'<div style="{GRID_STYLE}">'
        + "".join(_row(left, right, key=title == "Keys") for left, right in rows)
        + "</div></div>"
        for title, rows in parts
    )


def _row(left: str, right: str, *, key: bool) -> str:
    tag, first = "kbd" if key else "span", f' class="simaps-{left.lower()}"' * (left == "Fingers")
    frame = (
        "border:1px solid currentColor;border-radius:4px;padding:0 .45em;font-size:.95em" if key else "font-weight:550"
    )
    return (
        f'<div{first}><{tag} style="{frame}">{escape(left)}</{tag}></div>'
        f'<div{first} style="{DIM_STYLE}">{escape(right)}</div>'
    )


VISITING = "You are visiting: look, ask and simulate as you like. Nothing can be changed from this page."
HELP, LIGHT_DARK = "Help", "Light / dark"
MAX_OBJECTS = 300
"""Objects that Ctrl-K lists, the largest; the box Find finds them all."""


class HelpPanel(Panel):
    """Two buttons above all tabs, and the keys of the page."""

    def __init__(self, page: Page) -> None:
        """Fill the open container, and listen to keys."""
        self._page = page
        self._gui = gui = page.gui
        self.theme: Theme = LIGHT
        """The theme of the page, light or dark."""
        self._modal: GuiModalHandle | None = None
        gui.add_html(PAGE_SCRIPT)
        hint = "Keys, mouse, tabs and words; a light or a dark page."
        button_row(gui, "Page", {HELP: self.show, LIGHT_DARK: self.switch}, hint=hint)
        self._keys = self._make_keys()
        for code, _, text, do in self._keys:
            # viser's type knows fewer keys than the page does: the brackets pass all the same.
            command = gui.add_command(text[0].upper() + text[1:], hotkey=code)  # pyright: ignore[reportArgumentType]
            command.on_trigger(lambda _, do=do: do())
        self._found: dict[str, dict[tuple[str, str], CommandHandle]] = {}
        self._objects: tuple[SIMap, frozenset[int]] | None = None
        """The map whose objects Ctrl-K finds, and the doubtful ones."""

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """Have Ctrl-K find the map's objects, the doubtful called so, once the map is seen."""
        now = simap, doubtful_on(self._page)
        if not snapshot.badge and now != self._objects:
            self._objects = now
            self._page.worker.submit("commands", self._offer_objects, later=True)

    def _offer_objects(self) -> None:
        if self._objects is not None:
            simap, doubtful = self._objects
            names = object_names(simap, MAX_OBJECTS, not_counted(simap, doubtful))
            self._offer(
                "object", {(name, "Object"): functools.partial(self._go_to, one) for name, one in names.items()}
            )

    def panels_changed(self) -> None:
        """Have Ctrl-K find the settings of all tabs."""
        found: dict[tuple[str, str], Callable[[], None]] = {}

        def add(panel: Panel) -> None:
            title = panel.spec.title
            for one in panel.inputs:
                where = f"Setting of the tab {title}" if panel.spec.place != "head" else "Setting"
                found[one.label, where] = functools.partial(self._page.reveal, title, focus=one.label)

        self._page.panels.each(add)
        self._offer("setting", found)

    built = panels_changed

    def _offer(self, kind: str, found: Mapping[tuple[str, str], Callable[[], None]]) -> None:
        """List commands of a kind, {(label, description): what it does}, instead of those listed before."""
        offered = self._found.setdefault(kind, {})
        with self._page.client.atomic():
            for gone in offered.keys() - found.keys():
                offered.pop(gone).remove()
            for new in [one for one in found if one not in offered]:
                command = offered[new] = self._gui.add_command(new[0], description=new[1])
                command.on_trigger(lambda _, do=found[new]: do())

    def _go_to(self, number: int) -> None:
        found = [one for one in all_instances(self._page.simap) if one.id == number]
        if found:
            self._page.go_to(found[0])

    @property
    def keys(self) -> Sequence[tuple[str, str]]:
        """The (key, what it does) pairs that the help lists."""
        own = [(shown, text) for _, shown, text, _ in self._keys]
        return (*own, *BOX_KEYS, *(MEND_KEYS if MEND in self._page.panels.titles else ()))

    @property
    def tabs(self) -> Sequence[tuple[str, str]]:
        """The (tab, what it is for) pairs of the tabs that the page has."""
        panels = self._page.panels
        about = (*TABS, *((spec.title, spec.about) for spec in panels.specs if spec.about))
        return tuple((title, text) for title, text in about if title in panels.titles)

    def switch(self) -> None:
        """Go from light to dark, or back."""
        self.theme = LIGHT if self.theme.dark else DARK
        self._gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=BRAND, dark_mode=self.theme.dark
        )
        self._page.set_theme(self.theme)

    def show(self) -> None:
        """Open the help, or close it."""
        if self._modal is not None:
            self.hide()
            return
        modal = self._modal = self._gui.add_modal("How to use this page")
        with modal:
            if not self._page.may("edit"):
                self._gui.add_html(note_html(VISITING))
            self._gui.add_html(help_html(self.keys, self.tabs))
            button(self._gui, "Close", self.hide, color="gray")

    def hide(self) -> None:
        """Close the help."""
        modal, self._modal = self._modal, None
        if modal is not None:
            modal.close()

    def state(self) -> bool | None:
        """Return whether the page is dark, for a page that is loaded again."""
        return self.theme.dark or None

    def restore(self, state: bool) -> None:
        """Restore the theme."""
        if state != self.theme.dark:
            self.switch()

    def _play(self) -> None:
        self._page.panels[BuildPanel].toggle()

    def _escape(self) -> None:
        if self._modal is not None:
            self.hide()
        else:
            self._page.select(None)
            if CommandPanel in self._page.panels:
                self._page.panels[CommandPanel].escape()
            show_only(self._page, None)

    def _make_keys(self) -> tuple[tuple[str, str, str, Callable[[], None]], ...]:
        """Return the keys: the name in viser, its label, what it does in words, and the function."""
        page = self._page
        return (
            ("space", "Space", "play the build, or stop", self._play),
            ("[", "[", "one frame back", lambda: page.show_frame(page.frame - 1)),
            ("]", "]", "one frame on", lambda: page.show_frame(page.frame + 1)),
            ("T", "T", "view from the top", lambda: page.look(TOP)),
            ("3", "3", "3-D view", lambda: page.look(SLANT)),
            (
                "escape",
                "Esc",
                "leave a box, or close the help; else select nothing, show all classes, and no path",
                self._escape,
            ),
            ("L", "L", "light or dark page", self.switch),
            ("H", "H or ?", "this help", self.show),
        )
