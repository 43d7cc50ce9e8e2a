"""The café (west), with a lounge (south-east) and an office (north-east), 12 x 9 m together."""

from functools import cache

import numpy as np

from simaps_viz.scenes import appliances, props, seating, tables
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.building import (
    CEILING_HEIGHT_M,
    OUTSIDE,
    WALL_THICKNESS_M,
    Opening,
    Spot,
    WallRun,
    place_all,
    slab,
    structure,
)
from simaps_viz.scenes.materials import Texture, paint
from simaps_viz.scenes.place import Place
from simaps_viz.scenes.scene import Scene, SceneObject, assemble, build, place


def _kitchen() -> list[SceneObject]:
    """Furnish the bar along the café's north side: counter with stools in a row, worktop, machines, fridge."""
    worktop, bar = 0.92, 1.06
    board = 1.62
    body = paint("4d6157")
    stone = paint("d6d0c4", m.Texture.PLASTER)
    spots: list[Spot] = [
        ("bar counter", "counter", tables.bar_counter(3.2, paint("5b7468"), m.WALNUT), 2.1, 7.15, 0, -90),
        ("worktop", "counter", tables.cabinet((0.62, 3.6, worktop), body, doors=6, top=stone), 1.95, 8.69, 0, -90),
        ("fridge", "refrigerator", appliances.refrigerator(paint("c9ced0")), 4.2, 8.64, 0, -90),
        ("microwave", "microwave", appliances.microwave(), 3.35, 8.72, worktop, -90),
        ("toaster", "toaster", appliances.toaster(paint("a6483a")), 2.82, 8.75, worktop, -90),
        ("sink", "sink", appliances.sink(), 2.1, 8.68, worktop, -90),
        ("coffee machine", "coffee machine", appliances.coffee_machine(paint("b5453a")), 0.95, 8.7, worktop, -90),
        ("bottle worktop", "bottle", props.bottle(m.GLASS_GREEN), 1.48, 8.82, worktop, 0),
        ("wall board", "shelf", tables.wall_shelf(2.0, m.OAK), 1.6, 8.88, board, -90),
        ("plant board", "potted plant", props.bushy_plant(m.WHITE, radius=0.075, seed=6), 2.42, 8.88, board, 0),
        ("cake", "cake", props.cake(), 1.1, 7.15, bar, 0),
        ("cup bar 1", "cup", props.cup(m.CERAMIC), 1.7, 7.0, bar, 30),
        ("cup bar 2", "cup", props.cup(paint("8fa9b5")), 2.35, 7.05, bar, 250),
        ("wine glass bar", "wine glass", props.wine_glass(m.GLASS_CLEAR), 2.75, 7.02, bar, 0),
        ("vase bar", "vase", props.vase(paint("55788a"), paint("e9e1d2"), scale=0.85), 3.35, 7.2, bar, 0),
        ("laptop bar", "laptop", appliances.laptop(m.CHARCOAL), 0.72, 7.12, bar, 90),
    ]
    for i in range(5):
        spots.append((f"stool {i + 1}", "chair", seating.bar_stool(m.OAK), 1.1 + 0.5 * i, 6.5, 0, 90))
    colors = (m.GLASS_BROWN, m.GLASS_GREEN, paint("8e3b2f"), m.GLASS_GREEN)
    spots += [
        (f"bottle board {i + 1}", "bottle", props.bottle(c), 0.8 + 0.16 * i, 8.88, board, 0)
        for i, c in enumerate(colors)
    ]
    spots += [
        (f"cup board {i + 1}", "cup", props.cup(m.CERAMIC), 1.55 + 0.2 * i, 8.88, board, 40 * i) for i in range(3)
    ]
    return place_all(spots)


