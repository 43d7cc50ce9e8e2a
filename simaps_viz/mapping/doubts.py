"""Which objects of a map are doubtful, by what the map itself knows: for maps whose truth nobody knows."""

from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from simaps_viz.colors.classes import plural
from simaps_viz.mapping.explain import between, needed_text, score_text
from simaps_viz.mapping.in_space import has_voxels
from simaps_viz.mapping.method import percent_text
from simaps_viz.mapping.partition import applied_steps, owner_of_community
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.structures import Instance, SIMap

SURE_SCORE, SURE_FRAMES, SLIM = 0.6, 8, 0.1
"""Less confidence, fewer frames or a smaller distance to the threshold than this is a reason for doubt."""
FRAMES_PER_GLANCE = 20
"""Of so many frames one is enough, where there are few."""
LARGE, SMALL, ENOUGH = 2.0, 0.4, 4
"""Times the usual area of a class of at least so many objects, from which on a size is a reason for doubt."""
THIN = 0.15
"""Of the floor below its box an object that nothing hides has more than this share of cells."""
INSIDE = 0.5
"""A thing that is seen from above, and lies inside another one with more than this share, may be a part of that."""
MIN_SHARE = 0.15
"""A part with a smaller share of the object makes no two of it."""
HALF_CELLS = 30
"""An error of so small an object counts half as much as one of a very large one."""
MOST_ASKED = 60
"""Pairs of two objects at most of which it is asked how near they are."""
LEAST = 0.1
"""What is less doubtful is not listed."""


@dataclass(frozen=True)
class Doubt:
    """An object, and why it may be wrong."""

    instance: Instance
    strength: float
    """0 to 1: the reasons together."""
    weight: float
    """0 to 1: the strength, less for small objects, as what is wrong with them matters less."""
    brief: str
    """The strongest reason in a few words."""
    reasons: tuple[str, ...]
    """Sentences, the strongest reason first."""


def doubts(simap: SIMap, but: Collection[int] = (), among: frozenset[int] | None = None) -> tuple[Doubt, ...]:
    """Return the doubtful objects of a map, the most doubtful first.

    Args:
        simap: the map.
        but: ids of those to leave out, which no other is measured by either.
        among: ids of those that are asked about; None = all.
    """
    found: dict[int, list[tuple[float, str, str]]] = defaultdict(list)
    areas = {label: [one.cells for one in simap.of_class(label) if one.id not in but] for label in simap.counts()}
    usual = {label: _usual(of_class) for label, of_class in areas.items() if len(of_class) >= ENOUGH}
    names = {one.id: one for one in simap.instances}
    sure_frames = min(SURE_FRAMES, len(simap.frame_names) / FRAMES_PER_GLANCE + 1.0)
    # What the frames said of it, and how large it is.
    for one in simap.instances:
        if among is not None and one.id not in among:
            continue
        about = found[one.id]
        brief = f"class unsure, {percent_text(one.score)}"
        text = f"The frames name its class with a confidence of {percent_text(one.score)} on average."
        about.append(((SURE_SCORE - one.score) / SURE_SCORE, brief, text))
        seen = f"seen in {plural(one.frames, 'frame')} of {len(simap.frame_names)}"
        about.append((1.0 - one.frames / sure_frames, seen, f"It was {seen}."))
        if one.label in usual:
            share = one.cells / usual[one.label]
            text = f"It has {share:.2g} times the area that is usual for its class here: it may be"
            about.append((min(share / LARGE - 1.0, 0.8), f"{share:.1f} times the usual size", f"{text} several."))
            about.append((0.6 * (1.0 - share / SMALL), "far below the usual size", f"{text} a part of one, or none."))
        if not has_voxels(simap):  # columns would tell nothing new, and those of a large map fill the memory
            continue
        if one.box is not None and not one.under:
            long_m, wide_m, _ = one.box.size_m
            share = one.area_m2(simap.spec.cell_size_m) / max(long_m * wide_m, 1e-6)
            text = f"Its surface spans {long_m:.1f} × {wide_m:.1f} m, but it has {plural(one.cells, 'cell')} only."
            about.append((0.8 * (1.0 - share / THIN), "few cells for its size", f"{text} It may be a part, or none."))
        about += _shared_places(one, names)
    _note_margins(simap, found, names, among)
    listed = []
    for number, about in found.items():
        why = sorted((one for one in about if one[0] >= LEAST), key=lambda one: -one[0])
        if why and number in names and number not in but and (among is None or number in among):
            large = names[number].cells / (names[number].cells + HALF_CELLS)
            strength = 1.0 - float(np.prod([1.0 - weight for weight, _, _ in why]))
            listed.append(
                Doubt(names[number], strength, large * strength, why[0][1], tuple(text for _, _, text in why))
            )
    return tuple(sorted(listed, key=lambda doubt: (-doubt.weight, doubt.instance.id)))


