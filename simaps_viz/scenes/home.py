"""A flat, 11 x 8 m: living room with a dining table, kitchen, hall, bath, bedroom and a child's room behind it."""

from functools import cache

from simaps_viz.scenes import appliances, household, props, seating, tables
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.building import CEILING_HEIGHT_M, Hole, Room, Spot, furnished
from simaps_viz.scenes.materials import Texture, paint
from simaps_viz.scenes.place import Place
from simaps_viz.scenes.scene import Scene
from simaps_viz.scenes.walk import plan_stations

_PLANKS = paint("a97f57", Texture.PLANKS)
_TILES = paint("c8cdcb", Texture.TILES)
_PALE, _SAND = paint("ece7da", Texture.PLASTER), paint("e3d3b8", Texture.PLASTER)
_BLUE, _ROSE = paint("c3d0d8", Texture.PLASTER), paint("e6cfc6", Texture.PLASTER)
ROOMS = (
    Room("living room", 0.0, 0.0, 6.2, 4.6, _PLANKS, _PALE),
    Room("kitchen", 0.0, 4.6, 3.8, 8.0, paint("9d9a92", Texture.TILES), _SAND),
    Room("hall", 3.8, 4.6, 6.2, 8.0, _PLANKS, _PALE),
    Room("bath", 6.2, 5.2, 8.4, 8.0, _TILES, paint("d5e2e2", Texture.TILES)),
    Room("bedroom", 6.2, 0.0, 11.0, 5.2, paint("8f7f72", Texture.CARPET), _BLUE),
    Room("child's room", 8.4, 5.2, 11.0, 8.0, _PLANKS, _ROSE),
)
HOLES = (
    Hole(3.0, 4.6, 1.1), Hole(5.2, 4.6, 1.0), Hole(6.2, 6.5, 0.85), Hole(6.2, 3.9, 0.9), Hole(9.5, 5.2, 0.9),
    Hole(3.6, 0.0, 2.4, 0.9, 2.3), Hole(8.9, 0.0, 1.8, 1.3, 2.3), Hole(0.0, 6.6, 1.4, 1.2, 2.2),
    Hole(11.0, 6.4, 1.2, 1.0, 2.2), Hole(7.4, 8.0, 0.7, 1.5, 2.2),
)  # fmt: skip
_OAKISH, _DARK = paint("b98b58", Texture.WOOD), paint("54392a", Texture.WOOD)
_PLUM, _MOSS = paint("6d4a63", Texture.FABRIC), paint("74805c", Texture.FABRIC)


