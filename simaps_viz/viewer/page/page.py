"""The page in one browser tab: what it shows, and how panels change it."""

import logging
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from simaps_viz.colors.instances import take_over
from simaps_viz.drawing.surface import instance_near, place_of, ray_on_blocks, ray_on_floor
from simaps_viz.drawing.texture import MapPicture
from simaps_viz.drawing.theme import Theme
from simaps_viz.errors import SIMapsError
from simaps_viz.mapping.explain import Joint
from simaps_viz.mapping.in_space import all_instances, has_voxels
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import joining_percent
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Instance, Pose2, SIMap
from simaps_viz.viewer.page.panel import Panel, Panels, Player
from simaps_viz.viewer.page.recording import RecordingLink, position_inside
from simaps_viz.viewer.page.shared import Services, Snapshot, TimeStep, ids_then, paint, png, snapshot_at
from simaps_viz.viewer.scene.camera import SLANT, Extent, Viewpoints, with_margin
from simaps_viz.viewer.scene.map_scene import MapScene, Style
from simaps_viz.viewer.scene.why_marks import paint_cells
from simaps_viz.viewer.server.access import RIGHTS, Right, Role
from simaps_viz.viewer.server.viser_hooks import guard, role_of

if TYPE_CHECKING:
    from simaps_viz.viewer.workbench import Workbench

Job = Callable[[], object]
LATER_S = 0.15
"""About as long as a page takes to draw a map that was cut anew."""


class Worker:
    """Runs jobs one after another. A slider sends many values a second: only the latest waiting one is computed.

    The thread exists only while there are jobs, so that an idle page has none.
    """

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        """Take the function that is called with an error of a job."""
        self._on_error = on_error
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._later: OrderedDict[str, Job] = OrderedDict()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._stopped = False

    def submit(self, name: str, job: Job, *, later: bool = False) -> None:
        """Queue a job in place of a waiting one of the same name. After ``stop`` nothing is queued.

        Args:
            name: of the job.
            job: what is run.
            later: run it only once no other job has come for `LATER_S`, so that what was done before is seen first.
        """
        with self._changed:
            if self._stopped:
                return
            (self._later if later else self._jobs)[name] = job
            self._changed.notify_all()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="workbench-worker", daemon=True)
                self._thread.start()

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until all jobs are done; False when that took too long."""
        with self._changed:
            return self._changed.wait_for(lambda: self._thread is None, timeout_s)

    def stop(self, timeout_s: float = 10.0) -> None:
        """Drop the waiting jobs and wait for the running one; its errors are no longer reported."""
        with self._changed:
            self._stopped = True
            self._jobs.clear()
            self._later.clear()
            self._changed.notify_all()
            running = self._thread
        if running is not None and running is not threading.current_thread():
            running.join(timeout=timeout_s)

    def _run(self) -> None:
        waited = False
        while True:
            with self._changed:
                if self._later and not waited:
                    self._changed.wait_for(lambda: self._jobs or self._stopped, LATER_S)
                waited = not self._jobs
                jobs = self._jobs or self._later
                if not jobs:
                    self._thread = None
                    self._changed.notify_all()
                    return
                _, job = jobs.popitem(last=False)
            try:
                job()
            except Exception as error:  # no job may end the page
                if not self._stopped:
                    self._on_error(error)


logger = logging.getLogger(__name__)

DEFAULT_RESOLUTION = 1.0
MIN_RESOLUTION, MAX_RESOLUTION = 0.05, 5.0
"""Range of the slider for the Louvain resolution."""
BESIDE_FLOOR = ("Nothing was clicked", "That was beside the floor. Click a point on the map.")
NOTHING_HERE = ("Nothing here", "The floor, a wall, or never seen. Nothing is selected.")
"""What a tap on a phone is answered, where the pointer's hint would have said so before a click."""
AIM_M = 0.1
"""A click so near to an object selects it: objects have holes. The page's script outlines by the same distance."""
MAP_TABS, SELECTED_TAB = "Map|Compare|Masks", "Instance"
"""The tabs about the map, and that about the selected object, which opens in their place when one is selected."""
ERROR_S = 12.0
"""How long an error stays on the page."""


