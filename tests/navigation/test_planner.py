import heapq
import math
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from benchmarks.planner import bench_commands, bench_planner, networkx_cost, octile_graph
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from toy_maps import LABELS, TOY_POSE, Box, map_from_drawing, map_of_boxes, toy_map

from simaps_viz.errors import InputError, PlanningError
from simaps_viz.navigation import planner as planners
from simaps_viz.navigation.planner import (
    EAST,
    NORTH,
    SOUTH,
    WEST,
    Planner,
    RobotShape,
    clear_length,
    pull_straight,
    search,
    straight_jumps,
)
from simaps_viz.structures import Grid, GridSpec

POINT = RobotShape(radius_m=0.02)
"""Small enough to stand in every cell beside an obstacle."""


def plain_graph(free: np.ndarray) -> nx.Graph:
    """The grid's graph, written out: the plain twin's ground."""
    graph = nx.Graph()
    graph.add_nodes_from((int(r), int(c)) for r, c in np.argwhere(free))
    for r, c in graph.nodes:
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            there = (r + dr, c + dc)
            corners = (r, c + dc) in graph and (r + dr, c) in graph
            if there in graph and (dr == 0 or dc == 0 or corners):
                graph.add_edge((r, c), there, cost=math.hypot(dr, dc))
    return graph


def plain_dijkstra(graph: nx.Graph, start: tuple[int, int]) -> dict[tuple[int, int], float]:
    done, heap = {}, [(0.0, start)]
    while heap:
        cost, here = heapq.heappop(heap)
        if here not in done:
            done[here] = cost
            for there, edge in graph[here].items():
                heapq.heappush(heap, (cost + edge["cost"], there))
    return done


def box_of(goal: np.ndarray) -> np.ndarray:
    rows, cols = np.nonzero(goal)
    return np.array([rows.min(), rows.max(), cols.min(), cols.max()], np.int64)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 16), st.integers(2, 16), st.floats(0.0, 0.6), st.integers(1, 4))
def test_astar_costs_what_dijkstra_costs(seed: int, rows: int, cols: int, share: float, goals: int) -> None:
    random = np.random.default_rng(seed)
    free = random.random((rows, cols)) >= share
    free[0, 0] = True
    goal = np.zeros_like(free)
    goal.flat[random.integers(0, free.size, goals)] = True
    cells, cost = search(free, straight_jumps(free), (0, 0), goal, box_of(goal))
    known = plain_dijkstra(plain_graph(free), (0, 0))
    best = min((known[int(r), int(c)] for r, c in np.argwhere(goal & free) if (r, c) in known), default=math.inf)
    assert cost == pytest.approx(best)
    if math.isfinite(best):
        assert tuple(cells[0]) == (0, 0) and goal[tuple(cells[-1])]
        steps = np.diff(cells, axis=0)
        assert (np.abs(steps).max(axis=1) == 1).all() if len(steps) else True
        assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(best)
        assert free[cells[:, 0], cells[:, 1]].all()
        for (r, c), (dr, dc) in zip(cells, steps, strict=False):
            assert free[r + dr, c] and free[r, c + dc], "cut a corner"
    else:
        assert len(cells) == 0


def random_floor(seed: int, rows: int, cols: int) -> np.ndarray:
    """Rooms, furniture and speckles: long straight jumps as well as narrow places."""
    random = np.random.default_rng(seed)
    free = random.random((rows, cols)) >= random.choice([0.0, 0.02, 0.2])
    for _ in range(random.integers(0, 14)):
        row, col, high, wide = (int(v) for v in random.integers((0, 0, 1, 1), (rows, cols, 9, 9)))
        free[row : row + high, col : col + wide] = False
    free[0, 0] = free[-1, -1] = True
    return free


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 100_000), st.integers(2, 40), st.integers(2, 40))
def test_astar_costs_what_networkx_finds(seed: int, rows: int, cols: int) -> None:
    free = random_floor(seed, rows, cols)
    goal = np.zeros_like(free)
    goal[-1, -1] = True
    cells, cost = search(free, straight_jumps(free), (0, 0), goal, box_of(goal))
    graph = octile_graph(free)
    by_cell = nx.relabel_nodes(graph, {n: divmod(n, cols) for n in graph})
    assert nx.utils.graphs_equal(by_cell, plain_graph(free))
    if not nx.has_path(graph, 0, free.size - 1):
        assert math.isinf(cost) and len(cells) == 0
    else:
        assert cost == pytest.approx(nx.dijkstra_path_length(graph, 0, free.size - 1, weight="cost"))
        assert cost == pytest.approx(networkx_cost(graph, 0, free.size - 1, cols))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 100_000), st.integers(1, 12), st.integers(1, 12), st.floats(0.0, 0.6))
