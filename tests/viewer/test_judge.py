"""People judge runs on the page: blind, saved at once, by button and by key; and what `simaps judge` refuses."""

import json
import re

import numpy as np
import pytest
from browser import field_of, mine, open_workbench, toy_workbench, until, watched_page
from fake_page import fake_page
from playwright.sync_api import expect
from services import real_services
from toy_maps import toy_map

from simaps_viz.cli.main import main
from simaps_viz.evaluation.judging import resume_session, start_session
from simaps_viz.mapping.file import save_map
from simaps_viz.structures import Pose2
from simaps_viz.viewer.panels import judge
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.judge import (
    FIRST_S,
    PAUSE_S,
    JudgePanel,
    named_in,
    outcome_text,
    position_labels,
    summary_html,
    timed_trajectory,
)

pytestmark = pytest.mark.slow

METHODS = ("evidence", "components")


def run(method="evidence", command="go to the couch", **others):
    start = [0.5, 0.5, 90.0]
    track = [[0.5, 0.5], [1.5, 0.5], [2.5, 0.5]]
    return {
        "method": method, "errors": "light", "seed": 0, "command": command, "start": start, "track": track,
        "stops": [[2.5, 0.5]], "collision": None, "status": "ok", "automatic": True, "strict": True, "wrong": None,
        "reason": "secret", "program": "secret", "planned": [], "meant": [], **others,
    }  # fmt: skip


@pytest.fixture
def session(tmp_path):
    return start_session(tmp_path / "runs.jsonl", [run(method) for method in METHODS])


@pytest.fixture
def hasty(monkeypatch):
    """Every answer is taken, however soon it comes."""
    monkeypatch.setattr(judge, "LOOK_FIRST_S", 0.0)


def judge_of(bench):
    panel = mine(bench).panels[JudgePanel]
    assert panel is not None
    return panel


def text_of(panel):
    return panel._head.content + panel._outcome.content


# --- words and trajectories


def test_what_the_robot_did_is_said_without_a_verdict():
    assert outcome_text(run()) == "The robot drove and stopped once."
    assert outcome_text(run(stops=[[1, 1], [2, 2]])) == "The robot drove and stopped 2 times."
    assert "bumped" in outcome_text(run(collision=[1.0, 0.5]))
    assert "refused" in outcome_text(run(status="refused", track=[[0.5, 0.5]], stops=[]))
    assert "no way" in outcome_text(run(status="failed", track=[[0.5, 0.5]], stops=[]))
    assert outcome_text(run(track=[[0.5, 0.5]], stops=[])) == "The robot did not move."


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("go to the third chair", ["chair"]),
        ("move between the chairs and the couches", ["chair", "couch"]),
        ("visit both tables", ["dining table"]),
        ("find the potted plant", ["potted plant"]),
        ("turn left", []),
    ],
)
def test_the_things_a_command_names_are_found(command, named):
    assert named_in(command, ["chair", "dining table", "couch", "potted plant"]) == named


def test_a_trajectory_waits_at_the_start_and_at_each_stop_in_order():
    track = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.0, 0.0]])
    timed = timed_trajectory(Pose2(0.0, 0.0, 0.0), track, [[2.0, 0.0], [1.0, 0.0]])
    assert timed.at(FIRST_S - 0.01).x_m == 0.0
    plain = timed_trajectory(Pose2(0.0, 0.0, 0.0), track, [])
    assert timed.duration_s == pytest.approx(plain.duration_s + 2 * PAUSE_S)
    end = timed.at(timed.duration_s)
    assert (end.x_m, abs(end.yaw_rad)) == pytest.approx((1.0, np.pi))  # as it came
    there = FIRST_S + 2.0 / 0.9
    assert timed.at(there + 0.5 * PAUSE_S).x_m == pytest.approx(2.0)


def test_a_robot_that_did_not_move_is_shown_too():
    timed = timed_trajectory(Pose2(1.0, 2.0, 0.5), np.array([[1.0, 2.0]]), [])
    pose = timed.at(timed.duration_s)
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == (1.0, 2.0, 0.5)


def test_places_name_start_stops_and_collision(session):
    shown = session.next_run()
    named = position_labels(shown, Pose2.from_heading(0.5, 0.5, 90.0))
    assert [label[:3] for label in named] == [("start, looking east", 0.5, 0.5), ("stop", 2.5, 0.5)]


# --- a served page, nobody looking


def test_runs_come_blind_and_every_answer_is_in_the_file(session, hasty):
    with toy_workbench(real_services(judging=session)) as bench, fake_page(bench):
        panel = judge_of(bench)
        for n, verdict in enumerate(("yes", "no"), start=1):
            assert f"{n} of 2" in text_of(panel) and "go to the couch" in text_of(panel)
            for secret in (*METHODS, "secret", "light"):
                assert secret not in re.sub("<[^>]*>", " ", text_of(panel))  # styles say light-dark(...)
            panel.answer(verdict)
            assert list(resume_session(session.path).answers.values())[-1] == verdict
        assert "All runs are judged" in text_of(panel) and panel.run is None
        panel.answer("yes")  # a late key
        assert len(session.answers) == 2
        for method in METHODS:
            assert method in text_of(panel)
        assert "100 %" in text_of(panel) and ">0 %<" in text_of(panel).replace("<b>", "").replace("</b>", "<")


