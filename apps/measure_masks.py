"""Print how a network's masks err where the truth is known: missed, misnamed, split, merged, borders, invented.

Missed things are counted by class, by distance, by size in the picture, and by whether they were missed in the frame
before: a network that misses a thing misses it again, which simulated errors drawn anew for every frame do not. Level
"detector" of the simulated errors was set from what this prints. ``--simulate`` simulates errors as frequent as those
measured, and segments that cover as much of things and of what is around them, as confidently, and compares the maps.
"""

import math
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from simaps_viz import open_sequence
from simaps_viz.build.methods import build
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.evaluation.evaluate import PRECOMPUTED, evaluate
from simaps_viz.evaluation.report import overall_table
from simaps_viz.evaluation.truth import find_truth
from simaps_viz.scenes.simulated_errors import LEVELS, PLACES, SMALLEST_PX, ClassErrors, ErrorLevel, around
from simaps_viz.structures import Segment, Segmentation

PART = 0.25
"""A segment that covers this share of a thing shows it."""
BAND_M = 1.5
LATER = 20
MEASURED = "as measured"
GAP = 0.03
"""Two things can be merged when the boxes round them are at most this share of the picture's width apart."""


@dataclass
class MaskErrors:
    """Errors of all frames so far; each counter holds [cases, errors]."""

    known: frozenset[str]
    """Classes that the network could name: others are not its errors."""
    by_class: dict[str, list[int]] = field(default_factory=dict)
    by_band: dict[int, list[int]] = field(default_factory=dict)
    by_size: dict[int, list[int]] = field(default_factory=dict)
    by_class_and_size: dict[tuple[str, int], list[int]] = field(default_factory=dict)
    """Objects of all classes: things, also those that the network has no name for, and stuff."""
    called: dict[str, Counter[str]] = field(default_factory=dict)
    """What the objects of each class are called by the segment that shows them best."""
    scores: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    """Confidence of the segment that shows an object of each class best, named wrongly and rightly."""
    extents: dict[str, NDArray] = field(default_factory=dict)
    """Of things that are most of what their segment shows, pixels [all or covered, beside it or its own, places]."""
    after: dict[str, list[int]] = field(default_factory=dict)
    """Missed after a frame in which it was "found" or "missed"."""
    later: list[list[int]] = field(default_factory=lambda: [[0, 0], [0, 0]])
    """Found or missed (0, 1), then the same `LATER` frames on."""
    unnamed: list[int] = field(default_factory=lambda: [0, 0])
    """Things of other classes, and those that a segment of a known class shows."""
    renamed: list[int] = field(default_factory=lambda: [0, 0])
    split: list[int] = field(default_factory=lambda: [0, 0])
    merged: list[int] = field(default_factory=lambda: [0, 0])
    """Of pairs of neighbours of one class that were both found."""
    invented: list[int] = field(default_factory=lambda: [0, 0])
    """Of all segments of known classes, those that lie on no known thing."""
    border_px: list[float] = field(default_factory=list)
    """Of each segment that fits a thing (IoU above 0.5): mean distance of its border from the thing's."""
    _found: list[dict[int, bool]] = field(default_factory=list)
    """Of each frame so far: whether each thing was."""

    def add(self, exact: Segmentation, found: Segmentation, depth_m: NDArray) -> None:
        """Compare the masks of a frame with the exact ones; frames come in order."""
        smallest = SMALLEST_PX * (exact.ids.shape[1] / 512) ** 2
        names = {s.id: s.label for s in found.segments}
        segments = max(names, default=0) + 1
        cells = exact.ids.astype(np.int64) * segments + found.ids
        true_px = Counter(dict(zip(*(a.tolist() for a in np.unique(exact.ids, return_counts=True)), strict=True)))
        found_px = Counter(dict(zip(*(a.tolist() for a in np.unique(found.ids, return_counts=True)), strict=True)))
        both = {divmod(int(c), segments): int(n) for c, n in zip(*np.unique(cells, return_counts=True), strict=True)}
        things = {
            s.id: s.label for s in exact.segments
            if s.is_thing and s.label in self.known and true_px[s.id] >= smallest
        }  # fmt: skip
        shows = {i: [k for k in names if both.get((i, k), 0) > PART * true_px[i]] for i in things}
        for i, label in things.items():
            missed = not shows[i]
            near_m = float(np.median(depth_m[exact.ids == i]))
            count(self.by_class, label, missed)
            count(self.by_band, int(near_m // BAND_M), missed)
            count(self.by_size, int(np.log2(true_px[i] / smallest)), missed)
            if self._found and i in self._found[-1]:
                count(self.after, "found" if self._found[-1][i] else "missed", missed)
            if len(self._found) >= LATER and i in self._found[-LATER]:
                self.later[not self._found[-LATER][i]][missed] += 1
            if missed:
                continue
            best = max(shows[i], key=lambda k: both[i, k])
            note(self.renamed, names[best] != label)
            own = [k for k in shows[i] if names[k] == label and both[i, k] > found_px[k] / 2]
            note(self.split, len(own) > 1)
            shared = both[i, best]
            if names[best] == label and 2 * shared > true_px[i] + found_px[best] - shared:
                self.border_px.append(border_distance(exact.ids == i, found.ids == best))
        for one, other in neighbours(exact.ids, things):
            if shows[one] and shows[other]:
                note(self.merged, bool(set(shows[one]) & set(shows[other])))
        for k, label in names.items():
            if label in self.known and found_px[k] >= smallest:
                note(self.invented, not any(both.get((i, k), 0) > PART * found_px[k] for i in things))
        for s in exact.segments:
            if true_px[s.id] >= smallest:
                showing = {k: n for k in found.segments if (n := both.get((s.id, k.id), 0)) > PART * true_px[s.id]}
                self._add_object(s, int(np.log2(true_px[s.id] / smallest)), showing)
        self._add_extents(exact, found, both, smallest)
        self._found.append({i: bool(shows[i]) for i in things})

    def _add_object(self, known: Segment, size: int, showing: Mapping[Segment, int]) -> None:
        """Count an object of any class by the segments that show it: {segment: pixels they share}."""
        count(self.by_class_and_size, (known.label, size), not showing)
        if showing:
            best = max(showing, key=lambda k: showing[k])
            self.called.setdefault(known.label, Counter())[best.label] += 1
            self.scores.setdefault(known.label, ([], []))[best.label == known.label].append(best.score)
        if known.is_thing and known.label not in self.known:
            note(self.unnamed, bool(showing))

    def _add_extents(
        self, exact: Segmentation, found: Segmentation, both: Mapping[tuple[int, int], int], smallest: float
    ) -> None:
        """Count the pixels around each thing, and those that its segment covers, if the thing is most of it."""
        sizes = np.bincount(exact.ids.ravel(), minlength=1 + max((s.id for s in exact.segments), default=0))
        boxes, things = find_objects(exact.ids), {s.id: s.label for s in exact.segments if s.is_thing}
        best = {i: max((s.id for s in found.segments), key=lambda k: both.get((i, k), 0), default=0) for i in things}
        most = {k: max(both.get((i, k), 0) for i in things) for k in best.values()}
        for thing, k in best.items():
            shared = both.get((thing, k), 0)
            if not k or shared < most[k] or shared <= PART * sizes[thing] or sizes[thing] < smallest:
                continue
            window, place = around(boxes[thing - 1], exact.ids.shape)
            own, covered = exact.ids[window] == thing, found.ids[window] == k
            counts = self.extents.setdefault(things[thing], np.zeros((2, 2, PLACES**2)))
            for side in (0, 1):
                for errors, pixels in enumerate((own == side, (own == side) & covered)):
                    counts[errors, side] += np.bincount(place[pixels], minlength=PLACES**2)

    def lasting(self) -> float:
        """Return the correlation of a thing being missed in two frames `LATER` apart (Pearson's, of odds)."""
        (stays_found, lost), (comes, stays_missed) = self.later
        odds = stays_found * stays_missed / max(lost * comes, 1)
        return math.cos(math.pi / (1.0 + math.sqrt(odds)))

    def level(self) -> ErrorLevel:
        """Return simulated errors as frequent as those counted.

        A class and size of few cases is missed as often as the class is: as if four more cases were like it.
        """
        sizes = range(1 + max((size for _, size in self.by_class_and_size), default=0))
        classes = {}
        for label, names in self.called.items():
            table = [self.by_class_and_size.get((label, size), [0, 0]) for size in sizes]
            missed = sum(row[1] for row in table) / sum(row[0] for row in table)
            by_size = tuple((row[1] + 4 * missed) / (row[0] + 4) for row in table)
            shares = {name: n / names.total() for name, n in names.most_common()}
            wrong, right = map(sorted, self.scores[label])
            classes[label] = ClassErrors(by_size, shares, self._extent(label), (tuple(wrong), tuple(right)))
        # The mean distance of a border displaced by a normal deviate is 0.8 standard deviations.
        border_px = float(np.median(self.border_px)) / 0.8 if self.border_px else 0.0
        return ErrorLevel(
            border_px=border_px, miss=0.0, flip=0.0, split=share(self.split), merge=share(self.merged),
            lasting=max(self.lasting(), 0.0), by_class=classes,
        )  # fmt: skip

    def _extent(self, label: str) -> NDArray | None:
        """Return the shares covered; a place of few pixels leans on all the places."""
        if label not in self.extents:
            return None
        cases, covered = self.extents[label]
        usual = covered.sum(axis=1, keepdims=True) / np.maximum(cases.sum(axis=1, keepdims=True), 1)
        return (covered + usual) / (cases + 1)

    def lines(self) -> Iterator[str]:
        """Return what a person reads."""
        for words, table in (
            ("missed by class", self.by_class),
            (f"missed by distance, bands of {BAND_M} m", self.by_band),
            (f"missed by size, doubling from {SMALLEST_PX} pixels at 512 pixels width", self.by_size),
            ("missed after a frame in which it was", self.after),
        ):
            rates = (f"{key}: {rate(table[key])} of {table[key][0]}" for key in sorted(table))  # pyright: ignore[reportArgumentType]
            yield f"{words}: {', '.join(rates)}"
        yield f"correlation of missing a thing in two frames {LATER} apart: {self.lasting():.2f}"
        for words in ("renamed", "split", "merged", "invented", "unnamed"):
            counts = getattr(self, words)
            yield f"{words}: {rate(counts)} of {counts[0]}"
        if self.border_px:
            low, middle, high = np.percentile(self.border_px, (25, 50, 75))
            yield f"borders, pixels off: median {middle:.1f}, quartiles {low:.1f} and {high:.1f}"


def count(table: dict, key: Any, error: bool) -> None:
    """Note a case under its key."""
    note(table.setdefault(key, [0, 0]), error)


def note(counts: list[int], error: bool) -> None:
    """Note a case."""
    counts[0] += 1
    counts[1] += error


def share(counts: list[int]) -> float:
    """Return the share of errors; 0 where there is no case."""
    return counts[1] / max(counts[0], 1)


def rate(counts: list[int]) -> str:
    """Return the share of errors in words."""
    return f"{share(counts):.3f}" if counts[0] else "none"


def neighbours(ids: NDArray, things: Mapping[int, str]) -> Iterator[tuple[int, int]]:
    """Return the pairs of things of one class whose boxes are close to each other."""
    boxes = {i: cv2.boundingRect((ids == i).astype(np.uint8)) for i in things}
    for one in things:
        for other in things:
            if one < other and things[one] == things[other]:
                (xa, ya, wa, ha), (xb, yb, wb, hb) = boxes[one], boxes[other]
                gap = max(xb - (xa + wa), xa - (xb + wb), yb - (ya + ha), ya - (yb + hb), 0)
                if gap <= GAP * ids.shape[1]:
                    yield one, other


def border_distance(true: NDArray, found: NDArray) -> float:
    """Return the mean distance of a mask's border from that of the true one, pixels."""
    edges = [cv2.morphologyEx(m.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) for m in (true, found)]
    away = cv2.distanceTransform(1 - edges[0], cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return float(away[edges[1] > 0].mean())


@dataclass(frozen=True)
class MeasureMasks:
    """Which masks; the exact ids lie beside them."""

    sequence: tyro.conf.Positional[Path]
    """Manifest of a sequence with a network's masks."""
    labels: Path | None = None
    """The network's class names, one a line. By default those that its masks name."""
    truth: Path | None = None
    """Manifest of the same frames with exact ids, where it is not the folder's sequence.json."""
    simulate: int = 0
    """Also build maps of masks with simulated errors as frequent as those found, of so many seeds, and of the
    network's masks, and print their panoptic quality."""


def compare(sequence: PosedFrames, truth: Path | None, level: ErrorLevel, seeds: int) -> str:
    """Return the panoptic quality of maps of a network's masks and of simulated ones, as a table."""
    LEVELS[MEASURED] = level
    report = evaluate(
        sequence, ("evidence",), errors=(PRECOMPUTED, MEASURED), seeds=range(seeds), build=build, truth=truth
    )
    return overall_table(report).text()


def main(config: MeasureMasks) -> None:
    """Compare all frames, and print the rates."""
    sequence = open_sequence(config.sequence)
    exact = find_truth(sequence, config.truth)
    if exact.frame_names != sequence.frame_names:
        raise InputError(
            f"{exact.path}: expected exact ids of the frames of {sequence.path}, {len(sequence)}, found "
            f"{len(exact)} or others"
        )
    named = sequence.labels if config.labels is None else config.labels.read_text(encoding="utf-8").splitlines()
    errors = MaskErrors(frozenset(named) & frozenset(exact.labels[1:]))
    for index in range(len(sequence)):
        errors.add(exact.segmentation(index), sequence.segmentation(index), exact.read(index).depth_m)
    sys.stdout.writelines(line + "\n" for line in errors.lines())
    if config.simulate:
        sys.stdout.write(compare(sequence, config.truth, errors.level(), config.simulate))


if __name__ == "__main__":
    main(tyro.cli(MeasureMasks))
