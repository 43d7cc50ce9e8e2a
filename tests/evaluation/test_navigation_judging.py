"""Sessions in which people judge runs: blind, in random order, kept whatever happens."""

import json

import pytest

from simaps_viz.errors import InputError
from simaps_viz.evaluation.judging import HumanScore, resume_session, start_session

RUNS = [
    {"method": method, "errors": "light", "seed": 0, "command": f"go to the chair {i}", "start": [0, 0, 90],
     "track": [[0, 0], [1, i]], "status": "ok", "automatic": True, "strict": False, "wrong": "x", "meant": []}
    for i in range(6)
    for method in ("vlmaps", "paper")
]  # fmt: skip


def judge_all(session, verdict):
    order = []
    while (run := session.next_run()) is not None:
        order.append(run)
        session.judge(run.run_id, verdict(run))
    return order


def test_runs_come_blind_once_each_in_seeded_order(tmp_path):
    shown = judge_all(start_session(tmp_path / "a.jsonl", RUNS, seed=1), lambda run: "yes")
    again = judge_all(start_session(tmp_path / "b.jsonl", RUNS, seed=1), lambda run: "no")
    other = judge_all(start_session(tmp_path / "c.jsonl", RUNS, seed=2), lambda run: "no")
    commands = [run.shown["command"] for run in shown]
    assert commands == [run.shown["command"] for run in again]
    assert commands != [run.shown["command"] for run in other]
    assert sorted(commands) == sorted(str(run["command"]) for run in RUNS)
    assert [(run.number, run.total) for run in shown] == [(n, 12) for n in range(1, 13)]
    for run in shown:
        told = json.dumps([run.run_id, dict(run.shown)])
        assert set(run.shown) == {"command", "start", "track", "status"}
        assert "vlmaps" not in told
        assert "paper" not in told


def test_a_session_goes_on_after_a_restart(tmp_path):
    path = tmp_path / "session.jsonl"
    session = start_session(path, RUNS)
    first = session.next_run()
    assert first is not None
    assert session.next_run() == first
    session.judge(first.run_id, "yes")
    second = session.next_run()
    resumed = resume_session(path)
    assert resumed.next_run() == second
    assert resumed.answers == {first.run_id: "yes"}
    assert resumed.summary() == session.summary()


def test_an_answer_is_on_the_disk_before_judging_returns(tmp_path):
    path = tmp_path / "session.jsonl"
    session = start_session(path, RUNS)
    session.judge("run-0003", "no")
    assert json.loads(path.read_text().splitlines()[-1]) == {"event": "answer", "run_id": "run-0003", "answer": "no"}


@pytest.mark.parametrize(
    "torn", ['{"event": "answer", "run_', '{"event": "answer", "run_id": "run-0002", "answer": "yes"}']
)
def test_a_line_cut_short_by_a_crash_is_cut_off(tmp_path, torn):
    path = tmp_path / "session.jsonl"
    start_session(path, RUNS).judge("run-0001", "no")
    with path.open("a") as file:
        file.write(torn)
    resumed = resume_session(path)
    assert resumed.answers == {"run-0001": "no"}
    resumed.judge("run-0002", "skip")
    assert resume_session(path).answers == {"run-0001": "no", "run-0002": "skip"}


def test_the_summary_counts_the_last_answer_of_each_run(tmp_path):
    path = tmp_path / "session.jsonl"
    session = start_session(path, RUNS)
    of = {run["run_id"]: run["method"] for run in session.runs}
    mine = [run_id for run_id, method in of.items() if method == "paper"]
    for run_id, verdict in zip(mine, ("yes", "yes", "no", "skip", "no"), strict=False):
        session.judge(run_id, verdict)
    session.judge(mine[4], "yes")  # thought better of it
    summary = resume_session(path).summary()
    assert summary["light", "paper"] == HumanScore(yes=3, no=1, skipped=1, left=1)
    assert summary["light", "vlmaps"] == HumanScore(left=6)
    assert (summary["light", "paper"].share, summary["light", "vlmaps"].share) == (0.75, None)


@pytest.mark.parametrize(("run_id", "verdict"), [("run-0099", "yes"), ("run-0001", "maybe")])
def test_senseless_answers_are_refused_and_not_written(tmp_path, run_id, verdict):
    path = tmp_path / "session.jsonl"
    session = start_session(path, RUNS)
    before = path.read_bytes()
    with pytest.raises(InputError, match="judging: expected"):
        session.judge(run_id, verdict)
    assert path.read_bytes() == before


def test_bad_files_are_named(tmp_path):
    with pytest.raises(InputError, match="at least one run"):
        start_session(tmp_path / "none.jsonl", [])
    path = tmp_path / "session.jsonl"
    start_session(path, RUNS)
    with pytest.raises(InputError, match="new file"):
        start_session(path, RUNS)
    lines = path.read_text().splitlines(keepends=True)
    for content, words in (
        ("", "session file"),
        ("{}\n", "session file"),
        ("".join(lines[:5]), "12 runs, found 4"),
        (lines[0] + "not JSON\n", "line 2"),
        ("".join(lines) + '{"event": "answer", "run_id": "run-0001", "answer": "perhaps"}\n', "line 14"),
    ):
        bad = tmp_path / "bad.jsonl"
        bad.write_text(content)
        with pytest.raises(InputError, match=words):
            resume_session(bad)
    with pytest.raises(InputError, match="session file"):
        resume_session(tmp_path / "missing.jsonl")
    assert [p.name for p in tmp_path.iterdir() if "partial" in p.name] == []
