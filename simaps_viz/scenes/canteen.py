"""A canteen, 15 x 10 m: tables placed tightly in a hall, a serving counter, a kitchen and a room for washing up."""

from functools import cache

import numpy as np

from simaps_viz.scenes import appliances, household, props, seating, tables
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.building import CEILING_HEIGHT_M, Hole, Room, Spot, furnished
from simaps_viz.scenes.materials import Texture, paint
from simaps_viz.scenes.place import Place
from simaps_viz.scenes.scene import Scene
from simaps_viz.scenes.walk import plan_stations

_WHITE = paint("efeeea", Texture.PLASTER)
_TILED = paint("dfe3e2", Texture.TILES)
ROOMS = (
    Room("hall", 0.0, 0.0, 10.6, 10.0, paint("a5a89b", Texture.TILES), paint("dce3c9", Texture.PLASTER)),
    Room("kitchen", 10.6, 0.0, 15.0, 6.2, paint("8f9494", Texture.TILES), _TILED),
    Room("scullery", 10.6, 6.2, 15.0, 10.0, paint("7f8487", Texture.TILES), _WHITE),
)
HOLES = (
    Hole(10.6, 5.3, 1.0), Hole(10.6, 8.6, 1.0), Hole(13.9, 6.2, 0.95),
    Hole(0.0, 2.5, 3.4, 0.8, 2.3), Hole(0.0, 7.0, 3.4, 0.8, 2.3), Hole(5.0, 10.0, 3.6, 0.8, 2.3),
    Hole(15.0, 3.0, 1.8, 1.3, 2.2),
)  # fmt: skip


def _hall() -> list[Spot]:
    """Furnish it: square and long tables a chair's depth apart, benches at two of them, trays, the counter."""
    rng = np.random.default_rng(11)
    shells = [paint(c) for c in ("c0563f", "3f6f86", "d3a63c", "5d7f58")]
    spots: list[Spot] = []

    def seat(name: str, x: float, y: float, yaw: float, model: seating.Model) -> None:
        spots.append((name, "chair", model, x + rng.uniform(-0.03, 0.03), y + rng.uniform(-0.03, 0.03), 0,
                      yaw + rng.uniform(-8, 8)))  # fmt: skip

    for row in range(3):  # square tables of four, in three rows of three
        for column in range(3):
            x, y, name = 1.75 + 1.85 * column, 1.75 + 1.85 * row, f"{row + 1}{column + 1}"
            chair = household.low_back_chair(m.STEEL, shells[(row + column) % 4], width=0.46)
            spots.append(
                (f"table {name}", "dining table", tables.long_table(0.82, 0.82, m.BIRCH, height=0.73), x, y, 0, 0)
            )
            for i, yaw in enumerate((0, 90, 180, 270)):
                away = np.deg2rad(yaw + 180)
                seat(f"chair {name}{i + 1}", x + 0.5 * np.cos(away), y + 0.5 * np.sin(away), yaw, chair)
            spots.append((f"tray {name}", "tray", household.tray(m.RUST), x - 0.12, y + 0.1, 0.73, 90 * column))
            if (row + column) % 2:
                spots.append((f"bottle {name}", "bottle", props.bottle(m.GLASS_GREEN), x + 0.25, y - 0.2, 0.73, 0))
    for i, x in enumerate((1.6, 4.6)):  # long tables with a bench on one side
        spots.append(
            (f"long table {i + 1}", "dining table", tables.long_table(0.75, 2.3, m.OAK, height=0.76), x, 8.0, 0, 90)
        )
        spots.append(
            (
                f"bench {i + 1}",
                "bench",
                household.resized(seating.bench(2.2, m.OAK, back=False), 0.85, 1, 1),
                x,
                8.58,
                0,
                -90,
            )
        )
        for j in range(4):
            seat(
                f"long chair {i + 1}{j + 1}",
                x - 0.84 + 0.56 * j,
                7.52,
                90,
                household.resized(seating.shell_chair(m.LINEN, m.OAK), 1.04, 1.08, 0.96),
            )
            spots.append((f"bowl {i + 1}{j + 1}", "bowl", props.bowl(m.CERAMIC), x - 0.8 + 0.53 * j, 7.85, 0.76, 0))
        spots.append(
            (f"pendant {i + 1}", "lamp", props.pendant_lamp(m.TERRACOTTA, drop=0.6), x, 8.0, CEILING_HEIGHT_M, 0)
        )
    return spots