def test_straight_jumps_against_walking(seed: int, rows: int, cols: int, share: float) -> None:
    free = np.random.default_rng(seed).random((rows, cols)) >= share
    jumps = straight_jumps(free)

    def is_free(row: int, col: int) -> bool:
        return 0 <= row < rows and 0 <= col < cols and bool(free[row, col])

    for side, (dr, dc) in ((EAST, (0, 1)), (WEST, (0, -1)), (NORTH, (1, 0)), (SOUTH, (-1, 0))):
        for row, col in np.ndindex(rows, cols):
            n, found = 0, False
            while is_free(row, col) and not found and is_free(row + (n + 1) * dr, col + (n + 1) * dc):
                n += 1
                r, c = row + n * dr, col + n * dc
                found = any(
                    is_free(r + h * dc, c + h * dr) and not is_free(r + h * dc - dr, c + h * dr - dc) for h in (1, -1)
                )
            assert jumps[row, col, side] == (n if found else -n)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 100_000), st.integers(2, 40), st.integers(2, 40))
def test_smoothing_never_cuts_an_obstacle(seed: int, rows: int, cols: int) -> None:
    """Every cell that a stretch of the path so much as touches is free, and no stretch is longer than what it skips."""
    free = random_floor(seed, rows, cols)
    goal = np.zeros_like(free)
    goal[-1, -1] = True
    cells, cost = search(free, straight_jumps(free), (0, 0), goal, box_of(goal))
    if len(cells) == 0:
        return
    way = cells[:, ::-1] + 0.5
    short = pull_straight(free, way)
    assert (short[0] == way[0]).all() and (short[-1] == way[-1]).all()
    kept = [np.flatnonzero((way == point).all(axis=1))[0] for point in short]
    assert kept == sorted(kept), "only points of the way, in its order"
    lengths = np.linalg.norm(np.diff(short, axis=0), axis=1)
    assert lengths.sum() <= cost + 1e-9
    for (x0, y0), (x1, y1) in pairwise(short):
        for row, col in np.argwhere(~free):
            assert not crosses_cell(x0, y0, x1, y1, int(row), int(col))


def crosses_cell(x0: float, y0: float, x1: float, y1: float, row: int, col: int) -> bool:
    """Whether a segment runs through the inside of a cell: clipped to it, something is left (Liang and Barsky)."""
    enter, leave = 0.0, 1.0
    for start, delta, low in ((x0, x1 - x0, col), (y0, y1 - y0, row)):
        if delta == 0.0:
            if not low < start < low + 1:
                return False
        else:
            a, b = sorted(((low - start) / delta, (low + 1 - start) / delta))
            enter, leave = max(enter, a), min(leave, b)
    return leave - enter > 1e-9


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 100_000), st.sampled_from([0.05, 0.12, 0.2]))
def test_a_planned_path_keeps_the_robot_off_every_obstacle(seed: int, radius_m: float) -> None:
    """Measured without the planner's own masks: the hull stays off the blocked cells, but for the inflation's rounding.

    A centre may lie anywhere in a free cell, half a diagonal from the cell's centre that the distance was taken of.
    """
    floor = random_floor(seed, 40, 40)
    spec = GridSpec(40, 40, 0.05, 0.0, 0.0)
    height = np.where(floor, 0.0, 0.8).astype(np.float32)
    planner = Planner(grid_of(spec, height, np.where(floor, np.nan, 0.12).astype(np.float32)), RobotShape(radius_m))
    cells = np.argwhere(planner.free)
    if len(cells) == 0 or floor.all():
        return
    start = spec.centre_of(*cells[0])
    reachable = np.argwhere(planner.reachable(*start))
    path = planner.plan(start, spec.centre_of(*reachable[-1]))
    blocked = (np.argwhere(~floor)[:, ::-1] + 0.5) * 0.05
    for p, q in zip(path.points_m[:-1], path.points_m[1:], strict=True):
        for point in p + np.linspace(0.0, 1.0, 100)[:, None] * (q - p):
            gap = np.linalg.norm(np.maximum(np.abs(blocked - point) - 0.025, 0.0), axis=1).min()
            assert gap >= radius_m - 0.025 * math.sqrt(2.0) - 1e-9


