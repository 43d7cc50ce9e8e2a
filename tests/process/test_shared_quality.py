"""How good the maps of a rendered house are, with masks nobody tuned on; skipped, saying so, without that house."""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from benchmarks.paper import OnePass

from simaps_viz import open_sequence, save_map
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource
from simaps_viz.evaluation.evaluate import WithSimulatedErrors
from simaps_viz.evaluation.quality import Scores, score
from simaps_viz.evaluation.truth import Truth, truth_of
from simaps_viz.structures import SIMap

SHARED = Path(__file__).parents[2].parent / "shared"
HOUSE = SHARED / "data" / "aws-small-house" / "rgbd"

pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason=f"{SHARED} is not on this machine")

METHODS = ("evidence", "components", "paper")
"""From the best to the worst."""
ERRORS = "heavy", 102, 0.60
"""Simulated errors, their seed, and the least quality: a seed that the defaults were not chosen on."""


@pytest.fixture(scope="module")
def house() -> PosedFrames:
    return open_sequence(HOUSE)


def built(masks: FrameSource) -> dict[str, SIMap]:
    """The maps that `build` makes by each method, the frames read once."""
    one_pass = OnePass()
    return {method: one_pass(masks, method) for method in METHODS}


@pytest.fixture(scope="module")
def exact_maps(house) -> Mapping[str, SIMap]:
    return built(house)


@pytest.fixture(scope="module")
def files(exact_maps, tmp_path_factory) -> Mapping[str, Path]:
    folder = tmp_path_factory.mktemp("house")
    for method, simap in exact_maps.items():
        save_map(simap, folder / f"{method}.npz")
    return {method: folder / f"{method}.npz" for method in exact_maps}


def judged(path: Path, house: Path, *labels: str) -> dict[str, Any]:
    """Scores by a program that shares no code with ours."""
    command = [sys.executable, str(SHARED / "tools" / "score_map.py"), str(path), str(house), *labels]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.fixture(scope="module")
def truth(house, exact_maps) -> Truth:
    return truth_of(exact_maps["evidence"], house)


def scores_by_method(masks: FrameSource, truth: Truth) -> dict[str, Scores]:
    return {method: score(simap, truth) for method, simap in built(masks).items()}


def overall(scores: Mapping[str, Scores]) -> dict[str, float]:
    return {method: one.overall.pq or 0.0 for method, one in scores.items()}


def in_order(pq: Mapping[str, float]) -> bool:
    ordered = [pq[method] for method in METHODS if method in pq]
    return len(ordered) > 1 and ordered == sorted(ordered, reverse=True)


def test_simulated_errors_cost_little(house, truth):
    level, seed, least = ERRORS
    masks = WithSimulatedErrors(house, level, seed)
    masks.prepare()
    pq = overall(scores_by_method(masks, truth))
    assert pq["evidence"] >= least and in_order(pq), pq


def test_a_real_detector_finds_the_chairs(truth):
    """Most classes of the house are none of its; of the few others, one object decides who leads overall."""
    scores = scores_by_method(open_sequence(HOUSE / "sequence-pred.json"), truth)
    chairs = {method: one.by_class["chair"].pq or 0.0 for method, one in scores.items()}
    assert chairs["evidence"] >= 0.70 and in_order(chairs), chairs
    pq = overall(scores)
    assert pq["evidence"] >= pq["components"] - 0.01 and pq["evidence"] >= pq["paper"] + 0.05, pq


def test_exact_masks_give_nearly_the_true_map(exact_maps, files, truth):
    theirs = judged(files["evidence"], HOUSE)
    assert theirs["pq"] >= 0.97
    chairs = theirs["by_label"]["chair"]
    assert chairs["true"] == chairs["found"] == chairs["matched"] == 8
    ours = {method: score(simap, truth) for method, simap in exact_maps.items()}
    assert ours["evidence"].overall.pq == pytest.approx(theirs["pq"], abs=0.002)
    assert in_order(overall(ours)), overall(ours)
