"""Commands made from the truth, runs judged by it, and the success table."""

import json
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from toy_maps import TOY_POSE, toy_map
from worlds import world_of, write_room

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.evaluation.navigation import (
    TRUE_MAP,
    Drive,
    automatic_share,
    carry_out,
    evaluate_navigation,
    gains_over,
    judge,
    navigation_json,
    navigation_text,
    strict_share,
    true_objects_of,
)
from simaps_viz.evaluation.tasks import AWAY_M, FAMILIES, PHRASINGS, Task, TrueGoal, is_ambiguous, make_tasks
from simaps_viz.language.commands import read_command
from simaps_viz.navigation.agent import answer
from simaps_viz.structures import Pose2

pytestmark = pytest.mark.slow

TOY = toy_map()
WORLD = world_of(TOY)
SHOWS = true_objects_of(TOY, WORLD)


def build(source, method):
    return build_map(source, BuildConfig(k_percent=float(method.removeprefix("paper K="))))


@cache
def tasks_of(seed):
    return make_tasks(WORLD, count=60, seed=seed)


@pytest.fixture
def tasks():
    return tasks_of(1)


# ---- commands


def test_commands_are_many_and_mixed(tasks):
    assert [task.number for task in tasks] == list(range(60))
    counts = Counter(task.family for task in tasks)
    assert set(counts) == set(FAMILIES)
    assert len({(task.command, task.goals) for task in tasks}) == 60
    assert all(task.wants_refusal == (task.family == "absent") for task in tasks)
    assert {len(task.goals) for task in tasks if task.family == "multi-goal"} <= {2, 3}


def test_commands_depend_on_the_seed_and_on_nothing_else(tasks):
    assert make_tasks(WORLD, count=60, seed=1) == tasks
    assert tasks_of(0) != tasks


def test_starts_are_free_and_away_from_the_first_goal(tasks):
    for task in tasks:
        here = np.array([[task.start.x_m, task.start.y_m]])
        assert WORLD.clearance_m(here)[0] >= WORLD.robot.radius_m
        if task.goals:
            point = task.goals[0].point_m
            off = WORLD.by_id(task.goals[0].object).distance_m(here[0])
            assert (np.hypot(*(np.array(point) - here[0])) if point else off) >= AWAY_M


@pytest.mark.parametrize("seed", [0, 1])
def test_on_the_true_map_every_command_is_carried_out(seed):
    wrong = []
    for task in tasks_of(seed):
        said, _, verdict = carry_out(WORLD, TOY, SHOWS, task)
        if not (verdict.strict and verdict.automatic):
            wrong.append((task.command, task.start, said.reason, verdict.reason))
    assert wrong == []


WORDS = {
    "x": "chair", "y": "couch", "z": "potted plant", "nth": "second", "side": "south", "most": "southernmost",
    "absent": "piano", "beyond": "ninth",
}  # fmt: skip
MEANS = {
    PHRASINGS["only"]: 'robot.move_to_object("chair")',
    PHRASINGS["closest"]: 'robot.move_to_object("chair")',
    PHRASINGS["nth"]: 'robot.move_to_nth_closest("chair", 2)',
    PHRASINGS["from_side"]: 'robot.move_to_object(nth(order(things("chair"), "south"), 2))',
    PHRASINGS["outermost"][:2]: 'robot.move_to_object(first(order(things("chair"), "south")))',
    PHRASINGS["outermost"][2:]: 'robot.move_to_object(nth(order(things("chair"), "south"), 1))',
    PHRASINGS["near"]: 'robot.move_to_object(nearest(things("chair"), 1, nearest(things("couch"))))',
    PHRASINGS["next_to"]: 'robot.move_to_object(nearest(near(things("chair"), "couch", 3), 1, "couch"))',
    PHRASINGS["between"]: 'robot.move_in_between("chair", "couch")',
    PHRASINGS["compass"]: 'robot.move_south("chair")',
    PHRASINGS["in_view"]: 'robot.move_to_object(nth(visible(things("chair")), 2))',
    PHRASINGS["first_in_view"][:2]: 'robot.move_to_object(nearest(visible(things("chair"))))',
    PHRASINGS["first_in_view"][2:]: 'robot.move_to_object(visible(things("chair")))',
}


@pytest.mark.parametrize(("wording", "program"), [(w, p) for wordings, p in MEANS.items() for w in wordings])
def test_every_wording_is_read_as_its_family_means_it(wording, program):
    reading = read_command(wording.format(**WORDS), tuple(TOY.counts()))
    assert reading.program == program
    assert not reading.alternatives


