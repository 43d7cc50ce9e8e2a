"""Simulated network errors: exact instance ids spoiled the way a panoptic network errs. Never called anything else.

What goes wrong, in this order: borders wander (a smooth random displacement of the whole picture), objects are
missed, get a wrong name, are cut in two; and two neighbours of one class become one segment. Stuff keeps its name;
all stuff of one class is one segment, as networks give it.

Level "detector" errs as often as a real one was measured to. It knows the things of COCO only, misses small things more
often than large ones, and a thing that it misses or misnames once it does again.
"""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects
from scipy.special import ndtr, ndtri

from simaps_viz.colors.classes import COCO_THINGS
from simaps_viz.errors import InputError


@dataclass(frozen=True, eq=False)
class ClassErrors:
    """What goes wrong with things of one class, as measured."""

    miss_by_size: tuple[float, ...]
    """As ``ErrorLevel.miss_by_size``."""
    names: Mapping[str, float]
    """What those that are found are called: shares, 1 in all."""
    extent: NDArray | None = None
    """Float [2, `PLACES`²]: in each place of `around` a thing, the shares of the pixels beside it and of its own that
    its segment covers. None: its own."""
    scores: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    """Confidences of those that are named wrongly, and rightly; ascending."""


@dataclass(frozen=True)
class ErrorLevel:
    """How often what goes wrong. Chances are per object and frame, or per pair of neighbours and frame."""

    border_px: float
    """Standard deviation of the displacement's control points, pixels at 512 pixels width."""
    miss: float
    flip: float
    """The object gets the name of another thing class of the scene."""
    split: float
    """The object is cut in two at its middle, along a random line."""
    merge: float
    """Two segments of one class become one, if their objects' middles are less than ``MERGE_DISTANCE_M`` apart."""
    miss_by_size: tuple[float, ...] = ()
    """Instead of ``miss``: for things of once, twice, four times ... as many pixels as ``SMALLEST_PX``."""
    known: frozenset[str] | None = None
    """The classes that it has names for; no stuff among them. None = all, and stuff."""
    invent: float = 0.0
    """A thing that it has no name for gets that of another one."""
    lasting: float = 0.0
    """Correlation of what goes wrong with one object in two frames."""
    by_class: Mapping[str, ClassErrors] | None = None
    """Instead of ``miss``, ``flip``, ``known`` and ``invent``; objects of other classes are never found. A misnamed
    thing is part of the nearest segment of that name, if there is one as near as those that merge."""


LEVELS: dict[str, ErrorLevel] = {
    "none": ErrorLevel(border_px=0.0, miss=0.0, flip=0.0, split=0.0, merge=0.0),
    "light": ErrorLevel(border_px=1.0, miss=0.05, flip=0.01, split=0.03, merge=0.05),
    "medium": ErrorLevel(border_px=2.0, miss=0.10, flip=0.03, split=0.05, merge=0.10),
    "heavy": ErrorLevel(border_px=4.0, miss=0.20, flip=0.05, split=0.10, merge=0.25),
    # As apps/measure_masks.py finds it for yolo11n-seg-int8 on pictures of a rendered house (aws-small-house).
    "detector": ErrorLevel(
        border_px=1.0,
        miss=0.0,
        flip=0.065,
        split=0.016,
        merge=0.15,
        miss_by_size=(0.91, 0.77, 0.72, 0.53, 0.42, 0.29, 0.24, 0.21, 0.16, 0.25, 0.71, 1.0),
        known=frozenset(COCO_THINGS),
        invent=0.117,
        lasting=0.67,
    ),
}
CONTROL_SPACING_PX = 32
"""Distance of the displacement's control points, at 512 pixels width."""
SMALLEST_PX = 60
"""Things of fewer pixels (at 512 x 384) are never found."""
MERGE_DISTANCE_M = 1.2
"""Horizontal distance of two objects' middles."""
MERGE_GAP = 0.03
"""Two segments merge only if the boxes round them are at most this share of the picture's width apart."""
PLACES = 8
"""Rows and columns of places around a thing."""


@dataclass(frozen=True)
class KnownInstance:
    """What is known of one object of the world."""

    label: str
    is_thing: bool
    centre_m: tuple[float, float]
    """Horizontal middle of its box, world frame (z up)."""


