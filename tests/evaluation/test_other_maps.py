"""Maps for the page's comparison: made once, in the grid of the map on the page; the truth; giving up."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import write_tiny_sequence
from toy_maps import toy_map

from simaps_viz.app import workbench
from simaps_viz.build.methods import build
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.console.progress import stage_progress
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.evaluation.evaluate import PRECOMPUTED
from simaps_viz.evaluation.space import evaluate_space
from simaps_viz.evaluation.two_maps import TRUTH, MapMaker, compare_two, config_like
from simaps_viz.mapping.edits import apply, delete
from simaps_viz.viewer.page.shared import Shared
from simaps_viz.viewer.panels.compare import Cancelled, headline_html


@pytest.fixture
def tiny(tmp_path):
    sequence = open_sequence(write_tiny_sequence(tmp_path / "tiny", truth="instances"))
    return sequence, build(sequence, "evidence", BuildConfig(min_cells=1)), tmp_path / "cache"


def test_a_map_is_made_once_and_found_again_later(tiny):
    sequence, simap, folder = tiny
    told = []
    maker = MapMaker(sequence, folder)
    first = maker.make("components", simap, lambda *what: told.append(what))
    assert first.method == "components" and first.spec.cell_size_m == simap.spec.cell_size_m
    assert first.parameters["min_cells"] == 1
    assert told[-1][1:] == (3, 3) and "components" in told[-1][0]
    told.clear()
    assert maker.make("components", simap, lambda *what: told.append(what)) is first
    later = MapMaker(sequence, folder).make("components", simap, lambda *what: told.append(what))
    assert told == [] and np.array_equal(later.instance, first.instance)


def test_a_map_that_was_built_before_is_taken(tiny, monkeypatch):
    """What opening a sequence by another method has left in the cache need not be built again."""
    sequence, simap, folder = tiny
    monkeypatch.setenv("SIMAPS_CACHE", str(folder))
    with stage_progress(quiet=True) as progress:
        built, record = workbench.cached_build(sequence, "paper", config_like(simap), progress)
    told = []
    maker = MapMaker(sequence, folder)
    found = maker.make("paper", simap, lambda *what: told.append(what))
    assert told == [] and np.array_equal(found.instance, built.instance) and found.method == "paper"
    assert record.parent == folder / "maps" and len(list(record.parent.glob("*.npz"))) == 1
    other = replace(simap, parameters={**simap.parameters, "min_cells": 2})
    maker.make("paper", other, lambda *what: told.append(what))
    assert told and len(list(record.parent.glob("*.npz"))) == 2
    told.clear()
    sequence.path.write_text(sequence.path.read_text() + "\n")
    maker.make("paper", simap, lambda *what: told.append(what))
    assert told and len(list(record.parent.glob("*.npz"))) == 3


def test_the_truth_is_offered_where_ids_are_exact_and_agrees_with_a_perfect_map(tiny):
    sequence, simap, folder = tiny
    maker = MapMaker(sequence, folder)
    assert [s.key for s in maker.sources(simap)] == [TRUTH, "components", "paper", "vlmaps", "vlmaps+components"]
    told = []
    truth = maker.make(TRUTH, simap, lambda *what: told.append(what))
    assert [done for _, done, _ in told] == [*range(1, len(sequence) + 1)]
    assert {total for _, _, total in told} == {len(sequence)}
    compared = compare_two(("Truth", truth), ("Map", simap), truth="left")
    assert compared.score is not None and compared.score.true == 0
    assert compared.left.ignored + compared.right.ignored == 4  # 16 cells each: by the rules of a score too few
    peers = compare_two(("Truth", truth), ("Map", simap))
    assert peers.same == len(simap.instances) == 2 and not peers.items
    assert compared.space is None and peers.space is None  # the true map knows no surface
    assert MapMaker(None, folder).sources(simap) == ()
    assert all("simulated" in s.title for s in maker.sources(simap) if s.key.startswith("vlmaps"))


def test_in_space_the_truth_is_that_of_the_scores_and_two_maps_agree_with_each_other(tiny):
    sequence, simap, folder = tiny
    told, maker = [], MapMaker(sequence, folder)
    exact = maker.truth_in_space(simap, lambda *what: told.append(what))
    assert len(told) == len(sequence) and maker.truth_in_space(simap, lambda *what: told.append(what)) is exact
    assert len(told) == len(sequence)
    judged = maker.scores_in_space(simap, lambda *what: told.append(what))
    assert len(told) == len(sequence)
    (row,) = [
        one for one in evaluate_space(sequence, ("evidence",), errors=(PRECOMPUTED,), build=lambda *_: simap).runs
        if one.method == "evidence"
    ]  # fmt: skip
    assert judged == row.scores and judged.overall.true == 2

    # A map is all that it is itself; another that lacks an object has half of the pairs.
    lesser = apply(simap, delete(simap, simap.instances[0].id))
    same, lacks = (compare_two(("a", simap), ("b", other)).space for other in (simap, lesser))
    assert same is not None and lacks is not None
    assert same.overall.pq == same.strict.pq == same.boxes.f1_50 == same.volume_ratio == 1.0
    assert (lacks.overall.true, lacks.overall.found, lacks.overall.matched) == (2, 1, 1)
    assert "In space: PQ 0.67" in headline_html(compare_two(("a", simap), ("b", lesser)))
    surface = replace(simap, surface=None, hidden=())
    assert compare_two(("a", simap), ("b", surface)).space is compare_two(("a", surface), ("b", simap)).space is None


def test_giving_up_leaves_nothing_behind(tiny):
    sequence, simap, folder = tiny

    def stop(what, done, total):
        raise Cancelled

    maker = MapMaker(sequence, folder)
    for key in ("components", TRUTH):
        with pytest.raises(Cancelled):
            maker.make(key, simap, stop)
    with pytest.raises(Cancelled):
        maker.truth_in_space(simap, stop)
    assert not list(folder.rglob("*.npz"))
    assert maker.make("components", simap, lambda *what: None).method == "components"


def test_without_a_sequence_one_line_says_so(tmp_path):
    with pytest.raises(InputError, match="expected the sequence the map was built from, found none"):
        MapMaker(None, tmp_path).make("paper", toy_map(), lambda *what: None)
    with pytest.raises(InputError, match="with exact ids, found none"):
        MapMaker(None, tmp_path).truth_in_space(toy_map(), lambda *what: None)
    assert workbench.look_back(lambda: tmp_path / "no.npz")(toy_map(), 0) is None


def test_other_settings():
    shared = Shared(workbench.services_of(toy_map()))
    assert len(shared.cut_map(toy_map(), 0.0, 1.0).of_class("chair")) == 2
    assert len(shared.cut_map(toy_map(), 30.0, 1.0).of_class("chair")) == 4
    assert shared.cut_map(toy_map(), 5.0, 3.0).parameters["resolution"] == 3.0
