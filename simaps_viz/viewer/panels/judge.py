"""The panel on which people judge runs: blind, one after another; every answer is saved at once."""

import functools
import re
import time
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, Literal

import numpy as np
import viser

from simaps_viz.drawing.theme import DIM_STYLE
from simaps_viz.errors import SIMapsError
from simaps_viz.evaluation.judging import BlindRun, JudgingSession
from simaps_viz.navigation.trajectory import SPEED_HINT, Trajectory, TrajectoryPlayer, poses_along, trajectory
from simaps_viz.structures import Pose2
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, button, button_row
from simaps_viz.viewer.panels.command import message_html
from simaps_viz.viewer.scene.annotations import Label, label_of

_CELL = "padding:.15em .5em;text-align:right"


def run_html(run: BlindRun) -> str:
    """Show a run's command in large letters, and its number."""
    return (
        '<div style="padding:.6em .8em .2em">'
        f'<div style="font-size:.82em;{DIM_STYLE}">Run <b>{run.number} of {run.total}</b> · answers are saved at once'
        "</div>"
        '<div style="font-size:1.5em;line-height:1.25;font-weight:650;margin:.2em 0;overflow-wrap:anywhere">'
        f"“{escape(str(run.shown.get('command', '')))}”</div></div>"
    )


def outcome_text(shown: Mapping[str, Any]) -> str:
    """Describe what the robot did, without whether it was right."""
    stops = len(shown.get("stops") or ())
    moved = len(shown.get("track") or ()) > 1
    if shown.get("collision"):
        return "The robot bumped into something (✖) and stayed there."
    if shown.get("status") == "refused":
        return "The robot refused the command and did not move."
    if shown.get("status") == "failed":
        return "The robot found no way to go on" + ("." if moved else ", and did not move.")
    if not moved:
        return "The robot did not move."
    return "The robot drove and stopped once." if stops == 1 else f"The robot drove and stopped {stops} times."


def summary_html(session: JudgingSession) -> str:
    """Show how people judged each method, in a table for each kind of mask errors."""
    tables: dict[str, list[str]] = {}
    for (errors, method), score in session.summary().items():
        share = "–" if score.share is None else f"{100.0 * score.share:.0f} %"
        cells = "".join(
            f'<td style="{_CELL}">{value}</td>' for value in (score.yes, score.no, score.skipped, f"<b>{share}</b>")
        )
        tables.setdefault(errors, []).append(
            f'<tr><td style="padding:.15em .5em .15em 0">{escape(method)}</td>{cells}</tr>'
        )
    head = "".join(f'<th style="{_CELL};font-weight:500;{DIM_STYLE}">{h}</th>' for h in ("yes", "no", "skip", "right"))
    parts = [
        f'<div style="margin-top:.6em;font-weight:600">{escape(_masks(errors))}</div>'
        f'<table style="border-collapse:collapse;font-variant-numeric:tabular-nums"><tr><th></th>{head}</tr>'
        f"{''.join(rows)}</table>"
        for errors, rows in tables.items()
    ]
    return (
        '<div style="padding:.6em .8em;font-size:.88em;line-height:1.4">'
        '<div style="font-size:1.4em;font-weight:650">All runs are judged</div>'
        "<div>The share of runs that people judged to do what was asked; skipped runs are left out.</div>"
        f"{''.join(parts)}</div>"
    )


def _masks(errors: str) -> str:
    """Describe what the maps were built from."""
    known = {"none": "Exact masks", "precomputed": "The sequence's own masks"}
    return known.get(errors, f"Masks with {errors} simulated errors")


Verdict = Literal["yes", "no", "skip"]
ASKED = "Did it do what was asked?"
LOOK_FIRST_S = 0.4
"""An answer that comes sooner after a run appeared is ignored: it was meant for the run before."""
PAUSE_S = 0.6
"""How long the robot waits at each stop, at normal speed."""
FIRST_S = 1.6
"""How long it waits at the start, so that its heading can be seen."""
MAX_LABELS = 12
_ANSWERS: tuple[tuple[Verdict, str, str, str, viser.IconName], ...] = (
    ("yes", "Yes  (key Y)", "Y", "green", viser.Icon.CHECK),
    ("no", "No  (key N)", "N", "red", viser.Icon.X),
    ("skip", "Skip  (key S)", "S", "gray", viser.Icon.PLAYER_SKIP_FORWARD),
)


