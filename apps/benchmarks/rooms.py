"""How well rooms are found on floor plans whose rooms are known, and how long that takes.

    python apps/benchmarks/rooms.py FOLDER

FOLDER holds plans of 5 cm cells as pictures, NAME.png with free space white, and NAME_gt_segmentation.png, in which the
rooms are white areas; NAME_furnitures.png and NAME_furnitures_trashbins.png are the same plans with furniture. The 20
plans of Bormann et al. (ICRA 2016) come so, in ipa_room_segmentation/common/files/test_maps of the repository
ipa320/ipa_coverage_planning. The parameters were chosen on every second plan, by name; the others are held out.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz import InputError, segment_rooms

CELL_M = 0.05
WHITE = 250
TRUTH = "_gt_segmentation.png"
VARIANTS = {"empty": "", "furnished": "_furnitures", "furnished, with bins": "_furnitures_trashbins"}


@dataclass(frozen=True)
class Score:
    """How well the rooms of one plan were found."""

    f1: float
    """Of rooms that overlap a true one with an IoU above 0.5."""
    pq: float
    """Panoptic quality: F1 times the mean IoU of those rooms."""
    ms_per_mcell: float
    """CPU milliseconds per million cells."""


def true_rooms(path: Path) -> NDArray:
    """Read the rooms of a plan, int32 [rows, cols], 0 = none; areas up to 1 m² are no rooms."""
    areas, count = ndimage.label(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) >= WHITE)  # pyright: ignore
    sizes_m2 = np.bincount(areas.ravel(), minlength=count + 1) * CELL_M**2
    number = np.cumsum(sizes_m2[1:] > 1.0)
    return np.r_[0, np.where(sizes_m2[1:] > 1.0, number, 0)].astype(np.int32)[areas]


def score(free: NDArray, truth: NDArray) -> Score:
    """Find the rooms of a plan and compare them; rooms found of up to 0.5 m² do not count."""
    start = time.process_time()
    found = segment_rooms(free, CELL_M)
    took_ms = 1e3 * (time.process_time() - start)
    pairs = np.zeros((truth.max() + 1, found.max() + 1))
    np.add.at(pairs, (truth.ravel(), found.ravel()), 1)
    true_sizes, sizes = pairs.sum(axis=1)[1:], pairs.sum(axis=0)[1:]
    overlap = pairs[1:, 1:]
    iou = overlap / (true_sizes[:, None] + sizes - overlap)
    matched = iou[iou > 0.5]
    mean_count = (len(true_sizes) + np.count_nonzero(sizes * CELL_M**2 > 0.5)) / 2
    return Score(len(matched) / mean_count, matched.sum() / mean_count, 1e6 * took_ms / free.size)


def main(folder: tyro.conf.Positional[Path]) -> None:
    """Print a table: for each kind of plan, the half that parameters were chosen on, the half held out, and all."""
    names = sorted(path.name.removesuffix(TRUTH) for path in folder.glob(f"*{TRUTH}"))
    if not names:
        raise InputError(f"{folder}: expected plans NAME.png with NAME{TRUTH}, found none")
    segment_rooms(np.ones((9, 9), np.bool_), CELL_M)  # compiled outside the measurement
    print(f"{'plans':22}{'half':10}{'n':>4}{'F1':>8}{'PQ':>8}{'ms/Mcell':>10}")
    for kind, ending in VARIANTS.items():
        scores = {}
        for i, name in enumerate(names):
            picture = cv2.imread(str(folder / f"{name}{ending}.png"), cv2.IMREAD_GRAYSCALE)
            truth = true_rooms(folder / f"{name}{TRUTH}")
            if picture is not None and picture.shape == truth.shape:
                scores[i] = score(picture >= WHITE, truth)
        halves = {"chosen on": [s for i, s in scores.items() if i % 2 == 0],
                  "held out": [s for i, s in scores.items() if i % 2], "all": list(scores.values())}  # fmt: skip
        for half, found in halves.items():
            if found:
                mean = np.mean([[s.f1, s.pq, s.ms_per_mcell] for s in found], axis=0)
                print(f"{kind:22}{half:10}{len(found):4}{mean[0]:8.3f}{mean[1]:8.3f}{mean[2]:10.0f}")


if __name__ == "__main__":
    tyro.cli(main)