def _note_margins(
    simap: SIMap,
    found: dict[int, list[tuple[float, str, str]]],
    names: Mapping[int, Instance],
    among: frozenset[int] | None,
) -> None:
    """Add to what is found how near objects are to being two, or one with another."""
    log, threshold = simap.merges, joining_threshold(simap.method, simap.parameters)
    applied, owner = applied_steps(log, threshold), owner_of_community(simap)
    cells = np.bincount(simap.community.reshape(-1), minlength=len(owner)).astype(np.int64)
    meets = {}  # of a community that others joined beyond the threshold: all objects that would be one
    asked = 0
    for at, (source, target) in enumerate(zip(log.source.tolist(), log.target.tolist(), strict=True)):
        one, other = names.get(int(owner[source])), names.get(int(owner[target]))
        doubt = 0.7 * (1.0 - abs(float(log.score[at]) - threshold) / SLIM)
        if applied[at]:
            parts = sorted((int(cells[source]), int(cells[target])))
            if one is not None and doubt > LEAST and parts[0] >= MIN_SHARE * one.cells:
                score = score_text(simap.method, float(log.score[at]), threshold)
                said = f"{score}, where more than {needed_text(simap.method, threshold)} is needed"
                text = f"Two parts of it, {parts[0]} and {parts[1]} cells, were joined by a slim margin: {said}."
                found[one.id].append((doubt, "hardly joined, may be two", f"{text} It may be two."))
            cells[target] += cells[source]
        elif one is not None and other is not None:
            ours, theirs = meets.get(source, {one.id}), meets.get(target, {other.id})
            meets[target] = ours | theirs
            near = {}
            if doubt > LEAST and not ours & theirs:
                wanted = [(a, b) for a in ours for b in theirs if among is None or not among.isdisjoint((a, b))]
                near = dict.fromkeys(wanted, doubt)
                if len(ours) + len(theirs) > 2:  # the score is of all of them together: ask which two are as near
                    asked += len(ours) * len(theirs)
                    near = _near_pairs(simap, wanted, threshold) if asked <= MOST_ASKED else {}
            for (first, second), weight in near.items():
                _note_near(found, names[first], names[second], weight)


def _note_near(found: dict[int, list[tuple[float, str, str]]], one: Instance, other: Instance, weight: float) -> None:
    """Add to what is found that two were nearly joined; it is said once, of the larger."""
    this, that = sorted((one, other), key=lambda side: (-side.cells, side.id))
    brief = f"nearly one with {that.name}"
    if weight > max((known for known, words, _ in found[this.id] if words == brief), default=LEAST):
        others = [about for about in found[this.id] if about[1] != brief]
        found[this.id] = [*others, (weight, brief, f"It was nearly joined with {that.name}. The two may be one.")]


def _near_pairs(simap: SIMap, wanted: Collection[tuple[int, int]], threshold: float) -> dict[tuple[int, int], float]:
    """Return which pairs of objects were nearly joined, and the doubt that each raises."""
    links = {(a, b): between(simap, a, b).link for a, b in wanted}
    scores = {pair: link.score for pair, link in links.items() if link is not None and not np.isnan(link.score)}
    return {pair: 0.7 * (1.0 - abs(score - threshold) / SLIM) for pair, score in scores.items()}


def _shared_places(one: Instance, shown: Mapping[int, Instance]) -> list[tuple[float, str, str]]:
    """Return why a thing may be a part of one of another class, as a suitcase in the middle of a couch is."""
    found = []
    for number, share in one.inside.items():  # not what stands on it
        other = shown.get(number)
        if other is not None and share > INSIDE and other.label != one.label:
            text = f"{percent_text(share)} of it lies inside {other.name}: it may be a part of that, or none."
            found.append((share, f"shares its place with {other.name}", text))
    return found


def _usual(areas: list[int]) -> float:
    """Return the area of the object that the middle one of all cells is in, so that fragments count little."""
    ordered = np.sort(areas)
    return float(ordered[np.searchsorted(np.cumsum(ordered), ordered.sum() / 2.0)])