@pytest.mark.parametrize("wording", PHRASINGS["multi"])
def test_several_goals_are_read_in_order(wording):
    lines = [f'robot.move_to_object("{WORDS[k]}")' for k in "xyz" if f"{{{k}}}" in wording]
    assert read_command(wording.format(**WORDS), tuple(TOY.counts())).program.splitlines() == lines


@pytest.mark.parametrize("wording", PHRASINGS["absent"])
def test_what_is_absent_is_refused_on_the_true_map(wording):
    said = answer(TOY, wording.format(**WORDS), TOY_POSE)
    assert said.status == "refused"


def test_ambiguous_words_are_not_used():
    labels = ("chair", "dining table", "coffee table", "table")
    assert is_ambiguous("table", labels)
    assert not is_ambiguous("chair", labels)


# ---- judging


def verdict_of(goals, stops, *, command="go to the couch", contact=None, shows=SHOWS, start=TOY_POSE):
    task = Task(0, "plain", command, start, tuple(goals))
    track = np.array([(start.x_m, start.y_m), *stops])
    drive = Drive(track, tuple(stops if contact is None else stops[:-1]), contact)
    return judge(WORLD, shows, task, answer(TOY, command, start), drive)


COUCH = TrueGoal("object", "couch", 5)


def test_ids_of_the_toy_are_what_these_tests_take_them_for():
    assert {i.id: i.label for i in TOY.instances}[5] == "couch"
    assert {i: SHOWS[i] for i in SHOWS} == {i.id: i.id for i in TOY.instances}


# the couch's lowest row of cells has its centres at y = 2.225, x from 3.025
@pytest.mark.parametrize(("off_m", "right"), [(0.3, True), (1.0, True), (1.01, False)])
def test_one_metre_is_near_and_more_is_not(off_m, right):
    verdict = verdict_of([COUCH], [(3.525, 2.225 - off_m)])
    assert verdict.automatic is verdict.strict is right
    assert (verdict.reason is None) is right


def test_a_collision_near_the_goal_is_automatic_but_not_strict():
    verdict = verdict_of([COUCH], [(3.5, 1.7)], contact=(3.5, 1.72))
    assert (verdict.automatic, verdict.strict) == (True, False)
    assert "collided" in (verdict.reason or "")
    assert not verdict_of([COUCH], [(3.5, 0.5)], contact=(3.5, 0.52)).automatic


def test_another_object_on_the_judged_map_is_not_strict():
    verdict = verdict_of([COUCH], [(3.5, 1.9)], shows={**SHOWS, 5: 8})
    assert (verdict.automatic, verdict.strict) == (True, False)
    assert verdict.reason == "went to 8 instead of couch 5"


def test_goals_count_in_order():
    goals = [COUCH, TrueGoal("object", "potted plant", 9)]
    command, there, then = "go to the couch, then to the potted plant", (3.5, 1.9), (4.2, -1.4)
    assert verdict_of(goals, [there, then], command=command).strict
    assert not verdict_of(goals, [then, there], command=command).automatic
    assert not verdict_of(goals, [there], command=command).automatic


def test_the_side_and_the_gap_are_checked():
    beside = TrueGoal("beside", "couch", 5, side="south", point_m=(3.6, 1.7))
    command = "go to the south side of the couch"
    assert verdict_of([beside], [(3.6, 1.7)], command=command).strict
    off = verdict_of([beside], [(2.5, 2.4)], command=command)
    assert (off.automatic, off.strict) == (True, False)
    gap = TrueGoal("between", "couch", 5, other=8, point_m=(3.7, 1.4))
    command = "go between the couch and the dining table"
    looking = Pose2.from_heading(3.0, 1.0, 90.0)
    assert verdict_of([gap], [(3.7, 1.4)], command=command, start=looking).strict
    wrong = replace(gap, other=6)
    assert not verdict_of([wrong], [(3.7, 1.4)], command=command, start=looking).strict
    assert not verdict_of([gap], [(3.7, 0.39)], command=command, start=looking).automatic


def test_refusing_is_right_only_when_there_is_nothing():
    assert verdict_of([], [], command="go to the piano").strict
    assert not verdict_of([], [], command="go to the couch").automatic
    refused = verdict_of([COUCH], [], command="go to the piano")
    assert not refused.automatic
    assert "refused" in (refused.reason or "")


