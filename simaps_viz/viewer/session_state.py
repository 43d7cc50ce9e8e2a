"""What a person did on a page, so that loading it again loses nothing."""

import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simaps_viz.structures import SIMap
from simaps_viz.viewer.drawing.texture import ColorMode
from simaps_viz.viewer.drawing.viewpoints import CameraState
from simaps_viz.viewer.driving.robot import RobotState
from simaps_viz.viewer.panels.map import TOP

if TYPE_CHECKING:
    from simaps_viz.viewer.session import Session


@dataclass(frozen=True, eq=False)
class TabState:
    """A page as it was left."""

    published: "weakref.ref[SIMap]"
    """The map that was on all pages."""
    own: SIMap | None
    """The map of this page, where it was another."""
    sliders: tuple[float, float] | None
    """K or evidence in percent and resolution, where they were not as the map has them."""
    mode: ColorMode
    shown_class: str | None
    picked: tuple[float, float] | None
    """The place that was selected, map frame, metres."""
    frame: int | None
    """The frame shown; None = the last one."""
    fill_in_step: bool
    dark: bool
    camera: CameraState
    robot: RobotState
    panels: Mapping[str, Any]
    """By title, what the panels that can tell gave."""


def state_of(session: "Session") -> TabState:
    """Give what a session's person did."""
    parts, published = session.parts, session.common.published()
    return TabState(
        published=weakref.ref(published),
        own=None if session.base is published else session.base,
        sliders=(parts.map.percent, parts.map.resolution) if parts.map.touched else None,
        mode=parts.map.mode,
        shown_class=parts.map.shown_class,
        picked=session.picked,
        frame=None if parts.build.at_end else parts.build.frame,
        fill_in_step=parts.build.fill_in_step,
        dark=parts.page.theme.dark,
        camera=session.viewpoints.state(),
        robot=parts.robot.state(),
        panels=parts.others.states(),
    )


def restore_session(session: "Session", state: TabState) -> None:
    """Do on a new page what was done on the one before; a map published since then is kept."""
    parts = session.parts
    if state.own is not None and state.published() is session.common.published():
        session.take_map_now(state.own)
    parts.map.set_look(state.mode, state.shown_class)
    if state.dark:
        parts.page.switch()
    session.remember(state.picked)
    parts.build.set_fill(state.fill_in_step)
    if state.frame is not None:
        session.jump(state.frame)
    if state.camera.name != TOP:
        session.look(state.camera.name)
    session.viewpoints.go_to(state.camera)
    parts.robot.go_to(state.robot)
    if state.sliders is not None:
        parts.map.set_sliders(*state.sliders)
        session.partition(*state.sliders)
    parts.others.restore(state.panels)
