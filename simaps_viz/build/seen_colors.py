"""Look at the colours of a map's objects: the median of their pixels in the few frames that show them best."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.appearance import Appearance
from simaps_viz.datasets.source import FrameSource, Unreadable, read_each
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.partition import owner_of_community
from simaps_viz.mapping.projection import ON_A_STEP, STEPS_PER_M, project_pixels
from simaps_viz.mapping.space import first_of_cells
from simaps_viz.mapping.surface import UNSEEN, Surface, coded_colors, owned_runs
from simaps_viz.structures import Frame, Segmentation, SIMap

FRAMES_SHARE = 0.07
"""Share of the frames that is looked at: decoding them with their colour takes less than a tenth of the build."""
_SOON = 0.2
"""What frames show of an object counts with this power: small, so that a first view is worth much more than others."""
_FEWEST, _MOST = 6, 400
_ENOUGH = 1e-3
"""A frame that adds less than this share of what all frames added so far is not looked at."""
_EVERY = 2
"""Of a picture, every so many rows and columns: a median needs no more."""


def with_colors(simap: SIMap, sequence: FrameSource) -> SIMap:
    """Return the map with the colours of its objects, looked up in its own sequence.

    Vectors that describe its objects stay, unless its communities have changed since. The map itself is returned where
    no frame has colour.
    """
    at = {name: index for index, name in enumerate(sequence.frame_names)}
    chosen = [frame for frame in choose_frames(simap) if simap.frame_names[frame] in at]
    looking = _Looking(simap)
    coloring = SurfaceColors(simap) if simap.surface is not None else None
    indices = [at[simap.frame_names[frame]] for frame in chosen]
    for frame, read in zip(chosen, read_each(sequence, indices, color=True), strict=True):
        if isinstance(read, Unreadable) or read[0].color is None:
            continue
        cells, heights = project_every_second(read[0], simap, simap.T_map_camera[frame])
        color = np.ascontiguousarray(read[0].color[::_EVERY, ::_EVERY])
        looking.look(cells, color, read[1])
        if coloring is not None:
            coloring.look(cells, heights, color)
    if coloring is not None and coloring.total.any():
        simap = replace(simap, surface=coloring.surface())
    if not looking.pixels:
        return simap
    found, earlier = looking.appearance(), simap.appearance
    if earlier is not None and np.array_equal(earlier.cell, found.cell) and np.array_equal(earlier.patch, found.patch):
        found = replace(earlier, spec=found.spec, rgb=found.rgb, pixels=found.pixels)
    return replace(simap, appearance=found)


def choose_frames(simap: SIMap) -> list[int]:
    """Choose few frames that together show all objects well.

    The best frame comes first, then the one that adds most, and so on. What frames show of an object is the sum of
    the shares of its cells that they name, to a power, so a second view adds less than the first.

    Returns:
        indices into ``frame_names``, ascending.
    """
    # The objects of the views: a community lies in one instance.
    views, frames = simap.views, len(simap.frame_names)
    owner = owner_of_community(simap)
    named = owner[views.community] > 0
    one, frame_of = owner[views.community[named]], views.frame[named]
    pair, at = np.unique(one * frames + frame_of, return_inverse=True)
    cells = np.bincount(at, (views.cells * views.score)[named]) if len(pair) else np.zeros(0)
    one, frame_of = pair // frames, pair % frames
    # Greedily, as long as a frame adds something.
    best = np.zeros(len(owner))
    np.maximum.at(best, one, cells)
    share = cells / np.maximum(best[one], 1e-9)
    shown = np.zeros(len(best))
    chosen: list[int] = []
    total = 0.0
    for _ in range(min(max(_FEWEST, round(FRAMES_SHARE * frames)), _MOST, frames)):
        before = shown[one]
        gain = np.bincount(frame_of, (before + share) ** _SOON - before**_SOON, minlength=frames)
        gain[chosen] = 0.0
        frame = int(gain.argmax())
        if gain[frame] <= _ENOUGH * total:
            break
        chosen.append(frame)
        total += float(gain[frame])
        here = frame_of == frame
        shown[one[here]] += share[here]
    return sorted(chosen)


def project_every_second(frame: Frame, simap: SIMap, T_map_camera: NDArray) -> tuple[NDArray, NDArray]:
    """Return the cell int32 (-1 = none) and the height float32 of every second row and column of a frame's pixels."""
    spec, k = simap.spec, frame.intrinsics
    s = ProjectionSettings(**{
        name: simap.parameters[name] for name in ProjectionSettings.__dataclass_fields__ if name in simap.parameters
    })  # fmt: skip
    depth = np.ascontiguousarray(frame.depth_m[::_EVERY, ::_EVERY])
    cells, heights = np.full(depth.shape, -1, np.int32), np.zeros(depth.shape, np.float32)
    project_pixels(
        depth, k.fx / _EVERY, k.fy / _EVERY, k.cx / _EVERY, k.cy / _EVERY,
        np.ascontiguousarray(T_map_camera, np.float64), s.near_m, s.far_m, -s.below_floor_m, s.cut_height_m,
        spec.cell_size_m, *spec.origin_cell,
        spec.rows, spec.cols, cells, heights,
    )  # fmt: skip
    return cells, heights


