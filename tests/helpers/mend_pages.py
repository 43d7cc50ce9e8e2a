"""Pages that have nothing but a map and the mending panel: one page for each browser tab."""

import viser

from simaps_viz.app.workbench import login
from simaps_viz.drawing.surface import ray_on_floor
from simaps_viz.drawing.texture import map_image
from simaps_viz.mapping.mending import Mending
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page, Worker
from simaps_viz.viewer.panels.mend import MendPanel


class StubPage(Page):
    """One person's page."""

    def __init__(self, client: viser.ClientHandle, pages: "MendPages") -> None:
        self.client, self.gui, self._pages = client, client.gui, pages
        self.simap = pages.simap
        self.selected = None
        self._place: tuple[float, float] | None = None
        self.told: list[str] = []
        self.worker = Worker(self.report)
        self._image: viser.ImageHandle | None = None
        self.repaint()
        with self.gui.add_folder("Mend"):
            self.panel = MendPanel(self, pages.mending, login())
        client.scene.on_click()(self._clicked)

    def select(self, instance_id: int | None) -> None:
        self.selected = instance_id
        self._place = None
        self.panel.selection_changed(instance_id)

    def take(self, simap: SIMap) -> None:
        self.simap = simap
        found = None if self._place is None else simap.at(*self._place)
        if self._place is not None:
            self.selected = found.id if found else None
        self.repaint()
        self.panel.map_changed(simap)

    def publish(self, simap: SIMap) -> None:
        self._pages.publish(simap)

    def repaint(self) -> None:
        image = map_image(self.simap, "instance", scale=6)
        if self._image is not None:
            self._image.image = image
            return
        xmin, ymin, xmax, ymax = self.simap.spec.extent_m
        middle = ((xmin + xmax) / 2.0, (ymin + ymax) / 2.0, 0.0)
        self._image = self.client.scene.add_image(
            "/map", image, xmax - xmin, ymax - ymin, format="png", position=middle, cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip

    def submit(self, name, job) -> None:
        self.worker.submit(name, job)

    def say(self, title: str, text: str) -> None:
        self.told.append(text)

    def report(self, error: Exception) -> None:
        self.told.append(f"error: {error!r}")

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        place = ray_on_floor(event.ray_origin, event.ray_direction)
        if place is None or self.panel.take_click(*place):
            return
        found = self.simap.at(*place)
        self.select(None if found is None else found.id)
        self._place = place


class MendPages:
    """Serves the toy map, or another, from construction until ``close``."""

    def __init__(self, mending: Mending, simap: SIMap | None = None) -> None:
        self.mending = mending
        self.simap = simap or mending.simap()
        self.sessions: list[StubPage] = []
        self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        scene = self.server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(hdri=None)
        scene.add_light_ambient("/light", intensity=3.141592653589793)
        xmin, ymin, xmax, ymax = self.simap.spec.extent_m
        camera = self.server.initial_camera
        camera.position, camera.look_at = (
            (0.5 * (xmin + xmax), 0.5 * (ymin + ymax), 7.0),
            (0.5 * (xmin + xmax), 0.5 * (ymin + ymax), 0.0),
        )
        camera.up = (0.0, 1.0, 0.0)
        self.server.on_client_connect(lambda client: self.sessions.append(StubPage(client, self)))
        self.server.on_client_disconnect(self._left)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.get_port()}"

    def publish(self, simap: SIMap) -> None:
        self.simap = simap
        for page in self.sessions:
            page.take(simap)

    def _left(self, client: viser.ClientHandle) -> None:
        self.sessions = [page for page in self.sessions if page.client.client_id != client.client_id]

    def __enter__(self) -> "MendPages":
        return self

    def __exit__(self, *_: object) -> None:
        for page in self.sessions:
            page.worker.stop()
        self.server.stop()
