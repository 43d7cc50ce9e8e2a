"""A bookshop, 12 x 9 m: shelves full of books, stools and armchairs to read in, a store, staff and wash rooms."""

from functools import cache

import numpy as np

from simaps_viz.scenes import appliances, household, props, seating, tables
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.building import CEILING_HEIGHT_M, Hole, Room, Spot, furnished
from simaps_viz.scenes.materials import Texture, paint
from simaps_viz.scenes.place import Place
from simaps_viz.scenes.scene import Scene
from simaps_viz.scenes.walk import plan_stations

_BRICK, _PALE = paint("a8654c", Texture.BRICK), paint("e7e0d0", Texture.PLASTER)
ROOMS = (
    Room("sales room", 0.0, 0.0, 8.4, 9.0, paint("6f4f38", Texture.PLANKS), _BRICK),
    Room("store", 8.4, 0.0, 12.0, 4.6, paint("9a968e", Texture.PLASTER), _PALE),
    Room("staff room", 8.4, 4.6, 12.0, 7.2, paint("8a6b4f", Texture.PLANKS), paint("cdd8cf", Texture.PLASTER)),
    Room("wash room", 8.4, 7.2, 12.0, 9.0, paint("c4c9c7", Texture.TILES), paint("dbe4e6", Texture.TILES)),
)
HOLES = (
    Hole(8.4, 3.6, 1.0), Hole(8.4, 5.9, 0.9), Hole(9.4, 7.2, 0.9),
    Hole(2.0, 0.0, 2.6, 0.5, 2.4), Hole(6.0, 0.0, 2.6, 0.5, 2.4), Hole(12.0, 5.9, 1.4, 1.0, 2.2),
)  # fmt: skip
_CHERRY, _GREEN = paint("8a3f2a", Texture.WOOD), paint("3c5a45", Texture.FABRIC)


def _filled(
    name: str, x: float, y: float, yaw: float, *, length: float, height: float, boards: int, seed: int
) -> list[Spot]:
    """Return a bookshelf with a row of books on every board, of different lengths, and a few boxes lowest."""
    spots: list[Spot] = [(name, "shelf", tables.bookshelf(length, height, _CHERRY, boards=boards), x, y, 0, yaw)]
    rng = np.random.default_rng(seed)
    c, s = np.cos(np.deg2rad(yaw)), np.sin(np.deg2rad(yaw))
    for level, z in enumerate(tables.shelf_heights(height, boards)):
        filled = length * rng.uniform(0.55, 0.85)
        off = (length - 0.1 - filled) / 2 * rng.choice((-1, 1))
        row = props.book_row(filled, seed + level)
        at = (x - 0.03 * c - off * s, y - 0.03 * s + off * c)
        spots.append((f"{name} books {level + 1}", "book", row, *at, z, yaw))
    return spots


