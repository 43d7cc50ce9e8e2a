"""Serves the page: the map in the middle, the recorded build on the left, the panels on the right; one for each tab."""

import contextlib
import gc
import io
import logging
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import urlsplit

import viser

from simaps_viz.recorder.web_viewer import CONTENT_SECURITY_POLICY, viewer_assets
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.page.page import Worker
from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.page.shared import Services, Shared
from simaps_viz.viewer.scene.camera import set_first_view
from simaps_viz.viewer.scene.map_scene import frame_extent, light_up, seen_extent
from simaps_viz.viewer.server.access import Access
from simaps_viz.viewer.server.front_door import FrontDoor, Viser
from simaps_viz.viewer.server.host import Host
from simaps_viz.viewer.server.viser_hooks import admit_only, check_values
from simaps_viz.viewer.session import TAB_CSP, TAB_PAGE, Session, Tabs, TabState, prepare

logger = logging.getLogger(__name__)

TELL_S = 0.8
"""How long a new page may take to say which tab it is in, before it is painted as if nobody had been there."""


LIVE_STREAM = "rerun+/proxy"
"""Address of the live recording, as the recording's page has it: on the front door."""


class LocalServer(viser.ViserServer):
    """A page server that never opens a tunnel to the outside, whoever asks."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse."""
        return None


