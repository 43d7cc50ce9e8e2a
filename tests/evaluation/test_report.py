"""Evaluations as a whole: who is built from what, what is written, and what the pictures show."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from judged_maps import drawn, map_of_ids, truth_of_ids
from sequences import write_tiny_sequence
from toy_maps import toy_map

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.drawing.sheet import INK, save_png
from simaps_viz.errors import InputError
from simaps_viz.evaluation.evaluate import Footprint, Report, Run, WithSimulatedErrors, evaluate, evaluate_variants
from simaps_viz.evaluation.quality import ScoringRules, find_overlaps, parse_counts, score, score_counts, scores_of
from simaps_viz.evaluation.report import Measured, ablation_table, class_table, cost_table, overall_table, report_json
from simaps_viz.evaluation.run import (
    WRONG_RED,
    EvaluationConfig,
    Verdict,
    compare_maps,
    compare_report,
    missed_ids,
    panel_image,
    render,
    run_evaluation,
    verdicts,
)
from simaps_viz.evaluation.truth import truth_map
from simaps_viz.evaluation.two_maps import NO_PARTNER, PALETTE, distinct_colors
from simaps_viz.scenes.demo import DemoSettings, ensure_demo

pytestmark = pytest.mark.slow  # whole evaluations are run

SHARED = Path(__file__).parents[2].parent / "shared"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason=f"{SHARED} is not on this machine")
RULES = ScoringRules(min_true_cells=4, min_found_cells=4)


@pytest.fixture(scope="module")
def cafe(tmp_path_factory):
    small = DemoSettings(frames=5, width=96, height=72)
    return open_sequence(ensure_demo(level="none", cache_dir=tmp_path_factory.mktemp("cache"), settings=small))


def by_k(source, name):
    return build_map(source, BuildConfig(k_percent=float(name)))


def drawn_report(truth, found, **classes) -> Report:
    """A report of one hand-made map."""
    chairs = {int(i): "chair" for i in np.unique([*np.unique(truth), *np.unique(found)]) if i}
    true = truth_of_ids(truth, {i: c for i, c in chairs.items() if (truth == i).any()})
    simap = map_of_ids(found, {i: c for i, c in chairs.items() if (found == i).any()})
    scores = scores_of(find_overlaps(simap, true), simap)
    run = Run("hand", "none", 0, scores, 1.0, Footprint(1, 2))
    return Report("drawing", Path("drawing"), "hand", False, (run,), ScoringRules(), {("none", "hand"): (simap, true)})


def test_every_method_gets_every_mask_once_a_seed(cafe):
    asked = []

    def build(source, name):
        asked.append((len(source), name, source.segmentation_source))
        return by_k(source, name)

    told = []
    report = evaluate(
        cafe, ("5", "0"), errors=("medium", "none"), seeds=(3, 1), build=build, rules=RULES,
        store=lambda method, simap: Footprint(1000, 10**6) if method == "0" else Footprint(),
        progress=lambda *step: told.append(step),
    )  # fmt: skip
    simulated = "simulated network errors, medium, seed "
    wholes = [(name, source) for frames, name, source in asked if frames == len(cafe)]
    assert wholes == [(n, s) for s in (simulated + "3", simulated + "1", "renderer") for n in ("5", "0")]
    assert [(r.errors, r.method, r.seed) for r in report.runs] == [
        ("medium", "5", 3), ("medium", "5", 1), ("medium", "0", 3), ("medium", "0", 1),
        ("none", "5", 3), ("none", "0", 3),
    ]  # fmt: skip
    plain, stored = report.runs[-2].footprint, report.runs[-1].footprint
    simap, _ = report.maps["none", "5"]
    assert plain.ram_bytes == simap.instance.nbytes + simap.grid.label.nbytes == stored.ram_bytes - 1000
    assert stored.disk_bytes > 10**6 > plain.disk_bytes > 1000
    assert told[-1] == ("building and scoring maps", 6, 6)
    again = score(
        by_k(WithSimulatedErrors(cafe, "medium", 1), "5"), truth_map(cafe), min_true_cells=4, min_found_cells=4
    )
    assert again.to_json() == report.of("medium", "5")[1].scores.to_json()


def test_the_report_as_tables_and_json(cafe):
    report = evaluate_variants(
        cafe, (("five", 5.0), ("zero", 0.0)), errors=("light",), seeds=(0, 1), rules=RULES,
        build=lambda source, k: build_map(source, BuildConfig(k_percent=k)),
    )  # fmt: skip
    written = json.loads(json.dumps(report_json(report)))
    assert [(row["method"], row["errors"], row["seeds"]) for row in written["rows"]] == [
        ("five", "light", [0, 1]), ("zero", "light", [0, 1]),
    ]  # fmt: skip
    row = written["rows"][0]
    pqs = [run["overall"]["pq"] for run in row["runs"]]
    assert row["mean"]["pq"] == pytest.approx(np.mean(pqs)) and row["std"]["pq"] == pytest.approx(np.std(pqs, ddof=1))
    assert row["simulated_errors"] is True and written["simulated"] is True
    assert min(r["mean"]["times_fastest"] for r in written["rows"]) == 1.0
    text = overall_table(report).text()
    assert f"{np.mean(pqs):.3f} ±{np.std(pqs, ddof=1):.3f}" in text and "simulated" in text.splitlines()[0]
    difference = written["rows"][1]["mean"]["pq"] - row["mean"]["pq"]
    ablation = ablation_table(report)
    assert ablation.columns[1] == "variant" and ablation.rows[1][-1] == f"{difference:+.3f}"
    assert ablation.rows[0][-1] == "+0.000"
    classes = class_table(report)
    assert {r[1] for r in classes.rows} >= set(row["runs"][0]["by_class"])
    assert all(len(line) == len(classes.columns) for line in classes.rows)
    assert [r[-1] for r in cost_table(report).rows].count("1.00") >= 1


@pytest.mark.parametrize(
    ("values", "digits", "text"),
    [([1.0], 3, "1.000"), ([1.0, 2.0], 2, "1.50 ±0.71"), ([None, 2.0], 1, "2.0"), ([None], 3, "none"), ([], 3, "none")],
)
def test_mean_and_spread(values, digits, text):
    assert Measured.over(values).text(digits) == text


@pytest.mark.parametrize(
    ("methods", "errors", "seeds", "message"),
    [
        ((), ("none",), (0,), "methods"), (("5", "5"), ("none",), (0,), "methods"), (("5",), ("lite",), (0,), "errors"),
        (("5",), (), (0,), "errors"), (("5",), ("none",), (), "seeds"),
    ],
)  # fmt: skip
def test_senseless_evaluations_are_refused(cafe, methods, errors, seeds, message):
    with pytest.raises(InputError, match=message):
        evaluate(cafe, methods, errors=errors, seeds=seeds, build=by_k)


def test_counts_are_read_and_compared_loosely():
    assert parse_counts(" chair=11, table = 2") == {"chair": 11, "table": 2}
    counted = score_counts(toy_map(), {"chairs": 5, "table": 1, "Couch": 1})
    assert [(c.label, c.expected, c.found, c.difference) for c in counted] == [
        ("chair", 5, 3, -2), ("dining table", 1, 2, 1), ("couch", 1, 1, 0),
    ]  # fmt: skip
    assert score_counts(toy_map(), {"tv": 1})[0].found == 0  # a class of the map, of which it has none
    assert score_counts(toy_map(), {"potted plant": 1}, min_cells=37)[0].found == 0
    assert score_counts(toy_map(), {"potted plant": 1}, min_cells=36)[0].found == 1


@pytest.mark.parametrize("text", ["chair", "chair=", "=3", "chair=-1", "chair=1,chair=2", "chair=1,", "chair=1.5"])
def test_counts_that_read_otherwise_are_refused(text):
    with pytest.raises(InputError, match="counts"):
        parse_counts(text)


def test_unknown_and_doubled_classes_are_refused_with_a_list():
    with pytest.raises(InputError, match=r'chair, couch, dining table.*found "piano"'):
        score_counts(toy_map(), {"piano": 1})
    with pytest.raises(InputError, match="chair"):
        score_counts(toy_map(), {"chair": 1, "chairs": 2})
    with pytest.raises(InputError, match="wall"):
        score_counts(toy_map(), {"wall": 4})


def test_verdicts_and_what_was_missed():
    truth = drawn("112233..44.55.", cells=5)
    found = drawn("111133..67....", cells=5)
    report = drawn_report(truth, found)
    overlaps = report.runs[0].scores.overlaps
    assert verdicts(overlaps) == {1: Verdict.MERGED, 3: Verdict.RIGHT, 6: Verdict.PIECE, 7: Verdict.PIECE}
    assert missed_ids(overlaps) == [5]
    panel = compare_report(report).rows[0][1][0]
    assert np.array_equal(panel.missed, truth == 5)
    floor = map_of_ids((truth == 0).astype(np.int32), {1: "chair"})
    assert verdicts(find_overlaps(floor, truth_of_ids(truth, dict.fromkeys(range(1, 6), "chair")))) == {
        1: Verdict.WRONG
    }


def test_the_same_object_has_the_same_colour_on_every_panel():
    truth, found = drawn("112233..44.", cells=5), drawn("111133..679", cells=5)
    comparison = compare_report(drawn_report(truth, found))
    reference, panel = comparison.panels
    assert tuple(panel.title for panel in comparison.panels) == ("truth", "hand   PQ 0.22")
    color = {i: tuple(reference.colors[truth == i][0]) for i in (1, 2, 3, 4)}
    assert len(set(color.values())) == 4
    for number, partner in ((1, 1), (3, 3), (6, 4), (7, 4)):
        assert {tuple(c) for c in panel.colors[found == number]} == {color[partner]}
    assert {tuple(c) for c in panel.colors[found == 9]} == {NO_PARTNER}
    image = panel_image(panel, 6)[::-1]
    merged = image[:, : 4 * 5 * 6]
    assert (merged == WRONG_RED).all(-1).any() and (merged.reshape(-1, 3) == color[1]).all(-1).any()
    assert (image[0, : 4 * 5 * 6] == WRONG_RED).all()  # outlined along the picture's edge too
    marks = (merged == INK).all(-1) | (merged == 255).all(-1)
    assert 0.2 < marks.mean() < 0.6  # hatched: to be seen without colours
    right = image[:, 4 * 5 * 6 : 6 * 5 * 6]
    assert not (right == WRONG_RED).all(-1).any()


def test_near_objects_never_share_a_colour():
    ids = np.kron(np.arange(1, 65).reshape(8, 8), np.ones((5, 5), int))
    colors = distinct_colors(ids)
    assert set(colors.values()) <= set(PALETTE) and list(colors) == sorted(colors)
    for a, b in ((0, 1), (1, 0)):
        first, second = ids[: 40 - 5 * a, : 40 - 5 * b], ids[5 * a :, 5 * b :]
        assert all(colors[i] != colors[j] for i, j in zip(first.ravel().tolist(), second.ravel().tolist(), strict=True))


def test_maps_without_truth_take_their_colours_from_the_first():
    comparison = compare_maps("toy", [("K 5", "", toy_map()), ("K 30", "", toy_map(k_percent=30.0))])
    first, second = comparison.panels
    assert not comparison.has_truth and set(second.verdicts.values()) == {Verdict.UNJUDGED}
    assert np.array_equal(first.colors, second.colors)  # pieces keep the colour of the whole
    assert len(np.unique(second.instance)) > len(np.unique(first.instance))
    only = compare_maps("toy", [("K 5", "", toy_map())], keep=lambda i: i.label == "chair")
    assert set(np.unique(only.reference.instance)) == {0, 1, 3, 4}


def test_the_picture_is_a_whole_png_north_up(tmp_path):
    comparison = compare_report(drawn_report(drawn("1.\n.."), drawn("1.\n..")))
    save_png(render(comparison), tmp_path / "maps.png")
    image = cv2.imread(str(tmp_path / "maps.png"))
    assert image is not None and [p.name for p in tmp_path.iterdir()] == ["maps.png"]
    rows, cols = np.nonzero((image[..., ::-1] == PALETTE[0]).all(-1))
    assert len(rows) and np.ptp(cols) > image.shape[1] / 3  # on both panels
    shown = panel_image(comparison.reference, 2)
    assert (shown[:8, :8] == PALETTE[0]).all(-1).any() and not (shown[8:] == PALETTE[0]).all(-1).any()
    for bad in (tmp_path / "maps.jpg", tmp_path / "no" / "maps.png", tmp_path):
        with pytest.raises(InputError):
            save_png(render(comparison), bad)


def test_an_evaluation_writes_what_was_asked_for(cafe, tmp_path):
    config = EvaluationConfig(
        str(cafe.path), methods="5,0", errors="none,light", seeds=2, counts="chairs=17",
        picture=tmp_path / "maps.png", output=tmp_path / "report.json", rules=RULES,
    )  # fmt: skip
    result = run_evaluation(config, by_k)
    written = json.loads((tmp_path / "report.json").read_text())
    assert written == json.loads(json.dumps(result.to_json())) and len(written["rows"]) == 4
    assert written["counts"]["5"][0]["expected"] == 17
    assert len(result.comparison.panels) == 5 and len(result.tables()) == 4
    assert cv2.imread(str(tmp_path / "maps.png")) is not None


def test_a_scan_without_truth_can_be_counted_but_not_scored(tmp_path):
    scan = write_tiny_sequence(tmp_path)
    with pytest.raises(InputError, match="--truth"):
        run_evaluation(EvaluationConfig(str(scan), methods="5"), by_k)
    result = run_evaluation(EvaluationConfig(str(scan), methods="5,0", counts="chair=3", min_count_cells=16), by_k)
    assert result.report is None and result.to_json()["rows"] == []
    assert [c.difference for c in result.counts["0"]] == [-1]
    assert result.tables()[0].rows == (("chair", "3", "2", "-1", "2", "-1"),)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"methods": ""}, "method"), ({"errors": "lite"}, "lite"), ({"seeds": 0}, "seed"),
        ({"counts": "piano=1"}, "piano"),
        ({"picture": Path("x.gif")}, "png"), ({"output": Path("no/such/folder.json")}, "folder"),
        ({"sequence": "no-such-folder"}, "no-such-folder"), ({"truth": Path("none.json")}, "none.json"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_before_anything_is_built(cafe, changes, message):
    def build(source, name):
        raise AssertionError("built")

    with pytest.raises(InputError, match=message):
        run_evaluation(EvaluationConfig(**({"sequence": str(cafe.path)} | changes)), build)
