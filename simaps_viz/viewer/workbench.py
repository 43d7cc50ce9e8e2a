"""The page: the map in the middle, the recorded build on the left, the panels on the right."""

import contextlib
import functools
import io
import logging
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, TypeVar

import viser
from numpy.typing import NDArray

from simaps_viz.errors import SIMapsError
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.mapping.why import Joint, recorded_step
from simaps_viz.structures import Instance, Pose2, SIMap
from simaps_viz.viewer.build_panel import BuildPanel, FrameLink
from simaps_viz.viewer.follow import Follower
from simaps_viz.viewer.host import Host
from simaps_viz.viewer.instance_panel import InstancePanel, best_pictures
from simaps_viz.viewer.judge_panel import JudgePanel
from simaps_viz.viewer.map_panel import SLANT, MapActions, MapPanel, joins
from simaps_viz.viewer.picking import communities_unseen_until, ray_on_blocks, ray_on_floor
from simaps_viz.viewer.recording_clicks import clicked_place, place_inside
from simaps_viz.viewer.robot import RobotControl
from simaps_viz.viewer.scene import MapScene
from simaps_viz.viewer.services import Services
from simaps_viz.viewer.viewpoints import Viewpoints
from simaps_viz.viewer.why_panel import WhyActions, WhyPanel
from simaps_viz.viewer.worker import Worker

logger = logging.getLogger(__name__)

RECORDING_WIDTH_PX = 420
PANEL_WIDTH_PX = 320

E = TypeVar("E")


class LocalServer(viser.ViserServer):
    """A page server that never opens a tunnel to the outside, whoever asks."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse."""
        return None