def test_an_instance_is_the_object_it_shares_most_cells_with():
    merged = np.where(TOY.instance == 3, 1, TOY.instance).astype(np.int32)  # chair 3 is called chair 1
    merged[20:22, 12:20] = 0  # and a part of it is lost
    one = replace(TOY, instance=merged, instances=tuple(i for i in TOY.instances if i.id != 3))
    shows = true_objects_of(one, WORLD)
    assert shows[1] == 1
    assert set(shows) == {i.id for i in one.instances}
    elsewhere = replace(TOY, instance=np.roll(TOY.instance, 40, axis=0))
    assert 0 in true_objects_of(elsewhere, WORLD).values()


def test_a_map_that_glues_two_chairs_misses_the_further_one():
    glued = toy_map(k_percent=0.0)
    chairs = [t for t in tasks_of(1) if t.family == "n-th closest" and t.goals[0].object == 4]
    assert chairs
    shows = true_objects_of(glued, WORLD)
    assert not any(carry_out(WORLD, glued, shows, task)[2].automatic for task in chairs)


# ---- the experiment


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    sequence = open_sequence(write_room(tmp_path_factory.mktemp("room")))
    told: list[tuple[str, int, int]] = []
    found = evaluate_navigation(
        sequence, [TRUE_MAP, "paper K=5"], build=build, errors=["none", "heavy"], seeds=[0, 1], commands=18,
        progress=lambda *event: told.append(event),
    )  # fmt: skip
    assert told[-1][1:] == (2 * 2 * 2 * 18,) * 2
    return found


def test_the_true_map_gets_everything_right(report):
    assert [run.verdict.reason for run in report.runs if run.method == TRUE_MAP and not run.verdict.strict] == []
    assert len(report.of("none", TRUE_MAP)) == 36


def test_exact_masks_of_things_apart_are_enough_for_the_paper(report):
    assert strict_share(report.of("none", "paper K=5")) >= 0.95
    worse = report.of("heavy", "paper K=5")
    assert strict_share(worse) <= automatic_share(worse) < strict_share(report.of("none", "paper K=5"))


def test_all_methods_get_the_same_commands(report):
    def asked(method):
        return [(r.seed, r.task) for r in report.of("heavy", method)]

    assert asked(TRUE_MAP) == asked("paper K=5")


def test_the_table_says_what_was_measured(report):
    text = navigation_text(report)
    runs = report.of("heavy", "paper K=5", "plain")
    assert f"{automatic_share(runs):.2f} / {strict_share(runs):.2f}" in next(
        line for line in text.split("heavy")[1].splitlines() if line.startswith("plain")
    )
    assert "simulated" in text
    assert "2305.12363" in text
    assert max(map(len, text.splitlines())) <= 120


def test_the_json_has_every_run_and_nothing_json_lacks(report):
    record = json.loads(json.dumps(navigation_json(report), allow_nan=False))
    assert len(record["runs"]) == len(report.runs) == 144
    share = next(
        s for s in record["shares"]
        if (s["errors"], s["method"], s["family"]) == ("heavy", "paper K=5", None)
    )  # fmt: skip
    own = [r for r in record["runs"] if (r["errors"], r["method"]) == ("heavy", "paper K=5")]
    assert share["commands"] == len(own) == 36
    assert share["strict"] == pytest.approx(sum(r["strict"] for r in own) / 36)


def test_gains_are_over_the_baseline(report):
    renamed = replace(
        report,
        runs=tuple(replace(r, method="vlmaps" if r.method == "paper K=5" else "other") for r in report.runs),
    )
    gain = gains_over(renamed, "vlmaps")["heavy", "other"]
    assert gain == pytest.approx(100.0 * (1.0 / strict_share(report.of("heavy", "paper K=5")) - 1.0))
    assert gains_over(report, "vlmaps") == {}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"methods": []}, "methods"),
        ({"errors": ["slight"]}, "slight"),
        ({"seeds": [1, 1]}, "seeds"),
        ({"commands": 0}, "at least 1 command"),
    ],
)
def test_senseless_requests_are_refused(tmp_path, changes, words):
    sequence = open_sequence(write_room(tmp_path / "room"))
    arguments = {"methods": ["paper K=5"], **changes}
    with pytest.raises(InputError, match=words):
        evaluate_navigation(sequence, arguments.pop("methods"), build=build, **arguments)