def _living_room() -> list[Spot]:
    """Furnish it: a dining table with chairs pushed under, couches round a low table, a television."""
    chair, low = household.ladder_chair(_DARK, _MOSS), 0.40
    spots: list[Spot] = [
        ("dining table", "dining table", tables.long_table(0.95, 1.7, _DARK, height=0.76), 1.55, 3.15, 0, 0),
        ("dining chair end", "chair", chair, 1.55, 2.2, 0, 90),
        ("fruit", "bowl", props.bowl(m.CERAMIC, (paint("d98f2b"),) * 5), 1.5, 3.2, 0.76, 0),
        ("cup dining", "cup", props.cup(paint("8fa9b5")), 1.8, 2.7, 0.76, 20),
        ("dining lamp", "lamp", props.pendant_lamp(m.BRASS, drop=0.65), 1.55, 3.15, CEILING_HEIGHT_M, 0),
        (
            "couch south",
            "couch",
            household.resized(seating.couch(3, _PLUM, m.LINEN), 1.04, 0.96, 0.95),
            3.7,
            0.6,
            0,
            90,
        ),
        (
            "couch east",
            "couch",
            household.resized(seating.couch(2, _PLUM, m.MUSTARD), 1.04, 0.96, 0.95),
            5.6,
            2.3,
            0,
            180,
        ),
        (
            "armchair",
            "chair",
            household.resized(seating.armchair(_MOSS, legs=_DARK), 0.95, 1.06, 0.95),
            1.75,
            0.75,
            0,
            55,
        ),
        ("low table", "coffee table", tables.coffee_table(0.65, 1.15, _OAKISH), 3.6, 2.05, 0, 90),
        ("book under low table", "book", props.book(paint("7c3b36")), 3.4, 2.05, 0.17, 80),
        ("book low table 1", "book", props.book(paint("2f5266")), 3.35, 2.1, low, 100),
        ("book low table 2", "book", props.book(paint("c2964b"), (0.14, 0.2, 0.02)), 3.36, 2.1, low + 0.028, 70),
        ("remote", "remote", props.remote_control(), 3.75, 1.95, low, 60),
        ("plant low table", "potted plant", props.bushy_plant(m.WHITE, radius=0.06, seed=31), 3.95, 2.15, low, 0),
        ("living rug", "rug-merged", props.rug(2.2, 1.9, paint("9c8f7d", Texture.FABRIC), m.NAVY), 3.6, 2.0, 0, 0),
        ("tv cabinet", "cabinet", tables.cabinet((0.42, 1.6, 0.45), m.BIRCH, doors=3, top=m.BIRCH), 0.32, 1.05, 0, 0),
        ("tv", "tv", appliances.tv(1.2, stand=True), 0.32, 1.05, 0.45, 0),
        ("bookshelf", "shelf", tables.bookshelf(0.9, 1.9, _DARK, boards=5), 5.94, 0.65, 0, 180),
        ("floor lamp", "lamp", props.floor_lamp(m.LINEN), 5.35, 0.42, 0, 0),
        ("plant window", "potted plant", props.rubber_plant(m.TERRACOTTA, height=1.5, seed=32), 0.45, 4.15, 0, 15),
        ("plant door", "potted plant", props.snake_plant(m.CHARCOAL, seed=33), 4.2, 4.3, 0, 0),
        ("picture living", "picture", props.picture(1.0, 0.7, ("a9bfc4", "3f6267", "e4d6a8")), 0.06, 3.1, 1.6, 0),
    ]
    for i, y in enumerate((2.8, 3.5)):
        spots.append((f"dining chair west {i + 1}", "chair", chair, 1.0, y, 0, 0))
        spots.append((f"dining chair east {i + 1}", "chair", chair, 2.1, y, 0, 180))
    for i, z in enumerate(tables.shelf_heights(1.9, 5)[:4]):
        spots.append((f"books living {i + 1}", "book", props.book_row(0.55 + 0.06 * i, 40 + i), 5.96, 0.62, z, 180))
    return spots


def _kitchen() -> list[Spot]:
    """Furnish it: two runs of worktops in a corner, cooker, fridge, a small table with stools pushed under."""
    body, stone, top = paint("8fa3a0"), paint("4a4b4d", Texture.PLASTER), 0.9
    spots: list[Spot] = [
        ("worktop north", "counter", tables.cabinet((0.6, 2.3, top), body, doors=4, top=stone), 1.24, 7.63, 0, -90),
        ("worktop west", "counter", tables.cabinet((0.6, 1.1, top), body, doors=2, top=stone), 0.37, 5.95, 0, 0),
        ("cooker", "oven", household.cooker(paint("dfe1e0")), 0.37, 6.85, 0, 0),
        (
            "fridge",
            "refrigerator",
            household.resized(appliances.refrigerator(m.WHITE), 0.95, 0.9, 1.08),
            2.85,
            7.6,
            0,
            -90,
        ),
        ("sink kitchen", "sink", appliances.sink(), 1.7, 7.6, top, -90),
        ("microwave", "microwave", appliances.microwave(), 0.5, 7.68, top, -90),
        ("toaster", "toaster", appliances.toaster(m.STEEL), 1.08, 7.68, top, -90),
        ("bottle kitchen 1", "bottle", props.bottle(m.GLASS_GREEN), 2.15, 7.75, top, 0),
        ("bottle kitchen 2", "bottle", props.bottle(m.GLASS_BROWN), 2.3, 7.72, top, 0),
        ("bowl kitchen", "bowl", props.bowl(m.TERRACOTTA), 0.35, 5.75, top, 0),
        ("vase kitchen", "vase", props.vase(m.WHITE, paint("d98c8c"), scale=0.8), 0.35, 6.25, top, 0),
        ("kitchen table", "dining table", tables.round_table(0.44, m.BIRCH, height=0.72), 2.85, 6.2, 0, 0),
        ("cup kitchen", "cup", props.cup(m.TERRACOTTA), 2.95, 6.3, 0.72, 0),
        ("kitchen bin", "trash can", props.trash_can(m.CHARCOAL), 3.5, 7.75, 0, 0),
        ("kitchen clock", "clock", props.clock(m.STEEL), 3.74, 5.6, 2.0, 180),
        ("crate", "box", household.carton(0.36, 0.28, 0.24), 0.3, 4.95, 0, 5),
    ]
    for i, (dx, dy) in enumerate(((-0.42, 0.0), (0.42, 0.0), (0.0, -0.42))):
        spots.append(
            (f"kitchen stool {i + 1}", "stool", household.stool(0.34, 0.46, _OAKISH), 2.85 + dx, 6.2 + dy, 0, 10)
        )
    return spots


