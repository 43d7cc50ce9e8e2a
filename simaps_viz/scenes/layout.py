"""What stands where: a café (west), a lounge (south-east) and an office (north-east), 12 x 9 m together.

World: metres, z up, floor at z = 0, x east 0 to 12, y north 0 to 9. Yaw is counter-clockwise from +x and turns
the front of a model (+x) to where it looks.
"""

from functools import cache

import numpy as np

from simaps_viz.scenes import appliances, props, seating, tables
from simaps_viz.scenes import architecture as arch
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.architecture import Opening, WallRun
from simaps_viz.scenes.layout_rooms import cafe_kitchen, lounge, office
from simaps_viz.scenes.materials import Texture, paint
from simaps_viz.scenes.scene import Scene, SceneObject, assemble, build, place

WIDTH_M = 12.0
DEPTH_M = 9.0
ROOM_WALL_X = 7.2
"""Middle line of the wall between the café and the two other rooms."""
ROOM_WALL_Y = 4.7
"""Middle line of the wall between lounge and office."""

_CREAM = paint("eee4d3", Texture.PLASTER)
_BRICK = paint("b98468", Texture.BRICK)
_GREEN = paint("b9c4ae", Texture.PLASTER)
_BLUE_GREY = paint("cfd6da", Texture.PLASTER)
_OUTSIDE = paint("a9a399", Texture.PLASTER)


def wall_runs() -> tuple[WallRun, ...]:
    """List the walls; the right side of an outer wall is its inner side."""
    t = arch.WALL_THICKNESS_M
    west, east, south, north = -t / 2, WIDTH_M + t / 2, -t / 2, DEPTH_M + t / 2
    x, y = ROOM_WALL_X, ROOM_WALL_Y
    return (
        WallRun("wall cafe west", (west, -t), (west, DEPTH_M + t), _CREAM, _OUTSIDE, (Opening(2.3, 5.1, 0.75, 2.3),)),
        WallRun("wall cafe north", (0, north), (x, north), _BRICK, _OUTSIDE),
        WallRun("wall office north", (x, north), (WIDTH_M, north), _BLUE_GREY, _OUTSIDE),
        WallRun("wall office east", (east, DEPTH_M + t), (east, y), _BLUE_GREY, _OUTSIDE, (Opening(1.5, 3.4, 1, 2.3),)),
        WallRun("wall lounge east", (east, y), (east, -t), _GREEN, _OUTSIDE),
        WallRun("wall lounge south", (WIDTH_M, south), (x, south), _GREEN, _OUTSIDE, (Opening(0.9, 3.7, 0.95, 2.35),)),
        WallRun(
            "wall cafe south", (x, south), (0, south), _CREAM, _OUTSIDE,
            (Opening(1.0, 3.5, 0.75, 2.3), Opening(4.2, 6.5, 0.75, 2.3)),
        ),
        WallRun("wall cafe lounge", (x, 0), (x, y), _GREEN, _CREAM, (Opening(1.9, 3.1),)),
        WallRun("wall cafe office", (x, y), (x, DEPTH_M), _BLUE_GREY, _CREAM, (Opening(1.6, 2.6),)),
        WallRun("wall lounge office", (x + t / 2, y), (WIDTH_M, y), _GREEN, _BLUE_GREY, (Opening(1.94, 2.94),)),
    )  # fmt: skip


