"""The panels of a page that are not on every page; one that fails holds up none of the others."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from simaps_viz.structures import SIMap
from simaps_viz.viewer.desk import Desk, Panel
from simaps_viz.viewer.panels.spec import PanelSpec


@dataclass(frozen=True, eq=False)
class _Made:
    spec: PanelSpec
    panel: Panel
    tab: Any


class ExtraPanels:
    """Made from specs, told what happens on the page, and exchanged when the page's map is done."""

    def __init__(self, desk: Desk, specs: Sequence[PanelSpec]) -> None:
        """Take the page and what it shall have; ``place`` makes them."""
        self._desk = desk
        self._groups: dict[str, Any] = {}
        self.specs = specs
        """What the panels were made of."""
        self._made: list[_Made] = []

    def __iter__(self) -> Iterator[tuple[str, Panel]]:
        return iter([(one.spec.title, one.panel) for one in self._made])

    def place(self, place: str, group: Any) -> None:
        """Make the panels that belong in a group of tabs."""
        self._groups[place] = group
        self._add([spec for spec in self.specs if spec.place == place])

    def renew(self, specs: Sequence[PanelSpec]) -> None:
        """Have these instead; those that were there already stay as they are."""
        self.specs = specs
        for one in [one for one in self._made if one.spec not in specs]:
            self._made.remove(one)
            self._guarded(one.panel.close)
            one.tab.remove()
        there = [one.spec for one in self._made]
        self._add([spec for spec in specs if spec not in there])

    def map_changed(self, simap: SIMap) -> None:
        """Another map is shown."""
        for _, panel in self:
            self._guarded(lambda panel=panel: panel.map_changed(simap))

    def selection_changed(self, instance_id: int | None) -> None:
        """Another object is selected, or none."""
        for _, panel in self:
            self._guarded(lambda panel=panel: panel.selection_changed(instance_id))

    def show_frame(self, frame: int) -> None:
        """Another frame is shown."""
        for _, panel in self:
            self._guarded(lambda panel=panel: panel.show_frame(frame))

    def theme_changed(self) -> None:
        """The page went from light to dark, or back."""
        for _, panel in self:
            self._guarded(panel.theme_changed)

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Offer a click on the map to the panels that may wait for one."""
        return any(panel.take_click(x_m, y_m) for _, panel in self)

    def states(self) -> dict[str, Any]:
        """Give what was done on each panel."""
        found: dict[str, Any] = {}
        for title, panel in self:
            self._guarded(lambda title=title, panel=panel: found.update({title: panel.state()}))
        return found

    def restore(self, states: Mapping[str, Any]) -> None:
        """Hand the panels what ``states`` gave."""
        for title, panel in self:
            if states.get(title) is not None:
                self._guarded(lambda title=title, panel=panel: panel.restore(states[title]))

    def close(self) -> None:
        """The person has gone."""
        for _, panel in self:
            self._guarded(panel.close)

    def _add(self, specs: Sequence[PanelSpec]) -> None:
        """Make panels in tabs of their own; one that fails is missing, and its error is told."""
        for spec in specs:
            tab = self._groups[spec.place].add_tab(spec.title, spec.icon)
            try:
                with tab:
                    self._made.append(_Made(spec, spec.make(self._desk), tab))
            except Exception as error:
                self._desk.report(error)

    def _guarded(self, do: Callable[[], object]) -> None:
        try:
            do()
        except Exception as error:
            self._desk.report(error)