def _lounge() -> list[SceneObject]:
    """Furnish the lounge: two couches and two armchairs round a low table, television, books."""
    low = 0.40
    spots: list[Spot] = [
        ("lounge rug", "rug-merged", props.rug(2.5, 2.6, paint("b9a88d", m.Texture.FABRIC), m.NAVY), 9.95, 2.15, 0, 0),
        ("couch east", "couch", seating.couch(3, m.TEAL, m.MUSTARD), 11.54, 2.15, 0, 180),
        ("couch south", "couch", seating.couch(2, m.GREY_FABRIC, m.RUST), 9.75, 0.5, 0, 90),
        ("armchair 1", "chair", seating.armchair(m.MUSTARD), 8.55, 1.72, 0, 0),
        ("armchair 2", "chair", seating.armchair(m.MUSTARD), 8.55, 2.6, 0, 0),
        ("low table", "coffee table", tables.coffee_table(0.6, 1.1, m.WALNUT), 10.05, 2.1, 0, 0),
        ("footstool", "ottoman", seating.stool_pouf(m.RUST), 10.05, 3.08, 0, 0),
        ("tv cabinet", "cabinet", tables.cabinet((0.42, 1.5, 0.5), m.BIRCH, doors=3, top=m.BIRCH), 11.1, 4.42, 0, -90),
        ("tv lounge", "tv", appliances.tv(1.1, stand=True), 11.1, 4.42, 0.5, -90),
        ("shelf lounge", "shelf", tables.bookshelf(1.1, 1.7, m.OAK, boards=4), 7.43, 4.0, 0, 0),
        ("side table", "coffee table", tables.side_table(0.22, m.OAK), 11.62, 3.68, 0, 0),
        ("vase lounge", "vase", props.vase(m.CERAMIC, paint("b97fa3"), scale=0.9), 11.62, 3.68, 0.5, 0),
        ("floor lamp", "lamp", props.floor_lamp(m.LINEN), 8.5, 0.42, 0, 0),
        ("plant lounge west", "potted plant", props.rubber_plant(m.CHARCOAL, height=1.6, seed=7), 7.66, 0.5, 0, 50),
        ("plant lounge east", "potted plant", props.rubber_plant(m.TERRACOTTA, height=1.3, seed=8), 11.5, 0.48, 0, 10),
        ("plant low table", "potted plant", props.bushy_plant(m.WHITE, radius=0.07, seed=9), 10.1, 2.5, low, 0),
        ("cup lounge", "cup", props.cup(m.CERAMIC), 9.9, 1.95, low, 60),
        ("book lounge 1", "book", props.book(paint("44604a")), 10.05, 1.7, low, 15),
        ("book lounge 2", "book", props.book(paint("c2964b"), (0.14, 0.2, 0.022)), 10.06, 1.71, low + 0.028, 40),
        ("remote", "remote", props.remote_control(), 10.2, 2.15, low, 20),
        ("teddy bear", "teddy bear", props.teddy_bear(paint("a87b4f", m.Texture.FABRIC)), 11.42, 2.72, 0.5, 190),
        ("clock lounge", "clock", props.clock(m.OAK), 8.35, 4.64, 1.95, -90),
        ("picture lounge", "picture", props.picture(0.9, 0.65, ("c9b79a", "5f7464", "d08b4c")), 12.0, 2.15, 1.6, 180),
    ]
    for i, z in enumerate(tables.shelf_heights(1.7, 4)[:3]):
        spots.append((f"books lounge {i + 1}", "book", props.book_row(0.62, 10 + i), 7.41, 3.82 + 0.09 * i, z, 0))
    spots.append(
        (
            "vase shelf",
            "vase",
            props.vase(m.TERRACOTTA, paint("e4c15a"), scale=0.7),
            7.43,
            4.3,
            tables.shelf_heights(1.7, 4)[3],
            0,
        )
    )
    return place_all(spots)


