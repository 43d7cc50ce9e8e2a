"""One person's page, in one browser tab: what is selected, which map is shown, what it looks like."""

import functools
import logging
import secrets
import threading
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import viser
from numpy.typing import NDArray

from simaps_viz.colors.instances import take_over
from simaps_viz.drawing.solids import ray_on_blocks, ray_on_floor
from simaps_viz.drawing.texture import ColorMode, MapPicture
from simaps_viz.drawing.theme import Theme
from simaps_viz.errors import SIMapsError
from simaps_viz.mapping.edit_log import edits_of
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import joining_percent
from simaps_viz.structures import Instance, Pose2, SIMap
from simaps_viz.viewer.layout import Parts, lay_out
from simaps_viz.viewer.page.shared import Common, paint, png
from simaps_viz.viewer.page.worker import Worker
from simaps_viz.viewer.panels.instance import best_pictures
from simaps_viz.viewer.panels.map import DEFAULT_RESOLUTION
from simaps_viz.viewer.panels.robot import RobotControl, RobotState
from simaps_viz.viewer.recording.clicks import place_inside
from simaps_viz.viewer.recording.link import RecordingLink, page_side
from simaps_viz.viewer.scene.camera import SLANT, TOP, CameraState, Extent, Viewpoints
from simaps_viz.viewer.scene.map_scene import MapScene, Style
from simaps_viz.viewer.scene.why_marks import paint_cells
from simaps_viz.viewer.server.viser_hooks import guard
from simaps_viz.viewer.timeline import PageTime


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
    """Return what a session's person did."""
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


logger = logging.getLogger(__name__)

TOLD_S = 12.0
"""How long an error stays on the page."""


