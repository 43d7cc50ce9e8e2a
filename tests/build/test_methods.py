"""Methods by name: what each name means, and that unknown ones are refused."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import write_tiny_sequence

from simaps_viz import load_map, save_map
from simaps_viz.baselines import BASELINES
from simaps_viz.build import METHOD_NAMES
from simaps_viz.build.methods import VARIANTS, build, config_of, keeps_log
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.mapping import methods
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.mending import open_mending
from simaps_viz.mapping.method import Method
from simaps_viz.mapping.paper import K_PERCENT, PAPER, Paper
from simaps_viz.mapping.partition import empty_log
from simaps_viz.mapping.simap import joining_percent, recommunity, repartition
from simaps_viz.mapping.votes import VoteSettings

CONFIG = BuildConfig(
    k_percent=7.0, affinity=0.55, resolution=1.5, seed=3, min_cells=2, projection=ProjectionSettings(far_m=5.0)
)
"""Nothing of it is a default, so that what is lost shows."""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"), frames=4))


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("evidence", {"method": "evidence"}),
        ("components", {"method": "components"}),
        ("components-highest", {"method": "components", "votes": VoteSettings(enabled=False)}),
        ("paper", {"method": "paper"}),
        ("paper-k9", {"method": "paper", "k_percent": 9.0}),
        ("paper-literal", {"method": "paper", "literal": True}),
    ],
)
def test_a_name_changes_what_it_says_and_nothing_else(tiny, name, changes):
    config = replace(CONFIG, **changes)
    assert config_of(name, CONFIG) == config
    simap, wanted = build(tiny, name, CONFIG), build_map(tiny, config)
    assert simap.method == config.method and simap.parameters == config.parameters() == wanted.parameters
    assert simap.parameters["min_cells"] == 2 and simap.parameters["far_m"] == 5.0
    assert np.array_equal(simap.instance, wanted.instance) and simap.instances == wanted.instances


def test_every_variant_was_tried_above():
    marks = test_a_name_changes_what_it_says_and_nothing_else.pytestmark
    assert {case[0] for case in marks[0].args[1]} == {*methods.METHODS, *VARIANTS}
    assert set(METHOD_NAMES) - set(methods.METHODS) == {"vlmaps", "vlmaps+components"}


@pytest.mark.parametrize(
    ("method", "has", "has_not"),
    [
        ("evidence", {"affinity": 0.55, "resolution": 1.5, "seed": 3}, {"k_percent", "literal"}),
        ("paper", {"k_percent": 7.0, "resolution": 1.5, "seed": 3, "literal": False}, {"affinity", "votes", "pooling"}),
        ("components", {}, {"affinity", "k_percent", "resolution", "seed", "literal", "evidence", "pooling"}),
    ],
)
def test_a_map_keeps_the_parameters_of_its_method_only(tiny, method, has, has_not):
    parameters = dict(build(tiny, method, CONFIG).parameters)
    assert {name: parameters[name] for name in has} == has and not has_not & set(parameters)
    assert ("votes" in parameters) == (method != "paper") and ("evidence" in parameters) == (method == "evidence")


@pytest.mark.parametrize("method", METHOD_NAMES)
def test_every_method_gives_a_map_that_bears_its_name(tiny, method):
    simap = build(tiny, method)
    assert simap.method == method
    assert set(np.unique(simap.instance[simap.instance > 0]).tolist()) == {i.id for i in simap.instances}
    if method in ("evidence", "components", "paper"):
        assert simap.counts() == {"chair": 2} and sorted(i.cells for i in simap.instances) == [16, 16]


def test_a_method_keeps_a_log_unless_it_is_a_baseline():
    assert [name for name in METHOD_NAMES if keeps_log(name)] == list(methods.METHODS)
    assert all(map(keeps_log, VARIANTS)) and not any(map(keeps_log, BASELINES)) and not keeps_log("louvain")
    assert set(METHOD_NAMES) == {*methods.METHODS, *BASELINES} and METHOD_NAMES[0] == "evidence"
    assert config_of("paper-k9", CONFIG) == replace(CONFIG, method="paper", k_percent=9.0)
    assert all(config_of(name, CONFIG) is CONFIG for name in BASELINES)


def test_the_default_is_evidence(tiny):
    assert BuildConfig().method == "evidence" and METHOD_NAMES[0] == "evidence"
    assert build_map(tiny).parameters == build(tiny, "evidence").parameters


@pytest.mark.parametrize("name", ["", "Evidence", "louvain", "paper-k5", "vlmaps+paper"])
def test_an_unknown_method_is_refused_and_the_known_are_listed(tiny, name):
    with pytest.raises(InputError) as caught:
        build(tiny, name)
    text = str(caught.value)
    assert text.endswith(f"found {name!r}") and "\n" not in text
    listed = text.removeprefix("method: expected one of ").partition(", found ")[0].split(", ")
    assert len(listed) == len(set(listed)) and set(listed) == {*METHOD_NAMES, *VARIANTS}


@pytest.mark.parametrize("affinity", [-0.1, 1.1, float("nan")])
def test_a_senseless_affinity_is_refused(affinity):
    with pytest.raises(InputError, match="affinity: expected a share from 0 to 1"):
        BuildConfig(affinity=affinity)


class EveryClass(Method):
    """All cells of a thing class are one instance."""

    votes = False

    def communities(self, grid, graphs, parameters):
        things = np.array(grid.is_thing)[grid.label] & (grid.label > 0)
        return np.where(things, grid.label, 0).astype(np.int32), empty_log()


EVERY_CLASS = EveryClass("every-class")


def test_a_new_method_is_one_object_and_one_line_of_the_registry(tiny, monkeypatch, tmp_path):
    known = ", ".join(methods.METHODS)
    with pytest.raises(InputError, match=f"method: expected one of {known}, found 'every-class'"):
        BuildConfig(method="every-class")
    monkeypatch.setitem(methods.METHODS, "every-class", f"{__name__}:EVERY_CLASS")
    simap = build_map(tiny, BuildConfig(method="every-class"), log=tmp_path / "log")
    assert simap.method == "every-class" and simap.counts() == {"chair": 1}
    assert simap.instances[0].cells == sum(one.cells for one in build_map(tiny).instances) == 32
    assert keeps_log("every-class") and not {"votes", "resolution", "k_percent"} & set(simap.parameters)
    # What is asked of every map works for its maps too: its slider, its file, its refusals.
    save_map(simap, tmp_path / "map.npz")
    assert load_map(tmp_path / "map.npz").instances == simap.instances and joining_percent(simap) == 0.0
    with pytest.raises(InputError, match="method every-class: expected a map that has k_percent"):
        repartition(simap, k_percent=5.0)


class Closeness(Paper):
    """Method paper, whose slider sets a parameter with a name of its own."""

    slider = replace(K_PERCENT, parameter="closeness")

    def parameters(self, config):
        kept = PAPER.parameters(config)
        return {**kept, "closeness": kept.pop("k_percent")}


CLOSENESS = Closeness("closeness")


def test_a_slider_can_have_a_parameter_of_its_own(tiny, monkeypatch, tmp_path):
    monkeypatch.setitem(methods.METHODS, "closeness", f"{__name__}:CLOSENESS")
    simap, paper = (build_map(tiny, BuildConfig(method=name)) for name in ("closeness", "paper"))
    assert simap.parameters["closeness"] == paper.parameters["k_percent"] == 5.0
    save_map(simap, tmp_path / "map.npz")
    mender = open_mending(tmp_path / "map.npz", simap)
    for k in (0.0, 40.0, 100.0):
        expected = repartition(paper, k_percent=k).instance
        assert joining_percent(other := repartition(simap, closeness=k)) == k and (other.instance == expected).all()
        other = mender.recommunity(simap, resolution=2.0, closeness=k)
        assert (other.instance == recommunity(paper, resolution=2.0, k_percent=k).instance).all()
    with pytest.raises(InputError, match="expected a map that has k_percent, found closeness only"):
        repartition(simap, k_percent=5.0)