def known_instances(scene: Mapping[str, Any]) -> dict[int, KnownInstance]:
    """Read the instance table of a ``scene.json``: {id: what is known}."""
    known = {}
    for row in scene["instances"]:
        x, y = ((row["aabb_min"][i] + row["aabb_max"][i]) / 2 for i in range(2))
        known[int(row["id"])] = KnownInstance(row["label"], bool(row["isthing"]), (x, y))
    return known


def check_level(level: str) -> str:
    """Return the level back; raises InputError when there is none of that name."""
    if level not in LEVELS:
        raise InputError(f"error level: expected one of {', '.join(LEVELS)}, found {level!r}")
    return level


@dataclass(frozen=True, eq=False)
class _Draws:
    """All chance of one frame. Light, medium and heavy share it: a heavier one errs wherever a lighter one does."""

    miss: NDArray
    flip: NDArray
    split: NDArray
    other: NDArray
    """[ids], 0-1: which wrong name."""
    angle: NDArray
    """[ids], 0-1: direction of the cut."""
    score: NDArray
    """[ids], 0-1."""
    merge: NDArray
    """[ids, ids]."""
    wander: NDArray
    """float32 [2, rows, cols], standard normal, displacement of the control points."""
    extent: NDArray
    """[ids], 0-1: a segment covers the places that more segments than this cover."""


def _draw(seed: int, frame: str, ids: int, control: tuple[int, int], lasting: float) -> _Draws:
    rng = np.random.default_rng([seed, zlib.crc32(frame.encode())])
    wander = rng.standard_normal((2, *control), dtype=np.float32)
    miss, flip, split, other, angle, score = rng.random((6, ids))
    merge, extent = rng.random((ids, ids)), rng.random(ids)
    if lasting:
        miss_always, flip_always, other, extent_always = np.random.default_rng(seed).random((4, ids))
        miss, flip = _correlated(miss, miss_always, lasting), _correlated(flip, flip_always, lasting)
        extent = _correlated(extent, extent_always, lasting)
    return _Draws(miss, flip, split, other, angle, score, merge, wander, extent)


def _correlated(one: NDArray, always: NDArray, correlation: float) -> NDArray:
    """Return chances from 0 to 1 that are alike wherever ``always`` is, by a Gaussian copula."""
    return ndtr(math.sqrt(correlation) * ndtri(always) + math.sqrt(1.0 - correlation) * ndtri(one))


def simulate_errors(
    ids: NDArray, instances: Mapping[int, KnownInstance], *, level: str, seed: int, frame: str
) -> tuple[NDArray, list[dict[str, Any]]]:
    """Spoil the exact ids of one frame.

    The outcome depends on the arguments alone, not on other frames or their order.

    Args:
        ids: Whole numbers [H, W], exact instance ids, 0 = nothing.
        instances: What the ids are; other ids count as nothing.
        level: A key of ``LEVELS``.
        seed: Not negative.
        frame: Name of the frame.

    Returns:
        Segment ids uint16 [H, W], 0 = nothing; and one row for each: id, label, score, area (pixels).

    Raises:
        InputError: There is no such level.
    """
    chance = LEVELS[check_level(level)]
    height, width = ids.shape
    scale = width / 512.0
    spacing = max(4.0, CONTROL_SPACING_PX * scale)
    control = (int(height / spacing) + 2, int(width / spacing) + 2)
    draws = _draw(seed, frame, max(instances, default=0) + 1, control, chance.lasting)
    moved = _wander(ids.astype(np.uint16), chance.border_px * scale, draws)
    area = np.bincount(moved.ravel(), minlength=max(instances, default=0) + 1)
    present = [int(i) for i in np.flatnonzero(area) if int(i) in instances]
    smallest = SMALLEST_PX * scale**2 if level != "none" else 0
    found = [
        i for i in present if _is_found(instances[i], float(area[i]), smallest, chance, draws.miss[i], draws.flip[i])
    ]
    names = _names(found, instances, chance, draws)
    segment_of = _numbers(found, names, instances)
    segments = {segment_of[i]: (names[i], _score(i, names[i], instances, chance, draws)) for i in found}
    lookup = np.zeros(max(int(moved.max()), max(instances, default=0)) + 1, dtype=np.uint16)
    for i in found:
        lookup[i] = segment_of[i]
    spoiled = lookup[moved]
    if chance.by_class is not None:
        _reshape(spoiled, moved, [i for i in found if instances[i].is_thing], instances, segment_of, chance, draws)
    _split(spoiled, [i for i in found if draws.split[i] < chance.split], instances, segment_of, segments, draws)
    _merge(spoiled, [i for i in found if instances[i].is_thing], names, instances, segment_of, chance, draws)
    areas = np.bincount(spoiled.ravel(), minlength=len(segments) + 1)
    rows = [
        {"id": number, "label": label, "score": score, "area": int(areas[number])}
        for number, (label, score) in sorted(segments.items())
        if areas[number]
    ]
    return spoiled, rows


