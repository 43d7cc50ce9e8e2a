"""A map that was opened unpacks what is asked for, no more: the same as it was built, whatever becomes of its file."""

import copy
import io
import pickle
import threading
import tracemalloc
import zipfile
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from sequences import write_tiny_sequence
from toy_maps import toy_map

from simaps_viz import build_map, load_map, open_sequence, save_map
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.errors import InputError
from simaps_viz.io import arrays
from simaps_viz.mapping import file, partition
from simaps_viz.mapping.file import PACKED
from simaps_viz.mapping.simap import repartition
from simaps_viz.mapping.surface import Surface
from simaps_viz.structures import Grid, GridSpec, SIMap

GRAPH_PARTS = {"cells", "edges", "counts", "different", "seen"}


@pytest.fixture(scope="module", params=["evidence", "paper", "components", "toy"])
def simap(request, tmp_path_factory) -> SIMap:
    if request.param == "toy":
        return toy_in_space()
    sequence = open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny")))
    return build_map(sequence, BuildConfig(method=request.param))


@pytest.fixture(scope="module")
def toy() -> SIMap:
    return toy_in_space()


def toy_in_space() -> SIMap:
    """The toy map with a surface: a run of two steps in every cell, of all kinds of owners."""
    toy = toy_map()
    size, rng = toy.instance.size, np.random.default_rng(0)
    low = rng.integers(-6, 30, size).astype(np.int8)
    owner = rng.integers(-2, 3, size).astype(np.int32)
    color = rng.integers(-16, 16, (3, 2 * size)).astype(np.int8)
    below = replace(toy.instances[0], id=int(toy.community.max()) + 1)
    surface = Surface(toy.spec, np.arange(size, dtype=np.int32), low, (low + 1).astype(np.int8), owner, color)
    return replace(toy, surface=surface, hidden=(below,))


@pytest.fixture(params=[1 << 20, 7])
def _together(request, monkeypatch):
    """However many cells and edges are looked at together."""
    monkeypatch.setattr(partition, "BLOCK_CELLS", request.param)
    monkeypatch.setattr(file, "_EDGES_AT_ONCE", request.param)


def same(one, other) -> None:
    """Everything in two structures is equal."""
    assert fields(one) == fields(other)
    for name in (field.name for field in fields(one)):
        a, b = getattr(one, name), getattr(other, name)
        if isinstance(a, np.ndarray):
            assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), name
        elif name == "graphs":
            for mine, its in zip(a, b, strict=True):
                same(mine, its)
                assert mine.weights.tobytes() == its.weights.tobytes()
        elif is_dataclass(a):
            same(a, b)
        elif not isinstance(a, dict):
            assert a == b, name


def arrays_in(path) -> dict[str, np.ndarray]:
    with np.load(path) as archive:
        return dict(archive)


@pytest.mark.usefixtures("_together")
def test_an_opened_map_is_the_built_one_when_its_file_is_gone_or_written_over(simap, tmp_path):
    save_map(simap, tmp_path / "a.npz")
    gone, changed = load_map(tmp_path / "a.npz"), load_map(tmp_path / "a.npz")
    (tmp_path / "a.npz").write_bytes(b"other")  # in place
    same(changed, simap)
    (tmp_path / "a.npz").unlink()
    same(gone, simap)
    save_map(gone, tmp_path / "b.npz")
    same(load_map(tmp_path / "b.npz"), simap)


@pytest.mark.usefixtures("_together")
def test_the_file_is_what_numpy_writes_of_the_same_arrays(simap, tmp_path):
    save_map(simap, tmp_path / "a.npz")
    whole, buffer = (tmp_path / "a.npz").read_bytes(), io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays_in(tmp_path / "a.npz"))
    theirs, ours = (zipfile.ZipFile(io.BytesIO(data)) for data in (buffer.getvalue(), whole))
    assert [(one.filename, theirs.read(one)) for one in theirs.infolist()] == [
        (one.filename, ours.read(one)) for one in ours.infolist()
    ]
    save_map(load_map(tmp_path / "a.npz"), tmp_path / "b.npz")
    assert (tmp_path / "b.npz").read_bytes() == whole


def test_opening_unpacks_no_layer_and_no_edge(toy, tmp_path):
    save_map(toy, tmp_path / "a.npz")
    simap = load_map(tmp_path / "a.npz")
    assert simap.counts() == toy.counts() and simap.at(*toy.instances[0].centroid_m[:2]) is not None
    assert not {"community", "surface"} & set(vars(simap)) and not {"height_m", "lowest_m", "observations"} & set(
        vars(simap.grid)
    )
    assert not any(GRAPH_PARTS & set(vars(graph)) for graph in simap.graphs)
    cut = repartition(simap, k_percent=30.0)
    assert cut.graphs is simap.graphs and cut.grid is simap.grid and cut.community is simap.community
    assert "lowest_m" not in vars(simap.grid) and not any(GRAPH_PARTS & set(vars(graph)) for graph in simap.graphs)
    assert len(simap.graphs[0].cells) and "edges" not in vars(simap.graphs[0])
    assert simap.graphs[0].edges is simap.graphs[0].edges and simap.grid.lowest_m is simap.grid.lowest_m
    assert not any(hasattr(one, "nothing") for one in (simap, simap.grid, simap.graphs[0]))


