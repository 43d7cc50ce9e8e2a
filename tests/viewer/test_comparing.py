"""A comparison whose page changes between light and dark while it is painted, ended, or replaced by another."""

import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from stub_page import StubPage
from toy_maps import toy_map
from toy_surfaces import toy_with_surface

from simaps_viz.drawing.compare_picture import TwoPictures
from simaps_viz.drawing.theme import DARK, LIGHT, Theme
from simaps_viz.evaluation.space import score_space, truth_of_map
from simaps_viz.evaluation.two_maps import TRUTH, Source
from simaps_viz.mapping.in_space import space_points
from simaps_viz.mapping.simap import repartition
from simaps_viz.viewer.page.page import Cut
from simaps_viz.viewer.panels import compare
from simaps_viz.viewer.panels.compare import ComparePanel

PATIENCE_S = 60.0


class Desk(StubPage):
    """A page whose theme may change."""

    now: Theme = LIGHT

    @property
    def theme(self) -> Theme:
        return self.now


class Painter:
    """In the place of `TwoPictures`: once, where that is asked for, something happens while it paints."""

    def __init__(self) -> None:
        self.meanwhile: list[Any] = []

    def __call__(self, maps: Any, theme: Theme) -> TwoPictures:
        if self.meanwhile:
            self.meanwhile.pop()()
        return TwoPictures(maps, theme)


@pytest.fixture
def painter(monkeypatch) -> Painter:
    painter = Painter()
    monkeypatch.setattr(compare, "TwoPictures", painter)
    return painter


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk(toy_map())
    try:
        yield desk
        assert desk.errors == []
    finally:
        desk.close()


@pytest.fixture
def panel(desk, painter) -> Iterator[ComparePanel]:
    maker: Any = SimpleNamespace(
        sources=lambda simap: (Source("joined", "All joined"),),
        make=lambda key, simap, tell: repartition(simap, k_percent=0.0),
    )
    panel = ComparePanel(desk, maker)
    yield panel
    panel.close()


def test_a_map_whose_slider_was_moved_says_so(panel, desk):
    assert panel._sides[0].map(desk.simap, print)[0] == f"This map ({desk.simap.method})"
    desk.cut = Cut(14.0, desk.cut.resolution)
    assert panel._sides[0].map(desk.simap, print)[0].endswith(" 14 %)")


def compares(panel, desk) -> None:
    panel.start()
    assert panel._worker.wait_idle() and desk.wait_idle()


def test_a_comparison_says_how_far_the_maps_are_that_have_to_be_made_for_it(desk, painter):
    said = []

    def made(key, simap, tell):
        for frame in (1, 2):
            tell("making the true map of the exact ids", frame, 2)
            said.append((panel._status.content, panel._progress.value, panel._progress.visible))
        return repartition(simap, k_percent=0.0)

    maker: Any = SimpleNamespace(sources=lambda simap: (Source("joined", "All joined"),), make=made)
    panel = ComparePanel(desk, maker)
    compares(panel, desk)
    assert [(share, shown) for _, share, shown in said] == [(50.0, True), (100.0, True)]
    assert "Making the true map of the exact ids: frame 1 of 2." in said[0][0]
    assert panel._status.content == "" and not panel._progress.visible
    panel.close()


def test_differences_are_shown_before_the_frames_are_read_for_the_scores_in_space(painter):
    desk, seen = Desk(toy_with_surface()), []

    def scores(simap, tell):
        tell("finding the true objects in space", 1, 2)
        assert not panel._progress.visible  # it was at its end once, and does not begin anew
        seen.append((panel.active, str(panel._headline.content), str(panel._status.content)))
        return score_space(space_points(simap), simap.grid.labels, truth_of_map(simap))

    maker: Any = SimpleNamespace(
        sources=lambda simap: (Source(TRUTH, "Ground truth"),),
        make=lambda key, simap, tell: toy_map(),  # which knows no surface, as the truth does not
        scores_in_space=scores,
    )
    panel = ComparePanel(desk, maker)
    compares(panel, desk)
    ((shown, before, status),) = seen
    assert shown and "<b>PQ " in before and "In space" not in before and "frame 1 of 2" in status
    assert "In space: PQ 1.00" in panel._headline.content
    assert panel._status.content == "" and not panel._progress.visible
    panel.close()
    desk.close()


def test_a_comparison_that_ends_while_it_is_painted_anew_is_over(panel, desk, painter):
    compares(panel, desk)
    assert panel.active and desk.pictures[-1] is not None
    desk.now = DARK
    painter.meanwhile.append(panel.stop)
    panel.theme_changed()
    assert desk.wait_idle()
    assert not panel.active and desk.pictures[-1] is None and panel._pictures is None
    desk.submit("compare picture", panel._draw)
    assert desk.wait_idle() and desk.pictures[-1] is None


def test_pictures_are_of_the_maps_that_are_compared(panel, desk, painter):
    compares(panel, desk)
    first = panel.maps

    def replaced() -> None:
        desk.publish(repartition(toy_map(), k_percent=30.0))
        panel.start()
        assert panel._worker.wait_idle(PATIENCE_S)

    desk.now = DARK
    painter.meanwhile.append(replaced)
    panel.theme_changed()
    assert desk.wait_idle()
    assert panel.active and panel.maps is not first
    assert panel._pictures is not None and panel._pictures._maps is panel.maps
    assert panel._pictures._theme is DARK


def test_side_by_side_a_click_on_the_right_map_is_on_its_own_place(panel, desk) -> None:
    compares(panel, desk)
    panel._how.value = "Side by side"
    desk.submit("compare picture", panel._draw)
    assert desk.wait_idle()
    maps, picture = panel.maps, desk.pictures[-1]
    assert maps is not None and picture is not None
    east_m = TwoPictures(maps).shift_m("side by side")[0]
    assert picture.spec.cols > 2 * maps.spec.cols and picture.spec.x0_m == maps.spec.x0_m
    x, y = desk.simap.by_id(3).centroid_m[:2]
    assert panel.take_click(x + east_m, y) and panel._chosen == maps.items[0]
    assert panel.take_click(2.0 + east_m, -0.5) and panel._chosen is None  # on its floor


def test_a_comparison_given_up_while_it_is_painted_is_not_shown(panel, desk, painter):
    painter.meanwhile.append(panel.stop)
    compares(panel, desk)
    assert not panel.active and desk.pictures[-1] is None


def test_a_page_that_turns_dark_while_a_comparison_is_made_has_a_dark_one(panel, desk, painter):
    def turns_dark() -> None:
        desk.now = DARK
        panel.theme_changed()

    painter.meanwhile.append(turns_dark)
    compares(panel, desk)
    assert panel.active and panel._pictures is not None and panel._pictures._theme is DARK


def test_who_ends_a_comparison_as_it_appears_has_ended_it(panel, desk, monkeypatch):
    stopping = threading.Thread(target=panel.stop)
    narrow = panel._narrow

    def ended_meanwhile() -> None:
        stopping.start()
        stopping.join(0.2)  # it waits until all of the comparison is there
        narrow()

    monkeypatch.setattr(panel, "_narrow", ended_meanwhile)
    compares(panel, desk)
    stopping.join(PATIENCE_S)
    assert desk.wait_idle()
    assert not panel.active and desk.pictures[-1] is None
    assert desk.looked[-1] == desk.simap.spec.extent_m, "the camera is where it was before"