def _is_found(
    known: KnownInstance, area_px: float, smallest_px: float, chance: ErrorLevel, miss: float, flip: float
) -> bool:
    """Whether an object becomes a segment; ``miss`` and ``flip`` are what was drawn for it."""
    if chance.by_class is not None:
        sizes = chance.by_class[known.label].miss_by_size if known.label in chance.by_class else (math.inf,)
    elif not known.is_thing:
        # A network of things alone knows nothing of stuff; one of everything never misses it.
        return chance.known is None
    elif chance.known is not None and known.label not in chance.known:
        return area_px >= smallest_px and flip < chance.invent
    else:
        sizes = chance.miss_by_size or (chance.miss,)
    if area_px < smallest_px:
        return False
    size = int(math.log2(area_px / smallest_px)) if smallest_px else 0
    return miss >= sizes[min(size, len(sizes) - 1)]


def _wander(ids: NDArray, sigma_px: float, draws: _Draws) -> NDArray:
    """Displace the picture smoothly by about ``sigma_px``."""
    if sigma_px <= 0:
        return ids
    height, width = ids.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    du, dv = (
        cv2.resize(w, (width, height), interpolation=cv2.INTER_CUBIC) * np.float32(sigma_px) for w in draws.wander
    )
    return cv2.remap(ids, u + du, v + dv, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)


def _names(
    found: list[int], instances: Mapping[int, KnownInstance], chance: ErrorLevel, draws: _Draws
) -> dict[int, str]:
    """Name every found object, a few of them wrongly."""
    if chance.by_class is not None:
        return {i: _drawn(chance.by_class[instances[i].label].names, draws.flip[i]) for i in found}
    things = sorted({known.label for known in instances.values() if known.is_thing})
    if chance.known is not None:
        things = sorted(chance.known.intersection(things) or chance.known)
    names = {}
    for i in found:
        label = instances[i].label
        wrong = label not in things or draws.flip[i] < chance.flip
        if instances[i].is_thing and wrong and (len(things) > 1 or label not in things):
            others = [name for name in things if name != label]
            label = others[int(draws.other[i] * len(others))]
        names[i] = label
    return names


def _drawn(shares: Mapping[str, float], at: float) -> str:
    """Return the key at a number from 0 to 1 of the shares laid end to end."""
    ends = np.cumsum(list(shares.values()))
    return list(shares)[min(int(np.searchsorted(ends, at * ends[-1], side="right")), len(shares) - 1)]


def _numbers(found: list[int], names: Mapping[int, str], instances: Mapping[int, KnownInstance]) -> dict[int, int]:
    """Number the segments from 1: one for each thing, one for all stuff of a class."""
    numbers: dict[int, int] = {}
    stuff: dict[str, int] = {}
    count = 0
    for i in found:
        if not instances[i].is_thing and names[i] in stuff:
            numbers[i] = stuff[names[i]]
            continue
        count += 1
        numbers[i] = count
        if not instances[i].is_thing:
            stuff[names[i]] = count
    return numbers


def _score(i: int, name: str, instances: Mapping[int, KnownInstance], chance: ErrorLevel, draws: _Draws) -> float:
    """Return a confidence: lower for a wrong name, or one of those that were measured."""
    if chance.by_class is not None:
        measured = chance.by_class[instances[i].label].scores[name == instances[i].label]
        if measured:
            return round(measured[int(draws.score[i] * len(measured))], 3)
    low, high = (0.70, 0.99) if name == instances[i].label else (0.40, 0.80)
    return round(float(low + (high - low) * draws.score[i]), 3)


