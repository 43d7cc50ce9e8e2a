"""The other embedded places: furnished, sound to walk through, and different from one another."""

import itertools
import json
from collections import Counter
from functools import cache
from typing import get_args

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from simaps_viz.cli.demo import PlaceName
from simaps_viz.errors import InputError
from simaps_viz.scenes import furniture, places
from simaps_viz.scenes import materials as m
from simaps_viz.scenes.demo import DemoSettings, ensure_demo, settings_of
from simaps_viz.scenes.places import PLACES, Place, place_of
from simaps_viz.scenes.render import Renderer, embree_scene
from simaps_viz.scenes.scene import SceneObject, place
from simaps_viz.scenes.walk import camera_pose
from simaps_viz.structures import Intrinsics

NEW = [name for name in PLACES if name != "cafe"]
TINY = DemoSettings(frames=4, width=96, height=72)
HANGING = {"picture", "clock", "lamp", "board"}


def joined(one: SceneObject) -> trimesh.Trimesh:
    mesh = trimesh.util.concatenate([part.mesh for part in one.parts])
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


@cache
def sampled(name: str, thing: str, count: int) -> np.ndarray:
    """Points on an object, drawn a little together so that what only touches is apart."""
    one = next(o for o in PLACES[name].scene().objects if o.name == thing)
    points = trimesh.sample.sample_surface(joined(one), count, seed=0)[0]
    middle = points.mean(axis=0)
    return middle + 0.98 * (points - middle)


@pytest.mark.slow
@pytest.mark.parametrize("name", NEW)
def test_a_place_has_many_objects_in_several_rooms(name):
    scene = PLACES[name].scene()
    things = [o for o in scene.objects if o.is_thing]
    middles = np.array([o.bounds_m.mean(axis=0)[:2] for o in things])
    in_room = [((middles > room[:2]) & (middles < room[2:])).all(axis=1).sum() for room in scene.rooms_m]
    assert len(things) >= 40 and len(in_room) >= 3 and min(in_room) >= 5 and sum(in_room) == len(things)
    assert Counter(o.label for o in things)["chair"] >= 6
    assert len({o.label for o in things}) >= 20


@pytest.mark.slow
@pytest.mark.parametrize("name", NEW)
def test_no_object_stands_in_another(name):
    objects = [o for o in PLACES[name].scene().objects if o.label not in ("ceiling", "rug-merged", "window-other")]
    bounds = np.array([o.bounds_m for o in objects])
    size = np.ptp(bounds, axis=1).prod(axis=1)
    for (a, one), (b, other) in itertools.permutations(enumerate(objects), 2):
        overlap = np.minimum(bounds[a, 1], bounds[b, 1]) - np.maximum(bounds[a, 0], bounds[b, 0])
        if not one.is_thing or size[a] > size[b] or (overlap < 0.012).any():
            continue
        points = sampled(name, one.name, 200)
        inside = np.zeros(len(points), dtype=bool)
        for mesh in (part.mesh for part in other.parts if part.mesh.is_watertight):
            near = ((points > mesh.bounds[0]) & (points < mesh.bounds[1])).all(axis=1)
            inside[near] |= mesh.contains(points[near])
        assert inside.mean() < 0.06, (one.name, other.name, inside.mean())