def _serving() -> list[Spot]:
    """Furnish the east side of the hall: counter with food, tray rack, bins, plants, two round tables."""
    spots: list[Spot] = [
        ("serving counter", "counter", tables.bar_counter(4.0, paint("7b8f6a"), m.STEEL), 9.6, 2.6, 0, 180),
        ("cake", "cake", props.cake(), 9.6, 1.3, 1.06, 0),
        ("fruit", "bowl", props.bowl(m.TERRACOTTA, (paint("a3b34b"),) * 5), 9.6, 1.9, 1.06, 0),
        ("soup", "bowl", household.resized(props.bowl(m.STEEL), 1.4, 1.4, 1.5), 9.6, 2.6, 1.06, 0),
        ("till", "laptop", appliances.laptop(m.CHARCOAL), 9.55, 4.1, 1.06, 0),
        ("tray rack", "shelf", household.rack(0.9, 1.5, 0.5, m.STEEL, boards=4), 10.28, 7.2, 0, 180),
        ("plant 1", "potted plant", props.rubber_plant(m.WHITE, height=1.6, seed=81), 0.45, 0.45, 0, 0),
        ("plant 2", "potted plant", props.rubber_plant(m.WHITE, height=1.5, seed=82), 0.45, 9.5, 0, 40),
        ("plant 3", "potted plant", props.snake_plant(m.TERRACOTTA, seed=83), 10.2, 9.6, 0, 0),
        ("bin 1", "trash can", household.resized(props.trash_can(m.STEEL), 1.2, 1.2, 1.5), 10.25, 6.4, 0, 0),
        ("bin 2", "trash can", household.resized(props.trash_can(m.CHARCOAL), 1.2, 1.2, 1.5), 9.8, 6.4, 0, 0),
        ("clock", "clock", props.clock(m.CHARCOAL), 10.54, 6.9, 2.1, 180),
        ("coat stand", "coat rack", props.coat_stand(), 9.6, 9.6, 0, 0),
    ]
    for i, z in enumerate(tables.shelf_heights(1.5, 4)):
        spots.append((f"tray rack tray {i + 1}", "tray", household.tray((m.RUST, m.TEAL)[i % 2]), 10.28, 7.2, z, 180))
    for i, (x, y) in enumerate(((8.2, 8.2), (8.0, 6.2))):
        spots.append((f"round table {i + 1}", "dining table", tables.round_table(0.4, m.WHITE), x, y, 0, 0))
        for j in range(3):
            angle = np.deg2rad(40 + 50 * i + 120 * j)
            at = (x + 0.52 * np.cos(angle), y + 0.52 * np.sin(angle))
            chair = household.resized(seating.cafe_chair(m.WALNUT, m.RUST), 0.95, 0.97, 1.06)
            spots.append((f"round chair {i + 1}{j + 1}", "chair", chair, *at, 0, float(np.rad2deg(angle)) + 180))
        spots.append((f"cup round {i + 1}", "cup", props.cup(m.CERAMIC), x + 0.1, y, 0.74, 0))
    return spots