class Session:
    """What one browser tab shows; it ends with its connection. Implements `desk.Desk`."""

    def __init__(self, client: viser.ClientHandle, common: Common) -> None:
        """Build the page; nothing is painted before ``begin``."""
        self.client, self.common = client, common
        self.token = secrets.token_urlsafe(12)
        """Names this session in the addresses of the frames on its page."""
        self._lock = threading.RLock()
        self._begun = self._closed = False
        self._waiting_state: TabState | None = None
        self._base = self._simap = self._colored = common.published()
        self._selected: int | None = None
        self._picked: tuple[float, float] | None = None
        self._picture: MapPicture | None = None
        self.worker, self.command_worker, self.panel_worker = (Worker(self.report) for _ in range(3))
        self.time = PageTime(self)
        """Which frame, or step of joining, the page shows."""
        self.recording = RecordingLink(common.recording, self.token, page_side(self))
        guard(client, self.report)
        with client.atomic():
            self._scene = MapScene(client, self._simap, robot_radius_m=common.robot_radius_m)
            self.viewpoints = Viewpoints(client, self._scene.frame_extent)
            self.parts: Parts = lay_out(self)
        client.scene.on_click()(self._clicked)

    @property
    def gui(self) -> viser.GuiApi:
        """This page's own widgets."""
        return self.client.gui

    @property
    def scene(self) -> MapScene:
        """This page's own 3-D scene."""
        return self._scene

    @property
    def simap(self) -> SIMap:
        """The map shown now."""
        return self._simap

    @property
    def base(self) -> SIMap:
        """The map that the sliders cut into what is shown."""
        return self._base

    @property
    def theme(self) -> Theme:
        """Whether the page is light or dark."""
        return self._scene.theme

    @property
    def aspect(self) -> float:
        """Width over height of the canvas in its middle."""
        return float(self.client.camera.aspect)

    @property
    def selected(self) -> int | None:
        """Id of the selected instance."""
        return self._selected

    @property
    def picked(self) -> tuple[float, float] | None:
        """The place that was selected, map frame, metres."""
        return self._picked

    @property
    def robot(self) -> RobotControl:
        """The robot of this page."""
        return self.parts.robot

    @property
    def pose(self) -> Pose2:
        """Where the robot is."""
        return self.parts.robot.pose

    @property
    def frame(self) -> int:
        """The frame that the build panel shows."""
        return self.parts.build.frame

    def begin(self, state: TabState | None) -> None:
        """Paint the page, as its tab was left where that is known; of several calls those with a state count."""
        with self._lock:
            first, self._begun = not self._begun, True
            if self._closed or (state is None and not first):
                return
            self._waiting_state = state
        self.worker.submit("begin", self._begin_now)

    def settle(self, width_px: object = None) -> None:
        """The page, of that width, shows its panels: it may not have docked them before."""
        self.worker.submit("settle", lambda: self.parts.settle(width_px))

    def select(self, instance_id: int | None) -> None:
        """Select an instance, or none."""
        self.pick(None if instance_id is None else place_inside(self._simap, instance_id))

    def publish(self, simap: SIMap) -> None:
        """Show a changed map on every open page, and on those opened later; each page cuts it as its sliders are."""
        self.common.publish(self._cut_as_published(simap))

    def show_picture(self, picture: MapPicture | None) -> None:
        """Lay a picture in the place of the map's own colours; None takes it away."""
        self._picture = picture
        self.worker.submit("picture", self._show_picture_now)

    def set_theme(self, theme: Theme) -> None:
        """Colour the map for a light or a dark page."""
        self._scene.set_theme(theme)
        self.parts.others.theme_changed()
        self.repaint()

    def repaint(self) -> None:
        """Colour the map anew, soon."""
        self.worker.submit("map", self._paint_now)

    def submit(self, name: str, job: Callable[[], None]) -> None:
        """Do a panel's work; it never holds up the page itself."""
        self.panel_worker.submit(name, job)

    def say(self, title: str, text: str) -> None:
        """Notify this person something in passing."""
        self._notify(title, text, "blue", 6.0)

    def report(self, error: Exception) -> None:
        """Notify this person of an error; one that is not meant for people also goes to the log in full."""
        if self._closed:
            return
        if self._begun:
            self.parts.map.calm()
        known = isinstance(error, SIMapsError)
        if not known:
            logger.error("the workbench met an error", exc_info=error)
        title = "That did not work" if known else f"Unexpected error ({type(error).__name__})"
        self._notify(title, str(error), "red", TOLD_S)

    def take_map(self, simap: SIMap, *, keep_sliders: bool = False) -> None:
        """Let the sliders cut another map, and show it, soon; ``keep_sliders``: cut as this person has set them."""
        with self._lock:
            self._base = simap
        self.worker.submit("take map", lambda: self.take_map_now(simap, keep_sliders=keep_sliders))

    def take_map_now(self, simap: SIMap, *, keep_sliders: bool = False) -> None:
        """Do what ``take_map`` says, on the worker's thread."""
        with self._lock:
            kept = self.parts.map.touched and keep_sliders
            self._base = simap
            percent, resolution = self.parts.map.percent, self.parts.map.resolution
            self.parts.map.come_from(simap)
            if kept:
                self.parts.map.set_sliders(percent, resolution)
                self.partition(percent, resolution)
            else:
                self._show(simap)

    def partition(self, percent: float, resolution: float) -> None:
        """Cut the map anew."""
        self.worker.submit("partition", lambda: self._partition_now(percent, resolution))

    def pick(self, place: tuple[float, float] | None) -> None:
        """Select what is at a place of the map; the place is kept, so that it outlives a new partition."""
        with self._lock:
            found = None if place is None else self._simap.at(*place)
            self._picked = None if found is None else place
            self._show_selected(found)

    def remember(self, place: tuple[float, float] | None) -> None:
        """Select what is at a place as soon as the next map is shown."""
        self._picked = place

    def show_recording(self, path: Path) -> None:
        """Show a recorded build beside the map; of another map, its frames and clicks mean nothing here."""
        self.recording.show(path)

    def catch_up(self, common: Common) -> None:
        """The map that was being built may be done: have the panels that only a finished map has, soon."""
        known = {"services": common.services, "recorded": common.recorded, "building": common.building}
        self.common = replace(self.common, **known)
        self.worker.submit("panels", self._catch_up_now)

    def look(self, name: str) -> None:
        """Go to the top view or the slanted one."""
        upright = name == SLANT
        self._scene.stand_up(upright)
        self.parts.why.stand_up(upright)
        self.viewpoints.look(name)

    def look_at(self, extent: Extent | None) -> None:
        """Look straight down on a part of the floor; None: as before."""
        self.viewpoints.look_down(extent)

    def send(self, name: str, content: bytes) -> None:
        """Hand the browser a file of that name to save."""
        self.client.send_file_download(name, content, save_immediately=True)

    def jump(self, frame: int) -> None:
        """Show a frame, here and in the recording."""
        self.parts.build.set_frame(frame, chosen_here=True)

    def view(self, frame: int) -> tuple[NDArray, NDArray] | None:
        """Return a frame's RGB picture and segment ids; None when the sequence is not at hand."""
        return None if self.common.services.view is None else self.common.services.view(frame)

    def leave_robot(self) -> None:
        """The robot is wanted for a run to judge."""
        self.robot.leave()

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until all that was asked for is done; False when that took too long."""
        return all(w.wait_idle(timeout_s) for w in (self.command_worker, self.panel_worker, self.worker))

    def close(self, timeout_s: float = 2.0) -> TabState:
        """End all that runs, and return what a page that is loaded again needs."""
        with self._lock:
            state = self._waiting_state or state_of(self)
            self._closed = True
        self.parts.close()
        self.recording.close()
        for worker in (self.command_worker, self.panel_worker, self.worker):
            worker.stop(timeout_s)
        return state

    def _begin_now(self) -> None:
        with self._lock:
            state = self._waiting_state
        if state is not None:
            with self.client.atomic():
                restore_session(self, state)
            self._waiting_state = None
        self._map_changed()
        if self.parts.judge is not None:
            self.parts.judge.show()

    def _catch_up_now(self) -> None:
        others, wanted = self.parts.others, self.common.services.panels
        if not self._closed and others.specs is not wanted:
            with self.client.atomic():
                others.renew(wanted)
            others.show_frame(self.frame)
            self.worker.submit("recorded", self.recording.opened)  # once the finished map, and its last frame, are here

    def _partition_now(self, percent: float, resolution: float) -> None:
        base = self._base
        simap = self.common.shared.partition(base, percent, resolution)
        with self._lock:
            if base is self._base:  # not when another map has come meanwhile
                self._show(simap)

    def _show(self, simap: SIMap) -> None:
        with self._lock:
            self._simap = simap
        self.worker.submit("map changed", self._map_changed)

    def _cut_as_published(self, simap: SIMap) -> SIMap:
        """Cut a map as the published one is, so that what one person cuts does not become everybody's."""
        published = self.common.published()
        slider = method_of(simap.method).slider
        if slider is None or simap.method != published.method or simap.spec != published.spec:
            return simap
        if all(
            simap.parameters.get(name) == published.parameters.get(name) for name in (slider.parameter, "resolution")
        ):
            return simap
        resolution = float(published.parameters.get("resolution", DEFAULT_RESOLUTION))
        return self.common.shared.partition(simap, joining_percent(published), resolution)

    def _map_changed(self) -> None:
        simap = self._simap
        take_over(simap, self._colored)
        self._colored = simap
        if self._scene.fit(simap):
            self.viewpoints.show_extent(self._scene.frame_extent)
        self.parts.map_changed(simap)
        self.parts.steps.withdraw()
        self.panel_worker.submit("steps", functools.partial(self._offer_steps, simap))
        with self._lock:
            self._show_selected(None if self._picked is None else simap.at(*self._picked))

    def _offer_steps(self, simap: SIMap) -> None:
        timeline = self.common.shared.timeline(simap)
        if timeline.last and simap is self._simap:  # finding Louvain's levels takes a while
            self.parts.steps.offer(timeline)

    def _show_selected(self, instance: Instance | None) -> None:
        simap = self._simap
        self._selected = None if instance is None else instance.id
        self._scene.outline(simap, self._selected)
        self.parts.instance.show(simap, instance)
        self.parts.others.selection_changed(self._selected)
        self.worker.submit("why", functools.partial(self._explain, simap, instance))
        if instance is not None:
            self.worker.submit("pictures", functools.partial(self._show_pictures, simap, instance.id))

    def _explain(self, simap: SIMap, instance: Instance | None) -> None:
        try:
            summary = self.parts.why.show(simap, instance)
            self.parts.instance.explain(summary, () if instance is None else edits_of(simap, instance.id))
        finally:
            self.repaint()

    def _show_pictures(self, simap: SIMap, instance_id: int) -> None:
        picture, note, frames = best_pictures(simap, instance_id, self.view)
        if instance_id == self._selected:
            self.parts.instance.show_pictures(picture, note, frames)

    def _style(self, simap: SIMap) -> Style:
        parts = self.parts
        lit: frozenset[int] | None = None
        if self._selected is not None:
            lit = frozenset({self._selected}) | parts.why.lit
        elif parts.map.shown_class is not None:
            lit = frozenset(i.id for i in simap.of_class(parts.map.shown_class))
        return Style(parts.map.mode, lit, None, parts.why.paint(simap), self._scene.theme)

    def _paint_now(self) -> None:
        shown = self._simap
        then = self.time.now()
        simap = then.simap
        style = replace(self._style(shown), until=then.until)
        if then.classes_only:
            style = replace(style, mode="class")
        if style.paint is None:
            picture = self.common.shared.picture(simap, style.mode, style.lit, style.until, style.theme)
        else:
            image = paint(simap, style.mode, style.lit, style.until, style.theme)
            paint_cells(image, *style.paint, simap.spec.cols)
            picture = png(image)
        self._scene.show_map(simap, picture, style)
        self.parts.map.show(simap if simap.instances else shown, style.theme)
        self.parts.build.tell(then.words)
        self.parts.map.tell_past(then.badge)
        self._scene.show_badge(then.badge)

    def _show_picture_now(self) -> None:
        picture = self._picture
        if picture is None:
            self._scene.show_picture(None)
        else:
            self._scene.show_picture(picture.spec, png(picture.pixels))

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        if self.viewpoints.name == SLANT and self._picture is None:
            place = ray_on_blocks(self._simap, event.ray_origin, event.ray_direction)
        else:
            place = ray_on_floor(event.ray_origin, event.ray_direction)
        if place is not None and (self.robot.take_click(*place) or self.parts.others.take_click(*place)):
            return
        if self.parts.why.take_click(None if place is None else self._simap.at(*place)):
            return
        self.pick(place)

    def _notify(self, title: str, text: str, color: Any, seconds: float) -> None:
        if not self._closed:
            self.client.add_notification(title, text, color=color, auto_close_seconds=seconds)
