"""Describe the objects of a map with an embedding: few views of each from new directions, fused into one vector.

What is known of the choice: views of new directions are worth more than the largest or random ones, and a mean weighted
by visible pixels more than other means (OVI-MAP, CVPR 2026, tables 4 to 6); a crop mixed with one whose background is
masked is worth more than either (HOV-SG, whose share is used here).
"""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.appearance import Appearance, unit
from simaps_viz.build.seen_colors import with_colors
from simaps_viz.datasets.source import FrameSource, Unreadable, read_each
from simaps_viz.embedding.search import STOCK
from simaps_viz.embedding.towers import Embedding, remember
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.geometry import upright_turns
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.partition import owner_of_community
from simaps_viz.structures import Frame, Segmentation, SIMap

MAX_VIEWS = 4
"""Views of an object; each is embedded twice, as it is and with its background masked."""
MASKED_SHARE = 0.4418
_YAW_BINS = 36
_NEW_BINS = 3
"""A view is of a new direction if it is at least so many yaw bins, or an elevation bin, away from those chosen."""
_ELEVATIONS_DEG = (20.0, 50.0)
_MIN_SHARE = 0.2
"""A view that shows less of an object than this share of its best view is not looked at."""
_MARGIN = 0.15
"""A crop is larger than the object's box by this share of its longer side, all round."""
_MIN_PIXELS = 64
_SCALES = np.geomspace(5.0, 500.0, 60)
_USUAL_SCALE = 100.0
"""What CLIP was trained to; SigLIP's is about the same."""


def describe(simap: SIMap, sequence: FrameSource, embedding: Embedding, progress: Progress) -> SIMap:
    """Return the map with a vector for each of its objects, and with their colours.

    Args:
        simap: the map.
        sequence: the sequence it was built from, with the same masks.
        embedding: the network.
        progress: called as (stage, done, total).

    Raises:
        InputError: the sequence or its masks are not those of the map, or no frame of it shows an object.
    """
    _check_same(simap, sequence)
    at = {name: index for index, name in enumerate(sequence.frame_names)}
    wanted = {frame: one for frame, one in choose_views(simap).items() if simap.frame_names[frame] in at}
    frames = sorted(wanted)
    size = embedding.dimension
    total, weight = np.zeros((len(simap.instances), size)), np.zeros(len(simap.instances))
    reads = read_each(sequence, [at[simap.frame_names[frame]] for frame in frames], color=True)
    for done, (frame, read) in enumerate(zip(frames, reads, strict=True)):
        progress("describing objects", done, len(frames))
        if isinstance(read, Unreadable) or read[0].color is None:
            continue
        turns = upright_turns(simap.T_map_camera[frame])
        upright = read[0].turned(turns), read[1].turned(turns)
        for row, segment, purity in wanted[frame]:
            view = _crops(*upright, segment, embedding.vision.grey)
            if view is not None:
                crops, pixels = view
                plain, masked = embedding.vision.embed(crops)
                total[row] += pixels * purity * ((1.0 - MASKED_SHARE) * plain + MASKED_SHARE * masked)
                weight[row] += pixels * purity
    progress("describing objects", len(frames), len(frames))
    if not weight.any():
        raise InputError(f"{sequence.path}: expected pictures that show the objects of the map, found none in colour")
    return _with_vectors(with_colors(simap, sequence), total, weight, embedding)


def describe_to_file(
    simap: SIMap, sequence: FrameSource, embedding: Embedding, output: Path, progress: Progress
) -> SIMap:
    """Describe a map, see `describe`, write it, and remember where the network of words lies."""
    described = describe(simap, sequence, embedding, progress)
    save_map(described, output)
    remember(embedding.text)
    return described


def choose_views(simap: SIMap) -> dict[int, list[tuple[int, int, float]]]:
    """Choose for each object up to `MAX_VIEWS` frames from directions that differ, those that show most of it first.

    A frame's worth is the number of the object's cells that its best segment names, times the segment's confidence,
    times the share of the segment that is this object's.

    Returns:
        {index of frame: [(position in ``simap.instances``, segment, that share)]}.
    """
    views = simap.views
    seen_by_segment: dict[tuple[int, int], int] = defaultdict(int)
    by_object: dict[int, dict[tuple[int, int], list[float]]] = defaultdict(lambda: defaultdict(lambda: [0.0, 0.0]))
    columns = (owner_of_community(simap)[views.community], views.frame, views.segment, views.cells, views.score)
    for one, frame, segment, cells, score in zip(*(column.tolist() for column in columns), strict=True):
        seen_by_segment[frame, segment] += cells
        if one:
            by_object[one][frame, segment][0] += cells
            by_object[one][frame, segment][1] += cells * score
    chosen: dict[int, list[tuple[int, int, float]]] = defaultdict(list)
    for row, instance in enumerate(simap.instances):
        found = []
        for (frame, segment), (cells, worth) in by_object[instance.id].items():
            purity = cells / seen_by_segment[frame, segment]
            found.append((-worth * purity, frame, segment, purity))
        directions: list[tuple[int, int]] = []
        for worth, frame, segment, purity in sorted(found):
            direction = _direction(simap.T_map_camera[frame][:3, 3], instance.centroid_m)
            enough = -worth >= -_MIN_SHARE * min(found)[0]
            if enough and all(_differ(direction, other) for other in directions):
                directions.append(direction)
                chosen[frame].append((row, segment, purity))
            if len(directions) == MAX_VIEWS or not enough:
                break
    return dict(chosen)


