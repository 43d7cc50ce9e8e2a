"""Why one object, why two: exact answers on small maps, sums counted edge by edge, never a failure on a real one."""

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from drawn_readings import drawn_grid, drawn_readings, evidence_map, random_readings
from toy_maps import TOY_SPEC, toy_map

from simaps_viz.drawing.frame_pictures import OTHER_OUTLINE, OUTLINE, outlined
from simaps_viz.drawing.texture import map_image
from simaps_viz.errors import InputError
from simaps_viz.mapping.explain import (
    Why,
    between,
    between_words,
    explain,
    frames_of_both,
    link_words,
    recorded_step,
    score_text,
    summary,
    weakest_name,
    weakest_of,
)
from simaps_viz.mapping.partition import applied_steps
from simaps_viz.recorder.map_log import merge_order
from simaps_viz.recorder.settings import SMALL
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.recording import clicked_position, position_inside
from simaps_viz.viewer.scene.why_marks import (
    RAMP,
    UNKNOWN,
    drawn_links,
    joint_line,
    link_lines,
    paint_cells,
    sureness_colors,
)

CHAIR_1, CHAIR_3, CHAIR_4, COUCH, TABLE = 1, 3, 4, 5, 6


def test_the_chair_of_two_communities():
    why = explain(toy_map(), CHAIR_1)
    (joint,) = why.joints
    assert why.weakest is joint and why.threshold == 0.05
    assert (joint.source.tolist(), joint.target.tolist(), joint.score) == ([2], [1], 0.25)
    assert (joint.source_cells, joint.target_cells) == (32, 32)
    assert (joint.same, joint.different) == (80, 0)  # 8 rows of 10 pixel pairs
    assert why.cells_of(joint.target).tolist() == [r * 120 + c for r in range(74, 82) for c in range(41, 45)]
    # Its inner edges weigh 10 / 5; the wrong one to chair 3 does not count.
    assert why.sureness.dtype == np.float32 and why.sureness.tolist() == [2.0] * 64
    # Frame 1 missed community 1, frame 2 community 2; the others saw each in a segment of its own.
    assert [(f.frame, f.segments, f.cells, f.as_one) for f in why.frames] == [
        (0, (11, 12), 64, False),
        (3, (11, 12), 64, False),
        (4, (11, 12), 64, False),
        (1, (12,), 32, True),
        (2, (11,), 32, True),
    ]
    assert why.together.as_one == () and [f.frame for f in why.together.as_two] == [0, 3, 4]
    assert {(f.first, f.second, f.cells) for f in why.together.as_two} == {((12,), (11,), 32)}


def test_the_wrong_edge_is_the_only_link_and_the_first_joint_to_break():
    why = explain(toy_map(), CHAIR_1)
    (link,) = why.neighbours  # all others are metres away
    assert link.other.id == CHAIR_3 and (link.same, link.different, link.touching) == (1, 0, False)
    assert link.score == 1 / 64
    assert link.ends_m == (TOY_SPEC.centre_of(74, 41), TOY_SPEC.centre_of(27, 19))
    assert link.distance_m == pytest.approx(0.05 * math.hypot(46, 21))
    joined = explain(toy_map(k_percent=0.0), CHAIR_1)
    assert [(j.source.tolist(), j.target.tolist()) for j in joined.joints] == [([2], [1]), ([3], [1, 2])]
    bridge = joined.joints[1]
    assert joined.weakest is bridge and (bridge.same, bridge.source_cells, bridge.target_cells) == (1, 64, 64)
    assert joined.neighbours == ()
    # The wrong edge weighs 1 / 5, at a corner of each chair.
    assert sorted(np.round(joined.sureness.astype(float), 6).tolist()) == [1.4] * 2 + [2.0] * 126


def test_what_is_of_one_piece_has_no_joint():
    why = explain(toy_map(), COUCH)
    assert why.joints == () and why.weakest is None and len(why.together) == 0 and why.neighbours == ()
    assert summary(why) == (
        "One object because all 4 frames that saw it show it as one. "
        "Class couch because the masks of 4 frames say so, 75 % sure on average. "
        "It is a single patch that was never joined from parts."
    )
    with pytest.raises(InputError, match="instance 99"):
        explain(toy_map(), 99)


