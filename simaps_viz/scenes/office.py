"""An office, 14 x 10 m: rows of alike desks in an open room, a meeting room, a tea kitchen and a store."""

from functools import cache

import numpy as np

from simaps_viz.scenes import appliances, household, props, seating, tables
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.building import Hole, Room, Spot, furnished
from simaps_viz.scenes.materials import Texture, paint
from simaps_viz.scenes.place import Place
from simaps_viz.scenes.scene import Scene
from simaps_viz.scenes.walk import plan_stations

_CARPET, _WHITE = paint("6f7b86", Texture.CARPET), paint("e9eaea", Texture.PLASTER)
_ACCENT = paint("c9a36a", Texture.PLASTER)
ROOMS = (
    Room("open office", 0.0, 0.0, 9.2, 10.0, _CARPET, _WHITE),
    Room("meeting room", 9.2, 0.0, 14.0, 4.8, paint("58616b", Texture.CARPET), _ACCENT),
    Room("tea kitchen", 9.2, 4.8, 14.0, 7.4, paint("b5b0a5", Texture.TILES), _WHITE),
    Room("store", 9.2, 7.4, 14.0, 10.0, paint("8d8a84", Texture.PLASTER), paint("cfd2d3", Texture.PLASTER)),
)
HOLES = (
    Hole(9.2, 3.2, 1.0), Hole(9.2, 6.1, 1.1), Hole(9.2, 8.7, 0.95),
    Hole(0.0, 2.6, 3.2, 0.9, 2.3), Hole(0.0, 7.4, 3.2, 0.9, 2.3), Hole(4.6, 0.0, 3.0, 0.9, 2.3),
    Hole(14.0, 2.4, 2.4, 0.9, 2.3),
)  # fmt: skip


