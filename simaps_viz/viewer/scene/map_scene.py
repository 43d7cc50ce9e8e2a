"""The 3-D scene of a page: the map, the robot, its path, the camera of a frame, scale bar and compass."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
import viser.transforms as vtf
from numpy.typing import ArrayLike, NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.surface import is_shown, layers, point_colors, ray_on_points, solids
from simaps_viz.drawing.texture import TINT, ColorMode, cell_colors, fade_objects, outline_segments
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.geometry import turned_pose, upright_turns
from simaps_viz.mapping.in_space import VOXEL_M, box_in, has_voxels, space_points
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Box, GridSpec, Points, Pose2, Room, SIMap
from simaps_viz.viewer.scene.annotations import Label, Texts, Zoom, draw_lines, label_of, line_share
from simaps_viz.viewer.scene.camera import Extent, with_margin
from simaps_viz.viewer.scene.why_marks import paint_cells

ROBOT = (10, 84, 200)
PATH = (22, 110, 235)
ROOM = (120, 70, 190)
CHANGED: dict[str, Color] = {"/changed": (230, 20, 150), "/changed_2": (255, 140, 0), "/changed_3": (0, 170, 100)}
"""Lines around what changed: those of one change have a colour each, which its name has too, in the page's style."""
OUTLINE_PX = 3.0
ROBOT_RADIUS_M, ROBOT_HEIGHT_M = RobotShape().radius_m, 0.35
RING_CORNERS = 24
PICTURE_M = 0.004
"""Height over the map of a picture that is shown instead of it."""
PARENTS = ("/why",)
"""Nodes whose children come and go; hiding one hides its children."""
LINES = ("/path", "/target", "/selection", *CHANGED, "/cut", "/rooms")
CAMERA = (220, 60, 40)
CAMERA_FOV_RAD, CAMERA_ASPECT, CAMERA_SIZE_M = 0.9, 4 / 3, 0.45
"""The mark of a camera shows where a frame was taken from, not how much was on it."""
NO_SHADOWS: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
FULL_HEIGHT_M = 2.5
"""A cut at this height cuts nothing."""
POINT_M = 1.2 * VOXEL_M
"""Points are drawn a little larger than voxels, or one would see through between them."""
HALF_PRECISION_M = 16.0
MAX_DIMMED = 1_000_000
"""Of more points the colours are not sent anew for each selection; its box is drawn alone."""
_BLANK = np.zeros((1, 1, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class Style:
    """How a map is coloured."""

    mode: ColorMode = "instance"
    lit: frozenset[int] | None = None
    """Instances that keep their colour while all else is dimmed; None dims nothing."""
    until: int | None = None
    """Leave out what no frame up to this one had named; None = leave out nothing."""
    paint: tuple[NDArray, NDArray] | None = None
    """Cells (flat) that get colours of their own, uint8 [n, 3]."""
    faint: frozenset[int] = frozenset()
    """Instances that keep a quarter of their colour."""
    theme: Theme = LIGHT
    """Theme of the page."""
    tint: float = TINT
    """Share of its object's colour in a cell of a photo, 0 to 1."""


class MapScene:
    """The nodes of one page's 3-D scene; every method replaces what it showed before."""

    def __init__(self, page: viser.ViserServer | viser.ClientHandle, simap: SIMap) -> None:
        """Add the scale bar and the compass; the map itself comes with ``show_map``."""
        self._scene = self.nodes = page.scene
        """Viser's scene, for others that draw on it."""
        self._page = page
        self._scene.set_up_direction("+z")
        if isinstance(page, viser.ViserServer):  # else it has light already
            light_up(page.scene)
        self._images: dict[str, tuple[tuple[float, ...], viser.ImageHandle]] = {}
        self._blocks: list[viser.MeshHandle] = []
        self._cloud: _Cloud | None = None
        self._cut_m, self._whole_walls = FULL_HEIGHT_M, False
        self._upright = False
        self._shown: tuple[SIMap, Style] | None = None
        self._theme = LIGHT
        self._outlined: NDArray = np.zeros((0, 2, 3))
        self._boxed: Box | None = None
        self.extent: Extent = (0.0, 0.0, 0.0, 0.0)
        self._pictured: Extent | None = None
        self.fit(simap)
        self._robot = self._add_robot()
        self._parents = [self._scene.add_frame(name, show_axes=False) for name in PARENTS]
        self.texts = Texts(page)
        """The texts on the map."""
        self._zoom = Zoom(page, self._zoomed, assumed_m=self._height_m)
        self._lock = threading.RLock()
        self._camera: CameraMark | None = None
        self._camera_at: NDArray | None = None
        self._badge: viser.LabelHandle | None = None

    @property
    def frame_extent(self) -> Extent:
        """Extent that a camera should show: the map, its scale bar and its compass."""
        return frame_extent(self.extent)

    def fit(self, simap: SIMap) -> bool:
        """Put scale bar and compass next to the seen part of a map; returns whether that part has changed."""
        extent = seen_extent(simap)
        if extent == self.extent:
            return False
        self.extent = extent
        with self._page.atomic():
            self._add_scale_bar()
            self._add_compass()
        return True

    @property
    def theme(self) -> Theme:
        """Light or dark."""
        return self._theme

    def set_theme(self, theme: Theme) -> None:
        """Draw the lines for a light or a dark page; the map's picture and blocks follow with ``show_map``."""
        with self._page.atomic(), self._lock:
            self._theme = theme
            self._add_scale_bar()
            self._add_compass()
            self._draw_outline()

    def show_map(self, simap: SIMap, picture: bytes, style: Style) -> None:
        """Lay a map's picture (PNG, painted in that style, row 0 at the south) on the floor."""
        self._lay("/map", simap.spec, picture, 0.0)
        self._shown = (simap, style)
        self._build_blocks()

    def show_picture(self, spec: GridSpec | None, picture: bytes = b"") -> None:
        """Lay a picture (PNG) over the map, where a grid lies; None takes it away.

        Meanwhile robot, path and marks of the map are hidden, and scale bar and compass are next to the picture.
        """
        with self._page.atomic(), self._lock:
            before = self._pictured
            self._pictured = None if spec is None else spec.extent_m
            if spec is not None:
                self._lay("/picture", spec, picture, PICTURE_M)
            elif "/picture" in self._images:
                self._images.pop("/picture")[1].remove()
            if before != self._pictured:
                self._add_scale_bar()
                self._add_compass()
                self._cover(spec is not None)
        if before is not None and spec is None:
            self._build_blocks()

    def _cover(self, covered: bool) -> None:
        handles = [self._scene.get_handle_by_name(name) for name in LINES]
        for handle in (self._robot, *self._parents, *handles):
            if handle is not None:
                handle.visible = not covered
        if covered:
            self._clear_blocks()
        self.show_camera(self._camera_at)
        if self._badge is not None:
            self.show_badge(self._badge.text if self._badge.visible else "")

    @property
    def _framed(self) -> Extent:
        """Extent next to which scale bar, compass and badge are."""
        return self._pictured or self.extent

    def stand_up(self, upright: bool) -> None:
        """Show what stands on the floor as blocks, or only the flat map."""
        self._upright = upright
        self._body.visible = upright or not isinstance(self._page, viser.ClientHandle)
        if upright:
            self._build_blocks()
        else:
            with self._lock:
                self._clear_blocks()
        if self._boxed is not None:
            self._draw_outline()

    def cut_at(self, height_m: float, *, whole_walls: bool) -> None:
        """Leave out, in the 3-D view, the surface above a height; walls are low unless they are wanted whole."""
        with self._page.atomic(), self._lock:
            self._cut_m, self._whole_walls = height_m, whole_walls
            if self._cloud is not None:
                self._cloud.cut_at(height_m, whole_walls)

    def point_hit(self, origin: ArrayLike, direction: ArrayLike) -> NDArray | None:
        """Return the shown point of the surface that a ray meets, float [3], metres, map frame.

        None where the surface is not shown, or the ray meets nothing of it.
        """
        with self._lock:
            cloud = self._cloud
            shown = None if cloud is None else cloud.shown(self._cut_m, self._whole_walls)
        if cloud is None or shown is None:
            return None
        hit = ray_on_points(cloud.points.positions[shown], origin, direction)
        return None if hit is None else cloud.points.positions[shown[hit]]

    def outline(self, simap: SIMap, instance_id: int | None, then: tuple[SIMap, frozenset[int]] | None = None) -> None:
        """Draw a line around an instance, in the 3-D view its box, or none; else around what it was ``then``."""
        segments, box, named = np.zeros((0, 2, 3)), None, ()
        if then is not None:
            segments = outline_segments(then[0], *then[1], z_m=0.012)
        elif instance_id is not None:
            segments = outline_segments(simap, instance_id, z_m=0.012)
            box, one = box_in(simap, instance_id), simap.by_id(instance_id)
            named = (label_of(one.name, one),)
        self.texts.show("selection", named)
        with self._lock:
            self._outlined, self._boxed = segments, box
            self._draw_outline()

    def show_changed(self, simap: SIMap, ids: Sequence[int], parts: Sequence[int] = (), *, named: bool = False) -> None:
        """Outline instances in other colours than the selected one's, instead of those shown before.

        Args:
            simap: the map.
            ids: of the instances.
            parts: of each instance, which of the colours is its own; empty: all have the first.
            named: whether their names are written on the map, too.
        """
        of_part = dict(zip(ids, parts or [0] * len(ids), strict=True))
        with self._lock, self._page.atomic():
            for number, (name, color) in enumerate(CHANGED.items()):
                mine = [one for one in ids if of_part[one] % len(CHANGED) == number]
                lines = outline_segments(simap, *mine, z_m=0.016 + 0.001 * number)
                draw_lines(self._scene, name, lines, color, OUTLINE_PX, visible=self._pictured is None)
        self.texts.show("change", [label_of(simap.by_id(one).name, simap.by_id(one)) for one in ids] if named else ())

    def show_rooms(self, rooms: Sequence[Room]) -> None:
        """Outline rooms and write their names, instead of those shown before."""
        rings = [np.column_stack([room.polygon_m, np.full(len(room.polygon_m), 0.02)]) for room in rooms]
        sides = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
        with self._lock, self._page.atomic():
            draw_lines(self._scene, "/rooms", np.concatenate([np.zeros((0, 2, 3)), *sides]), ROOM, 2.0)
        self.texts.show("rooms", [Label(room.name, *room.centre_m) for room in rooms])

    def show_robot(self, pose: Pose2) -> None:
        """Put the robot somewhere."""
        with self._page.atomic():
            self._robot.position = (pose.x_m, pose.y_m, 0.0)
            self._robot.wxyz = vtf.SO3.from_z_radians(pose.yaw_rad).wxyz

    def show_path(self, points_m: NDArray, stops_m: Sequence[tuple[float, float]] = ()) -> None:
        """Draw a path on the floor, [n, 2], with a ring as wide as the robot at its end and its stops; n < 2: none."""
        points = np.asarray(points_m, np.float64).reshape(-1, 2)
        lines = [points]
        if len(points) > 1:
            turns = np.linspace(0.0, 2.0 * np.pi, RING_CORNERS + 1)
            ring = ROBOT_RADIUS_M * np.column_stack([np.cos(turns), np.sin(turns)])
            lines += [ring + stop for stop in dict.fromkeys([*stops_m, tuple(points[-1].tolist())])]
        flat = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
        segments = np.pad(flat, ((0, 0), (0, 0), (0, 1)), constant_values=0.03)
        with self._lock:
            draw_lines(self._scene, "/path", segments, PATH, 4.0, visible=self._pictured is None)

    def show_target(self, lines: NDArray) -> None:
        """Draw lines around what a command means, float [n, 2, 3]; n = 0 draws none."""
        with self._lock:
            draw_lines(self._scene, "/target", lines, PATH, OUTLINE_PX, visible=self._pictured is None)

    def show_candidates(self, labels: Sequence[Label]) -> None:
        """Write texts on the map, the most important first; they leave the robot free."""
        x, y, _ = (float(value) for value in self._robot.position)
        robot = Label("", x, y, ROBOT_RADIUS_M, ROBOT_RADIUS_M)
        self.texts.show("command", (*labels, robot) if labels else ())

    def show_badge(self, text: str) -> None:
        """Write a warning next to the map, such as that it is simulated; none when the text is empty."""
        if self._badge is None:
            if not text:
                return
            self._badge = self._scene.add_label("/badge", text, anchor="bottom-left")
        xmin, _, _, ymax = self._framed
        with self._page.atomic():
            self._badge.position = (xmin, ymax, 0.05)
            if text and self._badge.text != text:
                self._badge.text = text
            self._badge.visible = bool(text)

    def show_camera(self, T_map_camera: NDArray | None) -> None:
        """Draw where a frame was taken from, or nothing."""
        with self._lock:
            self._camera_at = T_map_camera
            if T_map_camera is None or self._pictured is not None:
                if self._camera is not None:
                    self._camera.hide()
                return
            if self._camera is None:
                self._camera = CameraMark(self._page)
            self._camera.show(T_map_camera)

    def _height_m(self) -> float:
        _, ymin, _, ymax = self.frame_extent
        return ymax - ymin

    def _zoomed(self) -> None:
        with self._page.atomic(), self._lock:
            if len(self._outlined) or self._boxed is not None:
                self._draw_outline()

    def _draw_outline(self) -> None:
        # In the 3-D view its box; of what no cell shows, from above too.
        boxed = self._boxed if self._upright or not len(self._outlined) else None
        lines = self._outlined if boxed is None else boxed.edges_m
        width = OUTLINE_PX * line_share(lines, self._zoom.metres_per_px())
        color, visible = self._theme.selected, self._pictured is None
        draw_lines(self._scene, "/selection", lines, color, width, visible=visible)

    def _lay(self, name: str, spec: GridSpec, picture: bytes, z_m: float) -> None:
        xmin, ymin, xmax, ymax = spec.extent_m
        before = self._images.get(name)
        with self._page.atomic():
            if before is None or before[0] != spec.extent_m:
                handle = self._scene.add_image(
                    name,
                    _BLANK,
                    xmax - xmin,
                    ymax - ymin,
                    format="png",
                    **NO_SHADOWS,
                    position=((xmin + xmax) / 2.0, (ymin + ymax) / 2.0, z_m),
                )
                self._images[name] = (spec.extent_m, handle)
            # Already encoded, once for all pages; ``image`` would encode it for each.
            self._images[name][1]._data = picture

    def _build_blocks(self) -> None:
        """Build the blocks of the 3-D view, if it is on and no picture covers the map."""
        shown = self._shown
        if shown is None or not self._upright or self._pictured is not None:
            return
        simap, style = shown
        if has_voxels(simap):
            self._show_cloud(shown, simap, style)
            return
        colors = cell_colors(simap, style.mode, lit=style.lit, theme=style.theme)
        fade_objects(colors, simap, style.faint, style.theme)
        if style.paint is not None:
            paint_cells(colors, *style.paint, simap.spec.cols)
        made = list(solids(simap, colors))
        with self._page.atomic(), self._lock:
            if shown is not self._shown or not self._upright or self._pictured is not None:
                return  # which came meanwhile, on another thread
            self._clear_blocks()
            self._blocks = [
                self._scene.add_mesh_simple(
                    f"/blocks/{i}",
                    solid.vertices,
                    solid.faces,
                    color=solid.color,
                    flat_shading=True,
                    **NO_SHADOWS,
                )
                for i, solid in enumerate(made)
            ]

    def _show_cloud(self, shown: tuple[SIMap, Style], simap: SIMap, style: Style) -> None:
        """Show the surface as points; only their colours are sent where the points are those shown already."""
        points = space_points(simap)
        lit = style.lit if len(points.positions) <= MAX_DIMMED else None
        colors = point_colors(simap, points, style.mode, lit=lit, theme=style.theme)
        with self._page.atomic(), self._lock:
            if shown is not self._shown or not self._upright or self._pictured is not None:
                return  # which came meanwhile, on another thread
            if self._cloud is not None and self._cloud.is_of(simap):
                self._cloud.recolor(points, colors)
                return
            self._clear_blocks()
            self._cloud = _Cloud(self._scene, simap, colors)
            self._cloud.cut_at(self._cut_m, self._whole_walls)

    def _clear_blocks(self) -> None:
        if self._cloud is not None:
            self._cloud.remove()
            self._cloud = None
        for block in self._blocks:
            block.remove()
        self._blocks = []

    def _add_scale_bar(self) -> None:
        """Draw a scale bar below the map; a page draws its own, which follows the zoom."""
        if isinstance(self._page, viser.ClientHandle):
            return
        xmin, ymin, xmax, ymax = self._framed
        length = max(n for n in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if n == 0.5 or n <= 0.25 * (xmax - xmin))
        y, tick = ymin - 0.045 * (ymax - ymin), 0.012 * (ymax - ymin)
        a, b = xmin, xmin + length
        bar = [[[a, y, 0], [b, y, 0]], [[a, y - tick, 0], [a, y + tick, 0]], [[b, y - tick, 0], [b, y + tick, 0]]]
        draw_lines(self._scene, "/scale_bar", np.array(bar), self._theme.ink, 2.5)
        self._scene.add_label("/scale_bar/text", f"{length:g} m", position=(b + 2 * tick, y, 0.0), anchor="center-left")

    def _add_compass(self) -> None:
        """Draw an arrow to the north; a page has a button for it, a scene that is exported has nothing else."""
        if isinstance(self._page, viser.ClientHandle):
            return
        _, ymin, xmax, ymax = self._framed
        size = 0.045 * (ymax - ymin)
        x, y = xmax - 0.6 * size, ymin - 0.075 * (ymax - ymin)
        needle = [
            [[x, y, 0], [x, y + size, 0]],
            [[x, y + size, 0], [x - 0.25 * size, y + 0.6 * size, 0]],
            [[x, y + size, 0], [x + 0.25 * size, y + 0.6 * size, 0]],
        ]
        draw_lines(self._scene, "/compass", np.array(needle), self._theme.ink, 2.5)
        self._scene.add_label(
            "/compass/text", "N", position=(x - 0.4 * size, y + 0.5 * size, 0.0), anchor="center-right"
        )

    def _add_robot(self) -> viser.FrameHandle:
        robot = self._scene.add_frame("/robot", show_axes=False)
        self._body = self._scene.add_cylinder(
            "/robot/body",
            ROBOT_RADIUS_M,
            ROBOT_HEIGHT_M,
            color=ROBOT,
            position=(0.0, 0.0, ROBOT_HEIGHT_M / 2.0),
            **NO_SHADOWS,
        )
        if isinstance(self._page, viser.ClientHandle):  # its script draws the robot seen from above
            self._body.visible = False
            return robot
        tip, wing, z = 0.85 * ROBOT_RADIUS_M, 0.55 * ROBOT_RADIUS_M, ROBOT_HEIGHT_M + 0.01
        arrow = np.array([[tip, 0, z], [-wing, wing * 1.1, z], [-0.3 * wing, 0, z], [-wing, -wing * 1.1, z]])
        self._scene.add_mesh_simple(
            "/robot/nose",
            arrow,
            np.array([[0, 1, 2], [0, 2, 3]]),
            color=(255, 255, 255),
            side="double",
            **NO_SHADOWS,
        )
        return robot


class _Cloud:
    """The surface of a map as point clouds, a node for each layer, so that layers are hidden without sending them."""

    def __init__(self, scene: viser.SceneApi, simap: SIMap, colors: NDArray) -> None:
        self.points = space_points(simap)
        self._cells = None if simap.surface is None else simap.surface.cell
        self._layers = layers(simap, self.points)
        self._colors = colors
        # Half precision holds 16 m around the middle to 4 mm.
        xmin, ymin, xmax, ymax = simap.spec.extent_m
        middle = np.array([(xmin + xmax) / 2.0, (ymin + ymax) / 2.0, 0.0])
        precision = "float16" if max(xmax - xmin, ymax - ymin) / 2.0 <= HALF_PRECISION_M else "float32"
        self._nodes = [
            scene.add_point_cloud(
                f"/surface/{number}",
                self.points.positions[part] - middle,
                colors[part],
                point_size=POINT_M,
                point_shape="square",
                point_shading="flat",
                precision=precision,
                position=middle,
            )
            for number, (_, _, part) in enumerate(self._layers)
        ]

    def is_of(self, simap: SIMap) -> bool:
        """Whether the points are those of a map, however it is cut."""
        return simap.surface is not None and simap.surface.cell is self._cells

    def recolor(self, points: Points, colors: NDArray) -> None:
        """Set the colours of the points, and what they belong to; both of the same surface."""
        self.points = points
        for node, (_, _, part) in zip(self._nodes, self._layers, strict=True):
            if not np.array_equal(colors[part], self._colors[part]):
                node.colors = colors[part]
        self._colors = colors

    def cut_at(self, height_m: float, whole_walls: bool) -> None:
        """Show only the layers below a height."""
        for node, (low_m, building, _) in zip(self._nodes, self._layers, strict=True):
            node.visible = is_shown(low_m, building, height_m, whole_walls)

    def shown(self, height_m: float, whole_walls: bool) -> NDArray:
        """Return the indices of the points below a height."""
        parts = [part for low, building, part in self._layers if is_shown(low, building, height_m, whole_walls)]
        return np.concatenate([np.zeros(0, np.int64), *parts])

    def remove(self) -> None:
        """Take the points away."""
        for node in self._nodes:
            node.remove()


class CameraMark:
    """A camera's frustum and the line from it to the floor.

    Made once and then moved: a page that is sent a node anew for every frame shows none of them while they come.
    """

    def __init__(self, page: viser.ViserServer | viser.ClientHandle) -> None:
        """Add the nodes, hidden."""
        self._page = page
        self._frustum = page.scene.add_camera_frustum(
            "/camera",
            CAMERA_FOV_RAD,
            CAMERA_ASPECT,
            scale=CAMERA_SIZE_M,
            thickness=2.5,
            thickness_units="screen",
            color=CAMERA,
            **NO_SHADOWS,
            visible=False,
        )
        upright = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
        self._drop = page.scene.add_line_segments(
            "/camera_dot", upright, CAMERA, thickness=1.5, thickness_units="screen", visible=False
        )

    def show(self, T_map_camera: NDArray) -> None:
        """Show where a frame was taken from, float [4, 4], camera to map, metres."""
        T_map_camera = turned_pose(T_map_camera, upright_turns(T_map_camera))
        x, y, z = (float(value) for value in T_map_camera[:3, 3])
        with self._page.atomic():
            self._frustum.position = (x, y, z)
            self._frustum.wxyz = vtf.SO3.from_matrix(T_map_camera[:3, :3]).wxyz
            self._drop.position = (x, y, 0.0)
            self._drop.scale = (1.0, 1.0, z)
            self._frustum.visible = self._drop.visible = True

    def hide(self) -> None:
        """Hide it."""
        with self._page.atomic():
            self._frustum.visible = self._drop.visible = False


def seen_extent(simap: SIMap) -> Extent:
    """Return the part of the grid that anything was seen of."""
    seen = ~np.isnan(simap.grid.height_m)
    row, col = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if not len(row):
        return simap.spec.extent_m
    s, x0, y0 = simap.spec.cell_size_m, simap.spec.x0_m, simap.spec.y0_m
    return x0 + float(col[0]) * s, y0 + float(row[0]) * s, x0 + float(col[-1] + 1) * s, y0 + float(row[-1] + 1) * s


def frame_extent(extent: Extent) -> Extent:
    """Return what a camera should show of a map with that extent: its scale bar and its compass too."""
    xmin, ymin, xmax, ymax = with_margin(extent)
    return xmin, ymin - 0.06 * (ymax - ymin), xmax, ymax


def light_up(scene: viser.SceneApi) -> None:
    """Light a scene so that colours are as the legend has them on top, and darker on the sides."""
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(hdri=None)
    # A lid gets pi in all, which is what shows a colour unchanged; a side facing south four fifths of that.
    scene.add_light_ambient("/lights/ambient", intensity=1.9)
    scene.add_light_directional("/lights/sun", intensity=1.45, position=(-300.0, -500.0, 1000.0))
