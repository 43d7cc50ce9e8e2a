"""GeoJSON and CSV, opened with shapely and pandas."""

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from toy_maps import map_from_drawing, toy_map

from simaps_viz import export_map, to_pandas
from simaps_viz.exports.records import outlines


def covered(polygon, shape):
    """Cells whose centre lies in a polygon, bool [rows, cols]."""
    row, col = np.mgrid[: shape[0], : shape[1]] + 0.5
    return shapely.contains_xy(polygon, col, row)


@settings(deadline=None, max_examples=50)
@given(arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9))))
def test_outlines_are_valid_and_cover_exactly_the_cells(mask):
    polygons = [shapely.Polygon(rings[0], rings[1:]) for rings in outlines(mask)]
    for polygon in polygons:
        assert polygon.is_valid, shapely.is_valid_reason(polygon)
        assert shapely.LinearRing(polygon.exterior).is_ccw and not any(r.is_ccw for r in polygon.interiors)
    together = shapely.MultiPolygon(polygons)
    assert together.is_valid, shapely.is_valid_reason(together)
    assert together.area == mask.sum()
    np.testing.assert_array_equal(covered(together, mask.shape), mask)


def test_only_corners_are_kept_and_holes_and_touching_corners_stay_apart():
    ring = np.ones((3, 3), bool)
    ring[1, 1] = False
    ((outer, hole),) = outlines(ring)
    assert sorted(outer) == [(0, 0), (0, 3), (3, 0), (3, 3)] and sorted(hole) == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert len(outlines(np.eye(3, dtype=bool))) == 3
    assert outlines(np.zeros((2, 2), bool)) == []


@pytest.fixture
def collection(tmp_path):
    (path,) = export_map(toy_map(), tmp_path / "toy.geojson")
    return json.loads(path.read_text())


def test_geojson_features_are_the_instances_in_metres(collection):
    simap = toy_map()
    cell = simap.spec.cell_size_m**2
    features = [feature for feature in collection["features"] if feature["properties"]["label"] != "room"]
    assert collection["type"] == "FeatureCollection" and len(features) == len(simap.instances)
    row, col = np.mgrid[: simap.spec.rows, : simap.spec.cols]
    x, y = simap.spec.centre_of(row, col)  # pyright: ignore[reportArgumentType]
    for feature in features:
        one = simap.by_id(feature["id"])
        shape = shapely.geometry.shape(feature["geometry"])
        assert shape.is_valid and shape.area == pytest.approx(one.cells * cell, abs=cell / 1000)
        np.testing.assert_array_equal(shapely.contains_xy(shape, x, y), simap.instance == one.id)
        (x_low, y_low, _), (x_high, y_high, _) = one.aabb_m
        assert shape.bounds == pytest.approx((x_low, y_low, x_high, y_high))
        assert feature["properties"]["name"] == f"{one.label}-{one.id}"
        assert feature["properties"]["area_m2"] == pytest.approx(one.cells * cell)


def test_geojson_has_the_rooms_after_the_instances(collection):
    simap = toy_map()
    row, col = np.mgrid[: simap.spec.rows, : simap.spec.cols]
    x, y = simap.spec.centre_of(row, col)  # pyright: ignore[reportArgumentType]
    for room, feature in zip(simap.rooms, collection["features"][len(simap.instances) :], strict=True):
        shape, facts = shapely.geometry.shape(feature["geometry"]), feature["properties"]
        np.testing.assert_array_equal(shapely.contains_xy(shape, x, y), simap.room_cells == room.id)
        assert (feature["id"], facts["label"], facts["name"]) == (f"room-{room.id}", "room", room.name)
        assert facts["objects"] == list(room.objects)


def test_geojson_says_that_its_coordinates_are_local_metres(collection):
    assert (
        collection["coordinates_are"]["unit"] == "metre" and "no geographic" in collection["coordinates_are"]["frame"]
    )
    assert np.array(collection["coordinates_are"]["T_map_world"]).shape == (4, 4)
    assert "crs" not in collection and collection["map"]["simulated"] is True


def test_an_instance_at_the_edge_of_the_grid_and_one_with_a_hole(tmp_path):
    simap = map_from_drawing("AAA\nAAA\nAAA", {"A": "couch"})
    simap.instance[4:8, 4:8] = 0
    feature = json.loads(export_map(simap, tmp_path / "a.geojson")[0].read_text())["features"][0]
    shape = shapely.geometry.shape(feature["geometry"])
    assert isinstance(shape, shapely.Polygon) and len(shape.interiors) == 1
    assert shape.bounds == pytest.approx((0, 0, 0.6, 0.6))
    assert shape.area == pytest.approx((simap.instance > 0).sum() * 0.05**2)


def test_csv_opens_in_pandas_with_its_outlines(tmp_path):
    simap = toy_map()
    frame = pd.read_csv(export_map(simap, tmp_path / "toy.csv")[0])
    assert frame["id"].tolist() == [one.id for one in simap.instances]
    assert frame["label"].tolist() == [one.label for one in simap.instances]
    for row in frame.to_dict("records"):
        one = simap.by_id(row["id"])
        assert (row["x_m"], row["y_m"], row["z_m"]) == pytest.approx(one.centroid_m, abs=1e-6)
        assert shapely.area(shapely.from_wkt(row["outline_wkt"])) == pytest.approx(row["area_m2"])
    assert frame["color"].str.fullmatch("#[0-9a-f]{6}").all()


def test_a_spreadsheet_computes_nothing(tmp_path):
    simap = named(toy_map(), {"chair": "=cmd|' /C calc'!A0", "couch": 'a "soft", couch', "potted plant": "-2+3"})
    frame = pd.read_csv(export_map(simap, tmp_path / "toy.csv")[0])
    assert not [text for text in (*frame["name"], *frame["label"]) if text[0] in "=+-@"]
    assert frame["label"].str.removeprefix("'").tolist() == [one.label for one in simap.instances]
    assert frame["x_m"].tolist() == pytest.approx([one.centroid_m[0] for one in simap.instances], abs=1e-6)


def test_the_pandas_frame_is_the_csv_without_outlines(tmp_path):
    simap = toy_map()
    text = export_map(simap, tmp_path / "toy.csv")[0].read_text()
    read = pd.read_csv(io.StringIO(text)).drop(columns="outline_wkt").set_index("id")
    pd.testing.assert_frame_equal(to_pandas(simap), read, check_dtype=False)


def named(simap, names):
    """Return a map with other names for some classes."""
    labels = tuple(names.get(label, label) for label in simap.grid.labels)
    instances = tuple(replace(one, label=names.get(one.label, one.label)) for one in simap.instances)
    return replace(simap, grid=replace(simap.grid, labels=labels), instances=instances)


def test_a_frame_without_rows_still_holds_numbers():
    frame = to_pandas(map_from_drawing("..\n.."))
    assert (str(frame["area_m2"].dtype), str(frame.index.dtype)) == ("float64", "int64")
    assert frame["area_m2"].tolist() == []


def test_a_map_without_instances(tmp_path):
    bare = map_from_drawing("..\n..")
    (room,) = json.loads(export_map(bare, tmp_path / "b.geojson")[0].read_text())["features"]
    assert room["properties"]["objects"] == []
    assert len(pd.read_csv(export_map(bare, tmp_path / "b.csv")[0])) == 0 == len(to_pandas(bare))
