"""Simulated network errors: what may go wrong does, and nothing else."""

from typing import Any

import numpy as np
import pytest

from simaps_viz.errors import InputError
from simaps_viz.scenes.simulated_errors import (
    LEVELS,
    ClassErrors,
    ErrorLevel,
    KnownInstance,
    known_instances,
    simulate_errors,
)

HEIGHT, WIDTH = 120, 160
LABELS = {1: "floor", 2: "floor", 3: "chair", 4: "chair", 5: "chair", 6: "couch", 7: "couch", 8: "cup"}


def known(distance_m: float = 0.5) -> dict[int, KnownInstance]:
    return {i: KnownInstance(label, label != "floor", (distance_m * i, 0.0)) for i, label in LABELS.items()}


def picture() -> np.ndarray:
    """Two floors and six upright strips, side by side, a little apart."""
    ids = np.ones((HEIGHT, WIDTH), dtype=np.uint8)
    ids[60:] = 2
    for k, i in enumerate(range(3, 9)):
        ids[20:100, 10 + 24 * k : 30 + 24 * k] = i
    return ids


def only(monkeypatch: pytest.MonkeyPatch, **chances: Any) -> str:
    """Make a level where only the given things go wrong."""
    values: dict[str, Any] = {"border_px": 0.0, "miss": 0.0, "flip": 0.0, "split": 0.0, "merge": 0.0} | chances
    monkeypatch.setitem(LEVELS, "custom", ErrorLevel(**values))
    return "custom"


def spoil(level: str, *, seed: int = 0, frame: str = "000000", distance_m: float = 0.5):
    return simulate_errors(picture(), known(distance_m), level=level, seed=seed, frame=frame)


def damage(ids: np.ndarray, rows: list[dict]) -> float:
    """1 - mean IoU of the things with their best segment of the same name."""
    exact, losses = picture(), []
    label = {row["id"]: row["label"] for row in rows}
    for i in range(3, 9):
        mask = exact == i
        ious = [
            (mask & (ids == s)).sum() / (mask | (ids == s)).sum()
            for s in np.unique(ids[mask])
            if label.get(int(s)) == LABELS[i]
        ]
        losses.append(1 - max(ious, default=0.0))
    return float(np.mean(losses))


def test_level_none_keeps_every_pixel():
    ids, rows = spoil("none")
    label = {0: "", **{row["id"]: row["label"] for row in rows}}
    exact = picture()
    for i in range(3, 9):
        segment = np.unique(ids[exact == i])
        assert len(segment) == 1
        assert ((ids == segment[0]) == (exact == i)).all()
        assert label[int(segment[0])] == LABELS[i]
    assert len(np.unique(ids[(exact == 1) | (exact == 2)])) == 1  # stuff of one class is one segment
    assert {row["id"]: row["area"] for row in rows} == {i: int((ids == i).sum()) for i in np.unique(ids)}


def test_the_outcome_depends_on_level_seed_and_frame_only():
    ids, rows = spoil("heavy", seed=3, frame="000007")
    spoil("light", seed=1, frame="000001")
    again, rows_again = spoil("heavy", seed=3, frame="000007")
    assert (ids == again).all() and rows == rows_again
    assert (spoil("heavy", seed=4, frame="000007")[0] != ids).any()
    assert (spoil("heavy", seed=3, frame="000008")[0] != ids).any()


def test_merges_join_only_one_class_and_only_neighbours(monkeypatch):
    level = only(monkeypatch, merge=1.0)
    ids, rows = spoil(level)
    exact = picture()
    groups = [set(np.unique(exact[ids == row["id"]]).tolist()) for row in rows]
    assert sorted(map(sorted, groups)) == [[1, 2], [3, 4, 5], [6, 7], [8]]
    assert {row["label"] for row in rows} == set(LABELS.values())
    far, _ = spoil(level, distance_m=1.3)
    assert len(np.unique(far)) == 1 + 6


def test_segments_far_apart_in_the_picture_do_not_merge(monkeypatch):
    level = only(monkeypatch, merge=1.0)
    ids = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    ids[10:60, :30] = 3
    ids[10:60, 130:] = 4
    assert len(simulate_errors(ids, known(), level=level, seed=0, frame="a")[1]) == 2