def _office() -> list[SceneObject]:
    """Furnish the office: two desks side by side, one under the window, shelves."""
    h = 0.74
    spots: list[Spot] = [
        ("desk 1", "desk", tables.desk(m.BIRCH), 8.62, 8.62, 0, -90),
        ("desk 2", "desk", tables.desk(m.BIRCH), 10.14, 8.62, 0, -90),
        ("desk 3", "desk", tables.desk(m.BIRCH), 11.62, 6.55, 0, 180),
        ("office chair 1", "chair", seating.office_chair(m.NAVY), 8.55, 7.92, 0, 80),
        ("office chair 2", "chair", seating.office_chair(m.NAVY), 10.2, 7.88, 0, 105),
        ("office chair 3", "chair", seating.office_chair(m.GREY_FABRIC), 10.92, 6.5, 0, -10),
        ("monitor 1", "tv", appliances.tv(0.56, stand=True), 8.62, 8.8, h, -90),
        ("monitor 2", "tv", appliances.tv(0.6, stand=True), 10.14, 8.8, h, -90),
        ("keyboard 1", "keyboard", appliances.keyboard(m.WHITE), 8.6, 8.48, h, -90),
        ("keyboard 2", "keyboard", appliances.keyboard(m.CHARCOAL), 10.12, 8.48, h, -90),
        ("mouse 1", "mouse", appliances.computer_mouse(), 8.95, 8.48, h, 80),
        ("mouse 2", "mouse", appliances.computer_mouse(), 10.47, 8.48, h, 95),
        ("laptop office", "laptop", appliances.laptop(m.STEEL), 11.55, 6.6, h, 180),
        ("cup office 1", "cup", props.cup(m.TERRACOTTA), 8.15, 8.5, h, 10),
        ("cup office 2", "cup", props.cup(m.CERAMIC), 11.5, 6.15, h, 100),
        ("bottle office", "bottle", props.bottle(paint("88a9b5")), 10.66, 8.6, h, 0),
        ("book office 1", "book", props.book(paint("93593a")), 9.68, 8.55, h, 100),
        ("book office 2", "book", props.book(paint("33363d")), 11.6, 7.02, h, 5),
        ("book office 3", "book", props.book(paint("3c7070"), (0.15, 0.2, 0.03)), 11.6, 7.02, h + 0.028, 25),
        ("plant desk", "potted plant", props.bushy_plant(m.TERRACOTTA, radius=0.065, seed=12), 9.12, 8.75, h, 0),
        ("shelf office", "shelf", tables.bookshelf(1.3, 1.6, m.WALNUT, boards=4), 11.2, 4.93, 0, 90),
        ("office bench", "bench", seating.bench(1.1, m.BIRCH, back=False), 7.5, 5.55, 0, 0),
        ("suitcase", "suitcase", props.suitcase(paint("b06a3b")), 7.52, 7.75, 0, -20),
        ("backpack office", "backpack", props.backpack(m.NAVY, m.CHARCOAL), 7.5, 5.75, 0.462, 10),
        ("bin", "trash can", props.trash_can(m.STEEL), 7.55, 8.72, 0, 0),
        ("plant office", "potted plant", props.rubber_plant(m.WHITE, height=1.45, seed=13), 11.55, 8.5, 0, 30),
        ("plant bench", "potted plant", props.snake_plant(m.CERAMIC, seed=14), 8.75, 5.02, 0, 0),
        ("clock office", "clock", props.clock(m.STEEL), 9.38, 9.0, 2.05, -90),
        ("picture office", "picture", props.picture(0.55, 0.75, ("dcd3c2", "34465f", "b3593a")), 7.26, 5.55, 1.55, 0),
    ]
    for i, z in enumerate(tables.shelf_heights(1.6, 4)):
        spots.append(
            (f"books office {i + 1}", "book", props.book_row((0.9, 1.15, 0.7, 1.0)[i], 20 + i), 11.2, 4.91, z, 90)
        )
    return place_all(spots)


WIDTH_M = 12.0
DEPTH_M = 9.0
ROOM_WALL_X = 7.2
"""Middle line of the wall between the café and the two other rooms."""
ROOM_WALL_Y = 4.7
"""Middle line of the wall between lounge and office."""

