"""The map as a picture, as blocks, as a legend; rays of clicks; pictures of frames. No browser."""

from dataclasses import replace

import numpy as np
import pytest
from toy_maps import TOY_SPEC, furnished_map, toy_map

from simaps_viz.colors.classes import class_color, instance_color
from simaps_viz.drawing import frame_pictures, legend, texture
from simaps_viz.drawing.surface import WALL_CUT_M, block_heights, ray_on_blocks, ray_on_floor, solids
from simaps_viz.mapping.simap import repartition
from simaps_viz.structures import Views

CHAIR_1, CHAIR_3, TABLE_6 = 1, 3, 6


@pytest.fixture(scope="module")
def simap():
    return toy_map()


def test_every_cell_has_the_colour_its_legend_says(simap):
    image = texture.map_image(simap)
    assert image.shape == (100, 120, 3) and image.dtype == np.uint8
    for instance in simap.instances:
        assert (image[simap.instance == instance.id] == instance_color(instance.id)).all()
    assert (image[0, 0], image[50, 50], image[5, 5]) == (
        pytest.approx(texture.WALL),
        pytest.approx(texture.FLOOR),
        pytest.approx(texture.UNSEEN),
    )


def test_south_is_row_zero(simap):
    image = texture.map_image(simap)
    row, col = TOY_SPEC.cell_of(*simap.by_id(CHAIR_3).centroid_m[:2])
    assert row < 50 and tuple(image[row, col]) == instance_color(CHAIR_3)


def test_class_mode_paints_classes(simap):
    image = texture.map_image(simap, "class")
    assert (image[simap.instance == CHAIR_1] == class_color("chair")).all()
    assert (image[simap.instance == TABLE_6] == class_color("dining table")).all()


@pytest.mark.parametrize("mode", ["height", "observations"])
def test_ramps_leave_the_unseen_blank_and_grow(simap, mode):
    image = texture.map_image(simap, mode).astype(int)
    assert tuple(image[5, 5]) == texture.UNSEEN
    if mode == "height":  # viridis gets lighter with height
        assert image[50, 50].sum() < image[simap.instance == CHAIR_1][0].sum() < image[0, 0].sum()


def test_lit_instances_keep_their_colour_and_all_else_fades(simap):
    plain, lit = texture.map_image(simap), texture.map_image(simap, lit={CHAIR_1})
    mine = simap.instance == CHAIR_1
    assert (lit[mine] == plain[mine]).all()
    assert (lit[~mine].astype(int).sum(axis=1) > plain[~mine].astype(int).sum(axis=1) - 1).all()
    assert (lit[simap.instance == TABLE_6] != plain[simap.instance == TABLE_6]).any()


def test_hidden_communities_look_like_floor(simap):
    image = texture.map_image(simap, hidden=[7])
    assert (image[simap.community == 7] == texture.FLOOR).all()
    assert (image[simap.community == 6] == instance_color(TABLE_6)).all()


def test_enlarging_keeps_the_middle_of_cells_and_rims_objects(simap):
    large = texture.map_image(simap, scale=5)
    assert (large[2::5, 2::5] == texture.map_image(simap)).all()
    row, col = np.argwhere(simap.instance == CHAIR_1)[0]  # south-west corner of the chair
    assert large[row * 5, col * 5].sum() < sum(instance_color(CHAIR_1))


def test_outline_is_the_perimeter(simap):
    segments = texture.outline_segments(simap, CHAIR_1)
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    assert lengths == pytest.approx(4 * [8 * 0.05])  # cells of one side are one line
    (x0, y0, _), (x1, y1, _) = simap.by_id(CHAIR_1).aabb_m
    assert segments[..., :2].min(axis=(0, 1)) == pytest.approx((x0, y0))
    assert segments[..., :2].max(axis=(0, 1)) == pytest.approx((x1, y1))
    assert len(texture.outline_segments(simap, 99)) == 0