def around(box: tuple[slice, slice], shape: tuple[int, ...]) -> tuple[tuple[slice, slice], NDArray]:
    """Return twice as large a window round a thing's box, cut to the picture, and in which place each pixel of it is.

    The places are `PLACES` rows and columns of the uncut window, numbered row by row.
    """
    window, places = [], []
    for span, size in zip(box, shape, strict=True):
        long = span.stop - span.start
        first = span.start - long // 2
        window.append(slice(max(first, 0), min(first + 2 * long, size)))
        places.append((np.arange(window[-1].start, window[-1].stop) - first) * PLACES // (2 * long))
    return (window[0], window[1]), places[0][:, None] * PLACES + places[1]


def _reshape(
    spoiled: NDArray,
    moved: NDArray,
    things: list[int],
    instances: Mapping[int, KnownInstance],
    segment_of: Mapping[int, int],
    chance: ErrorLevel,
    draws: _Draws,
) -> None:
    """Let segments lack what those of their class often lack, and cover what they often cover beside the thing.

    What another thing's segment covers stays its own.
    """
    boxes = find_objects(moved)
    taken = np.isin(moved, things)
    for i in things:
        extent = (chance.by_class or {})[instances[i].label].extent
        if extent is None:
            continue
        window, place = around(boxes[i - 1], moved.shape)
        own, part = moved[window] == i, spoiled[window]
        covered = extent[own.astype(np.intp), place] > draws.extent[i]
        part[own & ~covered] = 0
        part[covered & (own | ~taken[window])] = segment_of[i]


def _split(
    spoiled: NDArray,
    chosen: list[int],
    instances: Mapping[int, KnownInstance],
    segment_of: Mapping[int, int],
    segments: dict[int, tuple[str, float]],
    draws: _Draws,
) -> None:
    """Cut chosen things in two halves of equal area; the second half becomes a segment of its own."""
    for i in chosen:
        if not instances[i].is_thing:
            continue
        v, u = np.nonzero(spoiled == segment_of[i])
        if len(u) < 2:
            continue
        angle = np.pi * draws.angle[i]
        across = np.cos(angle) * u + np.sin(angle) * v
        half = across > np.median(across)
        number = max(segments) + 1
        spoiled[v[half], u[half]] = number
        segments[number] = segments[segment_of[i]]


def _merge(
    spoiled: NDArray,
    things: list[int],
    names: Mapping[int, str],
    instances: Mapping[int, KnownInstance],
    segment_of: Mapping[int, int],
    chance: ErrorLevel,
    draws: _Draws,
) -> None:
    """Join neighbours of one name, pair by pair; chains can join more than two."""
    now = {i: segment_of[i] for i in things}
    gap = MERGE_GAP * spoiled.shape[1]

    def away_m(a: int, b: int) -> float:
        return math.dist(instances[a].centre_m, instances[b].centre_m)

    def join(a: int, b: int) -> bool:
        if now[a] == now[b] or away_m(a, b) >= MERGE_DISTANCE_M or _box_gap(spoiled, now[a], now[b]) > gap:
            return False
        ended = now[b]
        spoiled[spoiled == ended] = now[a]
        now.update({i: now[a] for i in things if now[i] == ended})
        return True

    if chance.by_class is not None:
        for a in (i for i in things if names[i] != instances[i].label):
            rightly = (i for i in things if i != a and names[i] == names[a] == instances[i].label)
            any(join(i, a) for i in sorted(rightly, key=lambda i: away_m(a, i)))
    for position, a in enumerate(things):
        for b in things[position + 1 :]:
            if names[a] == names[b] and draws.merge[a, b] < chance.merge:
                join(a, b)


def _box_gap(spoiled: NDArray, a: int, b: int) -> float:
    """Return the distance between the boxes round two segments, pixels; infinite when one has no pixel."""
    boxes = []
    for number in (a, b):
        mask = (spoiled == number).astype(np.uint8)
        if not mask.any():
            return float("inf")
        boxes.append(cv2.boundingRect(mask))
    (xa, ya, wa, ha), (xb, yb, wb, hb) = boxes
    across = max(xb - (xa + wa), xa - (xb + wb), 0)
    down = max(yb - (ya + ha), ya - (yb + hb), 0)
    return float(max(across, down))
