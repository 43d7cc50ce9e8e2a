"""The map file: what goes in comes out, a fault is named, and nothing saved is ever lost."""

import json
import os
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from sequences import write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.mapping import file
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.simap import recommunity, repartition


@pytest.fixture(scope="module")
def simap(tmp_path_factory):
    return build_map(
        open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"))), BuildConfig(method="paper", min_cells=1)
    )


def test_round_trip(simap, tmp_path):
    save_map(simap, tmp_path / "a.npz")
    back = load_map(tmp_path / "a.npz")
    assert back.instances == simap.instances and back.grid.spec == simap.grid.spec
    assert dict(back.parameters) == dict(simap.parameters) and dict(back.provenance) == dict(simap.provenance)
    assert back.frame_names == simap.frame_names and back.grid.labels == simap.grid.labels
    for ours, theirs in ((back.instance, simap.instance), (back.community, simap.community),
                         (back.grid.label, simap.grid.label), (back.T_map_camera, simap.T_map_camera)):  # fmt: skip
        assert ours.dtype == theirs.dtype and np.array_equal(ours, theirs)
    for ours, theirs in zip(back.graphs, simap.graphs, strict=True):
        assert np.array_equal(ours.edges, theirs.edges) and np.array_equal(ours.weights, theirs.weights)


def test_the_contract_that_other_programs_read(simap, tmp_path):
    save_map(simap, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        meta = json.loads(str(archive["metadata"]))
        kinds = {name: (archive[name].dtype, archive[name].ndim) for name in ("label", "instance", "height")}
        assert kinds == {"label": (np.int16, 2), "instance": (np.int32, 2), "height": (np.float32, 2)}
        assert archive["observations"].shape == archive["label"].shape
        assert np.array_equal(np.isnan(archive["height"]), archive["observations"] == 0)
    assert meta["format"] == "simap/1" and meta["cell_size_m"] == 0.05 and len(meta["origin_m"]) == 2
    assert np.array(meta["T_map_world"]).shape == (4, 4) and meta["labels"][0] == "none"
    assert set(meta["instances"][0]) == {"id", "label", "cells", "centroid_m", "aabb_m", "frames", "score"}


def test_graphs_of_a_method_that_is_not_known_here_are_weighted_by_frame(simap, tmp_path):
    foreign = replace(simap, method="another program's", graphs=simap.graphs)
    save_map(foreign, tmp_path / "map.npz")
    back = load_map(tmp_path / "map.npz")
    assert back.method == foreign.method and any(len(graph.edges) for graph in back.graphs)
    for graph, its in zip(simap.graphs, back.graphs, strict=True):
        seen = simap.grid.observations.reshape(-1)[graph.cells]
        per_frame = graph.counts / seen[graph.edges].mean(axis=1)
        assert its.seen is not None and np.allclose(its.weights, per_frame)


def test_every_k_from_the_file_is_what_building_with_that_k_gives(simap, tmp_path):
    save_map(simap, tmp_path / "a.npz")
    back = load_map(tmp_path / "a.npz")
    finer = recommunity(back, resolution=6.0)
    assert int(finer.community.max()) > int(back.community.max())
    counts = [len(repartition(finer, k_percent=k).instances) for k in (0, 5, 30, 100)]
    assert counts == sorted(counts) and counts[0] == 2 and counts[-1] == int(finer.community.max())
    again = recommunity(finer, resolution=1.0, k_percent=5.0)
    assert again.instances == back.instances
    with pytest.raises(InputError, match="K: expected a percentage from 0 to 100, found 101"):
        repartition(back, k_percent=101)
    with pytest.raises(InputError, match="resolution: expected"):
        recommunity(back, resolution=0.0)


def damaged(tmp_path, simap, change):
    path = tmp_path / "a.npz"
    save_map(simap, path)
    with np.load(path) as archive:
        data = {name: archive[name] for name in archive.files}
    change(data)
    np.savez(path, allow_pickle=False, **data)
    return path


def with_meta(**changes):
    def change(data):
        data["metadata"] = np.array(json.dumps({**json.loads(str(data["metadata"])), **changes}))

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("metadata"), "metadata"),
        (lambda d: d.update(metadata=np.array("{")), "metadata"),
        (with_meta(format="simap/9"), "expected format simap/1, found 'simap/9'"),
        (lambda d: d.pop("community"), "expected an array community"),
        (lambda d: d.update(label=d["label"].astype(np.int64)), "label: expected int16"),
        (lambda d: d.update(instance=d["instance"][:-1]), "instance: expected shape"),
        (lambda d: d.update(label=d["label"] + np.int16(99)), "found otherwise"),
        (lambda d: d.update(edge_step=d["edge_step"] + np.int32(999)), "found otherwise"),
        (with_meta(instances=[{"id": 1}]), "found otherwise"),
        (with_meta(T_map_world=[1, 2]), "found otherwise"),
    ],
)
def test_a_damaged_file_is_named(simap, tmp_path, change, message):
    path = damaged(tmp_path, simap, change)
    with pytest.raises(InputError) as caught:
        load_map(path)
    assert str(path) in str(caught.value) and message in str(caught.value) and "\n" not in str(caught.value)


def test_missing_truncated_and_foreign_files_are_named(simap, tmp_path):
    path = tmp_path / "a.npz"
    with pytest.raises(InputError, match="found nothing"):
        load_map(path)
    with pytest.raises(InputError, match="found a folder"):
        load_map(tmp_path)
    save_map(simap, path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match=r"a\.npz: expected a complete map file"):
        load_map(path)
    path.write_text("hello")
    with pytest.raises(InputError, match=r"a\.npz: expected a complete map file"):
        load_map(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x", "y")
    with pytest.raises(InputError, match=r"a\.npz"):
        load_map(path)


def test_a_save_that_fails_leaves_the_earlier_file_and_nothing_else(simap, tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    save_map(simap, path)
    before = path.read_bytes()

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(file.os, "fsync", fail)
    with pytest.raises(InputError, match=r"a\.npz: could not write the map: No space left"):
        save_map(simap, path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["a.npz"]


def test_an_unwritable_place_is_refused_before_any_work(simap, tmp_path):
    for path in (tmp_path / "missing" / "a.npz", tmp_path):
        with pytest.raises(InputError, match="expected a"):
            save_map(simap, path)
    assert os.listdir(tmp_path) == []


def test_a_million_cells_take_six_bytes_each_for_label_and_instance(simap):
    per_cell = simap.grid.label.itemsize + simap.instance.itemsize
    assert per_cell * 1_000_000 <= 8 * 1024**2
