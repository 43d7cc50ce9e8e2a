"""A building: a map for each floor of a simulated house, the file that holds them, and the commands that read it."""

import json

import numpy as np
import pytest
from sequences import write_tiny_sequence
from two_storeys import BED, CHAIRS_ABOVE, CHAIRS_BELOW, STOREY_M, TABLE, turned_sequence, write_two_storeys

from simaps_viz import Pose2, load_map, open_sequence
from simaps_viz.app.masks import segmentation_services
from simaps_viz.app.workbench import sequence_of, services_of
from simaps_viz.build.pipeline import BuildConfig, cache_folder
from simaps_viz.build.to_file import BuildRequest, build_building, build_to_file
from simaps_viz.cli.main import main
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError
from simaps_viz.evaluation.truth import exact_of, truth_as_map, truth_of
from simaps_viz.geometry import transform_points
from simaps_viz.mapping.building import load_building, map_of, save_building
from simaps_viz.navigation.agent import answer


def build(sequence, output, **others):
    with stage_progress(quiet=True) as progress:
        request = BuildRequest("evidence", BuildConfig(), output, **others)
        return build_building(sequence, request, progress)


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    """Return a recording of the house, which goes up and down again."""
    return write_two_storeys(tmp_path_factory.mktemp("scan") / "house", back=True)


@pytest.fixture(scope="module")
def built(scanned, tmp_path_factory):
    path = tmp_path_factory.mktemp("built") / "house.json"
    assert main(["build", str(scanned), "-o", str(path)]) == 0
    return path


def places(simap, label):
    return sorted(one.centroid_m[:2] for one in simap.instances if one.label == label)


def test_each_floor_has_a_map_of_what_stands_on_it(built):
    house = load_building(built)
    assert [f.height_m for f in house.floors] == pytest.approx([0.0, STOREY_M], abs=0.01)
    assert [f.map.name for f in house.floors] == ["house-floor-1.npz", "house-floor-2.npz"]
    below, above = (load_map(f.map) for f in house.floors)
    assert {label: n for label, n in below.counts().items() if label != "stairs"} == {"chair": 2, "dining table": 1}
    assert {label: n for label, n in above.counts().items() if label != "stairs"} == {"bed": 1, "chair": 1}
    # x and y are those of the house on both floors; heights are over the floor of each.
    assert places(below, "chair") == pytest.approx(np.array(sorted(CHAIRS_BELOW)), abs=0.1)
    assert places(below, "dining table") == pytest.approx(np.array([TABLE]), abs=0.1)
    assert places(above, "chair") == pytest.approx(np.array(CHAIRS_ABOVE), abs=0.1)
    assert places(above, "bed") == pytest.approx(np.array([BED]), abs=0.1)
    bed = next(one for one in above.instances if one.label == "bed")
    low, high = np.reshape(bed.aabb_m, (2, 3))[:, 2]
    assert -0.05 < low < high < 1.2
    # Nothing of a floor is on the map of the other: the ceiling below is not floor above.
    for simap in (below, above):
        seen = simap.grid.height_m[simap.grid.observations > 0]
        assert np.quantile(seen, 0.02) > -0.06
    ((lower, foot, head),) = [(s.lower, s.foot_m, s.head_m) for s in house.stairs]
    assert lower == 1 and 1.3 < foot[0] < 2.0 and 6.0 < head[0] < 6.8


def test_one_drives_from_the_head_of_the_stairs_to_the_bed(built):
    house = load_building(built)
    above = load_map(house.floors[1].map)
    result = answer(above, "go to the bed", Pose2(*house.stairs[0].head_m, 0.0))
    assert result.status == "ok" and np.hypot(*(result.path_m[-1] - BED)) < 2.0


