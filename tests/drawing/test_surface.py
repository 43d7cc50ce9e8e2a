"""The surface as points: colours, layers, rays, stacks and the photo from above, on the toy map with voxels."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from toy_maps import toy_map
from toy_surfaces import BROWN, GREEN, GREY, PLANT, RED, toy_with_surface

from simaps_viz.colors.instances import instance_colors
from simaps_viz.drawing import surface
from simaps_viz.drawing.legend import facts_html, not_counted, object_names
from simaps_viz.drawing.surface import (
    DIMMED,
    LAYER_M,
    WALL_CUT_M,
    instance_near,
    is_shown,
    layers,
    place_of,
    point_colors,
    ray_on_points,
    stack_at,
)
from simaps_viz.drawing.texture import TINT, cell_colors, color_modes, map_image, photo
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.mapping.in_space import box_in


@pytest.fixture(scope="module")
def simap():
    return toy_with_surface()


def table_of(simap):
    return simap.of_class("dining table")[0]


def test_the_plant_under_the_table_is_an_object_of_its_own(simap):
    plant, table = simap.by_id(PLANT), table_of(simap)
    assert plant.under == {table.id: 1.0} and plant.on == {} and table.on == {}
    assert plant.box.size_m == pytest.approx((0.15, 0.15, 0.35), abs=0.02)
    assert box_in(simap, PLANT) == plant.box and box_in(toy_map(), 1) is None
    assert plant.name == f"potted plant {PLANT}" and object_names(simap)[plant.name] == PLANT
    words = facts_html(simap, plant)
    assert (
        "dining table 6" in words
        and "below others, and seen too little; of this class there are 1" in words
        and "Under" in words
        and "from 0.0" in words
    )


def test_what_is_hidden_and_no_object_of_its_own_says_why_it_does_not_count(simap):
    plant, other = simap.by_id(PLANT), simap.of_class("potted plant")[0]
    whys = []
    for facts in ({}, {"frames": 50}, {"frames": 50, "cells": 0}, {"frames": 50, "aabb_m": other.aabb_m}):
        one = replace(plant, **facts)
        changed = replace(simap, hidden=(one,))
        whys.append(changed.left_out.get(PLANT, ""))
        assert (one in changed.objects) == (not whys[-1]) and whys[-1] in facts_html(changed, one)
        names = object_names(changed, uncounted=not_counted(changed, ()))
        assert f"{one.name}{', not counted' * bool(whys[-1])}" in names
    few, counted, small, part = whys
    assert (few, counted, part) == ("below others, and seen too little", "", f"may be a part of {other.name}")
    assert small == "far smaller than others of its class"


def test_points_have_the_colours_they_were_seen_in(simap):
    points = simap.points()
    for number, color in ((PLANT, GREEN), (table_of(simap).id, BROWN), (simap.of_class("couch")[0].id, RED)):
        mine = point_colors(simap, points, "photo")[points.instances == number]
        assert np.abs(mine.astype(int) - color).max() <= 16 and len(mine)
    lit = point_colors(simap, points, "photo", lit={PLANT})
    kept = points.instances == PLANT
    assert (lit[kept] == points.colors[kept]).all()
    pale = points.colors[~kept] * DIMMED + np.array(LIGHT.unseen) * (1 - DIMMED)
    assert np.abs(lit[~kept] - pale).max() <= 1


def test_points_of_an_object_have_its_colour_by_instance_and_differ_by_height(simap):
    points = simap.points()
    colors = point_colors(simap, points, "instance").astype(float)
    for one in simap.instances:
        shades = colors[points.instances == one.id]
        wanted = instance_colors(simap)[one.id].astype(float)
        full = shades[shades.max(axis=1) < 255]  # brighter ones are cut off
        assert np.abs(full / full.sum(1, keepdims=True) - wanted / wanted.sum()).max() < 0.03
    height = point_colors(simap, points, "height")
    assert len(np.unique(height[np.isclose(points.positions[:, 2], 0.025)], axis=0)) == 1
    assert len(np.unique(height, axis=0)) >= 20


def test_a_cut_leaves_out_what_is_above_and_walls_are_low(simap):
    points = simap.points()
    made = layers(simap, points)
    assert np.array_equal(np.sort(np.concatenate([part for _, _, part in made])), np.arange(len(points.positions)))
    for cut, whole in ((0.4, False), (2.5, False), (2.5, True)):
        shown = np.concatenate([part for low, building, part in made if is_shown(low, building, cut, whole)])
        top, wall = points.positions[shown, 2], points.classes[shown] == simap.grid.labels.index("wall")
        assert top[~wall].max() < cut and top[~wall].max() > min(cut, 1.1) - LAYER_M
        assert top[wall].max() == pytest.approx(min(cut, 2.025 if whole else WALL_CUT_M), abs=LAYER_M)


def test_a_ray_meets_the_first_point_also_under_the_table(simap):
    points = simap.points()
    plant, table = simap.by_id(PLANT), table_of(simap)
    x, y, _ = plant.box.center_m
    from_above = ray_on_points(points.positions, (x, y, 3.0), (0, 0, -2.0))
    assert points.instances[from_above] == table.id
    low = ray_on_points(points.positions, (x - 0.6, y, 0.3), (1.0, 0.0, 0.0))
    assert points.instances[low] == PLANT
    assert ray_on_points(points.positions, (x, y, 3.0), (0, 0, 1.0)) is None
    assert ray_on_points(points.positions[:0], (x, y, 3.0), (0, 0, -1.0)) is None


def test_a_place_lists_what_is_there_from_top_to_floor(simap, monkeypatch):
    table = table_of(simap)
    place = place_of(simap, PLANT)
    assert place is not None
    x, y, z = place
    stack = stack_at(simap, x, y)
    assert list(stack) == [table.id, PLANT] and list(stack.values()) == pytest.approx([0.775, 0.425])
    assert instance_near(simap, (x, y, z)) == PLANT and instance_near(simap, (x, y, 0.76)) == table.id
    assert instance_near(simap, (x, y, 0.0)) is None  # floor
    assert stack_at(toy_map(), x, y) == {} and stack_at(simap, 1.0, 0.5) == {}
    points = simap.points()
    swapped = np.select([points.instances == PLANT, points.instances == table.id], [table.id, PLANT], points.instances)
    monkeypatch.setattr(surface, "space_points", lambda _: replace(points, instances=swapped))
    stack = stack_at(simap, x, y)  # whatever was seen as higher: the map shows the table, and a click selects it
    assert list(stack) == [table.id, PLANT] and list(stack.values()) == pytest.approx([0.425, 0.775])
    # One point of the plant that a mask has put on the table's far end does not make it stand there.
    ends = points.positions[points.instances == table.id]
    far = ends[np.abs(ends[:, :2] - (x, y)).sum(axis=1).argmax()] + (0.0, 0.0, 0.1)
    strewn = np.append(points.positions, [far.astype(np.float32)], axis=0), np.append(points.instances, [PLANT])
    monkeypatch.setattr(surface, "space_points", lambda _: SimpleNamespace(positions=strewn[0], instances=strewn[1]))
    assert list(stack_at(simap, *far[:2].tolist())) == [table.id]
    monkeypatch.undo()
    assert place_of(simap, 12345) is None


def test_the_photo_shows_the_top_of_each_cell_and_outlines_objects(simap):
    image, table = photo(simap), table_of(simap)
    assert np.abs(image[simap.instance == table.id].astype(int) - BROWN).max() <= 16
    floor = simap.grid.label == simap.grid.labels.index("floor")
    assert np.abs(image[floor].astype(int) - GREY).max() <= 16
    assert (image[np.isnan(simap.grid.height_m)] == LIGHT.unseen).all()
    assert "photo" in color_modes(simap) and "photo" not in color_modes(toy_map())
    large, rims = map_image(simap, "photo", scale=4), cell_colors(simap, "instance")
    rows, cols = np.nonzero(simap.instance == table.id)
    corner = large[rows.min() * 4, cols.min() * 4]
    assert (corner == rims[rows.min(), cols.min()]).all()
    at = rows.min(), cols.min()
    inner = image[at] * (1 - TINT) + rims[at] * TINT
    assert np.abs(large[at[0] * 4 + 2, at[1] * 4 + 2] - inner).max() <= 1
    unlit = floor & (simap.instance == 0)
    assert (map_image(simap, "photo", scale=1)[unlit] == image[unlit]).all()
