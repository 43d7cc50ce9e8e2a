"""One HTML file of a map, its growth and a robot's drive. It opens from disk and needs no network."""

import contextlib
import io
import re
from html import escape
from importlib import resources

import numpy as np
import viser

from simaps_viz.drawing.legend import counts_text, legend_html, title_of
from simaps_viz.drawing.texture import map_image
from simaps_viz.events import Progress
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.shared import png
from simaps_viz.viewer.scene.camera import set_first_view
from simaps_viz.viewer.scene.map_scene import MapScene, Style, light_up
from simaps_viz.viewer.share.story import Drive, Look, TimeStep, is_simulated, origin_text, time_steps

MAX_TIME_STEPS = 48
GROWTH_S = 7.0
"""How long the map grows."""
HOLD_S = 1.5
TICK_S = 0.08
MAX_DRIVE_S = 20.0
MAX_TEXTURE_PIXELS, MAX_PER_CELL = 1300, 4
ASPECT = 1.6
"""Width over height of the window the camera is set for."""
BESIDE = 0.42
"""Room for the text left of the map, as a share of the map's width."""
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; style-src 'unsafe-inline' data:; "
    "img-src data: blob:; font-src data:; connect-src data: blob:; worker-src blob: data:; media-src data: blob:"
)
"""Forbids the file to ask any network for anything."""


def page_html(
    simap: SIMap,
    *,
    drive: Drive | None = None,
    look: Look | None = None,
    progress: Progress | None = None,
) -> bytes:
    """Make the page, UTF-8; arguments as in `files.share_bytes`."""
    with contextlib.redirect_stdout(io.StringIO()):  # viser's banner
        server = viser.ViserServer(host="127.0.0.1", port=0, label="SI Maps", verbose=False)
    try:
        html = _record(server, simap, drive, look, progress)
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
    return _with_overlay(html, simap, drive).encode()


def overlay_html(simap: SIMap, drive: Drive | None = None) -> str:
    """Return the text that lies over the page: title, origin, counts, legend, the command."""
    badge = '<span class="badge">simulated</span> ' if is_simulated(simap) else ""
    said = ""
    if drive is not None:
        said = f"<p><b>“{escape(drive.command)}”</b><br>{escape(drive.outcome)} The drive is simulated.</p>"
    parts = [
        f"<h1>{escape(title_of(simap))}</h1>",
        f'<p class="dim">{badge}{escape(origin_text(simap))}</p>',
        f"<p>{escape(counts_text(simap))}</p>",
        said,
        f'<details open><summary>Legend</summary><div class="legend">{legend_html(simap, "instance")}</div></details>',
        '<p class="dim">Drag to turn, right drag to move, wheel to zoom. Below: play, pause, scrub.</p>',
    ]
    return f'<aside id="simaps" aria-label="About this map">{"".join(parts)}</aside>'


def _record(
    server: viser.ViserServer,
    simap: SIMap,
    drive: Drive | None,
    look: Look | None,
    progress: Progress | None,
) -> str:
    """Play the build and the drive on a server without pages, and return what it recorded as HTML."""
    scene = MapScene(server, simap)
    light_up(server.scene)
    # Look straight down, with the map to the right of the text.
    xmin, ymin, xmax, ymax = scene.frame_extent
    room, head = BESIDE * (xmax - xmin), 0.06 * (ymax - ymin)
    set_first_view(server, (xmin - room, ymin - head / 3.0, xmax, ymax + head), ASPECT)
    _, _, _, ymax = scene.extent
    label = server.scene.add_label(
        "/caption", "", position=(sum(scene.extent[0::2]) / 2.0, ymax + 0.03 * (ymax - scene.extent[1]), 0.0),
        anchor="bottom-center", font_screen_scale=1.3,
    )  # fmt: skip
    robot = server.scene.get_handle_by_name("/robot")
    if robot is not None:
        robot.visible = False
    story = list(time_steps(simap, MAX_TIME_STEPS, look))
    total = max(1, len(story) + (0 if drive is None else 1))
    recorder = server.get_scene_serializer()
    for at, step in enumerate(story, 1):
        scene.show_map(simap, _png(simap, step), Style())
        label.text = f"Building the map · {step.words}"
        recorder.insert_sleep(GROWTH_S / len(story))
        if progress:
            progress("writing the page", at, total)
    if not story:
        scene.show_map(simap, _png(simap, None), Style())
    if drive is None:
        label.text = counts_text(simap)
    else:
        recorder.insert_sleep(HOLD_S)
        label.text = f"“{drive.command}”"
        if robot is not None:
            robot.visible = True
        scene.show_path(drive.path_m)
        duration = drive.trajectory.duration_s
        seconds = min(duration, MAX_DRIVE_S)
        for share in np.linspace(0.0, 1.0, max(2, int(seconds / TICK_S))).tolist():
            scene.show_robot(drive.trajectory.at(share * duration))
            recorder.insert_sleep(TICK_S)
        label.text = drive.caption
    if story or drive is not None:
        recorder.insert_sleep(2 * HOLD_S)
    html = recorder.as_html()
    if progress:
        progress("writing the page", total, total)
    return html


def _png(simap: SIMap, step: TimeStep | None) -> bytes:
    """Paint the map at a time step of its build, PNG, row 0 at the south; None: the finished map."""
    spec = simap.spec
    scale = int(np.clip(MAX_TEXTURE_PIXELS // max(spec.shape), 1, MAX_PER_CELL))
    shown, hidden = (simap, ()) if step is None else (step.simap, step.hidden.tolist())
    return png(map_image(shown, "instance", hidden=hidden, scale=scale))


def _with_overlay(html: str, simap: SIMap, drive: Drive | None) -> str:
    """Put policy, title and text into viser's page."""
    css = resources.files("simaps_viz.viewer.share").joinpath("page.css").read_text(encoding="utf-8")
    head = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><style>{css}</style>'
    title = f"<title>{escape(title_of(simap))} · SI Maps</title>"
    html = re.sub(r"<title>.*?</title>", lambda _: title, html, count=1, flags=re.DOTALL)
    # The policy has to stand before everything it is for; the text after everything else.
    start = re.search(r"<head[^>]*>", html)
    at = start.end() if start else 0
    html = html[:at] + head + html[at:]
    end = html.rindex("</body>")
    return html[:end] + overlay_html(simap, drive) + html[end:]