def building() -> list[SceneObject]:
    """Build floors, ceiling, walls and windows."""
    x, y = ROOM_WALL_X, ROOM_WALL_Y
    tiles_from = 6.75
    objects = [
        build("floor cafe", "floor", arch.slab(0, 0, x, tiles_from, paint("b58a5f", Texture.PLANKS), top=0)),
        build("floor bar", "floor", arch.slab(0, tiles_from, x, DEPTH_M, paint("b7b0a4", Texture.TILES), top=0)),
        build("floor lounge", "floor", arch.slab(x, 0, WIDTH_M, y, paint("94694a", Texture.PLANKS), top=0)),
        build("floor office", "floor", arch.slab(x, y, WIDTH_M, DEPTH_M, paint("7d848a", Texture.CARPET), top=0)),
        build(
            "ceiling", "ceiling", arch.slab(0, 0, WIDTH_M, DEPTH_M, paint("f4f1ea"), top=arch.CEILING_HEIGHT_M + 0.05)
        ),
    ]
    for run in wall_runs():
        objects.append(build(run.name, "wall", arch.wall(run)))
        for i, hole in enumerate(o for o in run.openings if o.is_window):
            name = run.name.replace("wall", "window") + f" {i + 1}"
            objects.append(build(name, "window-other", arch.window(run, hole)))
    return objects


def _round_group(
    name: str, x: float, y: float, *, chairs: int, radius: float, distance: float, turn_deg: float, top: m.Material
) -> list[SceneObject]:
    """Set chairs evenly round a round table, their seats' middles ``distance`` from the table's."""
    objects = [place(f"{name} table", "dining table", tables.round_table(radius, top), x, y)]
    seats = (m.SAGE, m.MUSTARD, m.TEAL, m.LINEN)
    for i in range(chairs):
        angle = np.deg2rad(turn_deg + 360.0 * i / chairs)
        model = seating.cafe_chair(m.OAK if chairs % 2 else m.WALNUT, seats[chairs % len(seats)])
        at = (x + distance * np.cos(angle), y + distance * np.sin(angle))
        yaw = np.rad2deg(angle) + 180.0
        objects.append(place(f"{name} chair {i + 1}", "chair", model, *at, yaw_deg=float(yaw)))
    return objects


def _cafe_tables() -> list[SceneObject]:
    """Furnish the café's floor: three round groups with chairs 5-20 cm apart, a long table with chairs in a row."""
    objects = _round_group("west", 1.6, 4.35, chairs=5, radius=0.5, distance=0.61, turn_deg=20, top=m.BIRCH)
    objects += _round_group("middle", 4.5, 4.95, chairs=6, radius=0.55, distance=0.725, turn_deg=10, top=m.WALNUT)
    objects += _round_group("corner", 1.6, 1.65, chairs=4, radius=0.5, distance=0.53, turn_deg=35, top=m.OAK)
    objects.append(place("long table", "dining table", tables.long_table(0.8, 2.3, m.OAK), 4.9, 1.3, yaw_deg=90))
    for i in range(4):
        shell = seating.shell_chair((m.TEAL, m.RUST, m.LINEN, m.MUSTARD)[i])
        objects.append(place(f"row chair {i + 1}", "chair", shell, 4.06 + 0.555 * i, 1.96, yaw_deg=-90))
    objects.append(place("window bench", "bench", seating.bench(2.2, m.OAK, back=True), 4.9, 0.5, yaw_deg=90))
    objects.append(place("nook table", "dining table", tables.round_table(0.36, m.BIRCH), 5.55, 8.25))
    for i, side in enumerate((-1, 1)):
        shell = seating.shell_chair(m.RUST)
        objects.append(place(f"nook chair {i + 1}", "chair", shell, 5.55 + side * 0.53, 8.25, yaw_deg=90 + side * 90))
    return objects


