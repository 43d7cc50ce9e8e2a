"""A page with nothing but a map on a small viser server, for testing one panel in a browser."""

import contextlib
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import viser
from browser import PATIENCE_S, free_port, page_is_there, pixel, pixels_around, until
from playwright.sync_api import Page
from toy_maps import TOY_POSE

from simaps_viz.drawing.texture import MapPicture, map_image
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page import page
from simaps_viz.viewer.page.page import Worker
from simaps_viz.viewer.page.shared import Services, Shared
from simaps_viz.viewer.scene.annotations import Texts
from simaps_viz.viewer.scene.camera import top_view


class StubPage(page.Page):
    """One page for all clients of a server; what panels ask of it is kept."""

    def __init__(self, simap: SIMap, services: Services | None = None) -> None:  # and nothing of a real page
        with contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
        self.gui, self.scene = self.server.gui, cast(Any, self.server.scene)
        self.scene.texts = Texts(self.server)
        self.scene.set_up_direction("+z")
        self.simap, self.selected = simap, None
        self.cut = self._own_cut = page.cut_of(simap)
        services = services or Services()
        self.workbench: Any = SimpleNamespace(services=services)
        self.shared = Shared(services)
        self.opened: list[Path] = []
        self.recording: Any = SimpleNamespace(url=None, show=self.opened.append)
        self.said: list[tuple[str, str]] = []
        self.errors: list[Exception] = []
        self.pictures: list[MapPicture | None] = []
        self.looked: list[tuple[float, ...]] = []
        self.frames: list[int] = []
        self.pose, self.role = TOY_POSE, "owner"
        self.downloads: list[tuple[str, bytes]] = []
        self._worker = Worker(self.report)
        self.show_picture(None)
        self.server.on_client_connect(lambda client: self._look(client, simap.spec.extent_m))

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.get_port()}"

    @property
    def shown(self) -> MapPicture | SIMap:
        """What lies on the floor; its ``spec`` says where."""
        return self.pictures[-1] or self.simap

    @property
    def theme(self) -> Theme:
        return LIGHT

    def select(self, instance_id: int | None) -> None:
        raise AssertionError("nobody selects here")

    def show_frame(self, frame: int, *, also_recording: bool = True) -> None:
        self.frames.append(frame)

    def publish(self, simap: SIMap) -> None:
        self.simap = simap

    def show_picture(self, picture: MapPicture | None) -> None:
        self.pictures.append(picture)
        shown = picture or MapPicture(self.simap.spec, map_image(self.simap, scale=6))
        xmin, ymin, xmax, ymax = shown.spec.extent_m
        self.server.scene.add_image(
            "/map", shown.pixels, xmax - xmin, ymax - ymin, format="png", cast_shadow=False, receive_shadow=False,
            position=((xmin + xmax) / 2.0, (ymin + ymax) / 2.0, 0.0),
        )  # fmt: skip

    def repaint(self) -> None:
        pass

    def submit(self, name: str, job: Callable[[], None]) -> None:
        self._worker.submit(name, job)

    def say(self, title: str, text: str) -> None:
        self.said.append((title, text))

    def report(self, error: Exception) -> None:
        self.errors.append(error)

    def look_at(self, extent: tuple[float, float, float, float] | None) -> None:
        extent = extent or self.simap.spec.extent_m
        self.looked.append(extent)
        for client in self.server.get_clients().values():
            self._look(client, extent)

    def send(self, name: str, content: bytes) -> None:
        self.downloads.append((name, content))
        for client in self.server.get_clients().values():
            client.send_file_download(name, content, save_immediately=True)

    def wait_idle(self, timeout_s: float = PATIENCE_S) -> bool:
        return self._worker.wait_idle(timeout_s)

    def close(self) -> None:
        self._worker.stop()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def _look(self, client: viser.ClientHandle, extent: tuple[float, float, float, float]) -> None:
        view = top_view(extent, client.camera.aspect)
        with client.atomic():
            client.camera.fov = view.fov_rad
            client.camera.position = view.position
            client.camera.look_at = view.look_at


@contextmanager
def stub_page(simap: SIMap, services: Services | None = None) -> Iterator[StubPage]:
    desk = StubPage(simap, services)
    try:
        yield desk
    finally:
        desk.close()


def open_desk(page: Page, desk: StubPage) -> None:
    """Load the page and wait for the map and a camera that stands still."""
    page.goto(f"{desk.url}/?fixedDpr=1")
    page.wait_for_function("() => window.__viserMutable?.nodeRefFromName?.['/map'] != null")
    settle(desk, page)


def settle(desk: StubPage, page: Page) -> None:
    """Wait until the camera has stood still for a while, and the page draws from there."""
    last: list[tuple[float, ...]] = []

    def rests() -> bool:
        clients = list(desk.server.get_clients().values())
        if not clients or clients[0].camera.update_timestamp == 0.0:
            return False
        camera = clients[0].camera
        last.append((*camera.position, camera.aspect))
        still = len(last) > 10 and np.allclose(last[-1], last[-10], rtol=1e-6)
        return still and page_is_there(desk, page, desk.shown, SimpleNamespace(client=clients[0]))

    until(page, rests)


def _viewer(desk: StubPage) -> SimpleNamespace:
    return SimpleNamespace(client=next(iter(desk.server.get_clients().values())))


def color_at(desk: StubPage, page: Page, x_m: float, y_m: float) -> tuple[int, ...]:
    """The colour the canvas shows at a point of the floor."""
    return pixel(desk, page, x_m, y_m, _viewer(desk))


def colors_around(
    desk: StubPage, page: Page, place: tuple[float, float], reach_m: float, count: int
) -> list[list[int]]:
    """The colours along a short line through a point of the floor, west to east."""
    return pixels_around(desk, page, place, reach_m, count, _viewer(desk))