@dataclass(frozen=True)
class Cut:
    """How the sliders cut a map into instances."""

    percent: float
    """K or evidence, percent."""
    resolution: float
    """Louvain's resolution."""


def cut_of(simap: SIMap) -> Cut:
    """Return how a map is cut, within the range of the sliders."""
    resolution = float(simap.parameters.get("resolution", DEFAULT_RESOLUTION))
    return Cut(joining_percent(simap), min(max(resolution, MIN_RESOLUTION), MAX_RESOLUTION))


def aimed_at(simap: SIMap, position: tuple[float, float]) -> tuple[float, float]:
    """Return the middle of the object's cell that is nearest to a position, up to ``AIM_M``; else the position itself.

    Args:
        simap: the map.
        position: map frame, metres.
    """
    row, col = simap.spec.cell_of(*position)
    reach = int(AIM_M / simap.spec.cell_size_m + 1e-6)
    rows, cols = np.mgrid[row - reach : row + reach + 1, col - reach : col + reach + 1].reshape(2, -1)
    away = (rows - row) ** 2 + (cols - col) ** 2
    inside = (away <= reach**2) & (rows >= 0) & (cols >= 0) & (rows < simap.spec.rows) & (cols < simap.spec.cols)
    rows, cols, away = rows[inside], cols[inside], away[inside]
    hit = simap.instance[rows, cols] > 0
    if not hit.any() or (hit & (away == 0)).any():
        return position
    nearest = np.argmin(np.where(hit, away, reach**2 + 1))
    return simap.spec.centre_of(float(rows[nearest]), float(cols[nearest]))