def test_bench_says_costs_are_equal() -> None:
    lines = list(bench_planner(side_cells=250, pairs=3, compared=2))
    assert lines[-1].split() == ["costs", "equal", "2", "of", "2", "pairs"]
    said = list(bench_commands(toy_map(), ["go to the chair", "go to the piano"], TOY_POSE, name="toy"))
    assert [line.split()[2] for line in said[1:]] == ["ok", "refused"]


def test_astar_is_deterministic() -> None:
    free = np.random.default_rng(3).random((60, 60)) > 0.2
    free[0, 0] = free[-1, -1] = True
    goal = np.zeros_like(free)
    goal[-1, -1] = True
    first = search(free, straight_jumps(free), (0, 0), goal, box_of(goal))
    for _ in range(3):
        again = search(free.copy(), straight_jumps(free), (0, 0), goal, box_of(goal))
        assert np.array_equal(first[0], again[0]) and first[1] == again[1]


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10_000), st.tuples(*[st.floats(0.01, 9.99)] * 4))
def test_line_of_sight_against_dense_sampling(seed: int, ends: tuple[float, float, float, float]) -> None:
    free = np.random.default_rng(seed).random((10, 10)) > 0.15
    x0, y0, x1, y1 = ends
    share = clear_length(free, x0, y0, x1, y1)
    t = np.linspace(0.0, 1.0, 4001)
    inside = free[(y0 + t * (y1 - y0)).astype(int), (x0 + t * (x1 - x0)).astype(int)]
    assert inside[t < share - 1e-6].all()  # all it calls clear is clear
    if not inside.all():
        assert share <= t[~inside][0] + 1e-6
    if share < 1.0:  # where it stops it touches a cell that is not free
        x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        rows, cols = np.nonzero(~free)
        assert ((np.abs(cols + 0.5 - x) < 0.5 + 1e-6) & (np.abs(rows + 0.5 - y) < 0.5 + 1e-6)).any()


def test_line_of_sight_does_not_squeeze_through_a_corner() -> None:
    free = np.array([[True, False], [True, True]])
    assert clear_length(free, 0.5, 0.5, 1.5, 1.5) == pytest.approx(0.5)
    assert clear_length(free, 0.5, 0.5, 0.5, 1.5) == 1.0
    assert clear_length(free, 0.5, 0.5, 5.0, 0.5) == pytest.approx(0.5 / 4.5)


def grid_of(spec: GridSpec, height: np.ndarray, lowest: np.ndarray) -> Grid:
    ones = np.ones(spec.shape, np.int32)
    return Grid(spec, LABELS, (False,) * len(LABELS), np.zeros(spec.shape, np.int16), height, lowest, ones)


def test_what_is_blocked_depends_on_the_height_of_its_underside() -> None:
    spec = GridSpec(1, 6, 0.05, 0.0, 0.0)
    height = np.array([[0.0, 0.05, 0.8, 1.9, 1.9, np.nan]], np.float32)
    lowest = np.array([[np.nan, np.nan, 0.7, 1.5, 1.6, np.nan]], np.float32)
    planner = Planner(grid_of(spec, height, lowest), POINT)
    assert planner.blocked.tolist() == [[False, False, True, True, False, False]]
    assert planner.free.tolist() == [[True, True, False, False, True, False]]
    low = Planner(grid_of(spec, height, lowest), RobotShape(0.02, 0.6))
    assert low.free.tolist() == [[True, True, True, True, True, False]]


@pytest.mark.parametrize("radius_m", [0.02, 0.1, 0.2, 0.33])
def test_free_is_what_keeps_the_radius(radius_m: float) -> None:
    simap = toy_map()
    planner = Planner(simap.grid, RobotShape(radius_m))
    blocked = np.argwhere(planner.blocked)
    gap = (planner.robot.radius_m / 0.05 + 0.5) ** 2
    seen = ~np.isnan(simap.grid.height_m)
    for row, col in np.random.default_rng(0).integers(0, (100, 120), (300, 2)):
        nearest = ((blocked - (row, col)) ** 2).sum(axis=1).min()
        assert planner.free[row, col] == (seen[row, col] and nearest > 0 and nearest >= gap - 1e-6)


