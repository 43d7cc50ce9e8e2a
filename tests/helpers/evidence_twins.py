"""Plain, slow twins of method evidence: readings, votes, pairs of cells, pooling, patches. Written from the docs."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from math import exp, floor, log

import numpy as np
from numpy.typing import NDArray

from simaps_viz.mapping.evidence import HIDES_FROM_M, EvidenceSettings
from simaps_viz.mapping.observations import Readings
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.votes import VoteSettings
from simaps_viz.structures import CellGraph, Frame, Grid, MergeLog, Segmentation

Reading = tuple[int, tuple[int, int], int, str, float, float]
"""(frame, (row, col) from the map's origin, segment, class, score, height)."""


def plain_readings(parts: Sequence[tuple[Frame, Segmentation, NDArray]], *, cell_size_m: float = 0.05) -> list[Reading]:
    """The highest pixel of every frame and cell, one pixel at a time; of equally high ones the first."""
    found: list[Reading] = []
    for frame, segmentation, T_map_camera in parts:
        k, best = frame.intrinsics, {}
        for v, u in np.ndindex(*frame.depth_m.shape):
            z = float(frame.depth_m[v, u])
            if not 0.1 < z < 6.0:
                continue
            x, y, h = (T_map_camera @ [(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z, 1.0])[:3]
            if not -0.3 < h < 2.0:
                continue
            cell = (int(np.floor(y / cell_size_m)), int(np.floor(x / cell_size_m)))
            if cell not in best or h > best[cell][0]:
                best[cell] = (float(h), int(segmentation.ids[v, u]))
        known = {s.id: (s.label, s.score) for s in segmentation.segments} | {0: ("none", 0.0)}
        found += [(frame.index, cell, s, *known[s], h) for cell, (h, s) in best.items()]
    return found


def plain_vote_labels(grid: Grid, readings: Readings, settings: VoteSettings) -> tuple[NDArray, float]:
    """Name cells one by one; sums are exact where scores and weights are short binary fractions."""
    rows, cols = grid.spec.shape
    top = {cell: grid.height_m[cell] for cell in np.ndindex(rows, cols)}
    votes: dict[tuple[int, int], dict[int, float]] = defaultdict(dict)
    counts: dict[tuple[int, int], dict[int, int]] = defaultdict(lambda: defaultdict(int))
    for flat, label, score, height in zip(
        readings.cell.tolist(), readings.label.tolist(), readings.score.tolist(), readings.height_m, strict=True
    ):
        cell = divmod(flat, cols)
        if not height > top[cell] - np.float32(settings.window_m):
            continue
        weight = settings.nothing if label == 0 else score if settings.scores else 1.0
        if label > 0 and not grid.is_thing[label]:
            weight *= settings.stuff
        votes[cell][label] = votes[cell].get(label, 0.0) + weight
        counts[cell][label] += 1
    often = [c.values() for c in counts.values() if sum(c.values()) >= 3]
    total = sum(sum(c) for c in often)
    disagreement = 1.0 - sum(max(c) for c in often) / total if total else 0.0
    if not settings.enabled or disagreement < settings.exact_below:
        return grid.label, disagreement

    def elect(standing: set[int]) -> NDArray:
        named = np.zeros((rows, cols), dtype=np.int16)
        for cell, own in votes.items():
            sums: dict[int, float] = {}
            around = [(cell[0] + dr, cell[1] + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]
            lenders = [(cell, own, 1.0)]
            for other in around[4:] + around[:4]:  # from the one to the right on: who is met first wins ties
                if other in votes and settings.neighbours > 0.0:
                    share = settings.neighbours * exp(-abs(top[other] - top[cell]) / settings.height_scale_m)
                    diagonal = other[0] != cell[0] and other[1] != cell[1]
                    lenders.append((other, votes[other], share * 0.7 if diagonal else share))
            for _, lent, share in lenders:
                for label, weight in lent.items():
                    if not (label in standing and top[cell] < settings.floor_m):
                        sums[label] = sums.get(label, 0.0) + share * weight
            named[cell] = max(sums, key=lambda label: sums[label]) if sums else 0  # the first of equals
        return named

    named, standing = elect(set()), set()
    for label, is_thing in enumerate(grid.is_thing if settings.floor_m > 0.0 else ()):
        tops = [top[cell] for cell in np.ndindex(rows, cols) if named[cell] == label and not np.isnan(top[cell])]
        if is_thing and 2 * sum(t < settings.floor_m for t in tops) < len(tops):
            standing.add(label)
    named = elect(standing) if settings.floor_m > 0.0 else named
    return plain_learned_labels(named, grid, readings, settings, standing) if settings.rounds else named, disagreement


TRUST = (1.0, 1.0, 0.7, 0.1)
STEPS_M = np.array([0.003, 0.006, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1, 0.3], dtype=np.float32)


def plain_learned_labels(
    named: NDArray, grid: Grid, readings: Readings, settings: VoteSettings, standing: set[int]
) -> NDArray:
    """Learn what masks get wrong, in dictionaries; from the classes that votes gave, and those that stand."""
    rows, cols = grid.spec.shape
    top = {cell: grid.height_m[cell] for cell in np.ndindex(rows, cols) if not np.isnan(grid.height_m[cell])}
    read: dict[tuple[int, int], dict[tuple[int, int], int]] = defaultdict(lambda: defaultdict(int))
    for flat, label, height in zip(readings.cell.tolist(), readings.label.tolist(), readings.height_m, strict=True):
        cell = divmod(flat, cols)
        below = float(top[cell] - height)
        if height > top[cell] - np.float32(settings.window_m):
            read[cell][sum(below >= edge for edge in (0.005, 0.015, 0.03)), label] += 1
    around = {
        cell: [
            (other, abs(dr * dc), sum(abs(top[cell] - top[other]) >= e for e in STEPS_M))
            for dr in (-1, 0, 1) for dc in (-1, 0, 1)
            if (dr or dc) and (other := (cell[0] + dr, cell[1] + dc)) in read
        ]
        for cell in read
    }  # fmt: skip
    labels = sorted({label for looks in read.values() for _, label in looks} | set(named.reshape(-1).tolist()) | {0})
    classes = [-2, -1, *labels]  # 0, -1 and -2 are nothing, by the height of the cell
    level = {cell: floor(float(top[cell]) / 0.05) for cell in read}
    reached = [floor(float(h) / 0.05) for h in top.values()]
    levels = range(min(0, *reached), max(reached) + 1)
    nothing = {cell: -sum(float(top[cell]) >= edge for edge in (0.1, 1.0)) for cell in read}
    candidates = {
        cell: [int(named[cell]) or nothing[cell]] + [
            label or nothing[cell]
            for label in dict.fromkeys([*(k for _, k in looks), *(int(named[o]) for o, *_ in around[cell])])
            if label != named[cell] and not (label in standing and top[cell] < settings.floor_m)
        ]
        for cell, looks in read.items()
    }  # fmt: skip
    share = {cell: {label: float(max(label, 0) == named[cell]) for label in candidates[cell]} for cell in read}
    for done in range(settings.rounds):
        field = 0.3 if done else 0.0
        size = {k: sum(s.get(k, 0.0) for s in share.values()) for k in classes}
        often = {k: (size[k] + 0.5) / (sum(size.values()) + 0.5 * len(classes)) for k in classes}
        seen = {
            (d, as_, k): sum(s.get(k, 0.0) * read[c].get((d, as_), 0) for c, s in share.items())
            for d in range(4) for as_ in labels for k in classes
        }  # fmt: skip
        log_read = {}
        for d in range(4):
            all_ = sum(seen[d, a, k] for a in labels for k in classes)
            agree = (sum(seen[d, max(k, 0), k] for k in classes) + 1) / (all_ + 2)
            for a in labels:
                usual = (sum(seen[d, a, k] for k in classes) + 0.5) / (all_ + 0.5 * len(labels)) * (1 - agree)
                for k in classes:
                    of_k = sum(seen[d, b, k] for b in labels)
                    log_read[d, a, k] = log((seen[d, a, k] + 10 * (usual + agree * (a == max(k, 0)))) / (of_k + 10))
        log_level = {}
        for at in levels:
            at_level = {k: sum(s.get(k, 0.0) for c, s in share.items() if level[c] == at) for k in classes}
            usual = (sum(at_level.values()) + 0.5) / (len(read) + 0.5 * len(levels))
            for k in classes:
                log_level[at, k] = log(often[k] * (at_level[k] + 10 * usual) / (size[k] + 10))
        chance, odds = sum(p * p for p in often.values()), {}
        for kind in ((across, step) for across in (0, 1) for step in range(len(STEPS_M) + 1)):
            pairs = [(c, o) for c in read for o, *k in around[c] if tuple(k) == kind]
            alike = sum(s * share[o].get(k, 0.0) for c, o in pairs for k, s in share[c].items())
            same = min(max(((alike / 2 + 1) / (len(pairs) / 2 + 2) - chance) / (1 - chance + 1e-12), 0.0), 0.999)
            odds[kind] = same / (1 - same)
        weighed = {}
        for c, looks in read.items():
            sums = {
                k: log_level[level[c], k] + sum(TRUST[d] * n * log_read[d, a, k] for (d, a), n in looks.items())
                + field * sum(
                    log(1 + odds[across, step] * share[o][k] / often[k])
                    for o, across, step in around[c] if share[o].get(k, 0.0) >= 1e-3
                )
                for k in candidates[c]
            }  # fmt: skip
            shares = {k: exp(s - max(sums.values())) for k, s in sums.items()}
            weighed[c] = {k: s / sum(shares.values()) for k, s in shares.items()}
        share = weighed
    found = named.copy()
    for c, s in share.items():
        found[c] = max(max(s, key=lambda k: s[k]), 0)
    return found


Evidence = dict[tuple[int, int, int], tuple[int, int]]
"""{(class, flat cell, later flat cell): (frames that say same, frames that say different)}."""


def plain_pairs(grid: Grid, readings: Readings, settings: EvidenceSettings) -> Evidence:
    """Ask every frame about every two cells it saw."""
    cols, label = grid.spec.cols, grid.label.reshape(-1)
    frames: dict[int, dict[int, int]] = defaultdict(dict)
    for cell, frame, segment, named in zip(
        readings.cell.tolist(), readings.frame.tolist(), readings.segment.tolist(), readings.label.tolist(), strict=True
    ):
        if segment > 0 and grid.is_thing[named] and named == label[cell]:
            frames[frame][cell] = segment
    found: dict[tuple[int, int, int], list[int]] = defaultdict(lambda: [0, 0])
    for seen in frames.values():
        for a, b in combinations(sorted(seen), 2):
            d_row, d_col = (abs(p - q) for p, q in zip(divmod(a, cols), divmod(b, cols), strict=True))
            on_a_line = d_row == 0 or d_col == 0 or d_row == d_col
            if label[a] == label[b] and on_a_line and max(d_row, d_col) in settings.ranges:
                found[int(label[a]), a, b][int(seen[a] != seen[b])] += 1
    return {
        (named, a, b): (same, different if settings.different else 0)
        for (named, a, b), (same, different) in found.items()
        if (settings.gap_cells < 0 or plain_gap(grid, a, b) <= settings.gap_cells) and (settings.different or same > 0)
    }


def plain_gap(grid: Grid, a: int, b: int) -> int:
    """How many cells between two of one class let one see that there is nothing of it."""
    ends = np.array([divmod(a, grid.spec.cols), divmod(b, grid.spec.cols)])
    length = int(np.abs(ends[1] - ends[0]).max())
    between = [tuple(ends[0] + (ends[1] - ends[0]) * k // length) for k in range(1, length)]
    top = [float(grid.height_m[tuple(end)]) for end in ends]
    gap = 0
    for cell in between:
        label, height = int(grid.label[cell]), float(grid.height_m[cell])
        mine = label == grid.label[tuple(ends[0])]
        hides = np.isnan(height) or height > min(top) + HIDES_FROM_M
        fills = (label == 0 or grid.is_thing[label]) and height > min(top) - HIDES_FROM_M
        gap += not (mine or hides or fills)
    return gap


def evidence_of(graphs: Sequence[CellGraph]) -> Evidence:
    """Return the graphs as `plain_pairs` does."""
    return {
        (graph.label, int(graph.cells[a]), int(graph.cells[b])): (int(same), int(different))
        for graph in graphs
        for (a, b), same, different in zip(graph.edges, graph.counts, graph.different, strict=True)
    }


def plain_pool(
    community: NDArray, edges: NDArray, same: NDArray, different: NDArray, touching: NDArray, settings: PoolSettings
) -> list[tuple[int, int, float]]:
    """All affinities counted anew before every step: (source, target, affinity)."""
    mine, steps = community.tolist(), []
    m, p = settings.imagined_pairs, settings.touching_same
    while True:
        sums: dict[tuple[int, int], list[float]] = defaultdict(lambda: [0.0, 0.0, False])
        for (a, b), s, d in zip(edges.tolist(), same.tolist(), different.tolist(), strict=True):
            pair = sums[min(mine[a], mine[b]), max(mine[a], mine[b])]
            pair[0], pair[1] = pair[0] + s, pair[1] + d
        for a, b in touching.tolist():
            sums[min(mine[a], mine[b]), max(mine[a], mine[b])][2] = True
        best, found = 0.0, None
        for (low, high), (s, d, touches) in sorted(sums.items()):
            affinity = (s + (m * p if touches else 0.0)) / (s + d + m) if s + d + m > 0 else 0.0
            if low != high and affinity > best:
                best, found = affinity, (low, high)
        if found is None:
            return steps
        steps.append((found[1], found[0], best))
        mine = [found[0] if one == found[1] else one for one in mine]


def plain_touching(cells: NDArray, cols: int) -> set[tuple[int, int]]:
    """Positions of every two cells at most one row and one column apart."""
    at = [divmod(int(cell), cols) for cell in cells]
    return {
        (i, j)
        for i, j in combinations(range(len(at)), 2)
        if abs(at[i][0] - at[j][0]) <= 1 and abs(at[i][1] - at[j][1]) <= 1
    }


def plain_patches(grid: Grid) -> set[tuple[int, frozenset[tuple[int, int]]]]:
    """{(class, cells)} of the 8-connected patches of things, by walking from cell to cell."""
    left = {cell for cell in np.ndindex(*grid.spec.shape) if grid.label[cell] > 0 and grid.is_thing[grid.label[cell]]}
    found = set()
    while left:
        waiting = [left.pop()]
        patch = set(waiting)
        while waiting:
            row, col = waiting.pop()
            for other in [(row + dr, col + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)]:
                if other in left and grid.label[other] == grid.label[row, col]:
                    left.remove(other)
                    patch.add(other)
                    waiting.append(other)
        found.add((int(grid.label[min(patch)]), frozenset(patch)))
    return found


def plain_follow(log: MergeLog, community: NDArray, threshold: float) -> NDArray:
    """Join communities step by step; a class stops before its first step not above the threshold."""
    joined, stopped = community.copy(), set()
    for label, source, target, score in zip(log.label, log.source, log.target, log.score, strict=True):
        if not score > np.float32(threshold):
            stopped.add(int(label))
        if int(label) not in stopped:
            joined[joined == source] = target
    return joined


def blocks(numbers: NDArray) -> set[frozenset[int]]:
    """The sets of cells that carry one number above 0: a partition whatever it is called."""
    flat = numbers.reshape(-1)
    return {frozenset(np.flatnonzero(flat == n).tolist()) for n in np.unique(flat[flat > 0])}