def _hall_and_bath() -> list[Spot]:
    """Furnish them: shoe cabinet, bench with boxes under it; bathtub, toilet, washing machine."""
    return [
        ("shoe cabinet", "cabinet", tables.cabinet((0.34, 1.2, 0.95), m.WHITE, doors=3, top=_OAKISH), 4.05, 6.5, 0, 0),
        ("vase hall", "vase", props.vase(paint("55788a"), paint("e9e1d2"), scale=0.8), 4.03, 6.75, 0.95, 0),
        ("handbag", "handbag", props.handbag(paint("7a3b2c")), 4.05, 6.2, 0.95, 30),
        ("coat stand", "coat rack", props.coat_stand(), 4.15, 7.7, 0, 10),
        ("hall bench", "bench", seating.bench(1.15, _OAKISH, back=False), 5.35, 7.68, 0, -90),
        ("shoe box 1", "box", household.carton(0.2, 0.33, 0.13, paint("3d5f75")), 5.15, 7.68, 0, -90),
        ("shoe box 2", "box", household.carton(0.2, 0.33, 0.13, paint("a6483a")), 5.55, 7.62, 0, -90),
        ("suitcase", "suitcase", props.suitcase(paint("2f6b66")), 4.1, 5.1, 0, 0),
        ("backpack", "backpack", props.backpack(m.NAVY, m.CHARCOAL), 5.95, 5.25, 0, 180),
        ("picture hall", "picture", props.picture(0.5, 0.7, ("dcd3c2", "34465f", "b3593a")), 5.0, 7.94, 1.6, -90),
        ("bathtub", "bathtub", household.bathtub(1.75, 0.75), 7.45, 7.52, 0, 90),
        ("toilet", "toilet", household.toilet(), 7.95, 6.25, 0, 180),
        ("basin cabinet", "cabinet", tables.cabinet((0.46, 0.8, 0.78), m.BIRCH, doors=2, top=m.WHITE), 7.5, 5.5, 0, 90),
        ("sink bath", "sink", household.resized(appliances.sink(), 0.85, 0.85, 0.9), 7.5, 5.52, 0.78, 90),
        ("washing machine", "washing machine", household.washing_machine(), 6.6, 5.6, 0, 0),
        ("laundry basket", "basket", household.basket(m.LINEN), 8.1, 6.8, 0, 0),
    ]


