"""Which map stands on one side of a comparison: a choice, with the settings it needs."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import viser

from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.mapping.simap import JOINING, joining_percent
from simaps_viz.structures import SIMap
from simaps_viz.viewer.desk import Desk
from simaps_viz.viewer.panels.compare_services import CompareServices, Named
from simaps_viz.viewer.panels.map import DEFAULT_RESOLUTION, joining_words

THIS, SETTINGS = "This map", "This map, other settings"


@dataclass(frozen=True, eq=False)
class SideState:
    """What was chosen on one side."""

    title: str
    percent: float
    resolution: float
    files: Mapping[str, SIMap]


class SideChooser:
    """A drop-down list, and sliders for other settings."""

    def __init__(
        self,
        gui: viser.GuiApi,
        name: str,
        services: CompareServices,
        desk: Desk,
        changed: Callable[[], None],
        *,
        first: str,
    ) -> None:
        """Fill the open container.

        Args:
            gui: where the widgets go.
            name: "Left" or "Right".
            services: what makes maps.
            desk: the page.
            changed: told when another map was chosen.
            first: key of the choice to begin with.
        """
        self._services, self._desk, self._changed = services, desk, changed
        self._keys = {THIS: "map"}
        if services.rejoin is not None and desk.simap.method in JOINING:
            self._keys[SETTINGS] = "settings"
        self._keys |= {source.title: source.key for source in services.sources}
        at_first = next((title for title, key in self._keys.items() if key == first), THIS)
        self._files: dict[str, SIMap] = {}
        joining = joining_words(desk.simap)
        self._word = joining.word
        hint = f"Which map stands on the {name.lower()}."
        self._which = gui.add_dropdown(name, tuple(self._keys), initial_value=at_first, hint=hint)
        self._percent = gui.add_slider(
            f"{name} {joining.title}", 0.0, 100.0, 0.5, joining_percent(desk.simap), hint=joining.hint
        )
        self._resolution = gui.add_slider(
            f"{name} resolution", 0.05, 5.0, 0.05, self._resolution_of(desk.simap), hint="Louvain resolution."
        )
        self._which.on_update(lambda event: self._chose() if event.client_id is not None else None)
        for slider in (self._percent, self._resolution):
            slider.on_update(lambda event: changed() if event.client_id is not None else None)
        self._show_settings()

    @property
    def key(self) -> str:
        """What is chosen: map, settings, the key of a source, or the name of a file."""
        return self._keys[str(self._which.value)]

    def map(self, simap: SIMap, tell: Progress, cancel: threading.Event) -> Named:
        """Give the chosen map and what it is called; may take long.

        Raises:
            InputError: the map cannot be made.
        """
        key = self.key
        if key == "map":
            return f"This map ({simap.method})", simap
        if key in self._files:
            return key, self._files[key]
        if key == "settings" and self._services.rejoin is not None:
            percent, resolution = float(self._percent.value), float(self._resolution.value)
            title = f"{self._word} {percent:g} %, resolution {resolution:g}"
            return title[0].upper() + title[1:], self._services.rejoin(simap, percent, resolution)
        if self._services.make is None:
            raise InputError(f"comparison: expected a service that makes {self._which.value}, found none")
        return str(self._which.value), self._services.make(key, simap, tell, cancel)

    def add_file(self, name: str, simap: SIMap, *, choose: bool) -> None:
        """Let the map of a file be chosen, and perhaps choose it."""
        self._files[name] = simap
        self._keys[name] = name
        chosen = name if choose else str(self._which.value)
        self._which.options = tuple(self._keys)
        self._which.value = chosen
        self._show_settings()

    def state(self) -> SideState:
        """Give what is chosen, with the files that were read."""
        return SideState(str(self._which.value), float(self._percent.value), float(self._resolution.value), self._files)

    def restore(self, state: SideState) -> None:
        """Choose it again, without a word to anyone."""
        for name, simap in state.files.items():
            self.add_file(name, simap, choose=False)
        if state.title in self._keys:
            self._which.value = state.title
        self._percent.value, self._resolution.value = state.percent, state.resolution
        self._show_settings()

    def _chose(self) -> None:
        self._show_settings()
        self._changed()

    def _show_settings(self) -> None:
        self._percent.visible = self._resolution.visible = self.key == "settings"

    def _resolution_of(self, simap: SIMap) -> float:
        return min(max(float(simap.parameters.get("resolution", DEFAULT_RESOLUTION)), 0.05), 5.0)