class Workbench:
    """Serves from construction until ``close``. Every tab has a `Session`; what they compute is computed once."""

    def __init__(
        self,
        simap: SIMap,
        *,
        services: Services,
        port: int = 8080,
        access: Access | None = None,
        start: Pose2 | None = None,
    ) -> None:
        """Start serving.

        Args:
            simap: the map to show.
            services: what the page can ask for.
            port: where to serve; the next free one when it is taken.
            access: where to listen, and who may do what; by default this machine, whose people may do all.
            start: where robots stand; None finds open floor.

        Raises:
            InputError: a recording that the services name does not exist.
        """
        self.simap = simap
        """The map that a new page shows."""
        self.recorded = simap
        """The map whose build was recorded."""
        self.services, self.start = services, start
        self.shared = Shared(services)
        self.judging = threading.RLock()
        """Held while the answer of a judge is saved."""
        self._sessions: dict[int, Session] = {}
        self._changed = threading.Condition()
        self._closed = threading.Event()
        self._teller = Worker(lambda error: logger.error("a map could not be published", exc_info=error))
        self.tabs: Tabs[TabState] = Tabs()
        self.tab_host = Host(page=lambda _: TAB_PAGE, assets={}, csp=TAB_CSP, on_event=self._tab_told, root="tab")
        """Serves the hidden frame that identifies the browser tab."""
        self.recording_host = self._recording_host()
        """Serves the recorded build; None where there is none."""
        self.access = access or Access()
        self.door = FrontDoor(self.access, port)
        # viser listens on a private port, which only the front door knows the key of.
        with contextlib.redirect_stdout(io.StringIO()):  # its banner; the app says where the page is
            self.server = LocalServer(host="127.0.0.1", port=0, label="SI Maps workbench", verbose=False)
        behind = Viser(self.server.get_port(), f"viser-v{viser.__version__}")
        admit_only(self.server, behind.key)
        light_up(self.server.scene)
        prepare(self.server)
        set_first_view(self.server, frame_extent(seen_extent(simap)))
        self.server.on_client_disconnect(self._left)
        self.server.on_client_connect(self._came)
        # The first picture of a new page is painted while its browser is still loading.
        self._teller.submit("prepare", lambda: self.shared.picture(simap, "instance", None, None))
        hosts = [self.tab_host, *filter(None, [self.recording_host])]
        self.door.start(hosts, viser=behind, stream_port=urlsplit(services.stream.removeprefix("rerun+")).port)
        self.url, self.entrance, self.port = self.door.url, self.door.entrance, self.door.port
        """Address of the page, the same with the token where one is asked for, and the one port of everything."""
        self.owner_entrance = self.door.owner_entrance
        """Address that makes an owner of who opens it."""
        gc.freeze()  # what is loaded by now stays: looking through it for garbage would stop all pages for .1 s

    @property
    def sessions(self) -> Sequence[Session]:
        """The open pages, the oldest first."""
        with self._changed:
            return tuple(self._sessions[client] for client in sorted(self._sessions))

    def publish(self, simap: SIMap, *, growing: bool = False) -> None:
        """Show another map on every open page, and on those opened later; returns at once.

        Pages keep their camera, and their selection by its place. Each shows the latest map it has time for.

        Args:
            simap: the map.
            growing: it is the same map, further built: pages cut it as their persons have set the sliders.
        """
        self.simap = simap
        self._teller.submit("publish", lambda: self._tell(simap, growing))

    def finish(self, simap: SIMap, panels: Sequence[PanelSpec], recording: Path | None = None) -> None:
        """The map that was being built is done: show it on all pages, with the panels that only a finished map has.

        Args:
            simap: the map.
            panels: in the place of those there were.
            recording: of its build, when there is a file; otherwise the stream stays.
        """
        self.recorded, self.services = simap, replace(self.services, panels=panels, building=False)
        if recording is not None and self.recording_host is not None:
            self.recording_host.turn_to(recording)
        self.publish(simap, growing=True)
        self._teller.submit("finish", self._tell_finished)

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until all pages have done what they were asked for; False when that took too long."""
        return self._teller.wait_idle(timeout_s) and all(session.wait_idle(timeout_s) for session in self.sessions)

    def wait(self) -> None:
        """Serve until ``close`` is called or the program is interrupted."""
        while not self._closed.wait(0.5):
            pass

    def close(self) -> None:
        """Stop serving and free the port."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._teller.stop()
        with self._changed:
            sessions = list(self._sessions.values())
            self._sessions.clear()
        for session in sessions:
            session.close(timeout_s=10.0)
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
        self.door.close()
        gc.unfreeze()

    def __enter__(self) -> "Workbench":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _tell(self, simap: SIMap, growing: bool) -> None:
        sessions = self.sessions
        for session in sessions:
            session.take_map(simap, keep_sliders=growing)
        kept = {id(simap)} | {id(shown) for session in sessions for shown in (session.base, session.simap)}
        self.shared.forget_maps(lambda one: id(one) in kept)

    def _tell_finished(self) -> None:
        for session in self.sessions:
            session.catch_up()

    def _recording_host(self) -> Host | None:
        services = self.services
        if not services.recordings and not services.stream:
            return None
        return Host(
            page=services.rerun_page,
            assets=viewer_assets(),
            csp=CONTENT_SECURITY_POLICY,
            recordings=services.recordings,
            streams=(LIVE_STREAM,) if services.stream else (),
            on_event=self._recording_told,
            on_listen=self._recording_listens,
        )

    def _came(self, client: viser.ClientHandle) -> None:
        """Return a new page its session; it is painted once it is known which tab it is in."""
        try:
            check_values(client, self.door.note)
            session = Session(client, self)
        except Exception as error:  # whatever one page, or a panel of it, fails of, the others are served on
            logger.error("a page could not be built", exc_info=error)
            client.add_notification("The page could not be built", str(error), color="red")
            return
        with self._changed:  # viser may have told of the client's leaving before this
            here = client.client_id in self.server.get_clients() and not self._closed.is_set()
            if here:
                self._sessions[client.client_id] = session
                self._changed.notify_all()
        if not here:
            session.close()
            return
        if session.base is not self.simap:  # published while the page was built
            session.take_map(self.simap)
        session.catch_up()
        timer = threading.Timer(TELL_S, session.begin, args=(None,))
        timer.daemon = True
        timer.start()

    def _left(self, client: viser.ClientHandle) -> None:
        with self._changed:
            session = self._sessions.get(client.client_id)
        if session is not None:
            state = session.close()  # while it still gets published maps: it has to know which it was left on
            with self._changed:
                self._sessions.pop(client.client_id, None)
            self.tabs.leave(session.token, state)
        if not self.sessions:
            gc.collect()  # viser's pages refer to themselves in circles; nobody is kept waiting now

    def _session_named(self, token: str) -> Session | None:
        return next((session for session in self.sessions if session.token == token), None)

    def _tab_told(self, event: dict[str, Any], token: str) -> dict[str, Any] | None:
        with self._changed:  # its frame may be faster than the end of ``_came``
            self._changed.wait_for(lambda: any(one.token == token for one in self._sessions.values()), TELL_S)
        session = self._session_named(token)
        if session is None:
            return None
        if event.get("type") != "tab":
            session.panels.each(lambda panel: panel.told(event))
            return None
        name, state = self.tabs.claim(event.get("tab"), token)
        session.begin(state)
        session.settle(event.get("width"), event.get("height"))
        return {"tab": name}

    def _recording_told(self, event: dict[str, Any], token: str) -> None:
        session = self._session_named(token)
        if session is not None:
            session.recording.reported(event)

    def _recording_listens(self, token: str) -> None:
        session = self._session_named(token)
        if session is not None:
            session.recording.opened()