class JudgePanel(Panel):
    """Plays the runs of a session on the true map and takes the answers. All pages share the session."""

    def __init__(self, page: Page) -> None:
        """Fill the open container; the page's services have a session to judge."""
        session = page.services.judging
        assert session is not None
        self._page, self._scene, self._session = page, page.scene, session
        self.run: BlindRun | None = None
        """The run that is shown; None when all are judged."""
        self._seen: list[BlindRun] = []
        self._again: BlindRun | None = None
        self._shown_at = 0.0
        self._lock = page.workbench.judging
        self._drive = TrajectoryPlayer(lambda pose, _share, _leg: page.scene.show_robot(pose), lambda: None)
        self._fill(page.gui)

    def built(self) -> None:
        """Show the first run."""
        self.show()

    def show(self) -> None:
        """Show the first run without an answer, or the summary if all have one."""
        with self._lock:
            again, self._again = self._again, None
            self.run = again or self._session.next_run()
            if self.run is None:
                self._show_summary()
                return
            self._show_run(self.run)

    def answer(self, verdict: Verdict) -> None:
        """Save an answer for the run that is shown, and show the next run."""
        with self._lock:
            run = self.run
            if run is None or time.monotonic() - self._shown_at < LOOK_FIRST_S:
                return
            try:
                self._session.judge(run.run_id, verdict)
            except SIMapsError as error:
                self._outcome.content = message_html("Not saved", f"{error}. Answer again.", "bad")
                return
            if run not in self._seen:
                self._seen.append(run)
            self.show()

    def replay(self) -> None:
        """Play the run again."""
        with self._lock:
            if self.run is not None:
                self._show_run(self.run)

    def back(self) -> None:
        """Show the run before this one again; a new answer replaces the old one."""
        with self._lock:
            at = self._seen.index(self.run) if self.run in self._seen else len(self._seen)
            if at > 0:
                self._again = self._seen[at - 1]
                self.show()

    def leave_robot(self) -> None:
        """Stop the robot and clear what this panel drew on the map; ``replay`` draws it again."""
        self._drive.stop()
        self._scene.show_path(np.zeros((0, 2)))
        self._scene.show_candidates(())

    def close(self) -> None:
        """Stop the robot."""
        self._drive.stop()

    def _fill(self, gui: viser.GuiApi) -> None:
        self._head = gui.add_html("")
        self._outcome = gui.add_html("")
        self._question = gui.add_html(f'<div style="padding:.4em .8em 0;font-weight:600">{ASKED}</div>')
        self._buttons = []
        for verdict, label, key, color, icon in _ANSWERS:
            answer = functools.partial(self.answer, verdict)
            self._buttons.append(button(gui, label, answer, color=color, icon=icon))
            command = gui.add_command(f"Judge: {verdict}", hotkey=key, icon=icon)  # pyright: ignore[reportArgumentType]
            command.on_trigger(lambda _, answer=answer: answer())
        self._progress = gui.add_progress_bar(0.0)
        tools = {"Play again": self.replay, "Back": self.back}
        self._tools = button_row(gui, "Run", tools, hint="Back: answer the run before again.")
        self._speed = gui.add_slider("Speed (×)", 0.25, 8.0, 0.25, 2.0, hint=SPEED_HINT)
        self._speed.on_update(lambda _: setattr(self._drive, "speed", float(self._speed.value)))
        self._drive.speed = float(self._speed.value)

    def _show_run(self, run: BlindRun) -> None:
        self._page.claim_robot(self)
        self._shown_at = time.monotonic()
        self._head.content = run_html(run)
        self._outcome.content = message_html("", outcome_text(run.shown), "plain")
        self._progress.value = 100.0 * (run.number - 1) / max(run.total, 1)
        start = Pose2.from_heading(*(float(v) for v in run.shown["start"]))
        track = np.asarray(run.shown.get("track") or [[start.x_m, start.y_m]], np.float64).reshape(-1, 2)
        self._scene.show_path(track)
        self._scene.show_robot(start)
        self._scene.show_candidates([*position_labels(run, start), *self._things(run, start)])
        self._drive.start(timed_trajectory(start, track, run.shown.get("stops") or []))

    def _show_summary(self) -> None:
        self.leave_robot()
        self._head.content = summary_html(self._session)
        for widget in (self._outcome, self._question, self._progress, self._tools, self._speed, *self._buttons):
            widget.visible = False

    def _things(self, run: BlindRun, start: Pose2) -> list[Label]:
        """Label the named things with their distance from the start; without ranks, which would hint at the answer."""
        candidates = self._page.services.candidates
        if candidates is None:
            return []
        texts: list[Label] = []
        for label in named_in(str(run.shown.get("command", "")), list(self._page.simap.counts())):
            for one in candidates(self._page.simap, label, start)[:MAX_LABELS]:
                texts.append(label_of(f"{label} · {one.distance_m:.1f} m", one.instance))
        return texts


def named_in(command: str, labels: Sequence[str]) -> list[str]:
    """Return the classes that a command names, also by the last word of a name only ("table", "plants")."""
    words = set(re.findall(r"[a-z]+", command.lower()))
    words |= {word.removesuffix("es") for word in words} | {word.removesuffix("s") for word in words}
    return [label for label in labels if label.lower().split()[-1] in words]


def position_labels(run: BlindRun, start: Pose2) -> list[Label]:
    """Return labels at the start, the stops and the collision of a run."""
    stops, hit = run.shown.get("stops") or [], run.shown.get("collision")
    texts = [Label(f"start, looking {start.looks}", start.x_m, start.y_m, away_y=1.0)]
    for number, (x, y) in enumerate(stops, start=1):
        texts.append(Label("stop" if len(stops) == 1 else f"stop {number}", float(x), float(y)))
    if hit:
        texts.append(Label("✖ collision", float(hit[0]), float(hit[1])))
    return texts


def timed_trajectory(start: Pose2, track_m: np.ndarray, stops_m: Sequence[Sequence[float]]) -> Trajectory:
    """Return the trajectory along a track [n, 2]: it looks where it drives, and waits at the start and each stop."""
    poses = poses_along(start, track_m, Pose2(float(track_m[-1, 0]), float(track_m[-1, 1]), start.yaw_rad))
    poses = poses[:-1]  # the final heading is not recorded: it keeps the one it arrived with
    # The first pose is doubled, so that the robot can wait there.
    poses = np.concatenate([poses[:1], poses])
    wait = np.zeros(len(poses))
    wait[1] = FIRST_S
    at = 0
    for stop in stops_m:
        gap = np.hypot(*(poses[at:, :2] - np.asarray(stop, np.float64)).T)
        at += int(gap.argmin())
        wait[min(at + 1, len(poses) - 1)] += PAUSE_S
    return Trajectory(poses, trajectory(poses).times_s + np.cumsum(wait))
