"""How long planning takes on a large map, beside networkx on the same cells, and what a command costs altogether."""

import math
import statistics
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import networkx as nx
import numpy as np
from benchmarks.timing import best_of, timed
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz.navigation.agent import answer
from simaps_viz.navigation.planner import Planner
from simaps_viz.structures import Grid, GridSpec, Path, Pose2, SIMap

LABELS: Final = ("none", "chair", "dining table", "floor", "wall")
_WALL_CELLS, _DOOR_CELLS = 3, 24
_SQRT2 = math.sqrt(2.0)

Point = tuple[float, float]


def rooms_grid(*, side_cells: int = 1000, room_cells: int = 125, seed: int = 0) -> Grid:
    """Make a large seeded floor of square rooms with a door in every wall, full of boxes as high as chairs and tables.

    Args:
        side_cells: rows and columns of the grid; cells are 5 cm.
        room_cells: from wall to wall.
        seed: of the doors and the furniture.
    """
    random = np.random.default_rng(seed)
    spec = GridSpec(side_cells, side_cells, 0.05, 0.0, 0.0)
    label = np.full(spec.shape, LABELS.index("floor"), np.int16)
    for _ in range(side_cells * side_cells // 3000):
        row, col = random.integers(0, side_cells, 2)
        rows, cols = random.integers(8, 28, 2)
        name = "chair" if max(rows, cols) < 14 else "dining table"
        label[row : row + rows, col : col + cols] = LABELS.index(name)
    for wall in range(0, side_cells + 1, room_cells):
        at = slice(max(wall - _WALL_CELLS, 0), wall + _WALL_CELLS)
        label[at, :] = label[:, at] = LABELS.index("wall")
    _open_doors(label, room_cells, random)
    stands = label != LABELS.index("floor")
    height = np.where(label == LABELS.index("wall"), 2.0, np.where(stands, 0.8, 0.0)).astype(np.float32)
    lowest = np.where(stands, 0.12, np.nan).astype(np.float32)
    is_thing = tuple(name in ("chair", "dining table") for name in LABELS)
    return Grid(spec, LABELS, is_thing, label, height, lowest, np.ones(spec.shape, np.int32))


def _open_doors(label: NDArray, room_cells: int, random: np.random.Generator) -> None:
    """Clear a door, and the floor before it, in every wall between two rooms."""
    side, floor, depth = len(label), LABELS.index("floor"), 4 * _WALL_CELLS
    for wall in range(room_cells, side - 1, room_cells):
        for room in range(0, side - room_cells + 1, room_cells):
            for turned in (label, label.T):
                door = room + int(random.integers(2 * _WALL_CELLS, room_cells - _DOOR_CELLS - 2 * _WALL_CELLS))
                turned[wall - depth : wall + depth, door : door + _DOOR_CELLS] = floor


def far_pairs(planner: Planner, *, pairs: int, seed: int = 0) -> list[tuple[Point, Point]]:
    """Choose pairs of points that can reach each other and lie at least half the map's side apart, metres."""
    random = np.random.default_rng(seed)
    spec = planner.spec
    areas = np.asarray(ndimage.label(planner.free)[0])  # pyright: ignore[reportIndexIssue]
    cells = np.argwhere(areas == np.bincount(areas[areas > 0]).argmax())
    chosen: list[tuple[Point, Point]] = []
    while len(chosen) < pairs:
        a, b = cells[random.integers(0, len(cells), 2)]
        if np.abs(a - b).max() >= min(spec.shape) // 2:
            chosen.append((spec.centre_of(*a), spec.centre_of(*b)))
    return chosen


def octile_graph(free: NDArray) -> nx.Graph:
    """Return the planner's own moves as a graph: 8 neighbours, cost 1 or sqrt(2), corners never cut.

    Args:
        free: bool [rows, cols].
    """
    number = np.arange(free.size).reshape(free.shape)
    graph = nx.Graph()
    graph.add_nodes_from(np.flatnonzero(free).tolist())
    straight = (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])
    for a, b in straight:
        both = free[a] & free[b]
        graph.add_edges_from(zip(number[a][both].tolist(), number[b][both].tolist(), strict=True), cost=1.0)
    square = free[:-1, :-1] & free[:-1, 1:] & free[1:, :-1] & free[1:, 1:]
    for a, b in ((np.s_[:-1, :-1], np.s_[1:, 1:]), (np.s_[:-1, 1:], np.s_[1:, :-1])):
        ends = zip(number[a][square].tolist(), number[b][square].tolist(), strict=True)
        graph.add_edges_from(ends, cost=_SQRT2)
    return graph


