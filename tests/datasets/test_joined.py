"""Several sequences of one building on one map: joining the halves of a sequence is the whole, up to names."""

import json
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from sequences import frame_name, write_tiny_sequence

from simaps_viz import load_map, open_sequence
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.build.workers import reopening
from simaps_viz.cli.main import main
from simaps_viz.datasets.source import JoinedFrames
from simaps_viz.errors import InputError

FRAMES = 9


def part(folder, first, last, *, name="tiny"):
    """Return a folder with some of the tiny sequence's frames."""
    path = write_tiny_sequence(folder, frames=FRAMES, manifest={"name": name})
    lines = (folder / "poses.txt").read_text().splitlines()
    (folder / "poses.txt").write_text("\n".join(lines[first:last]) + "\n")
    table = json.loads((folder / "segments.json").read_text())
    kept = {frame_name(i): table[frame_name(i)] for i in range(first, last)}
    (folder / "segments.json").write_text(json.dumps(kept))
    return path


@pytest.fixture
def halves(tmp_path):
    return [part(tmp_path / "a", 0, 5), part(tmp_path / "b", 5, FRAMES)]


def plain(simap):
    """All that a map is, but names."""
    provenance = {k: v for k, v in simap.provenance.items() if k not in ("sequence", "name")}
    return replace(simap, frame_names=(), provenance=provenance)


def same(one, other):
    return np.array_equal(one, other, equal_nan=one.dtype.kind == "f") if isinstance(one, np.ndarray) else one == other


def assert_same(one, other):
    """Compare dataclasses of arrays, whatever is in them."""
    if hasattr(one, "__dataclass_fields__"):
        for name in (field.name for field in fields(one)):
            assert_same(getattr(one, name), getattr(other, name))
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    else:
        assert same(one, other)


@pytest.mark.parametrize("method", ["evidence", "paper"])
def test_the_halves_make_the_map_of_the_whole(tmp_path, halves, method):
    whole = open_sequence(write_tiny_sequence(tmp_path / "whole", frames=FRAMES))
    joined = JoinedFrames([open_sequence(path) for path in halves])
    config = BuildConfig(method=method)
    one, other = build_map(whole, config), build_map(joined, config)
    assert one.counts() == {"chair": 2}
    assert_same(plain(one), plain(other))
    assert other.frame_names == tuple(f"{'tiny' if i < 5 else 'tiny-2'}/{frame_name(i)}" for i in range(FRAMES))
    assert other.provenance["name"] == "tiny + tiny-2"
    assert other.provenance["sequence"] == f"{halves[0]} + {halves[1]}"


def test_frames_are_those_of_their_sequences(halves):
    first, second = (open_sequence(path) for path in halves)
    joined = JoinedFrames([first, second])
    assert len(joined) == FRAMES and np.array_equal(joined.poses[5:], second.poses)
    frame, inner = joined.read(6, color=True), second.read(1, color=True)
    assert (frame.index, frame.name) == (6, f"tiny-2/{frame_name(6)}")
    assert np.array_equal(frame.depth_m, inner.depth_m) and same(frame.color, inner.color)
    assert np.array_equal(joined.segmentation(4).ids, first.segmentation(4).ids)
    for index in (-1, FRAMES):
        with pytest.raises(InputError, match=f"expected a frame index from 0 to {FRAMES - 1}, found {index}"):
            joined.read(index)


@pytest.mark.parametrize("parts", [1, 2])
def test_a_worker_opens_them_again(halves, tmp_path, parts):
    joined = JoinedFrames([open_sequence(path) for path in halves[:parts]])
    again = reopening(joined, tmp_path)()
    assert again.frame_names == joined.frame_names and again.labels == joined.labels
    assert np.array_equal(again.poses, joined.poses)


def test_the_command_takes_several(halves, tmp_path, capsys):
    output = tmp_path / "m.npz"
    (tmp_path / "b" / "depth" / f"{frame_name(6)}.png").write_bytes(b"")
    build = ["build", *map(str, halves), "-o", str(output)]
    assert main([*build, "--strict"]) == 2
    assert main(build) == 0
    simap = load_map(output)
    assert simap.provenance["skipped"] == {"frames": 1, "names": [f"tiny-2/{frame_name(6)}"]}
    assert simap.grid.observations.max() == FRAMES - 1
    assert main(["info", str(output)]) == 0


def test_none_at_all_is_one_line(tmp_path, capsys):
    try:
        status = main(["build", "-o", str(tmp_path / "m.npz")])
    except SystemExit as stopped:
        status = stopped.code
    assert status == 2


def test_names_that_cannot_stand_before_a_frame_are_made_plain(tmp_path):
    paths = [
        part(tmp_path / f"{i}", i, i + 1, name=name) for i, name in enumerate(("west wing/2", "hall", "hall", "x"))
    ]
    joined = JoinedFrames([open_sequence(path) for path in paths])
    assert [name.split("/")[0] for name in joined.frame_names] == ["west-wing-2", "hall", "hall-2", "x"]
    assert joined.name == "west-wing-2 and 3 more"


def test_classes_are_those_of_all(halves, tmp_path):
    table = tmp_path / "b" / "segments.json"
    table.write_text(table.read_text().replace('"chair"', '"armchair"'))
    one, other = (open_sequence(path) for path in halves)
    joined = JoinedFrames([one, other])
    assert joined.labels == ("none", "armchair", "chair", "floor")
    assert joined.is_thing == (False, True, True, False)


def like(sequence, **changes):
    known = ("name", "path", "frame_names", "poses", "T_map_world", "labels", "is_thing", "segmentation_source")
    return SimpleNamespace(**{k: getattr(sequence, k) for k in (*known, "simulated")} | changes)


def test_what_cannot_be_of_one_world_frame_is_refused(halves):
    one, other = (open_sequence(path) for path in halves)
    turn = np.eye(4)
    turn[:3, :3] = [[1, 0, 0], [0, 0.98, -0.199], [0, 0.199, 0.98]]
    low = np.eye(4)
    low[2, 3] = -2.8
    floor = one.labels.index("floor")
    kinds = tuple(thing or i == floor for i, thing in enumerate(other.is_thing))
    for changes, message in [
        ({"T_map_world": turn}, "expected the world frame of .*sequence.json, found another up, 11.5 degrees off"),
        ({"T_map_world": low}, "found a floor 2.80 m off; a map has one floor"),
        ({"is_thing": kinds}, "class floor: expected stuff as in the sequences before it, found a thing"),
    ]:
        with pytest.raises(InputError, match=message):
            JoinedFrames([one, like(other, **changes)])  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="expected at least one, found none"):
        JoinedFrames([])