def test_words_on_the_toy_map():
    simap = toy_map()
    assert summary(explain(simap, CHAIR_1)) == (
        "One object although only 2 of the 5 frames that saw it show what they saw of it as one. "
        "Class chair because the masks of 5 frames say so, 71 % sure on average. Its weakest joint "
        "(32 + 32 cells) has 25.0 %, above the K = 5 % needed: seen together in 3 frames, each time as two."
    )
    found = between(simap, CHAIR_1, CHAIR_3)
    assert between_words(found, "chair 1", "chair 2") == (
        "chair 1 and chair 2 are 2.53 m apart: seen together in 4 frames, each time as two; "
        "1.6 % of the cells of one neighbour the other, below the K = 5 % needed."
    )
    apart = between(simap, CHAIR_1, TABLE)
    assert apart.link is None
    assert between_words(apart, "a", "b").startswith("a and b are of different classes, and the map joins cells of one")
    assert "no cell of one neighbours a cell of the other" in between_words(between(simap, CHAIR_3, CHAIR_4), "a", "b")


def test_the_weakest_joint_is_one_of_large_parts_if_there_are_any():
    (whole,) = explain(toy_map(), CHAIR_1).joints
    crumb, crust, half = (replace(whole, source_cells=n, score=s) for n, s in ((1, 0.61), (2, 0.7), (20, 0.8)))
    assert weakest_of((crumb, half, crust), 64) is half
    assert weakest_of((crumb, crust), 64) is crust and weakest_of((), 64) is None
    why = replace(explain(toy_map(), CHAIR_1), joints=(crust,), weakest=crust)
    assert summary(why).endswith(" Nearly all of it is one patch; only pieces of at most 2 cells joined it.")
    assert weakest_name(why) == "joint of the largest piece"
    assert summary(replace(why, joints=(crumb, crust))).endswith(
        " only pieces of at most 2 cells joined it, the least sure with 61.0 %."
    )


def test_small_pieces_that_joined_with_less_are_not_passed_over_in_silence():
    why = explain(toy_map(), CHAIR_1)
    (whole,) = why.joints
    assert " Its weakest joint (" in summary(why)
    below = replace(why, joints=(replace(whole, source_cells=1, score=whole.score / 2.0), whole))
    assert " The weakest joint of its larger parts (" in summary(below)
    assert summary(below).endswith(" Small pieces joined with less, down to 12.5 %.") and "pieces" not in summary(why)
    assert (weakest_name(why), weakest_name(below)) == ("weakest joint", "weakest of the larger parts")
    frame = next(one for one in why.frames if one.as_one)
    split = replace(why, frames=(replace(frame, segments=(1, 2), cells=len(why.cells)),))
    said = "One object because the 1 frame that saw it shows most of it as one."
    assert summary(split).startswith(said)
    part = replace(why, frames=(replace(frame, segments=(1, 2), cells=len(why.cells) - 1),))
    assert summary(part).startswith(said.replace("most of it", "most of what it saw of it"))


def test_a_score_that_reads_as_the_threshold_has_a_digit_more():
    assert score_text("evidence", 0.597, 0.6) == "59.7 %" and score_text("evidence", 0.597) == "60 %"
    assert score_text("evidence", 0.6, 0.6) == "60 %" and score_text("evidence", 0.87, 0.6) == "87 %"
    assert score_text("paper", 0.0496, 0.05) == "4.96 %" and score_text("evidence", 0.5999, 0.6) == "59.99 %"


LOOKS = ("ccccc.cc", "ccccc.cc", "aaabb.bb", "aaabb.bb", "aaabb.dd", "?????.cc")


@pytest.fixture
def row() -> SIMap:
    """One row of cells: five of a chair, a cell nobody named, two of another chair."""
    grid = drawn_grid("ccccc.cc")
    return evidence_map(grid, drawn_readings(grid, LOOKS, {"a": "chair", "b": "chair", "c": "chair", "d": "chair"}))