def _sales_room() -> list[Spot]:
    """Furnish it: shelves round the walls and back to back in the middle, tables of books, places to read, the till."""
    spots: list[Spot] = []
    for i, y in enumerate((2.2, 3.75, 5.3, 6.85)):
        spots += _filled(f"west shelf {i + 1}", 0.23, y, 0, length=1.5, height=1.9, boards=5, seed=100 + 10 * i)
    for i, x in enumerate((1.4, 2.9, 4.4)):
        spots += _filled(f"north shelf {i + 1}", x, 8.77, -90, length=1.4, height=2.1, boards=5, seed=140 + 10 * i)
    for i, (x, y) in enumerate(((2.75, 5.9), (4.9, 5.9))):  # islands, back to back
        spots += _filled(f"island {i + 1} west", x - 0.17, y, 180, length=1.6, height=1.25, boards=3, seed=180 + 20 * i)
        spots += _filled(f"island {i + 1} east", x + 0.17, y, 0, length=1.6, height=1.25, boards=3, seed=190 + 20 * i)
    stools = (household.stool(0.32, 0.42, m.OAK), household.stool(0.4, 0.46, _CHERRY, square=True))
    for i, (x, y) in enumerate(
        ((1.0, 3.0), (1.05, 6.1), (2.2, 8.1), (3.75, 8.05), (3.8, 6.35), (3.85, 5.6), (6.0, 6.3))
    ):
        spots.append((f"stool {i + 1}", "stool", stools[i % 2], x, y, 0, 23 * i))
    for i, (x, y, yaw) in enumerate(((2.2, 2.9, 0), (4.3, 2.6, 90))):
        table = tables.long_table(0.9, 1.4, m.OAK, height=0.7)
        spots.append((f"book table {i + 1}", "dining table", table, x, y, 0, yaw))
        for j in range(6):
            a, b = (j % 2 - 0.5) * 0.4, (j // 2 - 1) * 0.42
            dx, dy = (a, b) if yaw == 0 else (b, a)
            cover = paint(("7c3b36", "2f5266", "c2964b", "44604a", "93593a", "5a4a6a")[j])
            book = household.resized(props.book(cover), 1.1, 1.1, 1 + j % 3)
            spots.append((f"table {i + 1} book {j + 1}", "book", book, x + dx, y + dy, 0.7, 15 * j))
        spots.append((f"table {i + 1} box", "box", household.carton(0.4, 0.5, 0.3), x, y, 0, yaw + 7))
        spots.append(
            (f"pendant {i + 1}", "lamp", props.pendant_lamp(m.BLACK_METAL, drop=0.7), x, y, CEILING_HEIGHT_M, 0)
        )
    spots += [
        ("armchair 1", "chair", household.resized(seating.armchair(_GREEN), 1.05, 1.1, 1.05), 0.75, 0.75, 0, 40),
        ("armchair 2", "chair", household.resized(seating.armchair(_GREEN), 1.05, 1.1, 1.05), 3.9, 0.7, 0, 100),
        (
            "reading couch",
            "couch",
            household.resized(seating.couch(2, m.MUSTARD, m.NAVY), 0.96, 1.03, 1.04),
            2.4,
            0.6,
            0,
            90,
        ),
        ("reading table", "coffee table", tables.side_table(0.26, m.WALNUT), 1.35, 1.25, 0, 0),
        ("cup reading", "cup", props.cup(m.CERAMIC), 1.35, 1.2, 0.5, 0),
        (
            "till counter",
            "counter",
            household.resized(tables.bar_counter(2.0, paint("54382a"), m.OAK), 1, 1, 0.92),
            6.5,
            2.4,
            0,
            180,
        ),
        ("till", "laptop", appliances.laptop(m.CHARCOAL), 6.5, 2.9, 0.975, 0),
        ("counter books", "book", household.resized(props.book(paint("b5453a")), 1, 1, 3), 6.5, 1.7, 0.975, 10),
        ("counter plant", "potted plant", props.bushy_plant(m.BRASS, radius=0.07, seed=91), 6.5, 2.25, 0.975, 0),
        ("till stool", "stool", household.stool(0.36, 0.66, m.BLACK_METAL), 7.1, 2.6, 0, 0),
        ("till bin", "trash can", household.resized(props.trash_can(m.BLACK_METAL), 0.9, 0.9, 0.8), 7.2, 1.6, 0, 0),
        ("plant window", "potted plant", props.rubber_plant(m.CHARCOAL, height=1.5, seed=92), 7.9, 0.5, 0, 0),
        ("plant north", "potted plant", props.snake_plant(m.TERRACOTTA, seed=93), 5.5, 8.6, 0, 0),
        ("bench", "bench", seating.bench(1.4, m.WALNUT, back=True), 8.05, 7.9, 0, 180),
        ("handbag bench", "handbag", props.handbag(m.TEAL), 8.02, 8.2, 0.462, 20),
        ("umbrella stand", "basket", household.resized(household.basket(m.BRASS), 0.6, 0.6, 1.1), 7.85, 4.75, 0, 0),
        ("shop clock", "clock", props.clock(m.BRASS), 8.34, 4.7, 2.05, 180),
    ]
    return spots


def _store() -> list[Spot]:
    """Furnish it: racks with boxes, boxes in piles on the floor, a packing table with a stool under it."""
    heights, spots = tables.shelf_heights(2.0, 4), []
    for i, y in enumerate((0.85, 2.15)):
        spots.append(
            (
                f"store rack {i + 1}",
                "shelf",
                household.rack(1.25, 2.0, 0.5, paint("9c4a32"), boards=4),
                11.66,
                y,
                0,
                180,
            )
        )
        for level, z in enumerate(heights[:3]):
            for j in range(2 - (i + level) % 2):
                size = (0.38, 0.36 + 0.1 * ((i + level) % 2), 0.24 + 0.04 * j)
                spots.append(
                    (
                        f"store box {i + 1}{level + 1}{j + 1}",
                        "box",
                        household.carton(*size),
                        11.66,
                        y - 0.3 + 0.6 * j,
                        z,
                        180,
                    )
                )
    spots += [
        ("packing table", "desk", tables.desk(m.OAK, length=1.6, depth=0.8), 9.7, 0.5, 0, 90),
        ("packing stool", "stool", household.stool(0.38, 0.6, m.OAK), 9.6, 0.95, 0, 0),
        ("parcel", "box", household.carton(0.3, 0.42, 0.2), 9.9, 0.45, 0.74, 20),
        ("parcel books", "book", household.resized(props.book(paint("3c7070")), 1, 1, 2), 9.3, 0.45, 0.74, 40),
        ("pile 1 low", "box", household.carton(0.45, 0.5, 0.35), 8.8, 1.9, 0, 4),
        ("pile 1 high", "box", household.carton(0.4, 0.42, 0.3), 8.81, 1.88, 0.35, -10),
        ("pile 2", "box", household.carton(0.5, 0.6, 0.4), 8.82, 2.6, 0, -3),
        ("pile 3", "box", household.carton(0.35, 0.45, 0.3), 11.7, 3.2, 0, 8),
        ("suitcase", "suitcase", props.suitcase(paint("b06a3b")), 11.65, 4.15, 0, 190),
    ]
    return spots


def _staff_and_wash_room() -> list[Spot]:
    """Furnish them: a table with chairs pushed under, a small kitchen; toilet and basin."""
    top, chair = 0.9, household.resized(seating.cafe_chair(m.BIRCH, m.TEAL), 1.05, 1.05, 1.08)
    spots: list[Spot] = [
        ("staff table", "dining table", tables.long_table(0.75, 1.2, m.BIRCH), 10.5, 5.95, 0, 90),
        (
            "staff worktop",
            "counter",
            tables.cabinet((0.55, 1.7, top), m.TERRACOTTA, doors=3, top=m.OAK),
            10.45,
            4.96,
            0,
            90,
        ),
        (
            "staff fridge",
            "refrigerator",
            household.resized(appliances.refrigerator(m.TERRACOTTA), 0.85, 0.8, 0.8),
            11.65,
            5.0,
            0,
            90,
        ),
        ("staff sink", "sink", household.resized(appliances.sink(), 0.9, 0.9, 0.9), 11.1, 4.98, top, 90),
        ("staff toaster", "toaster", appliances.toaster(m.WHITE), 10.1, 4.92, top, 90),
        ("staff cup 1", "cup", props.cup(m.TERRACOTTA), 10.3, 6.0, 0.74, 0),
        ("staff laptop", "laptop", appliances.laptop(m.STEEL), 10.75, 5.9, 0.74, -90),
        ("staff coat stand", "coat rack", props.coat_stand(), 8.75, 4.95, 0, 0),
        ("staff backpack", "backpack", props.backpack(m.TEAL, m.CHARCOAL), 11.7, 6.85, 0, 180),
        ("staff picture", "picture", props.picture(0.7, 0.5, ("c9b79a", "5f7464", "d08b4c")), 11.0, 7.14, 1.6, -90),
        ("wash toilet", "toilet", household.toilet(), 11.55, 8.1, 0, 180),
        (
            "wash cabinet",
            "cabinet",
            tables.cabinet((0.42, 0.7, 0.8), m.WHITE, doors=2, top=m.WALNUT),
            10.2,
            8.7,
            0,
            -90,
        ),
        ("wash sink", "sink", household.resized(appliances.sink(), 0.8, 0.8, 0.9), 10.2, 8.68, 0.8, -90),
        ("wash bin", "trash can", props.trash_can(m.WHITE), 10.9, 8.75, 0, 0),
        ("wash boxes", "box", household.carton(0.4, 0.35, 0.3), 8.75, 8.7, 0, 0),
    ]
    for i, (dx, dy, yaw) in enumerate(((-0.3, -0.38, 90), (0.3, -0.38, 90), (-0.3, 0.38, -90), (0.3, 0.38, -90))):
        spots.append((f"staff chair {i + 1}", "chair", chair, 10.5 + dx, 5.95 + dy, 0, yaw))
    return spots


@cache
def shop_scene() -> Scene:
    """Build the whole place (once a process)."""
    return furnished(ROOMS, HOLES, [*_sales_room(), *_store(), *_staff_and_wash_room()])


PLACE = Place(
    "shop", "A bookshop of our own making", shop_scene, lambda: plan_stations(shop_scene()), frames=1200, width=320
)