@dataclass
class SurfaceColors:
    """The mean colour of each voxel of a map's surface."""

    simap: SIMap

    def __post_init__(self) -> None:
        found = self.simap.surface
        assert found is not None
        self.of = found
        size = found.high.astype(np.int64) - found.low + 1
        self.first = np.r_[0, np.cumsum(size)]
        """int64 [runs + 1], the first voxel of each run."""
        self.runs_of = first_of_cells(found.cell, self.simap.grid.label.size)
        """int32 [cells + 1], the first run of each cell."""
        self.total = np.zeros((int(self.first[-1]), 4), np.int32)
        """int32 [voxels, 4], sums of red, green and blue, and pixels."""

    def look(self, cells: NDArray, heights: NDArray, color: NDArray) -> None:
        """Take the pixels of a frame that fall in a voxel: what `project_every_second` returns, and uint8 [H, W, 3]."""
        _add_colors(cells, heights, color, self.runs_of, self.of.low, self.of.high, self.first, self.total)

    def surface(self) -> Surface:
        """Return the surface with its colours; a voxel that was missed has that of one of its class near by.

        What touches nothing of its class that was seen has the mean colour of the class.
        """
        of, spec = self.of, self.of.spec
        classes = owned_runs(self.simap, of)[0]
        known, rgb, sums = _means(self.total, self.first, classes + 1, len(self.simap.grid.labels) + 1)
        if not known.all():
            mean = sums[:, :3] / np.maximum(sums[:, 3:], 1)
            mean[sums[:, 3] == 0] = UNSEEN
            _spread(spec.rows, spec.cols, of.cell, of.low, of.high, classes, self.runs_of, self.first, known, rgb)
            missed = np.flatnonzero(~known)
            run_of = np.searchsorted(self.first, missed, side="right") - 1
            rgb[missed] = mean[classes[run_of] + 1].astype(np.uint8)
        return replace(self.of, color=coded_colors(rgb))


@njit(cache=True, nogil=True)
def _add_colors(
    cells: NDArray,  # int32 [H, W], -1 = none
    heights: NDArray,  # float32 [H, W]
    color: NDArray,  # uint8 [H, W, 3]
    runs_of: NDArray,  # int32 [cells + 1], first run of each cell
    low: NDArray,  # int8 [runs]
    high: NDArray,  # int8 [runs]
    first: NDArray,  # int64 [runs + 1]
    total: NDArray,  # in/out int32 [voxels, 4]
) -> None:
    voxel, at_cell, at_step = -1, -1, 0
    for v in range(cells.shape[0]):
        for u in range(cells.shape[1]):
            c = cells[v, u]
            if c < 0:
                continue
            # Pixels side by side mostly share their voxel.
            step = math.floor(heights[v, u] * STEPS_PER_M + ON_A_STEP)
            if c != at_cell or step != at_step:
                voxel, at_cell, at_step = -1, c, step
                for run in range(runs_of[c], runs_of[c + 1]):
                    if low[run] <= step <= high[run]:
                        voxel = first[run] + step - low[run]
                        break
            if voxel >= 0:
                for channel in range(3):
                    total[voxel, channel] += color[v, u, channel]
                total[voxel, 3] += 1


@njit(cache=True, nogil=True)
def _means(
    total: NDArray,  # int32 [voxels, 4]
    first: NDArray,  # int64 [runs + 1]
    group: NDArray,  # int16 [runs]
    groups: int,
) -> tuple[NDArray, NDArray, NDArray]:
    """Return which voxels have a colour, bool, their colours uint8 [voxels, 3], and the sums of each group of runs."""
    known, rgb = np.zeros(len(total), np.bool_), np.zeros((len(total), 3), np.uint8)
    sums = np.zeros((groups, 4), np.int64)
    for run in range(len(group)):
        for voxel in range(first[run], first[run + 1]):
            if total[voxel, 3] > 0:
                known[voxel] = True
                for channel in range(3):
                    rgb[voxel, channel] = total[voxel, channel] // total[voxel, 3]
                for k in range(4):
                    sums[group[run], k] += total[voxel, k]
    return known, rgb, sums