def test_an_answer_in_haste_is_for_the_run_before(session, monkeypatch):
    with toy_workbench(real_services(judging=session)) as bench, fake_page(bench):
        for look_first_s, answered in ((0.0, 1), (1e9, 1), (0.0, 2)):
            monkeypatch.setattr(judge, "LOOK_FIRST_S", look_first_s)
            judge_of(bench).answer("yes")
            assert len(session.answers) == answered


def test_back_answers_anew_and_goes_on(session, hasty):
    with toy_workbench(real_services(judging=session)) as bench, fake_page(bench):
        panel = judge_of(bench)
        first = panel.run
        assert first is not None
        panel.back()  # there is nothing before the first
        assert panel.run == first
        panel.answer("no")
        second = panel.run
        panel.back()
        assert panel.run == first
        panel.answer("yes")
        assert panel.run == second and session.answers == {first.run_id: "yes"}


def test_a_full_disk_is_told_and_the_run_stays(session, hasty):
    with toy_workbench(real_services(judging=session)) as bench, fake_page(bench):
        session.path.unlink()
        session.path.mkdir()
        judge_of(bench).answer("yes")
        assert "Not saved" in text_of(judge_of(bench)) and "1 of 2" in text_of(judge_of(bench))


def test_the_command_tab_takes_the_robot_and_the_judge_takes_it_back(session):
    with toy_workbench(real_services(judging=session)) as bench, fake_page(bench):
        panel = judge_of(bench)
        panel._drive.speed = 0.05  # so that the drive is not over when it is looked at
        panel.replay()
        assert panel._drive.active
        mine(bench).panels[CommandPanel]._drive.speed = 8.0
        mine(bench).panels[CommandPanel].ask("turn left")
        assert not panel._drive.active and bench.wait_idle()
        panel.replay()
        assert panel._drive.active and not mine(bench).panels[CommandPanel].driving


def test_the_summary_has_a_table_for_each_kind_of_errors(tmp_path):
    runs = [run(method, errors=errors) for method in METHODS for errors in ("none", "light")]
    opened = start_session(tmp_path / "runs.jsonl", runs)
    html = summary_html(opened)
    assert html.count("<table") == 2 and "none errors" not in html and "–" in html


# --- the command


def test_judge_refuses_what_is_no_session_or_another_scene(tmp_path, capsys):
    save_map(toy_map(), tmp_path / "toy.npz")
    judge = ["judge", str(tmp_path / "runs.jsonl"), str(tmp_path / "toy.npz"), "--no-browser"]
    assert main(judge) == 2
    assert "expected a session file" in capsys.readouterr().err
    start_session(tmp_path / "runs.jsonl", [run(start=[99.0, 0.0, 0.0])])
    assert main(judge) == 2
    assert "starts off it, at (99, 0) m" in capsys.readouterr().err.replace("\n", " ")
    assert main([*judge[:2], str(tmp_path / "no.npz")]) == 2
    assert "no.npz" in capsys.readouterr().err.replace("\n", "")


# --- a person


def test_a_person_judges_by_button_and_by_key(browser, tmp_path, hasty):
    session = start_session(
        tmp_path / "runs.jsonl", [run(m, c) for m in METHODS for c in ("go east", "go to the couch")]
    )
    services = real_services(judging=session)
    with toy_workbench(services) as bench, watched_page(browser) as page:
        open_workbench(page, bench)
        expect(page.get_by_role("tab", name="Judge")).to_have_attribute("aria-selected", "true")
        expect(page.get_by_text("1 of 4")).to_be_visible()
        expect(page.get_by_text("Did it do what was asked?")).to_be_visible()
        page.wait_for_function("() => '/path' in window.__viserMutable.nodeRefFromName")
        page.get_by_role("button", name="Yes (key Y)").click()
        expect(page.get_by_text("2 of 4")).to_be_visible()
        page.keyboard.press("n")
        expect(page.get_by_text("3 of 4")).to_be_visible()
        page.get_by_role("tab", name="Command", exact=True).click()
        field_of(page, "Command").press_sequentially("yes, no, say")  # letters in a text are no answers
        # The text is sent after the keys: where it has arrived, an answer would have, too.
        until(page, lambda: mine(bench).panels[CommandPanel]._text.value == "yes, no, say")
        assert list(session.answers.values()) == ["yes", "no"]
        page.get_by_role("tab", name="Judge").click()
        page.keyboard.press("s")
        expect(page.get_by_text("4 of 4")).to_be_visible()
        page.reload()
        expect(page.get_by_text("4 of 4")).to_be_visible()
        page.get_by_role("button", name="No (key N)").click()
        expect(page.get_by_text("All runs are judged")).to_be_visible()
        until(page, lambda: len(session.answers) == 4)
    answers = [json.loads(line) for line in session.path.read_text().splitlines()][-4:]
    assert [line["answer"] for line in answers] == ["yes", "no", "skip", "no"]