def networkx_cost(graph: nx.Graph, start: int, goal: int, cols: int) -> float:
    """Return the cost, in cells, of the way networkx's A* finds with the octile distance as its heuristic."""
    goal_row, goal_col = divmod(goal, cols)

    def octile(cell: int, _: int) -> float:
        row, col = divmod(cell, cols)
        dr, dc = abs(row - goal_row), abs(col - goal_col)
        return max(dr, dc) + (_SQRT2 - 1.0) * min(dr, dc)

    way = nx.astar_path(graph, start, goal, heuristic=octile, weight="cost")
    return sum(graph[a][b]["cost"] for a, b in pairwise(way))


def bench_planner(*, side_cells: int = 1000, pairs: int = 15, compared: int = 5, seed: int = 0) -> Iterator[str]:
    """Time planning across a large map, and compare time and cost with networkx's A* on the same cells and moves.

    Args:
        side_cells: rows and columns of the map.
        pairs: ways planned.
        compared: how many of them networkx plans as well.
        seed: of the map and the pairs.
    """
    grid = rooms_grid(side_cells=side_cells, seed=seed)
    _plan_all(Planner(rooms_grid(side_cells=250, seed=seed)), pairs=1, seed=seed)  # compiles the kernels
    planner = Planner(grid)
    setup_s, _ = timed(lambda: planner.free)
    jumps_s, _ = timed(lambda: planner.jumps)
    areas_s, _ = timed(lambda: planner.reachable(*far_pairs(planner, pairs=1, seed=seed)[0][0]))
    ways, seconds, paths = _plan_all(planner, pairs=pairs, seed=seed)
    length_m = statistics.median(path.length_m for path in paths)
    yield f"{side_cells} x {side_cells} cells, {np.mean(planner.free):.0%} free; {pairs} ways, median {length_m:.0f} m"
    yield f"  inflation (distances)       {1000 * setup_s:6.1f} ms, once for a map and a robot"
    yield f"  straight jumps              {1000 * jumps_s:6.1f} ms, once for a map and a robot"
    yield f"  connected areas             {1000 * areas_s:6.1f} ms, once for a map and a robot"
    yield (
        f"  one plan, smoothed          {1000 * statistics.median(seconds):6.1f} ms (median), "
        f"{1000 * max(seconds):.1f} ms for the slowest"
    )
    if compared:
        yield from _against_networkx(planner, ways[:compared], seconds[:compared], paths[:compared])


def bench_commands(simap: SIMap, commands: Sequence[str], pose: Pose2, *, name: str) -> Iterator[str]:
    """Time whole answers: words to program, validation, look-ups, planning and the simulated drive.

    Args:
        simap: the map.
        commands: English or programs.
        pose: where each command is given.
        name: of the map.
    """
    first_s, _ = timed(lambda: answer(simap, commands[0], pose))
    yield f"{name}: {len(commands)} commands; the first answer on a fresh map took {1000 * first_s:.0f} ms"
    for command in commands:
        seconds, said = best_of(lambda c=command: answer(simap, c, pose))
        words = command if len(command) <= 58 else command[:57] + "…"
        yield f"  {1000 * seconds:6.1f} ms  {said.status:<7}  {words!r}"


def _plan_all(planner: Planner, *, pairs: int, seed: int) -> tuple[list[tuple[Point, Point]], list[float], list[Path]]:
    ways = far_pairs(planner, pairs=pairs, seed=seed)
    done = [best_of(lambda a=a, b=b: planner.plan(a, b), runs=3) for a, b in ways]
    return ways, [seconds for seconds, _ in done], [path for _, path in done]


def _against_networkx(
    planner: Planner, ways: Sequence[tuple[Point, Point]], seconds: Sequence[float], paths: Sequence[Path]
) -> Iterator[str]:
    spec = planner.spec
    graph_s, graph = timed(lambda: octile_graph(planner.free))
    ratios, equal = [], 0
    for (start, goal), ours_s, path in zip(ways, seconds, paths, strict=True):
        a, b = (int(np.ravel_multi_index(spec.cell_of(*point), spec.shape)) for point in (start, goal))
        theirs_s, cost = timed(lambda a=a, b=b: networkx_cost(graph, a, b, spec.cols))
        ratios.append(theirs_s / ours_s)
        equal += math.isclose(cost * spec.cell_size_m, path.cost_m, rel_tol=1e-9)
    yield (
        f"  networkx's A*, same cells   {statistics.median(ratios):6.0f} x our time (median of {len(ratios)} pairs; "
        f"least {min(ratios):.0f} x), its graph made in {graph_s:.1f} s"
    )
    yield f"  costs equal                 {equal} of {len(ratios)} pairs"