class Workbench:
    """Serves the page from construction until ``close``. Everything on it is shared by all who have it open."""

    def __init__(
        self,
        simap: SIMap,
        *,
        services: Services,
        port: int = 8080,
        host: str = "127.0.0.1",
        start: Pose2 | None = None,
        robot_radius_m: float = 0.2,
    ) -> None:
        """Start serving.

        Args:
            simap: the map to show.
            services: what the page can ask for.
            port: where to serve; the next free one when it is taken.
            host: address to listen on; the recorded build is only ever served on 127.0.0.1.
            start: where the robot stands; None finds open floor.
            robot_radius_m: how large it is drawn.

        Raises:
            InputError: a recording that the services name does not exist.
        """
        self.simap = self._recorded = simap
        self._services = services
        self._selected: int | None = None
        self._picked: tuple[float, float] | None = None
        self._upright = False
        self._link = FrameLink(self._send_frame)
        self._closed = threading.Event()
        self._worker = Worker(self._report)
        self._command_worker = Worker(self._report)  # of its own: a language model may take long
        self._judge: JudgePanel | None = None
        self.recording_host = self._serve_recording()
        with contextlib.redirect_stdout(io.StringIO()):  # its banner; the app says where the page is
            self.server = LocalServer(host=host, port=port, label="SI Maps workbench", verbose=False)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(22, 110, 235))
        self._scene = MapScene(self.server, simap, robot_radius_m=robot_radius_m)
        self._viewpoints = Viewpoints(self.server, self._scene.frame_extent)
        self._lay_out(start)
        self.server.scene.on_click()(self._guarded(self._clicked))
        self._show_map()
        if self._judge is not None:
            self._judge.show()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    @property
    def pose(self) -> Pose2:
        """Where the robot is."""
        return self.robot.pose

    @property
    def selected(self) -> int | None:
        """Id of the selected instance."""
        return self._selected

    @property
    def frame(self) -> int:
        """The frame that the build panel shows."""
        return self._build.frame

    def select(self, instance_id: int | None) -> None:
        """Select an instance, or none."""
        if instance_id is None:
            self._pick(None)
            return
        self._pick(place_inside(self.simap, instance_id))

    def wait_idle(self, timeout_s: float = 10.0) -> bool:
        """Wait until all that was asked for is done; False when that took too long."""
        return self._command_worker.wait_idle(timeout_s) and self._worker.wait_idle(timeout_s)

    def wait(self) -> None:
        """Serve until ``close`` is called or the program is interrupted."""
        while not self._closed.wait(0.5):
            pass

    def close(self) -> None:
        """Stop serving and free the ports."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._build.stop()
        self.robot.close()
        if self._judge is not None:
            self._judge.close()
        self._command_worker.stop()
        self._worker.stop()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
        if self.recording_host is not None:
            self.recording_host.close()

    def __enter__(self) -> "Workbench":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _serve_recording(self) -> Host | None:
        services = self._services
        if services.rerun_page is None:
            return None
        return Host(
            page=services.rerun_page,
            assets=services.rerun_assets,
            csp=services.csp,
            recordings=services.recordings,
            on_event=self._recording_said,
            on_listen=lambda: self._link.opened(self._build.frame),
        )

    def _lay_out(self, start: Pose2 | None) -> None:
        gui, services = self.server.gui, self._services
        gui.set_panel_label("SI Maps workbench")
        if self.recording_host is not None:
            recording = gui.add_panel()
            with recording.add_tab("Recorded build", viser.Icon.MOVIE):
                gui.add_html(
                    f'<iframe title="Recorded build" src="{self.recording_host.url}" '
                    'style="width:100%;height:calc(100vh - 92px);border:0;display:block"></iframe>'
                )
            recording.dock_left()
            recording.set_width(RECORDING_WIDTH_PX)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH_PX)
        tabs = gui.add_tab_group()
        if services.judging is not None:
            with tabs.add_tab("Judge", viser.Icon.GAVEL):
                self._judge = JudgePanel(
                    gui,
                    self._scene,
                    services.judging,
                    simap=self.simap,
                    candidates=services.candidates,
                    take_robot=self._free_robot,
                )
        with tabs.add_tab("Map", viser.Icon.MAP):
            actions = MapActions(self._partition, self._guarded_call(self._show_map), self._look)
            self._map_panel = MapPanel(
                gui,
                self.simap,
                actions,
                with_k=services.repartition is not None and joins(self.simap),
                with_resolution=services.recommunity is not None and "resolution" in self.simap.parameters,
            )
        with tabs.add_tab("Command", viser.Icon.ROBOT):
            self.robot = RobotControl(
                gui,
                self._scene,
                self._command_worker,
                services,
                current_map=lambda: self.simap,
                start=start,
                follower=Follower(self.server, behind=lambda: self._upright, let_go=self._viewpoints.restore),
                on_use=self._judge.leave if self._judge is not None else lambda: None,
            )
        with tabs.add_tab("Build", viser.Icon.TIMELINE):
            recorded = self.recording_host is not None
            self._build = BuildPanel(gui, self.simap, on_frame=self._show_frame, recorded=recorded)
        objects = gui.add_panel()
        with objects.add_tab("Instance", viser.Icon.CUBE):
            self._instance_panel = InstancePanel(gui, self.simap, self._guarded(self.select), self._jump)
            self._why = WhyPanel(self.server, self._why_actions())
        objects.dock_below(gui.main_panel)

    def _free_robot(self) -> None:
        self.robot.leave()

    def _look(self, name: str) -> None:
        self._upright = name == SLANT
        self._scene.stand_up(self._upright)
        self._why.stand_up(self._upright)
        self._viewpoints.look(name)

    def _why_actions(self) -> WhyActions:
        return WhyActions(
            repaint=self._guarded_call(self._show_map),
            show_frame=self._jump,
            show_joint=self._send_joint,
            knows_joint=lambda simap: self.recording_host and simap.merges is self._recorded.merges,
            submit=self._worker.submit,
            view=self._view,
        )

    def _jump(self, frame: int) -> None:
        """Show a frame, here and in the recorded build."""
        self._build.set_frame(frame, chosen_here=True)

    def _send_joint(self, joint: Joint) -> None:
        if self.recording_host is not None:
            recorded = self._recorded
            applied = applied_steps(recorded.merges, joining_threshold(recorded.method, recorded.parameters))
            time = {"timeline": "merge", "time": recorded_step(joint, applied)}
            self.recording_host.push({"set_time": time})

    def _view(self, frame: int) -> tuple[NDArray, NDArray] | None:
        return None if self._services.view is None else self._services.view(frame)

    def _partition(self, k_percent: float, resolution: float) -> None:
        self._worker.submit("partition", lambda: self._partition_now(k_percent, resolution))

    def _partition_now(self, k_percent: float, resolution: float) -> None:
        services, before = self._services, self.simap
        same = resolution == float(before.parameters.get("resolution", resolution))
        if same and services.repartition is not None:
            self.simap = services.repartition(before, k_percent)
        elif services.recommunity is not None:
            self.simap = services.recommunity(before, resolution, k_percent)
        self._instance_panel.list(self.simap)
        self._pick(self._picked)

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        if self._upright:
            place = ray_on_blocks(self.simap, event.ray_origin, event.ray_direction)
        else:
            place = ray_on_floor(event.ray_origin, event.ray_direction)
        if place is not None and self.robot.take_click(*place):
            return
        if self._why.take_click(None if place is None else self.simap.at(*place)):
            return
        self._pick(place)

    def _pick(self, place: tuple[float, float] | None) -> None:
        """Select what is at a place of the map; the place is kept, so that it outlives a new partition."""
        instance = None if place is None else self.simap.at(*place)
        self._picked = place if instance is not None else None
        self._selected = None if instance is None else instance.id
        self._scene.outline(self.simap, self._selected)
        self._instance_panel.show(self.simap, instance)
        self._worker.submit("why", functools.partial(self._explain, self.simap, instance))
        if instance is not None:
            self._worker.submit("pictures", functools.partial(self._show_pictures, self.simap, instance.id))

    def _explain(self, simap: SIMap, instance: Instance | None) -> None:
        try:
            self._instance_panel.explain(self._why.show(simap, instance))
        finally:
            self._show_map()

    def _show_map(self) -> None:
        self._worker.submit("map", self._show_map_now)

    def _show_map_now(self) -> None:
        simap = self.simap
        lit: frozenset[int] | None = None
        if self._selected is not None:
            lit = frozenset({self._selected}) | self._why.lit
        elif self._map_panel.shown_class is not None:
            lit = frozenset(i.id for i in simap.of_class(self._map_panel.shown_class))
        hidden = ()
        if self._build.fill_in_step and self._build.frame < len(simap.frame_names) - 1:
            hidden = tuple(communities_unseen_until(simap, self._build.frame).tolist())
        self._scene.show_map(simap, self._map_panel.mode, lit=lit, hidden=hidden, paint=self._why.paint(simap))
        self._map_panel.show(simap)

    def _show_pictures(self, simap: SIMap, instance_id: int) -> None:
        picture, note, frames = best_pictures(simap, instance_id, self._view)
        if instance_id == self._selected:
            self._instance_panel.show_pictures(picture, note, frames)

    def _show_frame(self, frame: int, chosen_here: bool) -> None:
        if chosen_here:
            self._link.push(frame)
        last = len(self.simap.frame_names) - 1
        poses = self.simap.T_map_camera
        self._scene.show_camera(poses[frame] if len(poses) and (frame < last or chosen_here) else None)
        self._show_map()

    def _send_frame(self, frame: int) -> None:
        if self.recording_host is not None:
            self.recording_host.push({"set_time": {"timeline": "frame", "time": frame}})

    def _recording_said(self, event: dict[str, Any]) -> None:
        """Take over the frame that the recording shows.

        A recording that has just been opened, or has changed its timeline, starts where it likes: it is told the
        page's frame instead.
        """
        kind = event.get("type")
        if kind == "recording_open" or (kind == "timeline_change" and event.get("timeline") in ("frame", None)):
            self._link.opened(self._build.frame)
        elif kind == "selection_change" and isinstance(event.get("items"), list):
            self._worker.submit("recording click", functools.partial(self._recording_clicked, event["items"]))
        elif (
            kind == "time_update"
            and event.get("timeline") in ("frame", None)
            and isinstance(event.get("time"), int | float)
        ):
            frame = int(event["time"])
            if 0 <= frame < len(self.simap.frame_names) and self._link.accept(frame, self._build.frame):
                self._build.set_frame(frame)

    def _recording_clicked(self, items: list[Any]) -> None:
        """Select what was clicked in the recorded build, where that is something of the map."""
        place = clicked_place(
            [item for item in items if isinstance(item, dict)],
            self._recorded,
            self._build.frame,
            view=self._view,
            divide=self._services.picture_divide,
        )
        if place is not None and self.simap.at(*place) is not None:
            self._pick(place)

    def _guarded(self, callback: Callable[[E], None]) -> Callable[[E], None]:
        """Make a callback whose errors appear on the page."""

        @functools.wraps(callback)
        def guarded(event: E) -> None:
            try:
                callback(event)
            except Exception as error:  # whatever happens, the page must live on
                self._report(error)

        return guarded

    def _guarded_call(self, callback: Callable[[], None]) -> Callable[[], None]:
        return lambda: self._guarded(lambda _: callback())(None)

    def _report(self, error: Exception) -> None:
        """Say an error on every open page; one that is not meant for people also goes to the log in full."""
        known = isinstance(error, SIMapsError)
        if not known:
            logger.error("the workbench met an error", exc_info=error)
        title = "That did not work" if known else f"Unexpected error ({type(error).__name__})"
        for client in self.server.get_clients().values():
            client.add_notification(title, str(error), color="red", auto_close_seconds=12.0)