def test_misses_remove_things_and_never_stuff(monkeypatch):
    ids, rows = spoil(only(monkeypatch, miss=1.0))
    assert [row["label"] for row in rows] == ["floor"]
    assert (ids[picture() >= 3] == 0).all()


def test_flips_rename_things_to_other_things(monkeypatch):
    exact = picture()
    ids, rows = spoil(only(monkeypatch, flip=1.0))
    label = {row["id"]: row["label"] for row in rows}
    for i in range(3, 9):
        wrong = label[int(ids[exact == i][0])]
        assert wrong != LABELS[i] and wrong in {"chair", "couch", "cup"}
    assert label[int(ids[0, 0])] == "floor"


def test_splits_cut_things_in_equal_halves(monkeypatch):
    exact = picture()
    ids, rows = spoil(only(monkeypatch, split=1.0))
    assert len(rows) == 1 + 2 * 6
    for i in range(3, 9):
        halves = np.unique(ids[exact == i], return_counts=True)[1]
        assert len(halves) == 2
        assert halves.min() / halves.sum() > 0.4


def test_borders_wander_by_about_what_the_level_says(monkeypatch):
    ids, _ = spoil(only(monkeypatch, border_px=4.0))
    exact, plain = picture(), spoil("none")[0]
    changed = ids != plain
    assert 0.005 < changed.mean() < 0.15
    inner = exact[50, 12 + 24 * 1 + 8]
    assert ids[58:62, 44:46].tolist() == plain[58:62, 44:46].tolist(), inner  # the middle of a thing stays


@pytest.mark.parametrize("seed", range(3))
def test_heavier_levels_do_more_damage(seed):
    means = []
    for level in ("none", "light", "medium", "heavy"):
        frames = [spoil(level, seed=seed, frame=f"{i:06d}") for i in range(30)]
        means.append(np.mean([damage(ids, rows) for ids, rows in frames]))
    assert means[0] == 0
    assert means[0] < means[1] < means[2] < means[3]


def found_in(level: str, frames: int = 200, seed: int = 0) -> np.ndarray:
    """Whether each of the six things was found: bool [frames, 6]."""
    exact, frames_found = picture(), []
    for frame in range(frames):
        ids, _ = spoil(level, seed=seed, frame=f"{frame:06d}")
        frames_found.append([(ids[exact == i] > 0).any() for i in range(3, 9)])
    return np.array(frames_found)


def test_what_lasts_goes_wrong_with_one_object_again_and_as_often_in_all(monkeypatch):
    now_and_then = found_in(only(monkeypatch, miss=0.3))
    assert (now_and_then.mean(axis=0) > 0.6).all() and (now_and_then.mean(axis=0) < 0.8).all()
    always = np.concatenate([found_in(only(monkeypatch, miss=0.3, lasting=0.999), 20, seed) for seed in range(100)])
    by_seed = always.reshape(100, 20, 6)
    assert (by_seed == by_seed[:, :1]).mean() > 0.97
    assert always.mean() == pytest.approx(0.7, abs=0.06)


def test_misses_by_size(monkeypatch):
    strip_px = 20 * 80 / (WIDTH / 512) ** 2  # at 512 pixels width
    band = int(np.log2(strip_px / 60))
    misses = [0.0] * 12
    misses[band] = 1.0
    assert not found_in(only(monkeypatch, miss_by_size=tuple(misses)), 2).any()
    misses = [1.0] * 12
    misses[band] = 0.0
    assert found_in(only(monkeypatch, miss_by_size=tuple(misses)), 2).all()
    assert not found_in(only(monkeypatch, miss_by_size=(1.0,)), 2).any()  # the last band goes on


def test_a_network_names_what_it_knows_and_takes_other_things_for_that(monkeypatch):
    names = frozenset({"chair", "cup", "dog"})
    _, rows = spoil(only(monkeypatch, known=names))
    assert sorted(row["label"] for row in rows) == ["chair", "chair", "chair", "cup"]
    ids, rows = spoil(only(monkeypatch, known=names, invent=1.0))
    assert sorted({row["label"] for row in rows}) == ["chair", "cup"] and len(rows) == 6
    assert (ids[picture() <= 2] == 0).all()  # stuff