def _volume(solid):
    a, b, c = (solid.vertices[solid.faces[:, i]].astype(float) for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def test_blocks_hold_the_furniture_and_face_outwards(simap):
    colors = texture.cell_colors(simap, "instance")
    # Signed volume by the divergence theorem; bottoms lie in z = 0 and add nothing. Wrong windings would cancel.
    total = sum(_volume(solid) for solid in solids(simap, colors))
    assert total == pytest.approx(float(block_heights(simap).sum()) * 0.05**2, rel=1e-5)
    by_color = {solid.color: solid for solid in solids(simap, colors)}
    chair = by_color[instance_color(CHAIR_1)]
    assert chair.vertices.max(axis=0) == pytest.approx(simap.by_id(CHAIR_1).aabb_m[1])
    assert block_heights(simap)[0, 0] == pytest.approx(WALL_CUT_M)


def test_rays_meet_floor_and_blocks(simap):
    assert ray_on_floor((1.0, 2.0, 10.0), (0.1, 0.0, -1.0)) == pytest.approx((2.0, 2.0))
    assert ray_on_floor((1.0, 2.0, 10.0), (0.0, 0.0, 1.0)) is None
    chair = simap.by_id(CHAIR_1)
    x, y, _ = chair.centroid_m
    origin = np.array([x, y - 4.0, 4.0])
    towards_top = np.array([x, y, 0.85]) - origin
    place = ray_on_blocks(simap, origin, towards_top)
    assert place is not None and simap.at(*place) == chair
    beyond = ray_on_floor(origin, towards_top)
    assert beyond is not None and simap.at(*beyond) is None  # the plain floor would have missed it
    assert ray_on_blocks(simap, (0.0, 0.0, 5.0), (0.0, 0.0, -1.0)) == pytest.approx((0.0, 0.0))


def test_best_views_sum_up_the_communities_of_an_instance(simap):
    # Instance 1 = communities 1 and 2, each 32 cells; 1 is not seen in frame 1, 2 not in frame 2.
    views = frame_pictures.best_views(simap, CHAIR_1, most=4)
    assert [(v.frame, v.segments, v.cells) for v in views] == [
        (0, (11, 12), 64),
        (3, (11, 12), 64),
        (4, (11, 12), 64),
        (1, (12,), 32),
    ]
    split = repartition(simap, k_percent=50.0)
    assert {v.segments for v in frame_pictures.best_views(split, 2)} == {(12,)}
    assert frame_pictures.best_views(simap, 99) == []
    # A few stray cells in a neighbour's mask make it no mask of the object, unless it has no other.
    views = simap.views
    other = next(i for i in range(len(views.frame)) if views.frame[i] == 0 and views.segment[i] not in (11, 12))
    stray = {"community": 1, "frame": 0, "segment": views.segment[other], "cells": 3, "score": 0.5}
    added = {
        name: np.append(getattr(views, name), np.array(value, getattr(views, name).dtype))
        for name, value in stray.items()
    }
    assert frame_pictures.best_views(replace(simap, views=Views(**added)), CHAIR_1)[0].segments == (11, 12)
    alone = {name: np.append(column, column.dtype.type({"segment": 77, "cells": 1}.get(name, column[-1])))
             for name, column in added.items()}  # fmt: skip
    assert frame_pictures.best_views(replace(simap, views=Views(**alone)), CHAIR_1)[0].segments == (11, 12)
    only = {name: column[~np.isin(added["segment"], (11, 12))] for name, column in added.items()}
    found = frame_pictures.best_views(replace(simap, views=Views(**only)), CHAIR_1)
    assert [one.segments for one in found] == [(int(views.segment[other]),)]


def test_communities_appear_when_first_seen(simap):
    assert frame_pictures.communities_unseen_until(simap, 0).tolist() == [5]  # community c is not seen in frame c mod 5
    assert frame_pictures.communities_unseen_until(simap, 4).tolist() == []
    assert len(frame_pictures.communities_unseen_until(simap, -1)) == len(np.unique(simap.community)) - 1


def test_texts_say_what_is_on_the_map(simap):
    assert legend.counts_text(simap) == "3 chairs, 2 dining tables, 1 couch, 1 potted plant · 7 instances"
    assert legend.counts_text(simap, most=2) == "3 chairs, 2 dining tables, 2 more classes · 7 instances"
    chair = simap.by_id(CHAIR_3)
    assert chair.name == "chair 3" and "one of 3" in legend.facts_html(simap, chair)
    assert legend.facts_text(simap, chair) == "64 cells · 0.16 m² · seen in 4 frames"


@pytest.mark.parametrize(
    ("count", "noun", "text"),
    [
        (1, "chair", "1 chair"),
        (4, "bench", "4 benches"),
        (2, "person", "2 people"),
        (3, "knife", "3 knives"),
        (2, "mouse", "2 mice"),
    ],
)
def test_plurals(count, noun, text):
    assert legend.plural(count, noun) == text


def test_legend_escapes_names_and_holds_every_colour(simap):
    html = legend.legend_html(simap, "instance")
    assert all(f"rgb{instance_color(i.id)}" in html for i in simap.instances)
    assert f"rgb{class_color('chair')}" in legend.legend_html(simap, "class")
    assert "not its real one" in html and "not its real one" not in legend.legend_html(simap, "photo")
    assert "2 m" in legend.legend_html(simap, "height") and "5 frames" in legend.legend_html(simap, "observations")


def test_classes_of_one_colour_differ_by_pattern_on_the_map_and_in_its_legend():
    names = [f"class {i}" for i in range(30)]
    plan = {"size_m": (31.0, 2.0), "walls": [], "things": [(n, i, 0.5, i + 0.6, 1.1, 0.8) for i, n in enumerate(names)]}
    simap = furnished_map(plan)
    colors, html = texture.cell_colors(simap, "class"), legend.legend_html(simap, "class")
    looks = []
    for one in simap.instances:
        row, col = np.nonzero(simap.instance == one.id)
        looks.append(colors[row.min() : row.min() + 4, col.min() // 4 * 4 + 4 : col.min() // 4 * 4 + 8].tobytes())
    chips = [entry.split("class ")[0] for entry in html.split('simaps-chip" style=')[1:31]]
    assert len(set(looks)) == len(set(chips)) == 30
    plain = texture.cell_colors(simap, "instance")
    assert all(len(np.unique(plain[simap.instance == one.id], axis=0)) == 1 for one in simap.instances)
    assert "stripes" in html and "stripes" not in legend.legend_html(toy_map(), "class")
    # Dimmed, a pattern is dimmed too.
    dim = texture.cell_colors(simap, "class", lit={simap.instances[0].id})
    assert (dim[simap.instance == simap.instances[0].id] == colors[simap.instance == simap.instances[0].id]).all()
    assert (dim[simap.instance == simap.instances[29].id] > 150).all()


def test_the_legend_of_classes_names_every_colour_of_the_map(simap):
    """Also what cannot be counted, what is no object for being small."""
    grid, label = simap.grid, simap.grid.label.copy()
    label[50:54, 50:54] = len(grid.labels)
    label[60, 60] = grid.labels.index("tv")
    grid = replace(grid, labels=(*grid.labels, "rug"), is_thing=(*grid.is_thing, False), label=label)
    rug = replace(simap, grid=grid)
    html = legend.legend_html(rug, "class")
    colors = texture.cell_colors(replace(simap, grid=grid), "class")
    for cell, text in (((51, 51), "rug"), ((60, 60), "tv")):
        assert f'style="background:rgb{tuple(colors[cell].tolist())}"></i>{text}</span>' in html
    assert "not counted" in html and "not counted" not in legend.legend_html(simap, "class")


def test_a_photo_has_the_squares_of_objects_only_where_they_are_outlined(simap):
    squares = [f"rgb{instance_color(one.id)}" for one in simap.instances]
    outlined = legend.legend_html(simap, "photo")
    assert all(one in outlined for one in squares) and "objects are outlined" in outlined
    pale = legend.legend_html(simap, "photo", colored=False)
    assert not any(one in pale for one in squares) and "outlined" not in pale and "chair <b>3</b>" in pale


def test_thumbnail_outlines_the_mask_and_only_it():
    rgb = np.full((480, 640, 3), 100, np.uint8)
    ids = np.zeros((480, 640), np.int32)
    ids[200:260, 300:380] = 7
    ids[10:40, 10:40] = 8
    picture = frame_pictures.outlined(rgb, ids, {7})
    assert picture.shape == (frame_pictures.HEIGHT, frame_pictures.WIDTH, 3)
    yellow = (picture == frame_pictures.OUTLINE).all(axis=2)
    rows, cols = np.nonzero(yellow)
    assert np.ptp(cols) / np.ptp(rows) == pytest.approx(80 / 60, abs=0.1)
    middle = yellow[rows.min() + 12 : rows.max() - 12, cols.min() + 12 : cols.max() - 12]
    assert not middle.any()
    assert not (frame_pictures.outlined(rgb, ids, {9}) == frame_pictures.OUTLINE).all(axis=2).any()


def test_gallery_shows_each_picture_once():
    tinted = [np.full((frame_pictures.HEIGHT, frame_pictures.WIDTH, 3), v, np.uint8) for v in (10, 20, 30)]
    for count in (1, 2, 3):
        page = frame_pictures.gallery(tinted[:count])
        sizes = [int((page[..., 0] == v).sum()) for v in (10, 20, 30)]
        small = frame_pictures.HEIGHT * frame_pictures.WIDTH
        assert sizes[0] > 4 * small
        assert sizes[1:] == [small if count > i else 0 for i in (1, 2)]


def test_thumbnail_takes_a_segmentation_of_another_size():
    ids = np.zeros((48, 64), np.int32)
    ids[20:30, 30:40] = 70_001
    picture = frame_pictures.outlined(np.zeros((480, 640, 3), np.uint8), ids, {70_001})
    assert (picture == frame_pictures.OUTLINE).all(axis=2).sum() > 100


@pytest.mark.parametrize(
    "name", ["000123", "frame 椅子 12", "a_frame_with_a_name_that_is_much_too_long_to_be_shown.png"]
)
def test_a_thumbnail_is_named_in_its_lower_left_corner(name):
    plain = np.full((frame_pictures.HEIGHT, frame_pictures.WIDTH, 3), 120, np.uint8)
    picture = frame_pictures.named(plain, name)
    assert (plain == 120).all() and (picture[: frame_pictures.HEIGHT // 2] == 120).all()
    changed = (picture != 120).any(axis=-1)
    row, col = np.nonzero((picture > 200).all(axis=-1))
    assert changed[-1, 0] and col.min() < 30 and col.max() < frame_pictures.WIDTH - 1 and row.max() < len(picture) - 1