@njit(cache=True, nogil=True)
def _spread(
    rows: int,
    cols: int,
    cell: NDArray,  # int32 [runs], ascending
    low: NDArray,  # int8 [runs]
    high: NDArray,  # int8 [runs]
    label: NDArray,  # int16 [runs]
    runs_of: NDArray,  # int32 [cells + 1], first run of each cell
    first: NDArray,  # int64 [runs + 1], first voxel of each run
    known: NDArray,  # in/out bool [voxels]
    rgb: NDArray,  # in/out uint8 [voxels, 3]
) -> None:
    """Let colours spread to voxels of their class that touch, over a corner too, for as long as there are any."""
    run_of, step_of = np.zeros(len(known), np.int32), np.zeros(len(known), np.int8)
    missed = np.zeros(len(cell), np.int16)  # voxels of each run
    n = 0
    for run in range(len(cell)):
        for k in range(first[run], first[run + 1]):
            if known[k]:
                run_of[n], step_of[n] = run, low[run] + (k - first[run])
                n += 1
            else:
                missed[run] += 1
    # Voxels of one run follow each other: the runs around it are looked for once, without branches.
    around, size, around_run = np.zeros(len(cell), np.int32), 0, -1
    done = 0
    while done < n:
        run, step = run_of[done], step_of[done]
        done += 1
        if run != around_run:
            size, around_run = 0, run
            row, col = cell[run] // cols, cell[run] % cols
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                for other in range(runs_of[r * cols + max(col - 1, 0)], runs_of[r * cols + min(col + 2, cols)]):
                    near = (low[other] <= high[run] + 1) & (high[other] >= low[run] - 1)
                    around[size] = other
                    size += near & (missed[other] > 0) & (label[other] == label[run])
        voxel = first[run] + step - low[run]
        for other in around[:size]:
            for its in range(max(step - 1, low[other]), min(step + 1, high[other]) + 1):
                k = first[other] + its - low[other]
                if not known[k]:
                    known[k] = True
                    missed[other] -= 1
                    rgb[k, 0], rgb[k, 1], rgb[k, 2] = rgb[voxel, 0], rgb[voxel, 1], rgb[voxel, 2]
                    run_of[n], step_of[n] = other, its
                    n += 1


@dataclass
class _Looking:
    """Gathers the pixels of each community, frame by frame."""

    simap: SIMap

    def __post_init__(self) -> None:
        simap = self.simap
        flat = simap.community.reshape(-1)
        self.cell = np.flatnonzero(flat)
        numbers, self.patch = np.unique(flat[self.cell], return_inverse=True)
        self.patches = len(numbers)
        self.pixels: list[NDArray] = []

    def look(self, cells: NDArray, color: NDArray, segmentation: Segmentation) -> None:
        """Take the pixels of a frame that fall on an object's cell, and whose segment has the cell's class."""
        index_of = {name: i for i, name in enumerate(self.simap.grid.labels)}
        label_of = np.full(max((one.id for one in segmentation.segments), default=0) + 1, -1, np.int32)
        for one in segmentation.segments:
            label_of[one.id] = index_of.get(one.label, -1)
        # The segment at a pixel has to be of the class of the pixel's cell, which has to be in a patch.
        label = label_of[segmentation.ids[::_EVERY, ::_EVERY]]
        seen = (cells >= 0) & (self.simap.grid.label.reshape(-1)[cells] == label)
        cell, rgb = cells[seen], color[seen].astype(np.int64)
        at = np.minimum(np.searchsorted(self.cell, cell), max(len(self.cell) - 1, 0))
        inside = self.cell[at] == cell if len(self.cell) else np.zeros(len(cell), bool)
        # One number holds the patch and its colour, so that a pixel takes 8 bytes.
        patch, rgb = self.patch[at[inside]].astype(np.int64), rgb[inside]
        if len(patch):
            self.pixels.append(patch << 24 | rgb[:, 0] << 16 | rgb[:, 1] << 8 | rgb[:, 2])

    def appearance(self) -> Appearance:
        """Return the median colour of each patch."""
        packed = np.concatenate(self.pixels)
        patch = packed >> 24
        count = np.bincount(patch, minlength=self.patches)
        starts = np.cumsum(count) - count
        rgb = np.zeros((self.patches, 3), np.uint8)
        known = count > 0
        for channel, shift in enumerate((16, 8, 0)):
            value = np.sort(patch << 8 | (packed >> shift & 255)) & 255
            rgb[known, channel] = value[(starts + count // 2)[known]]
        return Appearance(
            self.simap.spec, self.cell.astype(np.int32), self.patch.astype(np.int32), rgb, count.astype(np.int32)
        )