class Page:
    """What one browser tab shows. Panels ask it for changes; it computes and paints, and reports events to all panels.

    Its public methods may be called from any thread, and none of them takes long: the work is done by `worker`, where
    a later job replaces a waiting one of the same name.
    """

    robot = RobotShape()
    """The shape of the robot; what is higher than it does not hinder it."""

    def __init__(self, client: viser.ClientHandle, workbench: "Workbench") -> None:
        """Show the published map, without any panel."""
        self.client, self.gui = client, client.gui
        self.workbench, self.shared = workbench, workbench.shared
        self.token = secrets.token_urlsafe(12)
        """Identifies this page in the addresses of its embedded frames."""
        self.role: Role = role_of(workbench.server, client)
        """Whose page it is; what that means is asked with ``may``."""
        self._lock = threading.RLock()
        self._begun = self._closed = False
        self.base = workbench.simap
        """The map that the sliders cut into the one shown."""
        self.simap = self._colored = self.base  # instances keep the colours of the second
        """The map shown now."""
        self._frame_names = self.simap.frame_names
        self.selected: int | None = None
        """Id of the selected instance."""
        self.picked: tuple[float, float] | None = None
        """The position that was selected, map frame, metres."""
        self.picked_z_m: float | None = None
        """Its height where it was selected in space; None selects what is on top there."""
        self.picked_as: tuple[int, str] | None = None
        """Id and class of what was selected there, on the map of then."""
        self._outlined_past = False
        self._picture: MapPicture | None = None
        self.cut = self._own_cut = cut_of(self.base)
        """How the sliders cut `base`."""
        # The time step, and the robot.
        self.time = TimeStep(self.last_frame)
        self.as_it_was = True
        """Whether an earlier frame shows the map as it was after that frame, instead of the finished map."""
        self.is_phone = False
        """Whether the page is as narrow as a phone's."""
        self.pose = workbench.start or Pose2(0.0, 0.0, 0.0)
        """Where the robot is."""
        self.players: dict[str, Player] = {}
        """The players of this page's timelines, by name."""
        # Threads, the scene, the recorded build; panels come last, as they use all of these.
        self.worker, self.command_worker, self.panel_worker = (Worker(self.report) for _ in range(3))
        guard(client, self.report)
        self.scene = MapScene(client, self.simap)
        self.viewpoints = Viewpoints(client, self.scene.frame_extent)
        self.recording = RecordingLink(workbench.recording_host, self.token, self)
        self.panels = Panels(self)
        client.scene.on_click()(self._clicked)

    def may(self, right: Right) -> bool:
        """Whether the person at this page has a right; asked here, and nowhere else."""
        return right in RIGHTS[self.role]

    # --- properties

    @property
    def services(self) -> Services:
        """The functions behind the page."""
        return self.workbench.services

    @property
    def theme(self) -> Theme:
        """Whether the page is light or dark."""
        return self.scene.theme

    @property
    def frame(self) -> int:
        """The frame of the build that is shown."""
        return self.time.frame

    @property
    def last_frame(self) -> int:
        """The last frame of the build; 0 where there is none."""
        return max(len(self._frame_names) - 1, 0)

    @property
    def at_end(self) -> bool:
        """Whether the last frame is shown."""
        return self.frame >= self.last_frame

    def view(self, frame: int) -> tuple[NDArray, NDArray] | None:
        """Return a frame's RGB picture and segment ids; None when the sequence is not at hand."""
        return None if self.services.view is None else self.services.view(frame)

    def reveal(self, title: str, *, only_from: str = "", focus: str = "") -> None:
        """Open a tab; a page without a layout has none to open.

        Args:
            title: of the tab.
            only_from: other tabs' titles, with | between them: open it only where one of them is open.
            focus: label of a control in it that gets the focus.
        """

    def unfold_recording(self) -> None:
        """Show the recorded build, where the page has one; a page without a layout has none."""

    # --- selection

    def select(self, instance_id: int | None) -> None:
        """Select an instance, or none."""
        if instance_id is None or any(one.id == instance_id for one in self.simap.instances):
            self.pick(None if instance_id is None else position_inside(self.simap, instance_id))
        else:  # no cell shows it
            self.pick_in_space(place_of(self.simap, instance_id))

    def click_name(self, instance_id: int, position: tuple[float, float]) -> None:
        """Select the object whose name was clicked; a panel that waits for a place gets that below the name."""
        below = self.simap.at(*position)
        on_it = below is not None and below.id == instance_id
        shown = not on_it and not self.panels.wait_for_place() and (self.simap.instance == instance_id).any()
        place = position_inside(self.simap, instance_id) if shown else position
        if self.panels.take_click(*place):
            return
        if on_it:
            self.pick(position)
        else:
            self.select(instance_id)

    def pick(self, position: tuple[float, float] | None) -> None:
        """Select what is at a position of the map; the position is kept, so that it outlives a map that is cut anew."""
        with self._lock:
            found = None if position is None else self.simap.at(*position)
            self.picked = None if found is None else position
            self.picked_z_m = None
            self._pick(found)
        if found is not None:
            self.reveal(SELECTED_TAB, only_from=MAP_TABS)

    def pick_in_space(self, place: tuple[float, float, float] | None) -> None:
        """Select what is at a place in space, map frame, metres, also below other things."""
        with self._lock:
            found = None if place is None else self._instance_near(place)
            self.picked = None if found is None or place is None else place[:2]
            self.picked_z_m = None if found is None or place is None else place[2]
            self._pick(found)
        if found is not None:
            self.reveal(SELECTED_TAB, only_from=MAP_TABS)

    def under_ray(self, origin: ArrayLike, direction: ArrayLike) -> Instance | None:
        """Return what a click would select in the 3-D view."""
        hit = self.scene.point_hit(origin, direction)
        if hit is not None:
            return self._instance_near((float(hit[0]), float(hit[1]), float(hit[2])))
        position = ray_on_blocks(self.simap, origin, direction)
        return None if position is None else self.simap.at(*aimed_at(self.simap, position))

    def _instance_near(self, place: tuple[float, float, float]) -> Instance | None:
        number = instance_near(self.simap, place) if has_voxels(self.simap) else None
        return None if number is None else self.simap.by_id(number)

    def _pick(self, instance: Instance | None) -> None:
        self.picked_as = None if instance is None else (instance.id, instance.label)
        self._show_selected(instance)

    def remember(self, position: tuple[float, float] | None, called: tuple[int, str] | None) -> None:
        """Select what is called so (id and class), or else what is at a position, as soon as the next map is shown."""
        self.picked, self.picked_z_m, self.picked_as = position, None, called

    def go_to(self, instance: Instance) -> None:
        """Select an instance, open the tab about it, and look at it and what is around it."""
        self.select(instance.id)
        self.reveal(SELECTED_TAB)
        (xmin, ymin, _), (xmax, ymax, _) = instance.aabb_m
        self.viewpoints.look_at(with_margin((xmin, ymin, xmax, ymax), share=1.0, least_m=1.5))

    # --- the map

    def publish(self, simap: SIMap) -> None:
        """Show a changed map on every open page, and on those opened later; each page cuts it as its sliders are."""
        self.workbench.publish(self._cut_as_published(simap), growing=True)

    def take_map(self, simap: SIMap, *, keep_sliders: bool = False) -> None:
        """Queue another map to be cut and shown; ``keep_sliders`` cuts it as this person has set the sliders."""
        with self._lock:
            self.base = simap
        self.worker.submit("take map", lambda: self.take_map_now(simap, keep_sliders=keep_sliders))

    def take_map_now(self, simap: SIMap, *, keep_sliders: bool = False) -> None:
        """Cut and show another map at once, on the thread that calls; see ``take_map``."""
        with self._lock:
            kept = self.cut if self.cut_here and keep_sliders else None
            self.base, self._own_cut = simap, cut_of(simap)
            self.cut = kept or self._own_cut
            self.panels.each(lambda panel: panel.base_changed(simap))
            if kept is not None:
                self.cut_map(kept.percent, kept.resolution)
            else:
                self._show(simap)

    @property
    def cut_here(self) -> bool:
        """Whether the sliders were moved away from the values that the map was cut with."""
        return self.cut != self._own_cut

    def cut_map(self, percent: float, resolution: float) -> None:
        """Cut the map anew, at K or evidence (percent) and Louvain's resolution."""
        self.cut = Cut(percent, resolution)
        self.worker.submit("cut map", lambda: self._cut_now(percent, resolution))

    def repaint(self) -> None:
        """Colour the map anew, soon."""
        self.worker.submit("map", self._paint_now)

    def show_picture(self, picture: MapPicture | None) -> None:
        """Show a picture instead of the map's own colours; None removes it."""
        self._picture = picture
        self.worker.submit("picture", self._show_picture_now)

    # --- time

    def show_frame(self, frame: int, *, also_recording: bool = True) -> None:
        """Show a frame of the build; ``also_recording`` moves the recorded build there too."""
        self.stop_playing(but="frames")
        self.time = TimeStep(min(max(frame, 0), self.last_frame))
        if also_recording:
            self.recording.show_frame(self.frame)
        self._time_changed()

    def show_step(self, position: int, timeline: Timeline, *, also_recording: bool = True) -> None:
        """Show a step of joining of the finished map; ``also_recording`` moves the recorded build there too."""
        self.stop_playing(but="steps")
        self.time = TimeStep(self.last_frame, None if position == timeline.finished else position)
        if also_recording:
            self.recording.show_position(position)
        self._time_changed()

    def show_joint(self, joint: Joint) -> None:
        """Show the finished map, and in the recorded build the step of joining that made the selected instance."""
        self.stop_playing()
        self.time = TimeStep(self.last_frame)
        self._time_changed()
        if self.recording.has_steps_of(self.simap):
            self.recording.show_joint(joint)

    def finish(self) -> None:
        """Stop what plays, and show the finished map here and in the recorded build."""
        self.stop_playing()
        if not self.at_end or self.time.step is not None:
            self.show_frame(self.last_frame)

    def stop_playing(self, but: str = "") -> None:
        """Stop the players of this page's timelines, all but the named one."""
        for name, player in tuple(self.players.items()):
            if name != but:
                player.stop()

    def snapshot(self) -> Snapshot:
        """Return the map at the time step that the page is at."""
        time = self.time
        past = time.step is None and self.as_it_was and not self.at_end
        return snapshot_at(self.shared, self.simap, frame=time.frame if past else None, step=time.step)

    # --- camera, theme, robot, recording

    def look(self, name: str) -> None:
        """Go to the top view or the slanted one."""
        self.scene.stand_up(name == SLANT)
        self.viewpoints.look(name)
        self.panels.each(lambda panel: panel.view_changed(name))

    def look_at(self, extent: Extent | None) -> None:
        """Look straight down on a part of the floor; None returns to the view before that."""
        self.viewpoints.look_down(extent)

    def set_theme(self, theme: Theme) -> None:
        """Colour the map for a light or a dark page."""
        self.scene.set_theme(theme)
        self.panels.each(lambda panel: panel.theme_changed())
        self.repaint()

    def claim_robot(self, by: Panel) -> None:
        """Make all other panels release the robot."""
        self.panels.each(lambda panel: None if panel is by else panel.leave_robot())

    # --- jobs and notifications

    def submit(self, name: str, job: Callable[[], None], *, later: bool = False) -> None:
        """Queue a job of a panel on the panels' thread, so that the page stays responsive; errors are reported.

        Args:
            name: of the job, as for `Worker.submit`.
            job: what is run.
            later: run it once no other has come for `LATER_S`.
        """
        self.panel_worker.submit(name, job, later=later)

    def send(self, name: str, content: bytes) -> None:
        """Send a file to the browser, which saves it under that name."""
        self.client.send_file_download(name, content, save_immediately=True)

    def say(self, title: str, text: str) -> None:
        """Show this person a short notification."""
        self._notify(title, text, "blue", 6.0)

    def report(self, error: Exception) -> None:
        """Show this person an error; an unexpected one is also logged with its traceback."""
        if self._closed:
            return
        if self._begun:
            self.panels.each(lambda panel: panel.failed())
        known = isinstance(error, SIMapsError)
        if not known:
            logger.error("the workbench met an error", exc_info=error)
        title = "That did not work" if known else f"Unexpected error ({type(error).__name__})"
        self._notify(title, str(error), "red", ERROR_S)

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until all queued jobs are done; False when that took too long."""
        return all(w.wait_idle(timeout_s) for w in (self.command_worker, self.panel_worker, self.worker))

    # --- on the worker's thread

    def _cut_now(self, percent: float, resolution: float) -> None:
        base = self.base
        simap = self.shared.cut_map(base, percent, resolution)
        with self._lock:
            if base is self.base:  # not when another map has come meanwhile
                self._show(simap)

    def _show(self, simap: SIMap) -> None:
        with self._lock:
            self.simap = simap
        self.worker.submit("map changed", self._map_changed)

    def _cut_as_published(self, simap: SIMap) -> SIMap:
        """Cut a map as the published one is cut, so that the sliders of one page do not change the others."""
        published = self.workbench.simap
        slider = method_of(simap.method).slider
        if slider is None or simap.method != published.method or simap.spec != published.spec:
            return simap
        names = (slider.parameter, "resolution")
        if all(simap.parameters.get(name) == published.parameters.get(name) for name in names):
            return simap
        resolution = float(published.parameters.get("resolution", DEFAULT_RESOLUTION))
        return self.shared.cut_map(simap, joining_percent(published), resolution, lasting=False)

    def _map_changed(self) -> None:
        simap = self.simap
        # Instances keep the colours they had on the map before.
        take_over(simap, self._colored)
        self._colored = simap
        if self.scene.fit(simap):
            self.viewpoints.show_extent(self.scene.frame_extent)
        # A page that showed the last frame follows a map that grows; its steps of joining are others now.
        follow = self.at_end and simap.frame_names != self._frame_names
        self._frame_names = simap.frame_names
        self.time = TimeStep(self.last_frame if follow else min(self.frame, self.last_frame))
        self.panels.each(lambda panel: panel.map_changed(simap))
        with self._lock:
            self._show_selected(self._selected_on(simap))

    def _selected_on(self, simap: SIMap) -> Instance | None:
        """Return what is selected on another map: what has the same name, or else what is at the same place."""
        place, called = self.picked, self.picked_as
        same = next((one for one in all_instances(simap) if (one.id, one.label) == called), None)
        if same is not None:
            return same
        if place is not None and self.picked_z_m is not None:
            return self._instance_near((*place, self.picked_z_m))
        return None if place is None else simap.at(*place)

    def _show_selected(self, instance: Instance | None) -> None:
        self.selected = None if instance is None else instance.id
        self.scene.outline(self.simap, self.selected)
        self.panels.each(lambda panel: panel.selection_changed(self.selected))

    def _time_changed(self) -> None:
        """Draw the frame's camera and the map at that time step; at the last frame no camera is drawn."""
        frame, poses = self.frame, self.simap.T_map_camera
        past = frame < min(len(self.simap.frame_names) - 1, len(poses))
        self.scene.show_camera(poses[frame] if past else None)
        self.panels.each(lambda panel: panel.time_changed(frame, self.time.step))
        self.repaint()

    def _paint_now(self) -> None:
        # Every panel may change how the map is painted.
        shown = self.simap
        then = self.snapshot()
        lit = None if self.selected is None else frozenset({self.selected})
        style = self.panels.style(shown, Style("instance", lit, then.until, theme=self.scene.theme))
        past = then.simap.instance is not shown.instance
        if past:  # an earlier map has ids, and evidence, of its own
            lit = style.lit and (ids_then(then.simap, shown, style.lit) or None)
            style = replace(style, lit=lit, paint=None, faint=frozenset())
        if past or self._outlined_past:
            mine = frozenset() if self.selected is None else frozenset({self.selected})
            at = (then.simap, ids_then(then.simap, shown, mine)) if past else None
            self.scene.outline(shown, self.selected, at)
            self._outlined_past = past
        if then.classes_only:
            style = replace(style, mode="class")
        # Pictures without marks of this page alone are shared by all pages.
        drawn = (then.simap, style.mode, style.lit, style.until, style.theme, style.tint, style.faint)
        if style.paint is None:
            picture = self.shared.picture(*drawn)
        else:
            image = paint(*drawn)
            paint_cells(image, *style.paint, then.simap.spec.cols)
            picture = png(image)
        self.scene.show_map(then.simap, picture, style)
        painted = then.simap if then.simap.instances else shown
        self.panels.each(lambda panel: panel.painted(painted, then))
        self.scene.show_badge(then.badge)

    def _show_picture_now(self) -> None:
        picture = self._picture
        if picture is None:
            self.scene.show_picture(None)
        else:
            self.scene.show_picture(picture.spec, png(picture.pixels))

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        hit = self.scene.point_hit(event.ray_origin, event.ray_direction)
        if hit is not None:
            x, y, z = (float(value) for value in hit)
            if not self.panels.take_click(x, y):
                self.pick_in_space((x, y, z))
            return
        if self.viewpoints.name == SLANT and self._picture is None:
            position = ray_on_blocks(self.simap, event.ray_origin, event.ray_direction)
        else:
            position = ray_on_floor(event.ray_origin, event.ray_direction)
        if position is None and self.panels.wait_for_click():
            self.say(*BESIDE_FLOOR)
        elif position is None or not self.panels.take_click(*position):
            self.pick(position if position is None else aimed_at(self.simap, position))
            if self.is_phone and self.picked is None:
                self.say(*NOTHING_HERE)

    def _notify(self, title: str, text: str, color: Any, seconds: float) -> None:
        if not self._closed:
            self.client.add_notification(title, text, color=color, auto_close_seconds=seconds)
