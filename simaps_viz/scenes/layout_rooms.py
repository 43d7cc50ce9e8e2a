"""What stands in the bar, the lounge and the office. Same frame and conventions as ``layout``."""

from simaps_viz.scenes import appliances, props, seating, tables
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.materials import paint
from simaps_viz.scenes.scene import SceneObject, place
from simaps_viz.scenes.shapes import Model

Spot = tuple[str, str, Model, float, float, float, float]
"""Name, label, model, x, y, z (metres), yaw (degrees)."""


def _place_all(spots: list[Spot]) -> list[SceneObject]:
    return [place(name, label, model, x, y, z, yaw_deg=yaw) for name, label, model, x, y, z, yaw in spots]


def cafe_kitchen() -> list[SceneObject]:
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
    return _place_all(spots)


def lounge() -> list[SceneObject]:
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
    return _place_all(spots)


def office() -> list[SceneObject]:
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
    return _place_all(spots)