@pytest.mark.slow
def test_opening_a_large_map_takes_less_than_its_layers(tmp_path):
    rng, shape = np.random.default_rng(3), (1500, 2000)
    heights = rng.random(shape, np.float32)
    grid = Grid(GridSpec(*shape, 0.05, 0.0, 0.0), ("none", "floor"), (False, False), np.ones(shape, np.int16), heights,
                heights, rng.integers(1, 9, shape, np.int32))  # fmt: skip
    empty = repartition(toy_map(), k_percent=100.0)
    none, nothing = np.zeros(shape, np.int32), np.zeros(0, np.int32)
    no_views = replace(empty.views, community=nothing, frame=nothing, segment=nothing, cells=nothing,
                       score=np.zeros(0, np.float32))  # fmt: skip
    log = replace(empty.merges, label=np.zeros(0, np.int16), source=nothing, target=nothing, score=no_views.score)
    save_map(
        replace(empty, grid=grid, instance=none, instances=(), community=none, merges=log, graphs=(), views=no_views),
        tmp_path / "a.npz",
    )  # fmt: skip
    cells, packed = shape[0] * shape[1], (tmp_path / "a.npz").stat().st_size
    tracemalloc.start()
    try:
        simap = load_map(tmp_path / "a.npz")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < (2 + 4) * cells + packed + 24 * partition.BLOCK_CELLS < 22 * cells + packed
    assert np.array_equal(simap.grid.height_m, heights)


@pytest.mark.usefixtures("_together")
@pytest.mark.parametrize(
    ("name", "change", "match"),
    [
        ("edge_first", lambda a: a + 10_000_000, "leave its cells"),
        ("edge_first", lambda a: np.r_[a[:-1], -1], "leave its cells"),
        ("edge_first", lambda a: np.r_[a[:-1], 0], "leave its cells"),
        ("edge_step", lambda a: np.r_[a[:-1], 0], "lead backwards"),
        ("edge_step", lambda a: np.r_[a[:-1], a[-1] + 1], "leave its cells"),
        ("edge_step", lambda a: a[:-1], "edge_ arrays of different lengths"),
        ("edge_count", lambda a: np.r_[a[:-1], -1], "edge counts"),
        ("edge_different", lambda a: np.r_[a[:-1], -1], "edge counts"),
        ("height", lambda a: np.where(np.arange(a.size).reshape(a.shape) == a.size - 1, np.inf, a), "infinite"),
        ("lowest", lambda a: np.where(np.arange(a.size).reshape(a.shape) == a.size - 1, -np.inf, a), "infinite"),
        ("observations", lambda a: np.where(np.arange(a.size).reshape(a.shape) == a.size - 1, -1, a), "observations"),
        ("community", lambda a: np.where(np.arange(a.size).reshape(a.shape) == a.size - 1, -1, a), "community"),
        ("community", lambda a: np.where(np.arange(a.size).reshape(a.shape) == 0, 1 << 30, a), "community"),
        ("community", lambda a: a * 0, "merge_source out of range"),
        ("instance", lambda a: np.where(a == a.max(), 1, a), "instances that are not"),
    ],
)  # fmt: skip
def test_what_is_not_unpacked_was_checked(toy, tmp_path, name, change, match):
    path = tmp_path / "a.npz"
    save_map(toy, path)
    contents = arrays_in(path)
    contents[name] = change(contents[name]).astype(contents[name].dtype)
    np.savez_compressed(path, allow_pickle=False, **contents)
    with pytest.raises(InputError, match=match) as caught:
        load_map(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", PACKED)
@pytest.mark.parametrize("compressed", [True, False])
def test_wrong_bytes_of_what_is_not_unpacked_are_refused(toy, tmp_path, name, compressed):
    path = tmp_path / "a.npz"
    save_map(toy, path)
    if not compressed:
        np.savez(path, allow_pickle=False, **arrays_in(path))
        same(load_map(path), toy)
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        info = archive.getinfo(f"{name}.npy")
    first, refused = info.header_offset + 30 + len(info.filename) + 20, 0
    places = range(first, first + info.compress_size, max(info.compress_size // 6, 1))
    for at in places:
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])
        try:
            simap = load_map(path)
        except InputError as error:
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
            refused += 1
        else:
            same(simap, toy)  # a bit that means nothing
    assert refused > 0.7 * len(places)


def test_a_member_that_claims_more_than_an_array_can_be_is_refused_before_it_is_read(toy, tmp_path, monkeypatch):
    save_map(toy, tmp_path / "a.npz")
    monkeypatch.setattr(arrays, "MAX_ARRAY_BYTES", 200)
    monkeypatch.setattr(arrays, "_BLOCK", 0)
    with pytest.raises(InputError, match=r"a.npz: .*expected a") as caught:
        load_map(tmp_path / "a.npz")
    assert "\n" not in str(caught.value)
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        info = archive.getinfo("height.npy")
    with (tmp_path / "a.npz").open("rb") as whole, pytest.raises(ValueError, match="no array can be"):
        arrays._packed(whole, info)


def test_layers_that_another_program_has_written_by_columns_are_read(toy, tmp_path):
    save_map(toy, tmp_path / "a.npz")
    turned = {name: array.copy("F") for name, array in arrays_in(tmp_path / "a.npz").items()}
    np.savez_compressed(tmp_path / "a.npz", allow_pickle=False, **turned)
    same(load_map(tmp_path / "a.npz"), toy)


@pytest.mark.parametrize("again", [copy.deepcopy, copy.copy, lambda simap: pickle.loads(pickle.dumps(simap))])
def test_an_opened_map_can_be_copied_and_sent(toy, tmp_path, again):
    save_map(toy, tmp_path / "a.npz")
    same(again(load_map(tmp_path / "a.npz")), toy)


def test_threads_share_what_one_of_them_has_unpacked(toy, tmp_path):
    save_map(toy, tmp_path / "a.npz")
    simap, found = load_map(tmp_path / "a.npz"), []
    start = threading.Barrier(8)

    def ask() -> None:
        start.wait()
        found.append((simap.community, simap.grid.height_m, *(graph.edges for graph in simap.graphs)))

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8 and {tuple(map(id, one)) for one in found} == {tuple(map(id, found[0]))}
