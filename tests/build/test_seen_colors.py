"""Colours as seen: exactly those of the pictures, whatever becomes of the communities later."""

import zipfile
from collections import Counter, deque
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from sequences import COLORS, write_tiny_sequence

from simaps_viz import BuildConfig, PosedFrames, build_map, load_map, open_sequence, recommunity, save_map
from simaps_viz.build.seen_colors import SurfaceColors, choose_frames, with_colors
from simaps_viz.build.to_file import BuildRequest, build_to_file
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError
from simaps_viz.mapping import edits
from simaps_viz.mapping.surface import Surface, coded_colors
from simaps_viz.structures import Views


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"), frames=6))


@pytest.fixture(scope="module")
def plain(sequence):
    return build_map(sequence, BuildConfig(min_cells=1))


@pytest.fixture(scope="module")
def colored(plain, sequence):
    return with_colors(plain, sequence)


class Faulty(PosedFrames):
    """A sequence whose colours are missing (None) or damaged (an error) in some frames."""

    def __init__(self, sequence, missing=(), damaged=()):
        vars(self).update(vars(sequence))
        self.missing, self.damaged = missing, damaged

    def read(self, index, *, color=False):
        if index in self.damaged:
            raise InputError("damaged")
        frame = super().read(index, color=color)
        return replace(frame, color=None) if index in self.missing else frame


def by_place(simap):
    """Return {where a chair is: its colour}."""
    return {"west" if one.centroid_m[0] < 0 else "east": simap.color_of(one) for one in simap.instances}


def test_a_built_map_has_the_colours_of_the_pictures_and_loses_nothing(sequence, plain, tmp_path):
    request = BuildRequest("evidence", BuildConfig(min_cells=1), tmp_path / "a.npz")
    with stage_progress(quiet=True) as progress:
        build_to_file(sequence, request, progress)
    save_map(plain, tmp_path / "b.npz")
    found = load_map(tmp_path / "a.npz")
    assert by_place(found) == {"west": COLORS[1], "east": COLORS[2]} and not found.described
    assert found.color_of(found.instances[0].id) == found.color_of(found.instances[0]) and found.color_of(99) is None
    assert by_place(load_map(tmp_path / "b.npz")) == {"west": None, "east": None}
    with zipfile.ZipFile(tmp_path / "a.npz") as ours, zipfile.ZipFile(tmp_path / "b.npz") as theirs:
        assert set(theirs.namelist()) < set(ours.namelist())
        assert all(ours.read(name) == theirs.read(name) for name in theirs.namelist())


def test_pictures_without_colour_or_damaged_are_left_out(plain, sequence):
    assert by_place(with_colors(plain, Faulty(sequence, (0, 1), (2, 3)))) == {"west": COLORS[1], "east": COLORS[2]}
    assert with_colors(plain, Faulty(sequence, missing=range(6))) is plain
    assert with_colors(plain, Faulty(sequence, damaged=range(6))) is plain


def test_colours_follow_the_cells_through_edits_and_other_communities(colored):
    west, east = sorted(colored.instances, key=lambda one: one.centroid_m[0])
    cut = edits.apply(colored, edits.split(colored, west.id, (-1.0, 0.01), (1.0, 0.01)))
    assert Counter(cut.color_of(one) for one in cut.instances) == {COLORS[1]: 2, COLORS[2]: 1}
    named = edits.apply(colored, edits.relabel(colored, east.id, "stool"))
    assert {one.label: named.color_of(one) for one in named.instances} == {"chair": COLORS[1], "stool": COLORS[2]}
    small = recommunity(colored, resolution=6.0, affinity=1.0)
    assert len(small.instances) > 2
    for one in small.instances:
        assert small.color_of(one) == COLORS[1 if one.centroid_m[0] < 0 else 2]
    # Joined with a part of the other chair, an object has the colour of most of its pixels, in either order.
    parts = [one for one in cut.instances if cut.color_of(one) == COLORS[1]]
    whole = next(one for one in cut.instances if cut.color_of(one) == COLORS[2])
    small_part = min(parts, key=lambda one: one.cells)
    both = edits.apply(cut, edits.merge(cut, small_part.id, whole.id))
    assert Counter(both.color_of(one) for one in both.instances) == {COLORS[1]: 1, COLORS[2]: 1}


