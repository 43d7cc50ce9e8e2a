"""Method evidence, built again and again and kept in a file: the same to the last bit."""

import json
import os
import subprocess
import sys
from dataclasses import asdict, fields

import cv2
import numpy as np
import pytest
from sequences import frame_name, write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.mapping.surface import Surface
from simaps_viz.structures import CellGraph, Grid, MergeLog, Views

FRAMES = 8


@pytest.fixture(scope="module")
def spoiled(tmp_path_factory):
    """The tiny sequence with blots on its masks, so that votes and evidence have something to weigh."""
    manifest = write_tiny_sequence(tmp_path_factory.mktemp("spoiled"), frames=FRAMES)
    rng = np.random.default_rng(0)
    for index in range(FRAMES):
        path = manifest.parent / "ids" / f"{frame_name(index)}.png"
        ids = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert ids is not None
        for _ in range(5):
            row, col = int(rng.integers(0, 20)), int(rng.integers(0, 28))
            ids[row : row + 4, col : col + 4] = rng.integers(0, 4)
        assert cv2.imwrite(str(path), ids)
    return open_sequence(manifest)


@pytest.fixture(scope="module")
def simap(spoiled):
    return build_map(spoiled, BuildConfig(min_cells=1, resolution=3.0))


def arrays_of(path) -> dict[str, tuple]:
    with np.load(path, allow_pickle=False) as archive:
        return {name: (archive[name].dtype, archive[name].shape, archive[name].tobytes()) for name in archive.files}


def test_the_spoiled_sequence_is_worth_a_test(simap):
    assert simap.provenance["disagreement"] > simap.parameters["votes"]["exact_below"]
    assert any(graph.different.any() for graph in simap.graphs) and len(simap.merges) >= 3


@pytest.mark.slow
def test_a_build_is_the_same_to_the_last_bit_also_with_one_thread(spoiled, simap, tmp_path):
    save_map(simap, tmp_path / "one.npz")
    save_map(build_map(spoiled, BuildConfig(min_cells=1, resolution=3.0)), tmp_path / "two.npz")
    code = (
        "import sys; from pathlib import Path; from simaps_viz import build_map, open_sequence, save_map\n"
        "from simaps_viz.build.pipeline import BuildConfig\n"
        "simap = build_map(open_sequence(Path(sys.argv[1])), BuildConfig(min_cells=1, resolution=3.0))\n"
        "save_map(simap, Path(sys.argv[2]))"
    )
    one_thread = {name: "1" for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    subprocess.run(
        [sys.executable, "-c", code, str(spoiled.path), str(tmp_path / "three.npz")],
        check=True, env={**os.environ, **one_thread},
    )  # fmt: skip
    one = arrays_of(tmp_path / "one.npz")
    assert one == arrays_of(tmp_path / "two.npz")
    assert one == arrays_of(tmp_path / "three.npz")


def same(ours, theirs) -> None:
    """Compare every array of two structures, types included."""
    assert fields(ours) == fields(theirs)
    for name in (field.name for field in fields(ours)):
        value, other = getattr(ours, name), getattr(theirs, name)
        if isinstance(value, np.ndarray):
            assert value.dtype == other.dtype and value.shape == other.shape, name
            assert np.array_equal(value, other, equal_nan=value.dtype.kind == "f"), name
        elif isinstance(value, (Grid, MergeLog, Views, Surface)):
            same(value, other)
        elif name == "graphs":
            assert len(value) == len(other)
            for one, two in zip(value, other, strict=True):
                assert isinstance(one, CellGraph)
                same(one, two)
        elif isinstance(value, (dict, tuple)):
            assert json.dumps(value, default=asdict) == json.dumps(other, default=asdict), (
                name
            )  # a file knows no tuples
        else:
            assert value == other, name


def test_a_map_comes_back_from_its_file_whole(simap, tmp_path):
    save_map(simap, tmp_path / "a.npz")
    back = load_map(tmp_path / "a.npz")
    same(back, simap)
    assert back.method == "evidence" and back.graphs[0].different.any()


def test_what_is_asked_of_a_loaded_map_is_what_was_asked_of_the_built_one(simap, tmp_path):
    save_map(simap, tmp_path / "a.npz")
    back = load_map(tmp_path / "a.npz")
    for affinity in (0.0, 0.3, 0.6, 0.9, 1.0):
        same(repartition(back, affinity=affinity), repartition(simap, affinity=affinity))
    for resolution in (0.2, 1.0, 3.0, 9.0):
        same(recommunity(back, resolution=resolution), recommunity(simap, resolution=resolution))
    same(recommunity(back, resolution=3.0), simap)
    counts = [len(repartition(back, affinity=a).instances) for a in (0.0, 0.6, 1.0)]
    assert counts[0] <= counts[1] < counts[2] == int(simap.community.max())