def _cafe_things() -> list[SceneObject]:
    """Put things on the café's tables, walls and floor."""
    h = 0.74
    on_table = [
        ("vase west", "vase", props.vase(m.WHITE, paint("d98c8c"), scale=0.8), 1.6, 4.4, h),
        ("cup west 1", "cup", props.cup(m.CERAMIC), 1.85, 4.2, h),
        ("cup west 2", "cup", props.cup(paint("8fa9b5")), 1.35, 4.55, h),
        ("laptop middle", "laptop", appliances.laptop(m.STEEL), 4.72, 5.05, h),
        ("cup middle", "cup", props.cup(m.CERAMIC), 4.45, 5.3, h),
        ("bottle middle", "bottle", props.bottle(m.GLASS_GREEN), 4.3, 4.9, h),
        ("wine glass middle", "wine glass", props.wine_glass(m.GLASS_CLEAR), 4.42, 4.65, h),
        (
            "bowl corner",
            "bowl",
            props.bowl(m.TERRACOTTA, (paint("c9402f"), paint("d98f2b"), paint("a3b34b"))),
            1.6,
            1.65,
            h,
        ),
        ("cup corner", "cup", props.cup(m.TERRACOTTA), 1.85, 1.85, h),
        ("book corner", "book", props.book(paint("2f5266")), 1.35, 1.5, h),
        ("vase long", "vase", props.vase(m.TERRACOTTA, paint("e4c15a")), 4.9, 1.3, h),
        ("bottle long", "bottle", props.bottle(m.GLASS_BROWN), 5.25, 1.4, h),
        ("bowl long", "bowl", props.bowl(m.CERAMIC, (paint("d98f2b"),) * 4), 4.4, 1.3, h),
        ("cup long 1", "cup", props.cup(m.CERAMIC), 4.06, 1.5, h),
        ("cup long 2", "cup", props.cup(paint("8fa9b5")), 5.7, 1.45, h),
        ("book long", "book", props.book(paint("7c3b36")), 5.72, 1.12, h),
        ("cup nook", "cup", props.cup(m.TERRACOTTA), 5.42, 8.3, h),
        ("handbag", "handbag", props.handbag(paint("7a3b2c")), 4.15, 0.48, 0.462),
    ]
    objects = [
        place(name, label, model, x, y, z, yaw_deg=37.0 * i) for i, (name, label, model, x, y, z) in enumerate(on_table)
    ]
    floor = [
        ("plant south west", "potted plant", props.rubber_plant(m.TERRACOTTA, seed=1), 0.42, 0.42, 20),
        ("plant south east", "potted plant", props.rubber_plant(m.WHITE, height=1.35, seed=2), 6.75, 0.45, 70),
        ("plant stools", "potted plant", props.snake_plant(m.CHARCOAL, seed=3), 0.3, 5.75, 0),
        ("plant nook", "potted plant", props.rubber_plant(m.CERAMIC, height=1.25, seed=4), 6.75, 8.62, 40),
        ("plant cafe east", "potted plant", props.snake_plant(m.TERRACOTTA, seed=5), 6.88, 4.35, 10),
        ("backpack cafe", "backpack", props.backpack(m.RUST, m.CHARCOAL), 2.36, 5.08, 200),
        ("coat stand", "coat rack", props.coat_stand(), 6.85, 5.5, 15),
    ]
    objects += [place(name, label, model, x, y, yaw_deg=yaw) for name, label, model, x, y, yaw in floor]
    wall_x = ROOM_WALL_X - arch.WALL_THICKNESS_M / 2
    objects.append(place("clock cafe", "clock", props.clock(m.BLACK_METAL), wall_x, 4.9, 2.05, yaw_deg=180))
    for i, y in enumerate((3.75, 4.25)):
        art = props.picture(0.4, 0.55, (("d9c7a0", "8a5a44", "c9772f"), ("a9bfc4", "3f6267", "e4d6a8"))[i])
        objects.append(place(f"picture cafe {i + 1}", "picture", art, wall_x, y, 1.6, yaw_deg=180))
    for i, (x, y) in enumerate(((1.6, 4.35), (4.5, 4.95), (1.6, 1.65), (4.4, 1.3), (5.4, 1.3))):
        lamp = props.pendant_lamp(m.BLACK_METAL if i < 3 else m.BRASS, drop=0.6)
        objects.append(place(f"pendant {i + 1}", "lamp", lamp, x, y, arch.CEILING_HEIGHT_M))
    return objects


@cache
def cafe_scene() -> Scene:
    """Build the whole place (once a process)."""
    return assemble([*building(), *_cafe_tables(), *_cafe_things(), *cafe_kitchen(), *lounge(), *office()])