def test_paths_keep_clear_of_the_inflated_obstacles() -> None:
    simap = toy_map()
    planner = Planner(simap.grid)
    spec, cells = simap.spec, np.argwhere(planner.free)
    random = np.random.default_rng(1)
    for a, b in random.choice(len(cells), (40, 2)):
        start, end = spec.centre_of(*cells[a]), spec.centre_of(*cells[b])
        path = planner.plan(start, end)
        assert path.points_m[0] == pytest.approx(start)
        assert path.points_m[-1] == pytest.approx(end)
        assert path.length_m <= path.cost_m + 1e-9
        for p, q in zip(path.points_m[:-1], path.points_m[1:], strict=True):
            for point in p + np.linspace(0.0, 1.0, 200)[:, None] * (q - p):
                assert planner.free[spec.cell_of(*point)]


def test_smoothing_leaves_a_straight_way_straight() -> None:
    planner = Planner(toy_map().grid)
    path = planner.plan((0.5, 0.5), (2.6, 0.7))
    assert len(path.points_m) == 2
    assert path.length_m == pytest.approx(math.hypot(2.1, 0.2))


def test_no_way_is_said_in_words() -> None:
    sealed = map_from_drawing("........\n..####..\n..#..#..\n..####..\n........")
    planner = Planner(sealed.grid, POINT)
    with pytest.raises(PlanningError, match=r"there is no free path from \(0.10, 0.10\) to \(0.75, 0.45\)"):
        planner.plan((0.1, 0.1), (0.75, 0.45))
    with pytest.raises(PlanningError, match=r"\(0.50, 0.50\) is not free floor for this robot"):
        planner.plan((0.1, 0.1), (0.5, 0.5))
    with pytest.raises(PlanningError, match="is not free floor"):
        planner.plan((0.1, 0.1), (99.0, 0.5))


def test_unseen_floor_is_not_driven_over() -> None:
    split = map_from_drawing("..?..\n..?..\n..?..")
    planner = Planner(split.grid, POINT)
    with pytest.raises(PlanningError, match="there is no free path"):
        planner.plan((0.1, 0.1), (0.9, 0.1))


def test_start_snaps_to_the_nearest_free_cell() -> None:
    simap = toy_map()
    planner = Planner(simap.grid)
    assert planner.start_cell(0.52, 0.52) == simap.spec.cell_of(0.52, 0.52)
    row, col = planner.start_cell(0.0, -0.65)  # inside chair 3, near its north east corner
    assert planner.free[row, col]
    offsets = np.array(simap.spec.centre_of(*np.argwhere(planner.free).T)).T - (0.0, -0.65)  # type: ignore[arg-type]
    moved = np.linalg.norm(np.array(simap.spec.centre_of(row, col)) - (0.0, -0.65))
    assert moved == pytest.approx(np.linalg.norm(offsets, axis=1).min())
    path = planner.plan((0.0, -0.65), (0.5, 0.5))
    assert path.points_m[0] == pytest.approx((0.0, -0.65))
    for outside in ((-5.0, 0.0), (1e300, 0.0), (-1.0, -2.0 - 0.5)):
        with pytest.raises(PlanningError, match=r"the robot cannot start at .* there is no free floor within 0.5 m"):
            planner.start_cell(*outside)


def test_start_prefers_roomy_floor_to_a_pocket() -> None:
    # the corridor is an L of 0.76 m2, the pocket a square of 0.04 m2
    drawing = "#..........\n##########.\n#.#........\n###########"
    planner = Planner(map_from_drawing(drawing, cells=4).grid, RobotShape(0.02))
    row, col = planner.start_cell(0.42, 0.3)  # on the wall between the pocket and the corridor
    assert planner._areas[row, col] == planner._areas[planner.spec.cell_of(1.5, 0.3)]


def test_goal_is_the_nearest_reachable_cell() -> None:
    simap = toy_map()
    planner = Planner(simap.grid)
    cells = np.array([simap.spec.centre_of(*rc) for rc in np.argwhere(simap.instance == 4)])
    path = planner.plan_near((0.5, 0.5), cells, "to the chair")
    free = np.array([simap.spec.centre_of(*rc) for rc in np.argwhere(planner.reachable(0.5, 0.5))])
    distance = np.sqrt(((free[:, None] - cells[None]) ** 2).sum(axis=2)).min(axis=1)
    mine = np.linalg.norm(cells - path.points_m[-1], axis=1).min()
    assert mine == pytest.approx(distance.min())
    ways = [planner.plan((0.5, 0.5), tuple(p)).cost_m for p in free[distance < distance.min() + 1e-9]]
    assert path.cost_m == pytest.approx(min(ways)), "of equally near cells, the shortest way"


