"""Keys of the page, its help, and the switch between light and dark."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import viser
from viser._gui_handles import GuiModalHandle

from simaps_viz.viewer.drawing.theme import BRAND, DARK, LIGHT, Theme
from simaps_viz.viewer.page_script import PAGE_SCRIPT
from simaps_viz.viewer.panels.help_words import BOX_KEYS, MEND, MEND_KEYS, help_html
from simaps_viz.viewer.panels.map import SLANT, TOP

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