def _bedroom() -> list[Spot]:
    """Furnish it: a double bed with boxes under it, wardrobe, dresser, a small desk by the wall."""
    stand = tables.cabinet((0.38, 0.46, 0.5), _OAKISH, doors=1, top=_OAKISH)
    spots: list[Spot] = [
        ("bed", "bed", household.bed(1.7, 2.05, _OAKISH, m.NAVY), 8.9, 1.2, 0, 90),
        ("nightstand west", "nightstand", stand, 7.7, 0.3, 0, 90),
        ("nightstand east", "nightstand", stand, 10.1, 0.3, 0, 90),
        ("lamp west", "lamp", household.table_lamp(m.LINEN), 7.68, 0.28, 0.5, 0),
        ("lamp east", "lamp", household.table_lamp(m.RUST), 10.12, 0.28, 0.5, 0),
        ("book nightstand", "book", props.book(paint("44604a")), 10.02, 0.44, 0.5, 80),
        ("bed box 1", "box", household.carton(0.5, 0.38, 0.22), 9.6, 1.35, 0, 4),
        ("bed box 2", "box", household.carton(0.55, 0.4, 0.2, paint("8c8f91")), 8.1, 1.5, 0, -3),
        ("bed box 3", "box", household.carton(0.45, 0.35, 0.18), 8.7, 2.05, 0, 90),
        ("wardrobe", "wardrobe", tables.cabinet((0.6, 2.1, 2.05), m.BIRCH, doors=4, top=m.BIRCH), 10.62, 3.5, 0, 180),
        ("dresser", "cabinet", tables.cabinet((0.45, 1.1, 0.85), _DARK, doors=3, top=_DARK), 8.1, 4.9, 0, -90),
        ("vase dresser", "vase", props.vase(m.CERAMIC, paint("b97fa3"), scale=0.9), 8.4, 4.9, 0.85, 0),
        ("clock dresser", "clock", props.clock(m.BRASS), 8.1, 5.14, 1.9, -90),
        ("pouf", "ottoman", seating.stool_pouf(m.TEAL), 8.9, 2.75, 0, 0),
        ("bedroom desk", "desk", tables.desk(_DARK, length=1.25, depth=0.6), 6.58, 1.9, 0, 0),
        ("bedroom chair", "chair", household.resized(seating.office_chair(_PLUM), 0.93, 0.93, 0.9), 7.0, 1.8, 0, 175),
        ("laptop", "laptop", appliances.laptop(m.STEEL), 6.55, 1.75, 0.74, 0),
        ("cup desk", "cup", props.cup(m.CERAMIC), 6.5, 2.25, 0.74, 0),
        ("desk bin", "trash can", household.resized(props.trash_can(m.WHITE), 0.8, 0.8, 0.75), 6.5, 1.45, 0, 0),
        ("plant bedroom", "potted plant", props.rubber_plant(m.WHITE, height=1.3, seed=34), 6.65, 0.5, 0, 60),
        ("bedroom picture", "picture", props.picture(0.8, 0.55, ("d9c7a0", "8a5a44", "c9772f")), 6.26, 2.0, 1.65, 0),
    ]
    return spots


def _childs_room() -> list[Spot]:
    """Furnish it: a narrow bed with boxes sticking out under it, a low shelf with toys on its lower boards."""
    low = tables.shelf_heights(1.1, 3)
    return [
        ("child's bed", "bed", household.bed(0.85, 1.95, m.WHITE, m.MUSTARD, height=0.36), 10.48, 6.9, 0, -90),
        ("toy box 1", "box", household.carton(0.4, 0.45, 0.26, paint("b5453a")), 10.15, 6.4, 0, 3),
        ("toy box 2", "box", household.carton(0.4, 0.45, 0.26, paint("3c7070")), 10.15, 7.0, 0, -4),
        ("teddy bear bed", "teddy bear", props.teddy_bear(paint("a87b4f", Texture.FABRIC)), 10.5, 7.3, 0.592, 200),
        ("child's desk", "desk", tables.desk(m.BIRCH, length=1.05, depth=0.55), 9.25, 7.62, 0, -90),
        ("child's chair", "chair", household.resized(seating.shell_chair(m.RUST), 0.85, 0.85, 0.85), 9.2, 7.1, 0, 95),
        ("child's lamp", "lamp", household.table_lamp(m.SAGE, height=0.36), 8.9, 7.72, 0.74, 0),
        ("child's keyboard", "keyboard", appliances.keyboard(m.WHITE), 9.3, 7.52, 0.74, -90),
        ("toy shelf", "shelf", tables.bookshelf(0.95, 1.1, m.BIRCH, boards=3), 8.63, 6.3, 0, 0),
        ("books toy shelf", "book", props.book_row(0.6, 51), 8.62, 6.35, low[2], 0),
        (
            "teddy bear shelf",
            "teddy bear",
            household.resized(props.teddy_bear(paint("8c8f91", Texture.FABRIC)), 0.8, 0.8, 0.8),
            8.64,
            6.1,
            low[1],
            0,
        ),
        ("bowl shelf", "bowl", props.bowl(paint("d98f2b")), 8.66, 6.5, low[0], 0),
        ("child's pouf", "ottoman", household.resized(seating.stool_pouf(m.MUSTARD), 1.15, 1.15, 0.8), 9.5, 6.5, 0, 0),
    ]


@cache
def home_scene() -> Scene:
    """Build the whole place (once a process)."""
    return furnished(ROOMS, HOLES, [*_living_room(), *_kitchen(), *_hall_and_bath(), *_bedroom(), *_childs_room()])


PLACE = Place(
    "home", "A flat of our own making", home_scene, lambda: plan_stations(home_scene()), frames=1200, width=320
)