def _kitchen() -> list[Spot]:
    """Furnish it: a row of cookers, steel worktops with boxes on a board below, fridges."""
    steel, top = m.STEEL, 0.88
    spots: list[Spot] = [
        ("island", "counter", household.rack(2.2, top, 0.8, steel, boards=1), 12.9, 2.9, 0, 90),
        ("island box 1", "box", household.carton(0.4, 0.5, 0.3), 12.4, 2.9, 0.08, 90),
        ("island box 2", "box", household.carton(0.35, 0.4, 0.25), 13.3, 2.85, 0.08, 85),
        ("worktop", "counter", tables.cabinet((0.65, 2.6, 0.9), steel, doors=4, top=steel), 14.58, 2.6, 0, 180),
        ("sink", "sink", household.resized(appliances.sink(), 1.1, 1.1, 1.0), 14.55, 3.3, 0.9, 180),
        ("microwave", "microwave", appliances.microwave(), 14.62, 2.0, 0.9, 180),
        ("coffee machine", "coffee machine", appliances.coffee_machine(m.CHARCOAL), 14.6, 2.6, 0.9, 180),
        ("island bowl 1", "bowl", household.resized(props.bowl(steel), 1.3, 1.3, 1.4), 12.3, 2.9, top, 0),
        ("island bowl 2", "bowl", props.bowl(m.CERAMIC, (paint("c9402f"),) * 4), 13.0, 3.0, top, 0),
        ("island bottle", "bottle", props.bottle(m.GLASS_BROWN), 13.5, 2.75, top, 0),
        ("kitchen stool", "stool", household.stool(0.38, 0.5, m.BIRCH, square=True), 11.1, 1.0, 0, 20),
        ("kitchen bin", "trash can", props.trash_can(m.CHARCOAL), 14.6, 5.8, 0, 0),
    ]
    for i in range(3):
        oven = household.resized(household.cooker(steel), 1.1, 1.0, 1.0)
        spots.append((f"cooker {i + 1}", "oven", oven, 12.0 + 0.64 * i, 0.42, 0, 90))
    for i in range(2):
        fridge = household.resized(appliances.refrigerator(steel), 1.0, 0.95, 1.1)
        spots.append((f"fridge {i + 1}", "refrigerator", fridge, 12.0 + 0.72 * i, 5.78, 0, -90))
    return spots


def _scullery() -> list[Spot]:
    """Furnish it: washing-up table with sinks, racks with boxes and crockery, a break table with stools under it."""
    heights = tables.shelf_heights(1.8, 4)
    spots: list[Spot] = [
        (
            "washing-up table",
            "counter",
            tables.cabinet((0.7, 2.2, 0.86), m.STEEL, doors=3, top=m.STEEL),
            12.9,
            9.56,
            0,
            -90,
        ),
        ("sink scullery 1", "sink", appliances.sink(), 12.4, 9.52, 0.86, -90),
        ("sink scullery 2", "sink", appliances.sink(), 13.2, 9.52, 0.86, -90),
        ("washer", "washing machine", household.washing_machine(), 14.4, 9.58, 0, -90),
        ("break table", "dining table", tables.long_table(0.7, 1.1, m.WHITE, height=0.72), 12.2, 7.3, 0, 90),
        ("book break", "book", props.book(paint("5a4a6a")), 12.3, 7.35, 0.72, 30),
        ("mop bucket", "basket", household.resized(household.basket(paint("3f6f86")), 0.9, 0.9, 0.7), 11.0, 9.5, 0, 0),
    ]
    for i, (dx, dy) in enumerate(((-0.3, 0.32), (0.3, 0.32), (-0.3, -0.32), (0.3, -0.32))):
        stool = household.stool(0.36, 0.45, m.BIRCH, square=True)
        spots.append((f"break stool {i + 1}", "stool", stool, 12.2 + dx, 7.3 + dy, 0, 0))
    for i, y in enumerate((7.1, 8.2)):
        spots.append(
            (f"scullery rack {i + 1}", "shelf", household.rack(1.0, 1.8, 0.42, m.STEEL, boards=4), 14.7, y, 0, 180)
        )
        for level, z in enumerate(heights[:3]):
            spots.append(
                (f"rack box {i + 1}{level + 1}", "box", household.carton(0.3, 0.42, 0.28), 14.68, y - 0.2, z, 180)
            )
            if level:
                bowl = props.bowl(m.CERAMIC)
                spots.append((f"rack bowl {i + 1}{level + 1}", "bowl", bowl, 14.68, y + 0.25, z, 0))
    return spots


@cache
def canteen_scene() -> Scene:
    """Build the whole place (once a process)."""
    return furnished(ROOMS, HOLES, [*_hall(), *_serving(), *_kitchen(), *_scullery()])


PLACE = Place(
    "canteen", "A canteen of our own making", canteen_scene, lambda: plan_stations(canteen_scene()), frames=1200,
    width=320,
)  # fmt: skip