def _direction(camera_m: NDArray, centre_m: tuple[float, float, float]) -> tuple[int, int]:
    """Return the bins of yaw and elevation in which a camera stands, seen from an object."""
    x, y, z = (camera_m - np.array(centre_m)).tolist()
    yaw = int((np.arctan2(y, x) / (2 * np.pi) % 1.0) * _YAW_BINS) % _YAW_BINS
    return yaw, int(np.searchsorted(_ELEVATIONS_DEG, np.rad2deg(np.arctan2(z, np.hypot(x, y)))))


def _differ(one: tuple[int, int], other: tuple[int, int]) -> bool:
    turn = abs(one[0] - other[0])
    return one[1] != other[1] or min(turn, _YAW_BINS - turn) >= _NEW_BINS


def _crops(frame: Frame, masks: Segmentation, segment: int, grey: NDArray) -> tuple[list[NDArray], int] | None:
    """Return a segment's picture, as it is and with its background masked, and its pixels; None for a few pixels."""
    mask = masks.ids == segment
    pixels = int(np.count_nonzero(mask))
    if pixels < _MIN_PIXELS or frame.color is None:
        return None
    # A square, as far as the picture reaches, so that neither squashing nor cutting out the middle does harm.
    v, u = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    half = (0.5 + _MARGIN) * max(v[-1] - v[0] + 1, u[-1] - u[0] + 1)
    spans = []
    for line, size in ((v, mask.shape[0]), (u, mask.shape[1])):
        middle = (line[0] + line[-1] + 1) / 2.0
        spans.append(slice(max(int(middle - half), 0), min(int(np.ceil(middle + half)), size)))
    plain = np.ascontiguousarray(frame.color[spans[0], spans[1]])
    masked = np.where(mask[spans[0], spans[1], None], plain, grey)
    return [plain, masked], pixels


def _with_vectors(simap: SIMap, total: NDArray, weight: NDArray, embedding: Embedding) -> SIMap:
    """Return the map with the vectors of its objects (sums over views, and their weights), and those of the words."""
    look = simap.appearance
    if look is None:
        raise InputError("describe: expected a sequence with colour, found none that shows the objects")
    rows = np.flatnonzero(weight > 0)
    ids = np.array([one.id for one in simap.instances])
    row_of = np.full(int(ids.max()) + 1, -1, np.int32)
    row_of[ids[rows]] = np.arange(len(rows))
    # The patches of an object take its vector.
    vector = np.full(len(look.rgb), -1, np.int32)
    vector[look.patch] = row_of[simap.instance.reshape(-1)[look.cell]]
    vectors = unit(total[rows])
    labels = [label for label in simap.grid.labels[1:] if label in simap.counts()]
    words = list(dict.fromkeys([*labels, *STOCK["things"], *STOCK["uses"]]))
    word_vectors = embedding.text.words(words)
    kind = np.array([words.index(simap.instances[row].label) for row in rows])
    model: dict[str, Any] = {
        "text": embedding.text.session.path.name, "text_sha256": embedding.text.session.digest,
        "vision": embedding.vision.session.path.name, "vision_sha256": embedding.vision.session.digest,
        "dimension": embedding.dimension, "views": MAX_VIEWS, "masked_share": MASKED_SHARE, "words": words,
        "scale": calibrated_scale(vectors, word_vectors[: len(labels) + len(STOCK["things"])], kind),
    }  # fmt: skip
    described = Appearance(
        look.spec, look.cell, look.patch, look.rgb, look.pixels, vector, vectors.astype(np.float16),
        weight[rows].astype(np.float32), word_vectors.astype(np.float16), model,
    )  # fmt: skip
    return replace(simap, appearance=described)


def calibrated_scale(vectors: NDArray, words: NDArray, kind: NDArray) -> float:
    """Return the scale of the softmax over words that makes the map's own classes likeliest.

    Args:
        vectors: [n, D], of the objects.
        words: [w, D].
        kind: int [n], the word that is each object's class.

    Returns:
        a number from 5 to 500; where there are fewer than three classes, 100.
    """
    if len(np.unique(kind)) < 3:
        return _USUAL_SCALE
    cosines = vectors @ words.T
    # All classes count the same, whatever their number of objects.
    share = 1.0 / np.bincount(kind)[kind]
    own = cosines[np.arange(len(kind)), kind]
    likelihood = [
        float(share @ (scale * own - np.logaddexp.reduce(scale * cosines, axis=1))) for scale in _SCALES.tolist()
    ]
    return round(float(_SCALES[int(np.argmax(likelihood))]), 3)


def _check_same(simap: SIMap, sequence: FrameSource) -> None:
    """Raise InputError unless a sequence is that of a map, with the same masks."""
    missing = [name for name in simap.frame_names if name not in set(sequence.frame_names)]
    if missing:
        raise InputError(
            f"{sequence.path}: expected the frames that the map was built from, found no frame {missing[0]} "
            f"({len(missing)} of {len(simap.frame_names)} are missing)"
        )
    built_with = simap.provenance.get("segmentation")
    if built_with != sequence.segmentation_source:
        raise InputError(
            f"{sequence.path}: expected the masks that the map was built with ({built_with}), found "
            f"{sequence.segmentation_source}; see --segmentation"
        )