def test_each_class_errs_as_it_was_measured(monkeypatch):
    found, lost = (0.0,), (1.0,)
    classes = {
        "chair": ClassErrors(lost, {"chair": 1.0}),
        "couch": ClassErrors(found, {"bed": 1.0}),
        "floor": ClassErrors(found, {"floor": 1.0}),
    }
    ids, rows = spoil(only(monkeypatch, by_class=classes))
    exact = picture()
    assert sorted(row["label"] for row in rows) == ["bed", "bed", "floor"]
    assert not ids[np.isin(exact, [3, 4, 5, 8])].any()  # chairs are missed, and of cups nothing was measured
    shares = {"chair": ClassErrors(found, {"chair": 0.7, "dog": 0.2, "cat": 0.1})}
    level = only(monkeypatch, by_class=shares)
    names = [row["label"] for frame in range(300) for row in spoil(level, frame=str(frame))[1]]
    assert len(names) == 900  # three chairs a frame
    assert {name: names.count(name) / 900 for name in ("chair", "dog", "cat")} == pytest.approx(
        {"chair": 0.7, "dog": 0.2, "cat": 0.1}, abs=0.04
    )


def test_measured_confidences_are_as_frequent_as_they_were(monkeypatch):
    names = {"chair": 0.5, "dog": 0.5}
    level = only(monkeypatch, by_class={"chair": ClassErrors((0.0,), names, scores=((0.3,), (0.4, 0.8, 0.8)))})
    rows = [row for frame in range(200) for row in spoil(level, frame=str(frame))[1]]
    assert {row["score"] for row in rows if row["label"] == "dog"} == {0.3}
    right = [row["score"] for row in rows if row["label"] == "chair"]
    assert set(right) == {0.4, 0.8} and right.count(0.4) / len(right) == pytest.approx(1 / 3, abs=0.08)


@pytest.mark.parametrize("distance_m", [0.5, 3.0])
def test_a_thing_taken_for_its_neighbour_is_part_of_the_neighbours_segment(monkeypatch, distance_m):
    """The cup, beside the last couch, is taken for one; three metres away it is a couch of its own."""
    named = {"couch": "couch", "cup": "couch"}
    classes = {label: ClassErrors((0.0,), {name: 1.0}) for label, name in named.items()}
    ids, rows = spoil(only(monkeypatch, by_class=classes), distance_m=distance_m)
    exact = picture()
    assert len(rows) == (2 if distance_m < 1 else 3)
    assert (ids[exact == 8][0] == ids[exact == 7][0]) == (distance_m < 1) and ids[exact == 6][0] != ids[exact == 7][0]


def test_shares_of_misses_are_those_of_the_level():
    for name in ("light", "heavy"):
        missed = [6 - len(set(np.unique(_kept(name, i)))) for i in range(300)]
        assert np.mean(missed) / 6 == pytest.approx(LEVELS[name].miss, rel=0.25)


def _kept(level: str, frame: int) -> np.ndarray:
    """Exact ids whose middle pixel still belongs to something."""
    ids, _ = spoil(level, frame=f"f{frame}")
    middles = [(60, 20 + 24 * k) for k in range(6)]
    return np.array([picture()[v, u] for v, u in middles if ids[v, u] > 0])


def test_small_things_are_never_found():
    ids = np.ones((384, 512), dtype=np.uint16)
    ids[100:105, 100:105] = 8
    assert [r["label"] for r in simulate_errors(ids, known(), level="light", seed=0, frame="a")[1]] == ["floor"]
    assert len(simulate_errors(ids, known(), level="none", seed=0, frame="a")[1]) == 2


def test_an_empty_picture_stays_empty():
    ids, rows = simulate_errors(np.zeros((30, 40), dtype=np.uint8), known(), level="heavy", seed=0, frame="a")
    assert not ids.any() and rows == []


def test_unknown_ids_count_as_nothing():
    ids, rows = simulate_errors(np.full((30, 40), 99, dtype=np.uint8), known(), level="none", seed=0, frame="a")
    assert not ids.any() and rows == []


def test_an_unknown_level_is_refused_by_name():
    with pytest.raises(InputError, match="expected one of none, light, medium, heavy, detector, found 'extreme'"):
        spoil("extreme")


def test_instance_table_is_read():
    row = {"id": 4, "label": "chair", "isthing": True, "aabb_min": [0, 2, 0], "aabb_max": [1, 3, 1]}
    assert known_instances({"instances": [row]}) == {4: KnownInstance("chair", True, (0.5, 2.5))}