def test_goal_is_not_behind_a_wall_unless_that_takes_a_long_detour(monkeypatch: pytest.MonkeyPatch) -> None:
    """The nearest free cell lies across a thin wall; the robot goes to the side of the chair instead."""
    spec = GridSpec(60, 80, 0.05, 0.0, 0.0)
    chair, shelf = Box("chair", 30, 40, 8, 8, 0.8), Box("couch", 12, 30, 18, 28, 0.7)
    wall = Box("wall", 38, 20, 1, 60, 2.0)
    around = [Box("couch", 30, 30, 8, 10, 0.7), Box("couch", 30, 48, 8, 12, 0.7)]
    simap = map_of_boxes(spec, [chair, shelf, *around], [wall])
    planner = Planner(simap.grid)
    cells = np.array([simap.spec.centre_of(*rc) for rc in np.argwhere(simap.instance == 1)])
    see_through = simap.grid.height_m < 1.5
    across = planner.plan_near((1.0, 0.3), cells, "to the chair").points_m[-1]
    beside = planner.plan_near((1.0, 0.3), cells, "to the chair", see_through=see_through).points_m[-1]
    assert across[1] > 39 * 0.05
    assert beside[1] < 38 * 0.05
    farther = np.linalg.norm(cells - beside, axis=1).min() - np.linalg.norm(cells - across, axis=1).min()
    for allowed, goal in ((farther + 0.01, beside), (farther - 0.01, across)):
        monkeypatch.setattr("simaps_viz.navigation.planner.DETOUR_TO_SEE_M", allowed)
        found = planner.plan_near((1.0, 0.3), cells, "to the chair", see_through=see_through).points_m[-1]
        assert found == pytest.approx(goal)


def test_goal_too_far_off_fails() -> None:
    simap = toy_map()
    planner = Planner(simap.grid, RobotShape(radius_m=0.6))  # does not fit through the doorway
    cells = np.array([simap.spec.centre_of(*rc) for rc in np.argwhere(simap.instance == 4)])
    with pytest.raises(PlanningError, match=r"cannot get to the chair: the nearest it can stand is 2\.\d\d m off"):
        planner.plan_near((1.0, 0.4), cells, "to the chair")


def test_clear_ahead() -> None:
    planner = Planner(toy_map().grid)
    here = (TOY_POSE.x_m, TOY_POSE.y_m)
    assert planner.clear_ahead_m(here, (2.5, 0.5)) == pytest.approx(2.0)
    assert planner.clear_ahead_m(here, (0.5, 2.0)) == pytest.approx(0.8)  # the table's free margin begins at y = 1.3
    assert planner.clear_ahead_m(here, here) == 0.0
    assert planner.obstacle_near((0.5, 1.35)) == "a dining table"
    assert planner.obstacle_near((-9.0, 0.0)) == "the edge of the map"
    assert planner.obstacle_near((-0.45, -1.45)) == "floor that was never seen"


@pytest.mark.parametrize("bad", [{"radius_m": 0.0}, {"radius_m": -1.0}, {"height_m": float("nan")}, {"radius_m": 6.0}])
def test_robot_shape_is_checked(bad: dict) -> None:
    with pytest.raises(InputError, match=r"robot .*: expected metres between 0 and 5"):
        RobotShape(**bad)


@pytest.mark.parametrize("band", [1, 400, 1 << 22])
@pytest.mark.parametrize("radius_m", [0.02, 0.2, 0.33, 1.2])
def test_free_cells_do_not_depend_on_how_many_rows_are_looked_at_together(monkeypatch, band: int, radius_m: float):
    rng = np.random.default_rng(7)
    for obstacles in (0.0, 0.002, 0.02):
        blocked = rng.random((83, 61)) < obstacles
        monkeypatch.setattr(planners, "_BLOCK_CELLS", band)
        needed = radius_m / 0.05 + 0.5
        near = np.asarray(ndimage.distance_transform_edt(~blocked))
        distance = near if blocked.any() else np.full(blocked.shape, np.inf)
        assert np.array_equal(planners._clear(blocked, needed - 1e-9), distance >= needed - 1e-9)
