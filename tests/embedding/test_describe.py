"""Described maps: which views are looked at, what is kept, and what the words find afterwards."""

import zipfile
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from sequences import write_tiny_sequence
from tiny_embeddings import write_colors, write_transformers

from simaps_viz import CommandError, InputError, load_map, open_sequence, repartition, save_map
from simaps_viz.appearance import Appearance
from simaps_viz.cli.main import main
from simaps_viz.embedding.describe import MAX_VIEWS, calibrated_scale, choose_views, describe
from simaps_viz.embedding.search import STOCK, Index
from simaps_viz.embedding.towers import open_embedding
from simaps_viz.mapping import edits
from simaps_viz.structures import Views


def quiet(stage, done, total):
    pass


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a sequence of 6 frames, its map, and an embedding that knows colours."""
    folder = tmp_path_factory.mktemp("place")
    write_tiny_sequence(folder / "tiny", frames=6)
    write_colors(folder / "net")
    assert main(["build", str(folder / "tiny"), "-o", str(folder / "tiny.npz"), "--min-cells", "1", "--json"]) == 0
    return folder


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def own_cache(cache, monkeypatch):
    monkeypatch.setenv("SIMAPS_CACHE", str(cache))
    monkeypatch.delenv("SIMAPS_EMBEDDING", raising=False)


@pytest.fixture(scope="module")
def simap(place):
    found = load_map(place / "tiny.npz")
    return describe(found, open_sequence(place / "tiny"), open_embedding(place / "net"), quiet)


def west(simap):
    return min(simap.instances, key=lambda one: one.centroid_m[0])


def east(simap):
    return max(simap.instances, key=lambda one: one.centroid_m[0])


def test_the_command_adds_vectors_and_changes_nothing_else(place, tmp_path, capsys):
    out = tmp_path / "out.npz"
    arguments = ["describe", str(place / "tiny.npz"), "--embedding", str(place / "net"), "-o", str(out), "--json"]
    assert main(arguments) == 0
    assert '"colored": 2, "described": 2' in capsys.readouterr().out
    with zipfile.ZipFile(out) as ours, zipfile.ZipFile(place / "tiny.npz") as theirs:
        assert ours.namelist() == theirs.namelist()
        changed = {name for name in theirs.namelist() if ours.read(name) != theirs.read(name)}
    assert changed == {f"embedding{end}.npy" for end in ("", "_of", "_weight", "_words", "_model")}
    found = load_map(out)
    assert found.described and not load_map(place / "tiny.npz").described
    # The network of words was remembered: the map says only which one it was.
    (best,) = found.search("red")
    assert best.instance == west(found) and best.score > 0.9
    assert found.appearance is not None and str(place) not in str(found.appearance.model)
    # Looking at the colours again keeps the vectors.
    assert main(["describe", str(out), "--json"]) == 0
    assert load_map(out).described


def test_build_describes_too(place, tmp_path):
    out = tmp_path / "a.npz"
    assert main(["build", str(place / "tiny"), "-o", str(out), "--embedding", str(place / "net"), "--json"]) == 0
    assert load_map(out).search("green")[0].instance == east(load_map(out))


def test_words_find_what_looks_so_or_are_refused(simap, place, monkeypatch):
    monkeypatch.setenv("SIMAPS_EMBEDDING", str(place / "net"))
    assert [one.instance for one in simap.search("Green")] == [east(simap)]
    assert [one.instance for one in simap.search("the red.")] == [west(simap)]
    with pytest.raises(
        CommandError, match=r'Nothing on this map looks like "blue". The nearest is the chair, which looks'
    ):
        simap.search("blue")
    # A class is answered from the map itself.
    assert {one.score for one in simap.search("chairs")} == {1.0} and len(simap.search("chair", k=1)) == 1
    for words, k in (("", 5), ("x" * 400, 5), (3, 5), ("red", 0)):
        with pytest.raises(InputError, match="expected"):
            simap.search(words, k)


def test_without_a_network_only_words_of_the_map_are_known(simap, place, monkeypatch, tmp_path):
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path))
    with pytest.raises(CommandError, match="set SIMAPS_EMBEDDING to its folder"):
        simap.search("red")
    write_transformers(tmp_path / "other")
    monkeypatch.setenv("SIMAPS_EMBEDDING", str(tmp_path / "other"))
    with pytest.raises(CommandError, match="expected the network that the map was described with, found another"):
        simap.search("red")
    plain = load_map(place / "tiny.npz")
    assert [one.score for one in plain.search("something to sit on")] == [1.0, 1.0], "a need of the table"
    with pytest.raises(CommandError, match=r'called "red". Free words need simaps describe'):
        plain.search("red")


def test_vectors_follow_the_cells_through_edits(simap, place, monkeypatch):
    monkeypatch.setenv("SIMAPS_EMBEDDING", str(place / "net"))
    cut = edits.apply(simap, edits.split(simap, west(simap).id, (-1.0, 0.01), (1.0, 0.01)))
    assert len(cut.search("red")) == 2
    joined = edits.apply(simap, edits.merge(simap, west(simap).id, east(simap).id))
    assert joined.appearance is not None
    ids, vectors = joined.appearance.instance_vectors(joined)
    both = simap.appearance.instance_vectors(simap)[1]
    weight = simap.appearance.weight[:, None]
    mean = (both * weight).sum(axis=0) / np.linalg.norm((both * weight).sum(axis=0))
    assert ids.tolist() == [joined.instances[0].id]
    np.testing.assert_allclose(vectors[0], mean, atol=2e-3)
    assert repartition(simap, affinity=0.9).described


def test_no_object_is_looked_at_more_than_eight_times(place, monkeypatch):
    opened, counts = open_embedding(place / "net"), Counter()
    real = opened.vision.embed
    monkeypatch.setattr(opened.vision, "embed", lambda crops: counts.update(crops=len(crops)) or real(crops))
    found = describe(load_map(place / "tiny.npz"), open_sequence(place / "tiny"), opened, quiet)
    assert 0 < counts["crops"] <= 2 * MAX_VIEWS * len(found.instances) and 2 * MAX_VIEWS <= 9


def test_views_are_of_new_directions_the_best_first(simap):
    """36 cameras on a circle around a chair, all at one height: each of 10 degrees; the best is at 90 degrees."""
    one = west(simap)
    number = int(simap.community[simap.instance == one.id][0])
    yaw = np.deg2rad(np.arange(36) * 10.0 + 5.0)
    cameras = np.tile(np.eye(4), (36, 1, 1))
    cameras[:, :3, 3] = np.stack([3 * np.cos(yaw), 3 * np.sin(yaw), 0 * yaw], axis=1) + one.centroid_m
    cells = np.full(36, 40) - np.minimum(abs(np.arange(36) - 9), 36 - abs(np.arange(36) - 9))
    ones = np.ones(36, np.int32)
    views = Views(
        number * ones, np.arange(36, dtype=np.int32), 5 * ones, cells.astype(np.int32), np.ones(36, np.float32)
    )
    drawn = replace(simap, views=views, T_map_camera=cameras, frame_names=tuple(map(str, range(36))))
    row = drawn.instances.index(one)
    chosen = choose_views(drawn)
    assert chosen == {f: [(row, 5, 1.0)] for f in (9, 6, 12, 3)}
    # A view that shows next to nothing is left out, and a segment shared with another object counts less.
    other = int(simap.community[simap.instance == east(simap).id][0])
    shared = Views(
        np.array([number, other, number, number], np.int32), np.array([0, 0, 9, 20], np.int32),
        np.array([5, 5, 6, 7], np.int32), np.array([30, 90, 20, 1], np.int32), np.ones(4, np.float32),
    )  # fmt: skip
    chosen = choose_views(replace(drawn, views=shared))
    assert chosen[9] == [(row, 6, 1.0)] and 20 not in chosen and (row, 5, 0.25) in chosen[0]


def test_another_sequence_or_other_masks_are_refused(simap, place, tmp_path):
    write_tiny_sequence(tmp_path / "short", frames=3)
    opened = open_embedding(place / "net")
    with pytest.raises(InputError, match="expected the frames that the map was built from, found no frame 0013"):
        describe(simap, open_sequence(tmp_path / "short"), opened, quiet)
    other = replace(simap, provenance={**simap.provenance, "segmentation": "another network"})
    with pytest.raises(InputError, match=r"expected the masks that the map was built with \(another network\)"):
        describe(other, open_sequence(place / "tiny"), opened, quiet)


def test_the_scale_is_that_of_the_maps_own_classes():
    """Cosines of 0.2 for the right word and -0.05 to 0.05 for others, some wrong: the likeliest scale is found."""
    rng = np.random.default_rng(0)
    cosines = rng.uniform(-0.05, 0.05, (300, 20))
    kind = rng.integers(0, 20, 300)
    named = np.where(rng.random(300) < 0.8, kind, (kind + 1) % 20)
    cosines[np.arange(300), named] = 0.2
    found = calibrated_scale(cosines, np.eye(20), kind)

    def likelihood(scale):
        shares = np.exp(scale * cosines) / np.exp(scale * cosines).sum(axis=1, keepdims=True)
        return sum(np.log(shares[kind == one, one]).mean() for one in range(20))

    assert 5.0 < found < 500.0
    assert likelihood(found) >= max(likelihood(found * 1.2), likelihood(found / 1.2))
    assert calibrated_scale(cosines[:2], np.eye(20), np.array([0, 1])) == 100.0


def test_scores_are_shares_of_a_softmax_without_the_words_that_mean_the_same(simap):
    """Against the plain formula, on random vectors."""
    rng = np.random.default_rng(1)
    words = ("chair", *STOCK["things"][1:6], *STOCK["uses"][:4])
    look = replace(
        simap.appearance, vectors=rng.standard_normal((2, 8)).astype(np.float16),
        word_vectors=rng.standard_normal((len(words), 8)).astype(np.float16),
        model={"words": words, "scale": 3.0},
    )  # fmt: skip
    index = Index(simap, look)
    for uses in (False, True):
        near = np.array(look.word_vectors[6 if uses else 2], np.float32)
        query = near + 0.1 * rng.standard_normal(8)
        query = (query / np.linalg.norm(query)).astype(np.float32)
        mine = range(6, 10) if uses else range(6)
        unit = look.word_vectors[list(mine)].astype(float)
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        cosines = unit @ query
        rivals = [i for i in range(len(unit)) if cosines[i] < (1 + np.median(cosines)) / 2]
        assert len(rivals) < len(unit), "the word that the query was made of means the same"
        ranking = index.rank(query, uses=uses)
        for row, vector in enumerate(index.vectors.astype(float)):
            others = np.exp(3.0 * unit[rivals] @ vector)
            own = np.exp(3.0 * query @ vector)
            assert ranking.scores[row] == pytest.approx(own / (own + others.sum()), abs=1e-4)
            name, share = ranking.rival(row)
            assert name == words[mine[rivals[int(others.argmax())]]]
            assert share == pytest.approx(others.max() / (own + others.sum()), abs=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("seen_rgb"), "seen_rgb"),
        (lambda d: d.update(seen_cell=-d["seen_cell"]), "seen_cell"),
        (lambda d: d.update(seen_cell=d["seen_cell"] + np.int32(9999)), "seen_cell"),
        (lambda d: d.update(seen_patch=d["seen_patch"] + np.int32(99)), "seen_patch"),
        (lambda d: d.update(seen_rgb=d["seen_rgb"].astype(np.int32)), "seen_rgb: expected uint8"),
        (lambda d: d.update(embedding_of=d["embedding_of"] + np.int32(9)), "embedding_of"),
        (lambda d: d.update(embedding=d["embedding"] * np.float16(np.nan)), "embedding"),
        (lambda d: d.update(embedding_words=d["embedding_words"][1:]), "appearance"),
        (lambda d: d.update(embedding_model=np.array("[]")), "found otherwise"),
        (lambda d: d.update(embedding_model=np.array('{"words": ["a"], "scale": "big"}')), "embedding_model"),
        (
            lambda d: d.update(embedding_model=np.array("{}"), embedding_words=d["embedding_words"][:0]),
            "embedding_model",
        ),
    ],
)
def test_damaged_looks_are_refused(simap, tmp_path, change, message):
    path = tmp_path / "a.npz"
    save_map(simap, path)
    back = load_map(path).appearance
    assert back is not None and back.model == simap.appearance.model
    with np.load(path) as archive:
        data = {name: archive[name] for name in archive.files}
    change(data)
    np.savez(path, allow_pickle=False, **data)
    with pytest.raises(InputError) as caught:
        load_map(path)
    assert str(path) in str(caught.value) and message in str(caught.value) and "\n" not in str(caught.value)


def test_arrays_that_do_not_fit_are_refused(simap):
    look = simap.appearance
    with pytest.raises(InputError, match="appearance: expected arrays of"):
        Appearance(look.spec, look.cell, look.patch, look.rgb, look.pixels[1:])