def test_info_lists_floors_and_stairs(built, capsys):
    capsys.readouterr()
    assert main(["info", str(built), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [floor["number"] for floor in facts["floors"]] == [1, 2]
    assert facts["floors"][1]["counts"]["bed"] == 1 and facts["floors"][1]["height_m"] == pytest.approx(3.0, abs=0.01)
    assert facts["stairs"] == [{"lower": 1, **json.loads(built.read_text())["stairs"][0]}]
    assert 30.0 < facts["floors"][0]["seen_m2"] < 50.0
    assert main(["info", str(built)]) == 0
    shown = capsys.readouterr().out
    assert "floor 1 to 2" in shown and "1 bed" in shown


def test_a_floor_is_named_by_its_number(built):
    assert map_of(built, None) == map_of(built, 1) == built.with_name("house-floor-1.npz")
    assert map_of(built, 2) == built.with_name("house-floor-2.npz")
    assert map_of(built.with_name("house-floor-2.npz"), None).name == "house-floor-2.npz"
    with pytest.raises(InputError, match="expected a floor from 1 to 2, found 3"):
        map_of(built, 3)
    with pytest.raises(InputError, match="expected a building file"):
        map_of(built.with_name("house-floor-2.npz"), 2)


def test_in_another_world_frame_the_building_is_the_same(scanned, built, tmp_path):
    turn = np.eye(4)
    turn[:3, :3] = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turn[:3, 3] = (3.0, -2.0, 5.0)
    sequence = turned_sequence(scanned, turn)
    house, counts = build(sequence, tmp_path / "turned.json")
    here = load_building(built)
    assert [f.height_m for f in house.floors] == pytest.approx([f.height_m for f in here.floors], abs=0.02)
    assert counts == [load_map(f.map).counts() for f in here.floors]
    T = sequence.T_map_world @ turn
    for end in ("foot_m", "head_m"):
        (there,), (then,) = ([getattr(s, end) for s in one.stairs] for one in (here, house))
        assert transform_points(T, np.array([*there, 0.0]))[:2] == pytest.approx(then, abs=0.05)


def test_a_recording_of_one_floor_makes_the_map_that_it_always_made(tmp_path, capsys):
    scan = write_tiny_sequence(tmp_path / "scan")
    assert main(["build", str(scan), "-o", str(tmp_path / "one.npz"), "--json"]) == 0
    assert "floors" not in capsys.readouterr().out
    assert main(["build", str(scan), "-o", str(tmp_path / "tiny.json"), "--json"]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert [floor["height_m"] for floor in last["floors"]] == [0.0] and last["stairs"] == 0
    assert (tmp_path / "tiny-floor-1.npz").read_bytes() == (tmp_path / "one.npz").read_bytes()
    assert load_building(tmp_path / "tiny.json").stairs == ()


def test_a_map_of_a_recording_of_two_floors_says_so(scanned, tmp_path, capsys):
    assert main(["build", str(scanned), "-o", str(tmp_path / "one.npz"), "--json"]) == 0
    notes = json.loads(capsys.readouterr().out.splitlines()[-1])["notes"]
    assert any("goes over 2 floors" in note for note in notes)


def test_a_killed_build_resumes_where_it_was(scanned, built, tmp_path, monkeypatch):
    path, made = tmp_path / "house.json", []

    def killed(part, request, progress, **options):
        if made:
            raise KeyboardInterrupt
        made.append(request.output.name)
        return build_to_file(part, request, progress, **options)

    sequence = open_sequence(scanned)
    monkeypatch.setattr("simaps_viz.build.to_file.build_to_file", killed)
    with pytest.raises(KeyboardInterrupt):
        build(sequence, path)
    # No building names a floor that is not there.
    assert not path.exists() and sorted(p.name for p in tmp_path.glob("*.npz")) == ["house-floor-1.npz"]

    def count(part, request, progress, **options):
        made.append(request.output.name)
        return build_to_file(part, request, progress, **options)

    monkeypatch.setattr("simaps_viz.build.to_file.build_to_file", count)
    build(sequence, path, resume=True)
    assert made == ["house-floor-1.npz", "house-floor-2.npz"]  # each was built once
    for name in ("house.json", "house-floor-1.npz", "house-floor-2.npz"):
        assert (tmp_path / name).read_bytes() == built.with_name(name).read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["house-floor-1.npz", "house-floor-2.npz", "house.json"]
    # Without --resume, all is built anew.
    build(sequence, path)
    assert made[2:] == ["house-floor-1.npz", "house-floor-2.npz"]


def test_another_file_is_not_replaced_by_a_building(scanned, tmp_path):
    manifest = tmp_path / "sequence.json"
    manifest.write_text('{"format": "posed-frames/1"}')
    with pytest.raises(InputError, match="expected the building file of an earlier build or nothing"):
        build(open_sequence(scanned), manifest)
    assert manifest.read_text() == '{"format": "posed-frames/1"}'


@pytest.mark.parametrize("option", [["--view"], ["--scheduler", "local:2"]])
def test_what_a_building_cannot_be_built_with_is_refused(scanned, tmp_path, capsys, option):
    assert main(["build", str(scanned), "-o", str(tmp_path / "h.json"), *option]) == 2
    assert f"{option[0]}: expected a map's name" in capsys.readouterr().err


def test_the_page_of_a_floor_shows_the_frames_of_that_floor(scanned, built):
    above = load_map(map_of(built, 2))
    sequence = open_sequence(scanned)
    at = sequence.frame_names.index(above.frame_names[4])
    assert at != 4
    view = services_of(above).view
    assert view is not None
    seen = view(4)
    assert seen is not None and np.array_equal(seen[0], sequence.color(at))
    assert np.array_equal(seen[1], sequence.segmentation(at).ids)
    masks = segmentation_services(above, cache_folder())
    assert masks.frame_names == above.frame_names and masks.look is not None
    assert np.array_equal(masks.look(4)[0], sequence.color(at))
    # Other methods and the truth are compared on that floor.
    frames = sequence_of(above)
    assert frames is not None and frames.frame_names == above.frame_names
    assert np.array_equal(frames.T_map_world, above.T_map_world)
    exact = exact_of(frames)
    assert exact is not None
    truth = truth_as_map(truth_of(above, exact))
    assert sorted(one.label for one in truth.instances if one.label != "stairs") == ["bed", "chair"]


GOOD = {
    "format": "simaps-building/1",
    "name": "h",
    "floors": [
        {"number": 1, "map": "a.npz", "height_m": 0.0},
        {"number": 2, "map": "b.npz", "height_m": 3},
    ],
    "stairs": [{"lower": 1, "foot_m": [0, 1], "head_m": [2, 3.5]}],
}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"format": "simaps-building/2"}, "expected format simaps-building/1"),
        ({"name": "a\nb"}, "printable"),
        ({"floors": []}, "1 to 500 floors"),
        ({"floors": None}, "expected a complete"),
        ({"floors": [{"number": 1, "map": "../a.npz", "height_m": 0.0}]}, "in the building's folder"),
        ({"floors": [{"number": 2, "map": "a.npz", "height_m": 0.0}]}, "number of a floor from 1 to 1"),
        ({"floors": [{"number": 1, "map": "a.npz", "height_m": True}]}, "expected metres"),
        ({"floors": [{"number": 1, "map": "a.npz", "height_m": float("nan")}]}, "expected metres"),
        ({"floors": [*GOOD["floors"][:1], {"number": 2, "map": "b.npz", "height_m": 0}]}, "from the lowest up"),
        ({"stairs": [{"lower": 2, "foot_m": [0, 1], "head_m": [2, 3]}]}, "number of a floor from 1 to 1"),
        ({"stairs": [{"lower": 1, "foot_m": [0], "head_m": [2, 3]}]}, "expected a complete"),
    ],
)
def test_a_damaged_building_file_is_refused_in_one_line(tmp_path, change, why):
    path = tmp_path / "h.json"
    path.write_text(json.dumps({**GOOD, **change}))
    with pytest.raises(InputError, match=why) as caught:
        load_building(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_building_file_survives_reading_and_writing(tmp_path):
    path = tmp_path / "h.json"
    path.write_text(json.dumps(GOOD))
    house = load_building(path)
    assert house.stairs[0].head_m == (2.0, 3.5) and house.floors[1].map == tmp_path / "b.npz"
    save_building(house, path)
    assert load_building(path) == house
    path.write_bytes(b'{"format": "simaps-building/1", "name"')
    with pytest.raises(InputError, match="expected a complete simaps-building/1 file"):
        load_building(path)
