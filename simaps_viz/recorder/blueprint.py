"""What the recording looks like when it is opened."""

import rerun.blueprint as rrb

from simaps_viz.recorder.map_pictures import GROUND, UNSEEN

MARGIN_M = 0.3
POINTS_FRAMES = 10
"""The 3-D view shows the points of so many frames up to this one; without a graphics card more are slow."""
PLAYBACK_FPS = 10.0

Extent = tuple[float, float, float, float]
"""xmin, ymin, xmax, ymax, map frame, metres."""


def build_blueprint(extent_m: Extent | None = None) -> rrb.Blueprint:
    """Lay the views out so that they can be read at 640 pixels of width too: what is seen above, the map below.

    Args:
        extent_m: what the map views show; None while nobody knows.
    """
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(_camera_views(), _room_and_counts()),
            _map_views(extent_m),
            rrb.TextDocumentView(origin="/now", name="Now", titlebar=False),
            row_shares=[0.40, 0.52, 0.08],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="frame", fps=PLAYBACK_FPS, play_state="paused"),
        auto_views=False,
    )


def _camera_views() -> rrb.Tabs:
    names = {"color": "Camera", "segmentation": "Segments", "depth": "Depth"}
    views = [rrb.Spatial2DView(origin=f"/world/camera/{path}", name=name) for path, name in names.items()]
    return rrb.Tabs(*views, active_tab=0)


def _room_and_counts() -> rrb.Tabs:
    recent = rrb.VisibleTimeRanges(
        rrb.VisibleTimeRange(
            "frame",
            start=rrb.TimeRangeBoundary.cursor_relative(seq=-POINTS_FRAMES),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
    )
    room = rrb.Spatial3DView(
        origin="/world",
        name="3-D",
        contents=["+ /world/**", "- /world/camera/depth", "- /world/camera/segmentation"],
        overrides={"/world/points": [recent]},
    )
    counts = rrb.Vertical(
        rrb.TimeSeriesView(origin="/counts", name="Cells and edges", contents=["/counts/cells/**", "/counts/edges"]),
        rrb.TimeSeriesView(origin="/counts/few", name="Classes and communities"),
        name="Counts",
    )
    about = rrb.TextDocumentView(origin="/about", name="About")
    log = rrb.TextLogView(origin="/log", name="Log")
    return rrb.Tabs(room, counts, about, log, active_tab=0)


def _map_views(extent_m: Extent | None) -> rrb.Tabs:
    bounds = None
    if extent_m is not None:
        xmin, ymin, xmax, ymax = extent_m
        bounds = rrb.VisualBounds2D(
            x_range=(xmin - MARGIN_M, xmax + MARGIN_M), y_range=(-ymax - MARGIN_M, -ymin + MARGIN_M)
        )
    shown = {
        "Objects": ["/map/ground", "/map/objects", "/map/camera", "/map/names", "/map/merge"],
        "Classes": ["/map/classes", "/map/camera"],
        "New edges": ["/map/ground", "/map/edges", "/map/camera"],
        "Heights": ["/map/heights", "/map/camera"],
    }
    views = [
        rrb.Spatial2DView(
            origin="/map", name=name, contents=contents, visual_bounds=bounds, background=GROUND[UNSEEN][2][:3]
        )
        for name, contents in shown.items()
    ]
    return rrb.Tabs(*views, active_tab=0)
