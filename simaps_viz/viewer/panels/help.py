"""Keys of the page, its help, and the switch between light and dark."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import viser
from viser._gui_handles import GuiModalHandle

from simaps_viz.drawing.theme import BRAND, DARK, DIM_STYLE, LIGHT, Theme
from simaps_viz.viewer.scene.camera import SLANT, TOP
from simaps_viz.viewer.server.viser_page import PAGE_SCRIPT

MEND = "Mend"
BOX_KEYS = (
    ("/", "to the command box"),
    ("F", "to the box that finds objects"),
    ("Ctrl K", "all commands, to search"),
)
MEND_KEYS = (
    ("J", "join the selected object with another"),
    ("X", "cut it in two"),
    ("Delete", "delete it"),
    ("Ctrl Z", "undo the last edit; with Shift, redo it"),
)
"""On pages where the map can be mended."""
MOUSE = (
    ("Click", "select the object; on open floor, select nothing"),
    ("Drag", "turn the view"),
    ("Right drag", "move the view"),
    ("Wheel", "come closer, go back"),
)
TABS = (
    ("Map", "how the map is cut into objects, what its colours mean, top or 3-D view"),
    ("Command", "tell the robot where to go, in plain English, and watch it drive"),
    ("Build", "go back in time, frame by frame, or merge by merge; the map shows what it was then"),
    ("Judge", "judge recorded runs blind, where there are any: keys Y, N and S"),
    ("Instance", "find an object; the selected one: where it is, how it looked, why it is one"),
)
OTHER_TABS = {
    "Compare": "this map beside another: of another method, other parameters, or the truth",
    "Masks": "what the network saw on a frame, and what other thresholds would make of it",
    "Share": "one file of map and build that opens without a server; pictures and films",
    "Recordings": "recorded builds at hand: show one beside the map, rename, delete",
    MEND: "put the map right by hand: join, cut in two, rename, delete, undo",
    "Progress": "how far the build is; stop it, and go on with it",
}
"""Of the panels that a page may have."""
WORDS = (
    ("Instance", "one object on the map: this chair, not chairs"),
    ("Class", "what kind of thing it is: chair, dining table"),
    ("Cell", "a small square of the floor; the map is a grid of them"),
    ("Frame", "one picture of the camera, with depth and the place it was taken from"),
    ("Mask", "the pixels of one object in one frame"),
    ("Community", "cells that frames kept seeing in the same mask; objects are joined from them"),
    ("Evidence (%)", "the share of what frames saw of two parts that says they are one; parts above it are joined"),
    ("K (%)", "a community joins another while more than K % of its cells neighbour it"),
    ("Resolution", "the higher, the smaller the communities"),
)
GRID_STYLE = "display:grid;grid-template-columns:max-content 1fr;gap:.1em 1em;font-size:.95em;line-height:1.45"


def help_html(keys: Sequence[tuple[str, str]], *, others: Sequence[tuple[str, str]] = ()) -> str:
    """Write the help.

    Args:
        keys: (key, what it does).
        others: (tab, what it is for) of tabs that are not on every page.
    """
    parts = (("Keys", keys), ("Mouse, on the map", MOUSE), ("Tabs", (*TABS, *others)), ("Words", WORDS))
    return "".join(
        f'<div style="font-weight:650;margin:.6em 0 .2em">{escape(title)}</div>'
        f'<div style="{GRID_STYLE}">'
        + "".join(_row(left, right, key=title == "Keys") for left, right in rows)
        + "</div>"
        for title, rows in parts
    )


def _row(left: str, right: str, *, key: bool) -> str:
    tag = "kbd" if key else "span"
    frame = (
        "border:1px solid currentColor;border-radius:4px;padding:0 .45em;font-size:.95em" if key else "font-weight:550"
    )
    return f'<div><{tag} style="{frame}">{escape(left)}</{tag}></div><div style="{DIM_STYLE}">{escape(right)}</div>'


HELP, LIGHT_DARK = "Help", "Light / dark"


@dataclass(frozen=True)
class PageActions:
    """What the keys do; none of these may take long."""

    play: Callable[[], None]
    """Play the build, or stop."""
    step: Callable[[int], None]
    """So many frames on."""
    clear: Callable[[], None]
    """Select nothing."""
    look: Callable[[str], None]
    """TOP or SLANT."""
    set_theme: Callable[[Theme], None]
    """Colour the map for a light or a dark page."""


@dataclass(frozen=True)
class Key:
    """A key, as viser calls it and as people do."""

    code: str
    shown: str
    text: str
    do: Callable[[], None]


class HelpPanel:
    """Two buttons, always in sight, and the keys."""

    def __init__(
        self, gui: viser.GuiApi, actions: PageActions, *, other_tabs: Sequence[tuple[str, str]] = (), dark: bool = False
    ) -> None:
        """Fill the current container, and listen to keys.

        Args:
            gui: one person's.
            actions: what keys do.
            other_tabs: (title, what it is for) of tabs beyond those of every page.
            dark: how the page begins.
        """
        self._gui, self._actions, self._other_tabs = gui, actions, other_tabs
        self._theme = LIGHT
        self._modal: GuiModalHandle | None = None
        gui.add_html(PAGE_SCRIPT)
        hint = "Help: keys, mouse, tabs and words (key H). Light or dark page (key L)."
        buttons = gui.add_button_group("Page", (HELP, LIGHT_DARK), hint=hint)
        buttons.on_click(lambda event: self.show() if event.target.value == HELP else self.switch())
        self._keys = self._make_keys()
        for key in self._keys:
            self._listen(key)
        if dark:
            self.switch()

    @property
    def theme(self) -> Theme:
        """Light or dark."""
        return self._theme

    @property
    def keys(self) -> Sequence[tuple[str, str]]:
        """(key, what it does), as the help lists them."""
        own = [(key.shown, key.text) for key in self._keys]
        return (*own, *BOX_KEYS, *(MEND_KEYS if MEND in dict(self._other_tabs) else ()))

    def switch(self) -> None:
        """Go from light to dark, or back."""
        self._theme = LIGHT if self._theme.dark else DARK
        self._gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=BRAND, dark_mode=self._theme.dark
        )
        self._actions.set_theme(self._theme)

    def show(self) -> None:
        """Open the help, or close it."""
        if self._modal is not None:
            self.hide()
            return
        modal = self._modal = self._gui.add_modal("How to use this page")
        with modal:
            self._gui.add_html(help_html(self.keys, others=self._other_tabs))
            self._gui.add_button("Close", color="gray").on_click(lambda _: self.hide())

    def hide(self) -> None:
        """Close the help."""
        modal, self._modal = self._modal, None
        if modal is not None:
            modal.close()

    def _escape(self) -> None:
        if self._modal is not None:
            self.hide()
        else:
            self._actions.clear()

    def _make_keys(self) -> tuple[Key, ...]:
        do = self._actions
        return (
            Key("space", "Space", "play the build, or stop", do.play),
            Key("[", "[", "one frame back", lambda: do.step(-1)),
            Key("]", "]", "one frame on", lambda: do.step(1)),
            Key("T", "T", "view from the top", lambda: do.look(TOP)),
            Key("3", "3", "3-D view", lambda: do.look(SLANT)),
            Key("escape", "Esc", "close the help; else select nothing", self._escape),
            Key("L", "L", "light or dark page", self.switch),
            Key("H", "H or ?", "this help", self.show),
        )

    def _listen(self, key: Key) -> None:
        # viser's type knows fewer keys than the page does: the brackets pass all the same.
        title = key.text[0].upper() + key.text[1:]
        command = self._gui.add_command(title, hotkey=key.code)  # pyright: ignore[reportArgumentType]
        command.on_trigger(lambda _: key.do())