def _desks() -> list[Spot]:
    """Set four double rows of five places each, face to face; chairs are pushed under more or less."""
    rng = np.random.default_rng(7)
    spots: list[Spot] = []
    for row, (x, turned) in enumerate(((1.75, 180), (2.52, 0), (6.25, 180), (7.02, 0))):
        out = 1.0 if turned == 0 else -1.0
        for seat in range(5):
            y, name = 1.65 + 1.52 * seat, f"{row + 1}{seat + 1}"
            push, sway = rng.uniform(0.3, 0.52), rng.uniform(-0.12, 0.12)
            chair = household.resized(seating.office_chair((m.GREY_FABRIC, m.NAVY)[row // 2]), 1.05, 1.05, 1.02)
            yaw = turned + 180 + rng.uniform(-25, 25)
            spots += [
                (f"desk {name}", "desk", tables.desk(m.BIRCH, length=1.5, depth=0.75), x, y, 0, turned),
                (f"chair {name}", "chair", chair, x + out * push, y + sway, 0, yaw),
                (f"monitor {name}", "tv", appliances.tv(0.55, stand=True), x - out * 0.15, y, 0.74, turned),
                (f"keyboard {name}", "keyboard", appliances.keyboard(m.CHARCOAL), x + out * 0.15, y, 0.74, turned),
            ]
            if rng.random() < 0.5:
                spots.append((f"cup {name}", "cup", props.cup(m.CERAMIC), x + out * 0.1, y + 0.45, 0.74, 0))
            if rng.random() < 0.4:
                spots.append(
                    (f"mouse {name}", "mouse", appliances.computer_mouse(), x + out * 0.16, y - 0.32, 0.74, turned)
                )
            if rng.random() < 0.3:
                bag = props.backpack((m.RUST, m.TEAL)[seat % 2], m.CHARCOAL)
                spots.append((f"backpack {name}", "backpack", bag, x + out * 0.05, y - out * 0.45, 0, turned + 90))
    return spots


def _open_office() -> list[Spot]:
    """Furnish the rest of it: shelves along the walls, printer table, plants, bins."""
    spots: list[Spot] = [
        ("bench north", "bench", seating.bench(1.6, m.WALNUT, back=True), 4.4, 9.68, 0, -90),
        ("backpack bench", "backpack", props.backpack(m.NAVY, m.BLACK_METAL), 4.9, 9.66, 0.462, -90),
        ("plant north west", "potted plant", props.rubber_plant(m.CHARCOAL, height=1.6, seed=61), 0.45, 9.5, 0, 0),
        ("plant south west", "potted plant", props.rubber_plant(m.CHARCOAL, height=1.45, seed=62), 0.45, 0.5, 0, 70),
        ("plant middle", "potted plant", props.snake_plant(m.WHITE, seed=63), 4.4, 4.6, 0, 0),
        ("plant east", "potted plant", props.snake_plant(m.WHITE, seed=64), 8.85, 4.7, 0, 0),
        ("bin 1", "trash can", props.trash_can(m.CHARCOAL), 4.1, 1.0, 0, 0),
        ("bin 2", "trash can", props.trash_can(m.CHARCOAL), 4.65, 1.0, 0, 0),
        ("bin 3", "trash can", props.trash_can(m.STEEL), 8.9, 0.4, 0, 0),
        ("clock office", "clock", props.clock(m.STEEL), 9.14, 4.75, 2.05, 180),
        ("coat stand office", "coat rack", props.coat_stand(), 8.8, 9.55, 0, 0),
    ]
    board = tables.shelf_heights(1.3, 3)
    for i, x in enumerate((1.3, 2.6, 6.3, 7.6)):
        spots.append((f"shelf {i + 1}", "shelf", tables.bookshelf(1.2, 1.3, m.BIRCH, boards=3), x, 9.76, 0, -90))
        for level in range(3):
            if (i + level) % 3:
                row = props.book_row(0.55 + 0.15 * level, 70 + 3 * i + level)
                spots.append((f"folders {i + 1}{level + 1}", "book", row, x - 0.1, 9.78, board[level], -90))
            else:
                spots.append(
                    (
                        f"shelf box {i + 1}{level + 1}",
                        "box",
                        household.carton(0.26, 0.4, 0.26),
                        x,
                        9.74,
                        board[level],
                        -90,
                    )
                )
    return spots


def _meeting_room() -> list[Spot]:
    """Furnish it: a long table with nine chairs pushed under, a screen, a board."""
    chair = household.low_back_chair(m.STEEL, paint("3b4a5a", Texture.FABRIC), width=0.52)
    spots: list[Spot] = [
        ("meeting table", "dining table", tables.long_table(1.2, 3.0, m.WALNUT), 11.7, 2.45, 0, 0),
        ("meeting chair north", "chair", chair, 11.7, 4.05, 0, -90),
        (
            "screen cabinet",
            "cabinet",
            tables.cabinet((0.4, 1.5, 0.7), m.WALNUT, doors=3, top=m.WALNUT),
            13.7,
            3.7,
            0,
            180,
        ),
        ("meeting screen", "tv", appliances.tv(1.3, stand=True), 13.7, 3.7, 0.7, 180),
        ("board", "board", household.whiteboard(1.8, 1.1), 9.26, 1.5, 1.4, 0),
        ("laptop meeting 1", "laptop", appliances.laptop(m.STEEL), 11.4, 1.9, 0.74, 180),
        ("laptop meeting 2", "laptop", appliances.laptop(m.CHARCOAL), 12.0, 3.0, 0.74, 0),
        ("bottle meeting", "bottle", props.bottle(m.GLASS_CLEAR), 11.7, 2.3, 0.74, 0),
        ("plant meeting", "potted plant", props.rubber_plant(m.TERRACOTTA, height=1.4, seed=65), 13.5, 0.5, 0, 0),
    ]
    for i in range(4):
        y = 1.4 + 0.7 * i
        spots.append((f"meeting chair west {i + 1}", "chair", chair, 11.02, y, 0, 0))
        spots.append((f"meeting chair east {i + 1}", "chair", chair, 12.38, y, 0, 180))
        if i % 2:
            spots.append((f"cup meeting {i}", "cup", props.cup(paint("8fa9b5")), 11.35, y + 0.2, 0.74, 0))
    return spots


def _tea_kitchen_and_store() -> list[Spot]:
    """Furnish them: worktop, fridge, high tables with stools; racks with boxes on all boards and under them."""
    top, heights = 0.92, tables.shelf_heights(1.9, 4)
    body = paint("b9744e")
    spots: list[Spot] = [
        ("worktop", "counter", tables.cabinet((0.6, 2.4, top), body, doors=4, top=m.WHITE), 11.4, 5.18, 0, 90),
        ("fridge", "refrigerator", appliances.refrigerator(m.STEEL), 13.3, 5.24, 0, 90),
        ("sink", "sink", appliances.sink(), 11.9, 5.2, top, 90),
        ("coffee machine", "coffee machine", household.resized(appliances.coffee_machine(m.STEEL), 0.8, 0.7, 0.9),
         10.65, 5.15, top, 90),
        ("microwave", "microwave", appliances.microwave(), 11.3, 5.1, top, 90),
        ("high table", "dining table", tables.round_table(0.35, m.WHITE, height=1.05), 12.6, 6.6, 0, 0),
        ("vase high table", "vase", props.vase(m.CERAMIC, paint("e4c15a"), scale=0.7), 12.6, 6.6, 1.05, 0),
        ("bin kitchen", "trash can", props.trash_can(m.STEEL), 9.95, 5.05, 0, 0),
        ("printer table", "cabinet", tables.cabinet((0.6, 0.9, 0.7), m.WHITE, doors=2, top=m.WHITE), 13.6, 8.7, 0, 180),
        ("printer", "printer", household.carton(0.42, 0.5, 0.32, paint("d9dadb")),
         13.6, 8.7, 0.7, 180),
        ("paper box 1", "box", household.carton(0.32, 0.44, 0.26), 10.3, 7.85, 0, 5),
        ("paper box 2", "box", household.carton(0.32, 0.44, 0.26), 10.31, 7.86, 0.26, -8),
        ("suitcase store", "suitcase", props.suitcase(paint("7d3340")), 13.6, 7.8, 0, 160),
    ]  # fmt: skip
    for i, angle in enumerate((30.0, 150.0, 270.0)):
        x, y = 12.6 + 0.5 * np.cos(np.deg2rad(angle)), 6.6 + 0.5 * np.sin(np.deg2rad(angle))
        spots.append((f"bar stool {i + 1}", "stool", household.stool(0.36, 0.74, m.WALNUT), x, y, 0, angle))
    for i, x in enumerate((10.15, 11.45, 12.75)):
        spots.append((f"rack {i + 1}", "shelf", household.rack(1.2, 1.9, 0.45, m.STEEL, boards=4), x, 9.68, 0, -90))
        for level, z in enumerate(heights[:3]):
            size = (0.34, 0.3 + 0.08 * ((i + level) % 3), 0.22 + 0.05 * level)
            spots.append((f"rack box {i + 1}{level + 1}a", "box", household.carton(*size), x - 0.3, 9.66, z, -90))
            if (i + level) % 2:
                spots.append(
                    (f"rack box {i + 1}{level + 1}b", "box", household.carton(0.3, 0.34, 0.2), x + 0.28, 9.66, z, -88)
                )
    return spots


@cache
def office_scene() -> Scene:
    """Build the whole place (once a process)."""
    return furnished(ROOMS, HOLES, [*_desks(), *_open_office(), *_meeting_room(), *_tea_kitchen_and_store()])


PLACE = Place(
    "office", "An office of our own making", office_scene, lambda: plan_stations(office_scene()), frames=1200, width=320
)