def test_sightings_of_a_drawn_row_are_counted_by_hand(row):
    """Communities 1 (cells 0-2), 2 (3, 4), 3 (6, 7); pairs are 1, 2 and 4 cells apart."""
    assert row.instance.tolist() == [[1, 1, 1, 2, 2, 0, 2, 2]]
    why = explain(row, 2)
    (joint,) = why.joints  # cells 3 and 7, 4 and 6: one in frames 0 to 3, two in frame 4
    assert (joint.source.tolist(), joint.target.tolist()) == ([3], [2])
    assert (joint.same, joint.different) == (8, 2) and joint.score == pytest.approx(8 / 13)
    assert [f.frame for f in why.together.as_one] == [0, 1, 2, 3]
    assert [(f.frame, f.first, f.second) for f in why.together.as_two] == [(4, (ord("d"),), (ord("b"),))]
    np.testing.assert_allclose(why.sureness, [9 / 10, 9 / 10, 10 / 11, 10 / 11], rtol=1e-6)
    (link,) = why.neighbours  # five pairs, each one in frames 0 and 1, two in frames 2 to 4
    assert (link.same, link.different, link.touching, link.distance_m) == (10, 15, True, 0.0)
    assert link.score == pytest.approx((10 + 2.1) / 28)
    assert summary(why) == (
        "One object because 5 of the 6 frames that saw it show what they saw of it as one. "
        "Class chair because the masks of 6 frames say so, 100 % sure on average. Its weakest joint "
        "(2 + 2 cells) has 62 % for one object, above the 60 % needed: seen together in 5 frames: as one in 4, as two "
        "in 1. The 62 % is counted cell by cell: 8 sightings as one, 2 as two, and 3 imagined, as two, of "
        "parts that do not touch."
    )
    assert between_words(between(row, 1, 2), "chair 1", "chair 2") == (
        "chair 1 and chair 2 touch: 43 % of what frames saw of their cells says one object, below the 60 % needed; "
        "seen together in 5 frames: as two in 3, as one in 2. The 43 % is counted cell by cell: 10 sightings as one, "
        "15 as two, and 3 imagined of parts that touch, 2.1 of them as one."
    )
    assert "just above the 43 % needed;" in between_words(replace(between(row, 1, 2), threshold=0.43), "a", "b")


def owners(simap: SIMap) -> np.ndarray:
    return simap.instance.reshape(-1)


def brute_between(simap: SIMap, a: int, b: int) -> tuple[int, int]:
    same = different = 0
    for graph in simap.graphs:
        for (i, j), s, d in zip(graph.edges.tolist(), graph.counts.tolist(), graph.different.tolist(), strict=True):
            if {int(owners(simap)[graph.cells[i]]), int(owners(simap)[graph.cells[j]])} == {a, b}:
                same, different = same + s, different + d
    return same, different


@pytest.fixture(scope="module", params=[(0, 0.6), (1, 0.3), (2, 0.45)], ids=str)
def random_map(request) -> SIMap:
    seed, affinity = request.param
    return evidence_map(*random_readings(seed, shape=(18, 20), frames=6), affinity=affinity)


def test_all_sums_equal_a_count_edge_by_edge(random_map):
    simap, joints, links = random_map, 0, 0
    community = simap.community.reshape(-1)
    for instance in simap.instances:
        why = explain(simap, instance.id)
        joints += len(why.joints)
        links += len(why.neighbours)
        for joint in why.joints:
            same = different = 0
            for graph in simap.graphs:
                for (i, j), s, d in zip(graph.edges, graph.counts, graph.different, strict=True):
                    ends = {int(community[graph.cells[i]]), int(community[graph.cells[j]])}
                    crossing = ends & set(joint.source.tolist()) and ends & set(joint.target.tolist())
                    same, different = same + int(s) * bool(crossing), different + int(d) * bool(crossing)
            assert (joint.same, joint.different) == (same, different)
            believed = [3.0 * p for p in (0.0, 0.7)]  # apart or touching
            assert any(np.isclose(joint.score, (same + b) / (same + different + 3.0)) for b in believed)
        for link in why.neighbours:
            assert (link.same, link.different) == brute_between(simap, instance.id, link.other.id)
            assert link.score == pytest.approx((link.same + 2.1 * link.touching) / (link.same + link.different + 3.0))
            back = between(simap, link.other.id, instance.id).link
            assert back is not None and (back.same, back.score) == (link.same, pytest.approx(link.score))
    assert joints > 5 and links > 5


def test_joints_are_the_applied_steps_and_the_weakest_is_their_minimum(random_map):
    simap, log = random_map, random_map.merges
    applied = applied_steps(log, simap.parameters["affinity"])
    found = []
    for instance in simap.instances:
        why = explain(simap, instance.id)
        steps = [joint.step for joint in why.joints]
        assert steps == sorted(steps)
        found += steps
        parts = [set(joint.source.tolist()) | set(joint.target.tolist()) for joint in why.joints]
        assert len(why.joints) == len(np.unique(why.community)) - 1
        if parts:
            assert max(parts, key=len) == set(why.community.tolist())
            assert why.weakest is not None and why.weakest.score == min(float(log.score[s]) for s in steps)
            assert all(joint.score > why.threshold for joint in why.joints)
        for joint in why.joints:
            assert joint.source_cells == len(why.cells_of(joint.source))
            assert joint.target_cells == len(why.cells_of(joint.target))
        assert all(link.score <= why.threshold for link in why.neighbours)
    assert sorted(found) == np.flatnonzero(applied).tolist()