ROOMS_M = (
    (-np.inf, -np.inf, ROOM_WALL_X, np.inf),
    (ROOM_WALL_X, -np.inf, np.inf, ROOM_WALL_Y),
    (ROOM_WALL_X, ROOM_WALL_Y, np.inf, np.inf),
)
"""Café, lounge and office, as far as lamps shine."""
LIGHTS_M = ((2.1, 7.7, 2.5), (5.5, 7.6, 2.5), (8.7, 7.6, 2.5), (10.6, 6.6, 2.5), (10.0, 2.6, 2.5))
"""Plain lights without a visible lamp."""

_CREAM = paint("eee4d3", Texture.PLASTER)
_BRICK = paint("b98468", Texture.BRICK)
_GREEN = paint("b9c4ae", Texture.PLASTER)
_BLUE_GREY = paint("cfd6da", Texture.PLASTER)


def wall_runs() -> tuple[WallRun, ...]:
    """List the walls; the right side of an outer wall is its inner side."""
    t = WALL_THICKNESS_M
    west, east, south, north = -t / 2, WIDTH_M + t / 2, -t / 2, DEPTH_M + t / 2
    x, y = ROOM_WALL_X, ROOM_WALL_Y
    return (
        WallRun("wall cafe west", (west, -t), (west, DEPTH_M + t), _CREAM, OUTSIDE, (Opening(2.3, 5.1, 0.75, 2.3),)),
        WallRun("wall cafe north", (0, north), (x, north), _BRICK, OUTSIDE),
        WallRun("wall office north", (x, north), (WIDTH_M, north), _BLUE_GREY, OUTSIDE),
        WallRun("wall office east", (east, DEPTH_M + t), (east, y), _BLUE_GREY, OUTSIDE, (Opening(1.5, 3.4, 1, 2.3),)),
        WallRun("wall lounge east", (east, y), (east, -t), _GREEN, OUTSIDE),
        WallRun("wall lounge south", (WIDTH_M, south), (x, south), _GREEN, OUTSIDE, (Opening(0.9, 3.7, 0.95, 2.35),)),
        WallRun(
            "wall cafe south", (x, south), (0, south), _CREAM, OUTSIDE,
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
        build("floor cafe", "floor", slab(0, 0, x, tiles_from, paint("b58a5f", Texture.PLANKS), top=0)),
        build("floor bar", "floor", slab(0, tiles_from, x, DEPTH_M, paint("b7b0a4", Texture.TILES), top=0)),
        build("floor lounge", "floor", slab(x, 0, WIDTH_M, y, paint("94694a", Texture.PLANKS), top=0)),
        build("floor office", "floor", slab(x, y, WIDTH_M, DEPTH_M, paint("7d848a", Texture.CARPET), top=0)),
        build("ceiling", "ceiling", slab(0, 0, WIDTH_M, DEPTH_M, paint("f4f1ea"), top=CEILING_HEIGHT_M + 0.05)),
    ]
    return [*objects, *structure(wall_runs())]


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
    wall_x = ROOM_WALL_X - WALL_THICKNESS_M / 2
    objects.append(place("clock cafe", "clock", props.clock(m.BLACK_METAL), wall_x, 4.9, 2.05, yaw_deg=180))
    for i, y in enumerate((3.75, 4.25)):
        art = props.picture(0.4, 0.55, (("d9c7a0", "8a5a44", "c9772f"), ("a9bfc4", "3f6267", "e4d6a8"))[i])
        objects.append(place(f"picture cafe {i + 1}", "picture", art, wall_x, y, 1.6, yaw_deg=180))
    for i, (x, y) in enumerate(((1.6, 4.35), (4.5, 4.95), (1.6, 1.65), (4.4, 1.3), (5.4, 1.3))):
        lamp = props.pendant_lamp(m.BLACK_METAL if i < 3 else m.BRASS, drop=0.6)
        objects.append(place(f"pendant {i + 1}", "lamp", lamp, x, y, CEILING_HEIGHT_M))
    return objects


@cache
def cafe_scene() -> Scene:
    """Build the whole place (once a process)."""
    objects = [*building(), *_cafe_tables(), *_cafe_things(), *_kitchen(), *_lounge(), *_office()]
    return assemble(objects, rooms_m=ROOMS_M, lights_m=LIGHTS_M)


STATIONS: tuple[tuple[float, float, float, float], ...] = (
    # x, y of the camera; x, y of what it looks at there
    (6.30, 3.50, 4.50, 4.90),
    (5.60, 3.05, 4.90, 1.60),
    (4.30, 2.95, 4.60, 1.30),
    (3.50, 2.85, 1.90, 1.50),
    (2.90, 2.95, 1.30, 1.90),
    (2.95, 2.10, 1.50, 1.60),
    (2.95, 1.30, 1.40, 1.60),
    (2.95, 2.00, 1.10, 2.60),
    (2.80, 2.80, 1.20, 3.90),
    (2.75, 3.30, 1.60, 4.40),
    (3.00, 4.30, 1.60, 4.40),
    (2.95, 5.45, 1.60, 6.60),
    (2.20, 5.68, 1.50, 6.80),
    (1.40, 5.66, 2.20, 6.70),
    (2.60, 5.72, 3.60, 6.60),
    (3.70, 6.30, 2.20, 7.00),
    (4.35, 7.10, 2.60, 7.80),
    (4.15, 7.85, 2.20, 8.30),
    (3.60, 7.93, 1.60, 8.60),
    (4.30, 7.70, 2.60, 8.80),
    (4.90, 7.10, 3.80, 8.60),
    (5.60, 6.70, 4.20, 8.60),
    (6.00, 6.65, 5.90, 8.40),
    (6.60, 6.80, 8.00, 6.80),
    (7.20, 6.80, 8.40, 7.60),
    (8.20, 6.75, 8.60, 8.50),
    (9.30, 6.70, 9.90, 8.50),
    (9.90, 6.75, 11.40, 7.60),
    (9.95, 6.30, 11.50, 6.40),
    (9.80, 5.95, 11.20, 5.00),
    (9.30, 6.20, 8.00, 5.30),
    (9.25, 5.90, 7.60, 6.60),
    (9.60, 5.50, 9.64, 4.20),
    (9.64, 4.70, 9.90, 2.80),
    (9.62, 4.00, 10.90, 3.90),
    (9.40, 3.50, 11.30, 2.60),
    (9.36, 2.60, 10.60, 2.00),
    (9.36, 1.75, 9.90, 0.50),
    (9.60, 1.24, 11.40, 1.40),
    (10.40, 1.24, 11.40, 2.20),
    (10.75, 1.70, 10.90, 3.80),
    (10.75, 2.60, 9.90, 3.60),
    (10.60, 3.75, 8.80, 2.40),
    (9.50, 3.65, 8.40, 2.10),
    (8.70, 3.55, 7.60, 4.00),
    (7.95, 3.05, 8.30, 1.90),
    (7.75, 2.60, 7.80, 0.80),
    (7.20, 2.50, 5.20, 2.20),
    (6.50, 2.50, 4.90, 1.20),
    (6.42, 1.90, 4.80, 0.60),
    (6.35, 2.60, 5.00, 2.60),
    (6.20, 3.40, 5.60, 5.00),
    (5.95, 4.60, 4.50, 5.00),
    (5.80, 5.80, 4.50, 4.90),
    (4.70, 6.20, 4.40, 5.00),
    (3.30, 5.75, 4.30, 4.90),
    (3.05, 4.60, 4.30, 4.95),
    (3.30, 3.50, 4.40, 4.80),
    (3.60, 3.00, 2.40, 4.00),
)
"""Where the walk passes and what it turns to."""

PLACE = Place("cafe", "A café with lounge and office of our own making", cafe_scene, lambda: STATIONS)