def test_every_voxel_of_the_surface_has_the_colour_of_its_pixels(colored, sequence):
    points = colored.points()
    of_id = {one.id: COLORS[1 if one.centroid_m[0] < 0 else 2] for one in colored.instances} | {0: COLORS[3]}
    wanted = np.array([of_id[one] for one in points.instances.tolist()])
    assert len(points) > 500 and np.abs(points.colors.astype(int) - wanted).max() <= 24
    # Where one frame shows it all, voxels that it does not show have the colour of their class near by.
    once = with_colors(colored, Faulty(sequence, missing=range(1, 6))).points()
    assert np.abs(once.colors.astype(int) - wanted).max() <= 24


@pytest.mark.parametrize("seed", range(20))
def test_colours_spread_voxel_by_voxel(plain, seed):
    """The twin keeps a voxel's class and colour by its row, column and step, and colours spread breadth first."""
    rng, spec = np.random.default_rng(seed), plain.spec
    class_of, runs = {}, []
    for cell in sorted(rng.choice(spec.rows * spec.cols, 60, replace=False)):
        row, col = divmod(int(cell) % 9 + (int(cell) // 9 % 9) * spec.cols, spec.cols)
        steps = [] if any(run[:2] == (row, col) for run in runs) else np.flatnonzero(rng.random(12) < 0.6).tolist()
        classes = rng.integers(0, 3, 12).tolist()
        for step in steps:
            if runs and runs[-1][:2] == (row, col) and runs[-1][3] == step - 1 and runs[-1][4] == classes[step]:
                runs[-1] = (*runs[-1][:3], step, classes[step])
            else:
                runs.append((row, col, step, step, classes[step]))
    runs.sort()
    for row, col, low, high, label in runs:
        class_of |= {(row, col, step): label for step in range(low, high + 1)}
    total = rng.integers(0, 256, (len(class_of), 4)) * (rng.random((len(class_of), 1)) < 0.2)
    total[:, 3] = total.any(axis=1)
    color = {voxel: one[:3] for voxel, one in zip(class_of, total, strict=True) if one[3]}
    mean = {
        k: np.mean([one for voxel, one in color.items() if class_of[voxel] == k] or [[128] * 3], 0) for k in range(3)
    }
    waiting = deque(color)
    while waiting:
        row, col, step = voxel = waiting.popleft()
        for near in product((row - 1, row, row + 1), (col - 1, col, col + 1), (step - 1, step, step + 1)):
            if near not in color and class_of.get(near, -1) == class_of[voxel]:
                color[near] = color[voxel]
                waiting.append(near)
    row, col, low, high, label = np.array(runs).T
    surface = Surface(
        spec, (row * spec.cols + col).astype(np.int32), low.astype(np.int8), high.astype(np.int8),
        (-1 - label).astype(np.int32),
    )  # fmt: skip
    colors = SurfaceColors(replace(plain, surface=surface))
    colors.total[:] = total
    expected = [color.get(voxel, mean[label].astype(int)) for voxel, label in class_of.items()]
    assert np.array_equal(colors.surface().color, coded_colors(np.array(expected, np.uint8)))


def test_a_map_on_another_grid_has_no_colours(colored):
    spec = replace(colored.spec, x0_m=colored.spec.x0_m + 1.0)
    moved = replace(colored, grid=replace(colored.grid, spec=spec))
    assert {moved.color_of(one) for one in moved.instances} == {None}


def test_few_frames_show_every_object(colored):
    """100 frames; one object is in all of them, the other in a single one, of low confidence."""
    west, east = (one.id for one in sorted(colored.instances, key=lambda one: one.centroid_m[0]))
    community = {one: int(colored.community[colored.instance == one][0]) for one in (west, east)}
    rows = [(community[west], frame, 10 + frame % 7) for frame in range(100)] + [(community[east], 41, 3)]
    numbers, frames, cells = np.array(rows, np.int32).T
    views = Views(numbers, frames, np.ones_like(frames), cells, np.where(frames == 41, 0.3, 1.0).astype(np.float32))
    chosen = choose_frames(replace(colored, views=views, frame_names=tuple(map(str, range(100)))))
    assert 41 in chosen and 2 <= len(chosen) <= 10 and chosen == sorted(set(chosen))
    empty = Views(*(np.zeros(0, part.dtype) for part in vars(views).values()))
    assert choose_frames(replace(colored, views=empty)) == []