def test_sureness_is_the_share_of_sightings_as_one_within_the_instance(random_map):
    simap = random_map
    same, both = defaultdict(int), defaultdict(int)
    for graph in simap.graphs:
        for (i, j), s, d in zip(graph.edges, graph.counts, graph.different, strict=True):
            a, b = int(graph.cells[i]), int(graph.cells[j])
            if owners(simap)[a] == owners(simap)[b]:
                for cell in (a, b):
                    same[cell] += int(s)
                    both[cell] += int(s + d)
    for instance in simap.instances:
        why = explain(simap, instance.id)
        expected = [same[c] / both[c] if both[c] else np.nan for c in why.cells.tolist()]
        np.testing.assert_allclose(why.sureness, expected, rtol=1e-6)


def plain_together(simap: SIMap, a: set[int], b: set[int]) -> tuple[set[int], set[int]]:
    """Frames that saw both, by the majority of pairs of cells, counted pair by pair."""
    seen: dict[int, tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    views = simap.views
    for c, f, s, n in zip(views.community, views.frame, views.segment, views.cells, strict=True):
        for side, group in enumerate((a, b)):
            if int(c) in group:
                seen[int(f)][side].extend([int(s)] * int(n))
    one, two = set(), set()
    for frame, (first, second) in seen.items():
        if first and second:
            same = sum(x == y for x in first for y in second)
            (one if 2 * same > len(first) * len(second) else two).add(frame)
    return one, two


def test_frames_see_one_or_two_by_the_majority_of_pairs(random_map):
    simap, decided = random_map, 0
    community = {i.id: set(np.unique(simap.community[simap.instance == i.id]).tolist()) for i in simap.instances}
    largest = sorted(simap.instances, key=lambda i: -i.cells)[:6]
    for a in largest:
        for b in largest:
            if a.id != b.id:
                found = frames_of_both(simap, a.id, b.id)
                one, two = {f.frame for f in found.as_one}, {f.frame for f in found.as_two}
                assert (one, two) == plain_together(simap, community[a.id], community[b.id])
                assert all(not set(f.first) & set(f.second) for f in found.as_two if f.first != f.second)
                decided += len(found)
    assert decided > 20


def test_a_step_is_found_on_the_recorded_timeline(random_map):
    simap = random_map
    applied = applied_steps(simap.merges, 0.6)
    order = merge_order(applied)
    joints = [j for i in simap.instances for j in explain(simap, i.id).joints]
    for joint in joints:
        assert order[recorded_step(joint, applied) - 1] == joint.step


def test_methods_without_a_log_are_explained_too(random_map):
    simap = replace(random_map, method="components", parameters={"min_cells": 1})
    why = explain(simap, simap.instances[0].id)
    assert why.joints == () and math.isinf(why.threshold) and all(math.isnan(n.score) for n in why.neighbours)
    assert summary(why).endswith("Method components has no joints to question: it knows no merge log.")
    assert all("their cells" in link_words(why.method, why.threshold, link) for link in why.neighbours)
    bare = replace(simap, graphs=())
    assert np.isnan(explain(bare, simap.instances[0].id).sureness).all()


def check_whole(simap: SIMap) -> list[Why]:
    found = [explain(simap, instance.id) for instance in simap.instances]
    for why in found:
        assert len(why.sureness) == len(why.community) == len(why.cells) == why.instance.cells
        assert len(why.frames) == why.instance.frames
        assert summary(why).startswith("One object ") and len(sureness_colors(why)) == len(why.cells)
        for link in why.neighbours:
            assert link_words(why.method, why.threshold, link)
        if why.weakest is not None:
            assert joint_line(simap, why, why.weakest).shape[1:] == (2, 3)
    return found


def test_the_joint_is_drawn_where_the_parts_meet():
    simap = toy_map()
    why = explain(simap, CHAIR_1)
    assert why.weakest is not None
    line = joint_line(simap, why, why.weakest)
    assert line.shape == (8, 2, 3)
    np.testing.assert_allclose(line[:, :, 0], -1.0 + 45 * 0.05, atol=1e-6)
    np.testing.assert_allclose(
        sorted(line[:, :, 1].reshape(-1)), -2.0 + 0.05 * np.repeat(range(74, 83), [1, *[2] * 7, 1])
    )
    joined = explain(toy_map(k_percent=0.0), CHAIR_1)  # chairs that do not touch
    assert joined.weakest is not None
    (bridge,) = joint_line(toy_map(k_percent=0.0), joined, joined.weakest)
    centres = [simap.by_id(i).centroid_m[:2] for i in (CHAIR_3, CHAIR_1)]
    np.testing.assert_allclose(bridge[:, :2], centres, atol=1e-5)
    (link,) = drawn_links(why)
    np.testing.assert_allclose(link_lines([link])[0, :, :2], link.ends_m, atol=1e-6)


def test_cells_are_painted_exactly(random_map):
    simap = random_map
    why = explain(simap, max(simap.instances, key=lambda i: i.cells).id)
    colors = sureness_colors(why)
    for cell, color in zip(why.sureness.tolist(), colors.tolist(), strict=True):
        if math.isnan(cell):
            assert tuple(color) == UNKNOWN
        elif cell >= 1.0 or cell <= 0.5:
            assert tuple(color) == RAMP[-1 if cell >= 1.0 else 0]
    before = map_image(simap, scale=3)
    after = before.copy()
    paint_cells(after, why.cells, colors, simap.spec.cols)
    mine = np.kron(simap.instance == why.instance.id, np.ones((3, 3), bool))
    assert (after[~mine] == before[~mine]).all()
    row, col = divmod(int(why.cells[5]), simap.spec.cols)
    assert (after[3 * row : 3 * row + 3, 3 * col : 3 * col + 3] == colors[5]).all()


def item(path: str, position=None, **more) -> dict:
    return {"type": "entity", "entity_path": path, "position": position, **more}


def test_a_click_in_the_recording_finds_its_place():
    simap = toy_map()
    ids = np.zeros((40, 60), np.int32)
    ids[10:20, 20:30] = 10 + CHAIR_4
    where = {"view": lambda frame: (np.zeros((80, 120, 3), np.uint8), ids)}
    # Pixel (44, 28) of the frame, (22, 14) of its ids, in the smaller picture that the page records.
    pixel = [44.0 / SMALL.color_divide, 28.0 / SMALL.color_divide, None]
    chair = position_inside(simap, CHAIR_4)
    assert simap.at(*chair) == simap.by_id(CHAIR_4)
    couch = next(i for i, one in enumerate(simap.instances) if one.id == COUCH)
    for items, place in (
        ([item("/map/objects", [1.5, -0.25, None])], (1.5, 0.25)),
        ([item("/world/cells", [1.5, -0.25, 0.4])], (1.5, -0.25)),
        ([item("/world/objects", [9.0, 9.0, 9.0], instance_id=couch)], position_inside(simap, COUCH)),
        ([item("/world/camera/color", pixel)], chair),
        ([item("/world/camera/color", [2.0, 2.0, None])], None),  # no segment there
        ([item("/world/camera/color", [900.0, *pixel[1:]])], None),
        ([item("/world/camera/depth", pixel)], None),  # of unknown scale
        ([{"type": "view", "view_name": "Objects"}, item("/map/objects", [0.0, -1.0, None])], (0.0, 1.0)),
        ([item("/map/objects", "nonsense"), item("/world/objects", instance_id=10**6)], None),
        ([], None),
    ):
        assert clicked_position(items, simap, 0, **where) == place
    # At frame 4 the object was not seen.
    assert clicked_position([item("/world/camera/color", pixel)], simap, 4, **where) is None


def test_two_parts_are_outlined_in_two_colours():
    rgb, ids = np.full((270, 360, 3), 128, np.uint8), np.zeros((270, 360), np.int32)
    ids[60:200, 60:150], ids[60:200, 220:300] = 1, 2

    def has(picture, color) -> bool:
        return bool((np.abs(picture.astype(int) - color).max(axis=2) < 8).sum() > 100)

    two, one, plain = outlined(rgb, ids, (1,), (2,)), outlined(rgb, ids, (1,), (1,)), outlined(rgb, ids, (1,))
    assert has(two, OUTLINE) and has(two, OTHER_OUTLINE)
    assert has(one, OUTLINE) and has(one, OTHER_OUTLINE)
    assert has(plain, OUTLINE) and not has(plain, OTHER_OUTLINE)