@pytest.mark.slow
@pytest.mark.parametrize("name", NEW)
def test_what_does_not_hang_stands_on_something(name):
    scene = PLACES[name].scene()
    down = np.array([[0, 0, -1]], dtype=np.float32)
    west_south, east_north = scene.triangles_m[..., :2].min(axis=1), scene.triangles_m[..., :2].max(axis=1)
    for number, one in enumerate(scene.objects, start=1):
        low = one.bounds_m[0, 2]
        if one.is_thing and one.label not in HANGING and low > 0.01:
            over = ((west_south <= one.bounds_m[1, :2]) & (east_north >= one.bounds_m[0, :2])).all(axis=1)
            tree = embree_scene(scene.triangles_m[over & (scene.instance != number)])
            lowest = joined(one).vertices
            lowest = lowest[lowest[:, 2] < low + 0.01] + [0, 0, 0.02]
            starts = np.concatenate([lowest[:: max(1, len(lowest) // 8)], lowest.mean(axis=0)[None]]).astype(np.float32)
            below = tree.run(starts, np.tile(down, (len(starts), 1)), query="DISTANCE")
            assert abs(float(below.min()) - 0.02) < 0.03, (one.name, below)


@pytest.mark.slow
@pytest.mark.parametrize("name", NEW)
def test_the_walk_touches_nothing_enters_all_rooms_and_sees_nearly_everything(name):
    place, walk = PLACES[name], PLACES[name].walk(1200)
    scene, positions = place.scene(), walk.T_world_camera[:, :3, 3]
    points = []
    for one in (o for o in scene.objects if o.label not in ("floor", "ceiling", "rug-merged")):
        points.append(trimesh.sample.sample_surface(joined(one), int(joined(one).area * 800) + 100, seed=0)[0])
    solid = np.concatenate(points)
    solid = solid[(solid[:, 2] > 0.05) & (solid[:, 2] < 1.6), :2]
    assert KDTree(solid).query(positions[:, :2])[0].min() > 0.2
    for room in scene.rooms_m:
        assert ((positions[:, :2] > room[:2]) & (positions[:, :2] < room[2:])).all(axis=1).sum() > 15, room
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    forward = walk.T_world_camera[:, :3, 2]
    turns = np.arccos(np.clip(np.einsum("ni,ni->n", forward[1:], forward[:-1]), -1, 1))
    assert steps.max() < 0.3 and np.rad2deg(turns).max() < 22
    renderer = Renderer(scene, Intrinsics(80, 60, 55.0, 55.0, 39.5, 29.5))
    seen = Counter()
    for T in walk.T_world_camera[::4]:
        ids, counts = np.unique(renderer.cast(T).instance, return_counts=True)
        seen.update(ids[counts >= 4].tolist())
    things = [number for number, o in enumerate(scene.objects, start=1) if o.is_thing]
    often = sum(seen[number] >= 3 for number in things)
    unseen = [scene.objects[number - 1].name for number in things if seen[number] < 3]
    assert often >= 0.93 * len(things), unseen


@pytest.mark.slow
def test_no_piece_of_seating_or_table_is_the_same_in_two_places():
    kinds = ("chair", "couch", "dining table", "desk", "bench", "bed", "stool")
    sizes = {
        name: {
            (o.label, *np.round(np.ptp(np.concatenate([_own_frame(o, p.mesh.vertices) for p in o.parts]), axis=0), 2))
            for o in place.scene().objects
            if o.label in kinds
        }
        for name, place in PLACES.items()
    }
    for one, other in itertools.combinations(sizes, 2):
        assert not sizes[one] & sizes[other], (one, other)


def _own_frame(one: SceneObject, points: np.ndarray) -> np.ndarray:
    T = one.T_world_object
    return (points - T[:3, 3]) @ T[:3, :3]


def test_a_place_is_what_its_file_tells(tmp_path, monkeypatch):
    told = {
        "title": "A closet",
        "frames": 3,
        "width": 80,
        "floors": [["floor west", [0, 0, 2, 3], "#806040 planks"], ["floor east", [2, 0, 5, 3], "BIRCH"]],
        "walls": [["wall north", [0, 3], [5, 3], "#ffffff", "OAK", [[1, 2], [3, 4, 0.9, 2.0]]]],
        "rooms": [[0, 0, 2, None], [None, 0, 5, 3]],
        "lights": [[1, 1, 2.5]],
        "things": [
            ["seat", "chair", ["resized", ["office_chair", "NAVY"], 2, 1, 1], 1, 2, 0.5, 90],
            ["fruit", "bowl", ["bowl", "CERAMIC", ["#d98f2b", "#a3b34b"]], 3, 1, 0, 0],
        ],
        "stations": [[1, 1, 2, 2], [2, 1, 3, 3]],
    }
    (tmp_path / "closet.json").write_text(json.dumps(told), encoding="utf-8")
    monkeypatch.setattr(places, "_FOLDER", tmp_path)
    closet = places._place("closet")
    assert (closet.title, closet.frames, closet.width) == ("A closet", 3, 80)
    assert list(closet.stations()) == [(1, 1, 2, 2), (2, 1, 3, 3)]
    scene = closet.scene()
    objects = {one.name: one for one in scene.objects}
    assert list(objects) == [
        "floor west", "floor east", "ceiling", "wall north", "window north 1", "seat", "fruit"
    ]  # fmt: skip
    np.testing.assert_allclose(objects["ceiling"].bounds_m[:, :2], [[0, 0], [5, 3]])
    assert objects["floor west"].parts[0].material == m.paint("806040", m.Texture.PLANKS)
    assert objects["floor east"].parts[0].material == m.BIRCH
    chair = place("seat", "chair", furniture.resized(furniture.office_chair(m.NAVY), 2, 1, 1), 1, 2, 0.5, yaw_deg=90)
    np.testing.assert_array_equal(objects["seat"].bounds_m, chair.bounds_m)
    assert len(objects["fruit"].parts) == len(furniture.bowl(m.CERAMIC, (m.OAK, m.OAK)))
    assert scene.rooms_m == ((0, 0, 2, np.inf), (-np.inf, 0, 5, 3)) and scene.lights_m == ((1, 1, 2.5),)
    # the doorway is open to the floor, the window from its sill on, and the wall beside them is whole
    shown = [Renderer(scene, Intrinsics(3, 3, 30.0, 30.0, 1.0, 1.0)).cast(_northwards(x, z)) for x, z in LOOKS]
    assert [list(objects)[one.instance[1, 1] - 1] if one.instance[1, 1] else None for one in shown] == [
        None, "window north 1", "wall north", "wall north"
    ]  # fmt: skip


LOOKS = ((1.5, 0.4), (3.35, 1.4), (3.5, 0.4), (0.5, 1.4))


def _northwards(x: float, z: float) -> np.ndarray:
    return camera_pose(np.array([x, 2.0, z]), np.pi / 2, 0.0)


def test_names_of_places_are_those_of_the_command():
    assert get_args(PlaceName) == tuple(PLACES)
    assert all(place.name == name for name, place in PLACES.items())
    assert sum(place.frames for place in PLACES.values()) == 5000
    with pytest.raises(InputError, match="place: expected one of cafe, home, office, canteen, shop, found 'moon'"):
        place_of("moon")


def test_frames_depend_on_their_own_place_and_the_programs_alone(tmp_path, monkeypatch):
    assert settings_of(PLACES["cafe"]) == DemoSettings()
    names = {path.name for path in PLACES["cafe"].sources()}
    assert {"cafe.json", "furniture.py", "render.py", "simulated_errors.py", "demo.py"} <= names
    assert "home.json" not in names
    folder = tmp_path / "scenes"
    folder.mkdir()
    for path in places._FOLDER.glob("*.*"):
        (folder / path.name).write_bytes(path.read_bytes())
    monkeypatch.setattr(places, "_FOLDER", folder)
    before = {name: DemoSettings().key(place) for name, place in PLACES.items()}
    (folder / "home.json").write_text("{}")
    (folder / "moon.json").write_text("{}")
    after = {name: DemoSettings().key(place) for name, place in PLACES.items()}
    assert {name for name in PLACES if before[name] != after[name]} == {"home"}
    (folder / "furniture.py").write_text("# other chairs")
    assert all(DemoSettings().key(place) != after[name] for name, place in PLACES.items())


@pytest.mark.slow
def test_a_place_is_rendered_under_its_own_name(tmp_path, monkeypatch):
    small = Place("shop", "A shop", PLACES["shop"].scene, PLACES["shop"].stations, frames=3)
    monkeypatch.setitem(PLACES, "shop", small)
    manifest = ensure_demo("shop", cache_dir=tmp_path, settings=TINY)
    assert manifest.parent.name == f"shop-{TINY.key(small)}"
    text = manifest.read_text(encoding="utf-8")
    assert '"name": "shop, light errors"' in text and '"description": "A shop, ray cast' in text
