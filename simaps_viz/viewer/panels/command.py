"""The panel that commands the robot: the command, its outcome, and the robot's trajectory."""

import contextlib
import functools
import math
import re
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import zip_longest
from typing import Any, Literal

import cv2
import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.drawing.texture import outline_segments
from simaps_viz.drawing.theme import (
    BAD_PAPER_STYLE,
    DIM_STYLE,
    GOOD_PAPER_STYLE,
    MAX_NAME_LENGTH,
    NESTED_EM,
    PAPER_STYLE,
    SENT_PAPER_STYLE,
)
from simaps_viz.errors import SIMapsError
from simaps_viz.geometry import STANDS_FROM_M, wrap_angle
from simaps_viz.language.commands import MAX_SUGGESTIONS
from simaps_viz.language.grounding import Candidate
from simaps_viz.language.llm_settings import Exchange
from simaps_viz.language.primitives import FUNCTIONS, PRIMITIVES
from simaps_viz.mapping.doubts import SURE_SCORE, doubts
from simaps_viz.mapping.in_space import all_instances
from simaps_viz.navigation.agent import Answer, is_program, outcome_text
from simaps_viz.navigation.robot import Goal
from simaps_viz.navigation.trajectory import (
    SPEED_HINT,
    Trajectory,
    TrajectoryPlayer,
    poses_along,
    trajectory,
    trajectory_of_steps,
)
from simaps_viz.structures import Instance, Pose2, SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, button, button_row, by_person
from simaps_viz.viewer.page.shared import Snapshot
from simaps_viz.viewer.panels.map import doubtful_on, without
from simaps_viz.viewer.scene.annotations import Label, label_of
from simaps_viz.viewer.scene.camera import SLANT, Follower
from simaps_viz.viewer.scene.map_scene import Style

_KEYS_LATE_S = 0.1
"""The browser holds back what is typed for up to 50 ms, but not the press of a button."""
_NTH = ("", "", "second ", "third ", "fourth ", "fifth ", "sixth ", "seventh ", "eighth ", "ninth ", "tenth ")
_MAX_LISTED = 4
_SIDE = re.compile(r"\b(left|right|in front|behind|ahead)(?:most)?\b")
_SIDE_OF_IT = re.compile(r"\b(?:left|right) (?:side )?of the\b")
SEEN = "as seen from the robot"
DOUBTFUL = 0.35
"""From doubts of this strength on it is said that an object that is meant may be wrong, however small it is."""
_LOOKUPS = [*FUNCTIONS.values(), *(primitive for primitive in PRIMITIVES.values() if primitive.kind == "lookup")]
_CHOOSERS = [one.name for one in _LOOKUPS if one.result in ("instance", "instances")]
_FROM_WHAT = re.compile(r",? (?:nearest to|farthest from) (the |)(?:nearest )?(.+)$")
"""What distances are from, in the words for something that is nearest to it."""
GIVEN = "where the command was given"
NOTHING_DONE = "Nothing was done: a command is tried out to its end before the robot moves."
CandidatesAt = Callable[[str, Pose2], Sequence[Candidate]]
TURNS = ("face", "with_object_on_left", "with_object_on_right")
"""Primitives whose goals the robot does not drive to."""
_CHOOSES = re.compile(rf"\b(?:{'|'.join(_CHOOSERS)})\(")
"""Calls with which a program chooses otherwise than by name and rank."""
_ANCHOR = re.compile(r'\b(?:the|nearest)\(things\("([^"]+)"\)\)')
"""One thing by which a program looks for others: the nearest of its name."""
_MAX_ANCHORS = 2
"""Others that are offered instead of it."""
_CALLED = re.compile(r"\bcalled\([^,]*, (\d+)\)")
"""What is named by its number: there was no choice."""


def why_text(answer: Answer, candidates: Sequence[Candidate], there: str = GIVEN) -> str:
    """Explain why the robot goes to this instance and to no other of its class; empty if there was no choice.

    Args:
        answer: with the goals.
        candidates: all instances of the goals' class, the closest to where the command was given first.
        there: what the place where the robot was then is called.
    """
    chosen = dict.fromkeys(goal.instance or 0 for goal in answer.goals)
    mine = [c for c in candidates if c.instance.id in chosen]
    if not mine:
        return ""
    label = mine[0].instance.label
    if len(mine) > 1:
        if len(mine) == len(candidates):
            all_of = f"All {plural(len(mine), label)}" if len(mine) > 2 else f"Both {_plural(label)}"
            return f"{all_of} on this map are meant."
        several = _listed(mine, label)
        return f"{several[0].upper()}{several[1:]} are meant, of {len(candidates)} on this map."
    one, name, goal = mine[0], _cap(mine[0].instance.name), answer.goals[0]
    words = next((one.words for one in answer.goals if one.words), "")
    nth = _NTH[one.rank] if one.rank < len(_NTH) else f"{one.rank}th "
    away, from_here = f"{one.distance_m:.2f} m", f"{one.distance_m:.2f} m from {there}."
    if len(candidates) == 1 and goal.away_m:
        text = f"{name} is the only {_FROM_WHAT.sub('', words) or label}, {away} {_from_what(words)}."
    elif len(candidates) == 1:
        text = f"{name} is the only {words or f'{label} on this map'}, {from_here}"
    elif goal.away_m:
        place = words or f"{nth or 'first '}of {goal.ranking}"
        text = f"{name} is the {place}: {away} from it; {_others(one, candidates)}"
    elif goal.among and words and _asked_order(answer, candidates):
        text = f"{name} is the {words}, of {plural(len(candidates), label)}; it is {from_here}"
    elif goal.ranking:
        text = f"{name} is the {nth or 'first '}of {goal.ranking}, {from_here}"
    else:
        place = f"the {nth}closest {words} to" if words else f"the {nth}closest to"
        if one.rank == len(candidates) > 2 and not words:
            place = f"the farthest of {len(candidates)} from"
        short = ", before which the path ends" if 0.0 < answer.path_length_m < one.distance_m else ""
        text = f"{name} is {place} {there}: {away} in a straight line to its edge{short}; {_others(one, candidates)}"
        text += "" if words else _choice(answer)
    return text


def _from_what(words: str) -> str:
    """Return what distances are from, as told in the words for something that is nearest to it."""
    found = _FROM_WHAT.search(words)
    return f"from {found[1]}{found[2]}" if found else "from it"


def each_why(answer: Answer, candidates_at: CandidatesAt, pose: Pose2, *, most: int = 4) -> list[str]:
    """Explain why the robot goes to each of several things, where there was a choice; nothing for more than ``most``.

    Args:
        answer: with the goals.
        candidates_at: finds all instances of a class, the closest to a pose first.
        pose: where the command was given.
        most: of a tour of many things the outcome says enough.
    """
    if len({one for goal in answer.goals for one in (goal.instance, goal.other_instance) if one}) > most:
        return []
    texts = dict.fromkeys(map(int, _CALLED.findall(answer.program or "")), "")
    here, there = pose, GIVEN
    for goal in answer.goals:
        other = Goal(goal.primitive, goal.other_label, goal.other_instance, goal.point_m)
        for one in (goal, other):
            if not one.label or not one.instance or one.instance in texts:
                continue
            mine, candidates = replace(answer, goals=(one,), program=""), candidates_at(one.label, here)
            closest = [candidate.instance.id for candidate in candidates[:2]]
            text = why_text(mine, in_asked_order(mine, candidates), there) if len(candidates) > 1 else ""
            if goal.label == goal.other_label and closest == [goal.instance, goal.other_instance]:
                count = plural(len(candidates), one.label)
                text = f"This map has {count}: {closest[0]} and {closest[1]}, the two closest to {there}, are meant."
                text = text if one is goal and len(candidates) > 2 else ""
            texts[one.instance] = text
        if goal.primitive not in TURNS:
            here, there = Pose2(*goal.point_m, here.yaw_rad), "where the robot is then"
    return [text for text in texts.values() if text]


def beyond_text(simap: SIMap, answer: Answer) -> str:
    """Explain why the robot stops far from the thing that it is sent to or on its far side; empty where it does not."""
    if len(answer.goals) > 1:
        return _short_stops(simap, answer)
    goal = answer.goals[0] if answer.goals and len(answer.path_m) > 1 else None
    if goal is not None and goal.instance and goal.other_instance:
        return _aside_text(simap.by_id(goal.instance), simap.by_id(goal.other_instance), answer.path_m[-1])
    if goal is None or goal.primitive not in ("move_to_object", "move_to_nth_closest") or not goal.instance:
        return ""
    start, stop, name = answer.path_m[0], answer.path_m[-1], simap.by_id(goal.instance).name
    cells = _cells_of(simap, goal.instance)
    if len(cells) and _is_beyond(cells, start, stop):
        reason = "nowhere on the near side is room to get as close"
        return f"It stops on the far side of {name}, as seen from the start: {reason}."
    away_m = _gap_m(cells, stop)
    return f"It stops {away_m:.1f} m from {name}: nowhere nearer is there room for it." if away_m > FAR_M else ""


def _short_stops(simap: SIMap, answer: Answer) -> str:
    """Return which stops of several are far from the thing that they are about; empty where none is."""
    found = []
    for goal in answer.goals:
        if goal.primitive in ("move_to_object", "move_to_nth_closest") and goal.instance:
            away_m = _gap_m(_cells_of(simap, goal.instance), goal.point_m)
            if away_m > FAR_M:
                found.append(f"{away_m:.1f} m from {simap.by_id(goal.instance).name}")
    return f"It stops {', '.join(found)}: nowhere nearer is there room for it." if found else ""


def _cells_of(simap: SIMap, number: int) -> NDArray:
    """Return the centres of the cells that show an object, float64 [n, 2], map frame, metres."""
    return np.asarray(simap.spec.centres_of(*np.nonzero(simap.instance == number)))


def _gap_m(cells: NDArray, point_m: Any) -> float:
    """Return how far a point is from the nearest of some cells' centres, metres; 0 without cells."""
    return float(np.hypot(*(cells - point_m).T).min()) if len(cells) else 0.0


def _is_beyond(cells: NDArray, start: NDArray, stop: NDArray) -> bool:
    """Whether a point is on the side of an object that is away from another one, within 60 degrees.

    What is long is first pressed to a square: all of its other long side is away.
    """
    middle, sides, turned = cv2.minAreaRect(cells.astype(np.float32))
    along = np.deg2rad(turned)
    axes = np.array([[np.cos(along), np.sin(along)], [-np.sin(along), np.cos(along)]]) / np.maximum(sides, 0.1)[:, None]
    a, b = axes @ (stop - middle), axes @ (middle - start)
    return bool(a @ b >= 0.5 * np.hypot(*a) * np.hypot(*b))


def stop_text(simap: SIMap, answer: Answer) -> str:
    """Return how far from the edge of what it was sent to the robot stops, and where that is then.

    Empty where the last goal is no drive to one object: a program that turns to it leaves nothing to explain.
    """
    goal = answer.goals[-1] if answer.goals and len(answer.path_m) > 1 else None
    if goal is None or not goal.instance or goal.other_instance or goal.primitive in TURNS:
        return ""
    one, pose, end = simap.by_id(goal.instance), answer.final_pose, answer.path_m[-1]
    cells = _cells_of(simap, goal.instance)
    if not (len(cells) and np.allclose(goal.point_m, end)):  # nothing shows it, or the robot drove on
        return ""
    x, y = np.subtract(one.centroid_m[:2], end)
    side = round(2.0 * wrap_angle(float(np.arctan2(y, x)) - pose.yaw_rad) / np.pi)
    where = ("", "on its left", "behind it", "on its right")[side % 4]
    turned = f', and the robot has that {where} then: add "and face it" to have it turn' if where else ""
    gap_m = _gap_m(cells, end)
    ends = "at" if gap_m < 0.005 else f"{gap_m:.2f} m from"
    return f"The path ends {ends} the edge of {one.name}{turned}."


def _aside_text(first: Instance, second: Instance, stop: NDArray) -> str:
    """Explain a stop beside two things that it was to be between; empty where it is between them."""
    start, line = first.centroid_m[:2], np.subtract(second.centroid_m[:2], first.centroid_m[:2])
    (x, y), (along_x, along_y) = stop - start, line / max(np.hypot(*line), 1e-9)  # one may lie in the other
    aside_m = abs(along_x * y - along_y * x)
    if aside_m <= ASIDE_M:
        return ""
    line_of = f"the line from {first.name} to {second.name}"
    return f"It stops {aside_m:.1f} m beside {line_of}: between them is no room for it."


def candidate_labels(
    candidates: Sequence[Candidate],
    chosen: Collection[int],
    most: int = 5,
    away: str = "away",
    also: Collection[int] = (),
) -> list[Label]:
    """Number what a command could mean: "▶ 3 · chair 18 · 2.6 m away" is the chosen one, "1 · chair 7" another.

    Args:
        candidates: in the order that was asked for.
        chosen: ids of the chosen ones.
        most: how many others to number; none of them comes after the last chosen one.
        away: what the distances are, such as "from the lamp".
        also: ids of others to number, wherever they come.

    Returns:
        the chosen ones first.
    """
    mine = [c for c in candidates if c.instance.id in chosen]
    last = max((c.rank for c in mine), default=len(candidates))
    left = [c for c in candidates if c.instance.id not in chosen]
    others = [c for c in left if c.rank <= last or c.instance.id in also][:most]
    texts = [(f"▶ {c.rank} · {c.instance.name} · {c.distance_m:.1f} m {away}", c.instance) for c in mine]
    texts += [(f"{c.rank} · {c.instance.name}", c.instance) for c in others]
    return [label_of(text, one) for text, one in texts]


def in_asked_order(answer: Answer, candidates: Sequence[Candidate]) -> Sequence[Candidate]:
    """Return the candidates that the first goal was chosen of, ranked in the order that was asked for.

    Their distances are from where the command was given, or from what the nearest to it was asked for.

    Args:
        answer: with the goals.
        candidates: the closest first, which is the order where no other was asked for.
    """
    by_id, goal = {one.instance.id: one for one in candidates}, answer.goals[0]
    among = [
        replace(by_id[i], distance_m=by_id[i].distance_m if away_m is None else away_m)
        for i, away_m in zip_longest(goal.among, goal.away_m)
        if i in by_id
    ]
    return [replace(one, rank=rank) for rank, one in enumerate(among, start=1)] or candidates


def _asked_order(answer: Answer, candidates: Sequence[Candidate]) -> bool:
    """Whether the candidates are in another order than by distance."""
    distances = [one.distance_m for one in candidates]
    return bool(answer.goals and answer.goals[0].among) and distances != sorted(distances)


def sides_text(text: str, pose: Pose2, then: Pose2 | None = None) -> str:
    """Return whose left and right a text speaks of; empty where it speaks of none, or says it.

    Args:
        text: the text.
        pose: of the robot, now.
        then: of the robot when the sides are meant; None = now.
    """
    sides = {} if SEEN in text else dict.fromkeys(_SIDE.findall(text))
    if sides and _SIDE_OF_IT.search(text):  # of a thing, not of the robot
        return f"{_cap(', '.join(sides))}: {SEEN}, if it faced that thing."
    looks = f"looks {pose.looks}" if then is None or then.looks == pose.looks else f"looks {then.looks} by then"
    return f"{_cap(', '.join(sides))}: {SEEN}, which {looks}." if sides else ""


def name_text(simap: SIMap, answer: Answer) -> str:
    """Return what the one thing that an answer speaks of is called on the map; empty where the answer says it."""
    told = [] if answer.answer is None else answer.answer["instances"]
    name = simap.by_id(told[0]).name if len(told) == 1 else ""
    return "" if not name or name in outcome_text(answer) else f"On the map it is {name}."


def anchors_of(answer: Answer) -> list[int]:
    """Return the ids of the objects that others were looked for by and an answer does not speak of."""
    told = () if answer.answer is None else answer.answer["instances"]
    meant = {*told, *(number for goal in answer.goals for number in (goal.instance, goal.other_instance))}
    return [number for number in answer.anchors if number not in meant]


def anchors_text(simap: SIMap, answer: Answer, doubtful: Collection[int]) -> list[str]:
    """Name each of the `anchors_of` an answer that is doubtful or not the only one of its class."""
    texts = []
    for one in map(simap.by_id, anchors_of(answer)):
        unsure = ", which is doubtful" if one.id in doubtful else ""
        if unsure or sum(other.label == one.label for other in simap.objects) > 1:
            texts.append(f"The {one.label} that is meant is {one.name}{unsure}.")
    return texts


def by_other_anchors(answer: Answer, candidates_at: CandidatesAt, pose: Pose2) -> list[str]:
    """Return the program of an answer with each of its single `Answer.anchors` exchanged for the next of its name.

    Args:
        answer: with the program and the anchors.
        candidates_at: finds all instances of a name, the closest to a pose first.
        pose: where the command was given.
    """
    programs = []
    for one in dict.fromkeys(_ANCHOR.finditer(answer.program or "")):
        ids = [candidate.instance.id for candidate in candidates_at(one[1], pose)]
        others = [number for number in ids if number not in answer.anchors]
        if len(others) < len(ids):  # it is one of the anchors
            called = [f'called(things("{one[1]}"), {number})' for number in others[:_MAX_ANCHORS]]
            programs += [answer.program.replace(one[0], other) for other in called]
    return list(dict.fromkeys(programs))


def _done(answer: Answer) -> tuple[Any, ...]:
    """Return what an answer comes to, however its program says so."""
    goals = [(goal.primitive, goal.instance, goal.other_instance, goal.point_m) for goal in answer.goals]
    told = answer.answer or {}
    return goals, told.get("text"), told.get("instances"), answer.final_pose


def pose_of_sides(answer: Answer) -> Pose2 | None:
    """Return where the robot is when left and right are those that an answer speaks of; None = where it is told so."""
    if answer.status != "ok":
        return answer.stuck_at
    if answer.answer is not None and not answer.goals:
        return answer.final_pose
    before = None
    for step in answer.steps:
        if step.goal is None:
            before = before if step.done else step.pose
        elif step.goal.primitive in TURNS:
            if step.goal.primitive != "face":
                return step.pose  # so that something is on its left
        elif _SIDE.search(step.goal.words):
            return before
    return None


def _ordered(why: Sequence[str], notes: Sequence[str]) -> tuple[str, ...]:
    """Return all that is said of an answer: first what the map cannot tell, as the rest builds on what was taken."""
    ties = [note for note in notes if note.startswith("The map cannot tell")]
    return (*ties, *why, *(note for note in notes if note not in ties))


def _undistanced(text: str) -> str:
    return re.sub(r" · [\d.]+ m \S.*$", "", text)


def _cap(text: str) -> str:
    return text[:1].upper() + text[1:]


def goal_labels(simap: SIMap, goals: Sequence[Goal]) -> list[Label]:
    """Name the objects that the robot was sent to, numbered in order if there are several goals, as far as shown."""
    numbers: dict[int, list[str]] = {}
    for number, goal in enumerate(goals, start=1):
        for one in (goal.instance, goal.other_instance):
            if one:
                numbers.setdefault(one, []).append(str(number))
    known = {instance.id: instance for instance in (*simap.instances, *simap.hidden)}
    order = {i: f"{', '.join(texts)} · " if len(goals) > 1 else "" for i, texts in numbers.items()}
    return [label_of(f"{order[i]}{known[i].name}", known[i]) for i in numbers if i in known]


def named_in(simap: SIMap, text: str) -> list[int]:
    """Return the ids of the objects that a text names, as "chair 18"."""
    return [one.id for one in all_instances(simap) if re.search(rf"\b{re.escape(one.name)}\b", text)]


def answer_labels(simap: SIMap, ids: Sequence[int], most: int = 12) -> list[Label]:
    """Name the objects that an answer speaks of, as far as they are on the map; at most so many."""
    known = {instance.id: instance for instance in (*simap.instances, *simap.hidden)}
    return [label_of(known[i].name, known[i]) for i in ids if i in known][:most]


def message_html(title: str, text: str, tone: str, more: Sequence[str] = ()) -> str:
    """Return a message: a bold title and a text, tinted by tone (plain, good, bad), and further lines, smaller."""
    paper = {"good": GOOD_PAPER_STYLE, "bad": BAD_PAPER_STYLE}.get(tone, PAPER_STYLE)
    head = f'<div style="font-weight:600">{escape(title)}</div>' if title else ""
    lines = "".join(
        f'<div style="margin-top:.35em;font-size:{NESTED_EM}em">{escape(line)}</div>' for line in more if line
    )
    return (
        f'<div style="margin:.2em .8em;padding:.5em .7em;border-radius:4px;font-size:.85em;line-height:1.4;'
        f'overflow-wrap:anywhere;{paper}">{head}<div>{escape(text)}</div>{lines}</div>'
    )


def program_html(program: str, line: int | None = None, *, stuck: bool = False) -> str:
    """Show a program as code, with line numbers; the given line (from 1) is marked, in red where it got stuck."""
    rows = []
    for number, text in enumerate(program.rstrip("\n").splitlines(), start=1):
        mark = (
            ("background:light-dark(#f9c8c8,#6a2626);" if stuck else "background:light-dark(#fff1b8,#57470f);")
            if number == line
            else ""
        )
        sign = "▶" if number == line and not stuck else "✖" if number == line else " "
        current = ' aria-current="step"' if number == line else ""
        rows.append(
            f'<div{current} style="{mark}white-space:pre-wrap;padding:0 .5em 0 4.2em;text-indent:-3.7em">'
            f'<span style="opacity:.75;user-select:none;white-space:pre">{sign} {number:>2} </span>{escape(text)}</div>'
        )
    return (
        f'<div style="margin:.3em .8em;padding:.4em 0;border-radius:4px;{PAPER_STYLE};'
        f'overflow-wrap:anywhere;font:12px/1.5 ui-monospace,monospace">{"".join(rows)}</div>'
    )


def line_text(program: str, line: int) -> str:
    """Return what Step does of a paused program: "Step runs line 2 of 3: robot.turn(90)"; empty for no line."""
    lines = program.rstrip("\n").splitlines()
    return f"Step runs line {line} of {len(lines)}: {lines[line - 1].strip()}" if 0 < line <= len(lines) else ""


def exchanges_html(exchanges: Sequence[Exchange]) -> str:
    """Show what was sent to a language model, and its answers."""
    parts = []
    for number, exchange in enumerate(exchanges, start=1):
        head = f"Question {number} of {len(exchanges)}, {exchange.seconds:.1f} s"
        parts.append(f'<div style="font-weight:600;margin-top:.4em">{head}</div>')
        parts += [_box(f"sent ({message.role})", message.content, PAPER_STYLE) for message in exchange.messages]
        if exchange.response:
            parts.append(_box("received", exchange.response, SENT_PAPER_STYLE))
        if exchange.error:
            parts.append(_box("no answer", exchange.error, BAD_PAPER_STYLE))
    return f'<div style="padding:0 .8em .4em;font-size:.85em">{"".join(parts)}</div>'


def _others(one: Candidate, candidates: Sequence[Candidate]) -> str:
    """Describe how far the closer ones are, or the next one if none is closer."""
    label = one.instance.label
    if one.rank == 1:
        far, next_m = f"{one.distance_m:.2f}", f"{candidates[1].distance_m:.2f}"
        return f"the next, {candidates[1].instance.name}, is {'just as far' if next_m == far else f'at {next_m} m'}."
    closer = candidates[: one.rank - 1]
    distances = [f"{c.distance_m:.2f}" for c in closer]
    if len(closer) == 1:
        return f"{closer[0].instance.name} is at {distances[0]} m."
    if len(closer) > _MAX_LISTED:
        return f"{plural(len(closer), label)} are closer, at {distances[0]} to {distances[-1]} m."
    return f"{_listed(closer, label)} are at {', '.join(distances[:-1])} and {distances[-1]} m."


def _plural(label: str) -> str:
    return plural(2, label).removeprefix("2 ")


def _listed(candidates: Sequence[Candidate], label: str) -> str:
    """Name several by their numbers: "chairs 1, 2 and 5"; many are counted."""
    numbers = [str(c.instance.id) for c in candidates]
    if len(numbers) > 2 * _MAX_LISTED:
        return plural(len(numbers), label)
    return f"{_plural(label)} {', '.join(numbers[:-1])} and {numbers[-1]}"


def _choice(answer: Answer) -> str:
    """Return what of the program chose the first goal; empty where it chose by name and rank."""
    last = next((step.line for step in answer.steps if step.goal is not None), None)
    lines = (answer.program or "").splitlines()
    choosing = [number for number, line in enumerate(lines[:last], start=1) if _CHOOSES.search(line)]
    line = f"line {choosing[-1]} of " if choosing and len(lines) > 1 else ""
    return f" It was chosen by {line}the program below." if choosing else ""


def _box(title: str, text: str, paper: str) -> str:
    return (
        f'<div style="{DIM_STYLE};margin-top:.3em">{escape(title)}</div>'
        f'<div style="{paper};border-radius:4px;padding:.3em .5em;max-height:14em;overflow:auto;'
        f'white-space:pre-wrap;overflow-wrap:anywhere;font:12px/1.45 ui-monospace,monospace">{escape(text)}</div>'
    )


TITLE = "Command"
PLACE_HINT = "Set position and heading by two clicks on the map, or put the robot back where it started."
MIN_HEIGHT_M = 0.1
ASIDE_M = 0.5
"""A stop that is to be between two things, and is farther from the line between them, has its reason said."""
FAR_M = 1.0
"""A stop farther from the edge of the thing it is about has its reason said."""
HEIGHT_HINT = (
    "The robot's: a robot of 0.3 m drives under tables, one of 1.2 m does not. Counts from the next command on."
)
EXAMPLES = 3
FEW = 2
"""Classes with at most this many objects are named in the examples without a number."""
MAX_PAST = 8
"""Commands shown in the history."""
_MAX_BUTTON_LENGTH = 34
"""Characters of a command on a button."""
Phase = Literal["idle", "asking", "driving", "paused"]
_FIRST: dict[Phase, str] = {"idle": "Go", "asking": "Go", "driving": "Pause", "paused": "Play"}
"""The first button of the row; the others are Step and Stop."""
_TITLES: dict[Phase, str] = {"driving": "On the way", "paused": "Paused"}
_ICONS = {
    "ok": viser.Icon.CHECK,
    "refused": viser.Icon.X,
    "failed": viser.Icon.ALERT_TRIANGLE,
    "stopped": viser.Icon.PLAYER_STOP,
}


@dataclass(frozen=True)
class Past:
    """A command that was given before."""

    command: str
    status: str
    """One of ok, refused, failed and stopped; empty until it has ended."""


def entered(text: str) -> str | None:
    """Return the command that Enter completed; None while it is still being typed.

    A program has several lines and ends with an empty one; any other command is one line.
    """
    if "\n" not in text or (is_program(text) and not text.endswith("\n")):
        return None
    return text.strip() if is_program(text) else " ".join(text.split())


def examples(simap: SIMap, most: int = EXAMPLES) -> list[str]:
    """Return example commands that use the classes of this map of which it is sure, if there are any."""
    counts = {name: count for name, count in simap.counts().items() if len(name) <= MAX_NAME_LENGTH}
    sure = {one.label for one in simap.instances if one.score >= SURE_SCORE}
    names = [name for name in counts if name in sure] or list(counts)
    if not names:
        return ["move forward 1 meter"]
    few = [name for name in names if counts[name] <= FEW] or names  # "the chair" is of little use where there are 31
    several = next((name for name in names if counts[name] >= 3), None)
    texts = [f"go to the third {several} from here"] if several else []
    texts.append(f"go to the {few[0]}")
    others = [name for name in names if name != few[0]]
    if others:
        texts.append(f"go to the {others[0]} nearest the {few[0]}")
        texts.append(f"move in between the {few[0]} and the {(few[1:] or others)[0]}")
    texts.append(f"face the {few[-1]}")
    return list(dict.fromkeys(texts))[:most]


def _counted(page: Page) -> SIMap:
    """Return the map of a page without what is doubtful."""
    return without(page.simap, doubtful_on(page))


def _in_short(command: str) -> str:
    """Return a command as a button has it."""
    return command if len(command) <= _MAX_BUTTON_LENGTH else f"{command[: _MAX_BUTTON_LENGTH - 1]}…"


def open_floor(simap: SIMap) -> Pose2:
    """Return the default start pose: the free cell farthest from any obstacle, looking north."""
    height = simap.grid.height_m
    free = (np.nan_to_num(height, nan=9.0) < STANDS_FROM_M) & (simap.instance == 0)
    if not free.any():
        xmin, ymin, xmax, ymax = simap.spec.extent_m
        return Pose2.from_heading((xmin + xmax) / 2.0, (ymin + ymax) / 2.0, 0.0)
    clearance = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    row, col = np.unravel_index(int(clearance.argmax()), clearance.shape)
    return Pose2.from_heading(*simap.spec.centre_of(float(row), float(col)), 0.0)


MAX_REMEMBERED = 50
PREVIEW_S = 0.5
"""A person who has typed nothing for so long sees what the command so far would mean."""
OUTLINE_M = 0.014
"""Height of the lines around what the robot goes to, or an answer speaks of."""
POSE_S = 0.3
"""How often it is said where a robot is that drives."""
GOAL_M = 0.25
"""Half the side of the square around the robot's final position that is kept free of labels."""
STOPS = "stops here"
WORKS, NEAREST = "These work here, for example:", "If the nearest one is meant all the same:"
MEANS = "Doubtful is what was seen too little to be sure of; the map counts it apart."
WELCOME, TYPING = "Try an example, or type what the robot shall do.", "Go sends it."
READING, PAST = "Reading it …", "The map is shown as it was: Go does this on the finished one."


@dataclass(frozen=True, eq=False)
class Marks:
    """What a command draws on the map."""

    path_m: NDArray = field(default_factory=lambda: np.zeros((0, 2)))
    """float [n, 2], map frame, metres; n < 2 draws none."""
    labels: Sequence[Label] = ()
    stops_m: tuple[tuple[float, float], ...] = ()
    """Where on the path the robot stops, besides its end."""


@dataclass(frozen=True)
class RobotState:
    """The state of the robot that a page keeps when it is loaded again."""

    pose: Pose2
    start: Pose2
    past: tuple[Past, ...]
    texts: tuple[str, str, str]
    """As `CommandPanel.texts`."""
    speed: float
    marks: Marks
    height_m: float


def _with_path(marks: Marks, answer: Answer) -> Marks:
    """Return marks with the path of an answer too, and the stops at what it goes to on the way."""
    return replace(marks, path_m=answer.path_m, stops_m=_stops(answer))


def _stops(answer: Answer) -> tuple[tuple[float, float], ...]:
    """Return where the robot stops at what it goes to."""
    return tuple(goal.point_m for goal in answer.goals if goal.instance and goal.primitive not in TURNS)


class CommandPanel(Panel):
    """Carries out commands and shows their outcomes, one at a time; a new command ends the one before."""

    def __init__(self, page: Page) -> None:
        """Fill the open container and put the robot on the map."""
        self._page, self._scene, self._services = page, page.scene, page.services
        viewpoints = page.viewpoints
        self._follower = Follower(
            page.client, behind=lambda: viewpoints.name == SLANT, let_go=lambda: viewpoints.look(viewpoints.name)
        )
        self._start = page.workbench.start or open_floor(page.simap)
        page.pose = self._asked_at = self._start
        self._placing: list[tuple[float, float]] | None = None
        self._answer: Answer | None = None
        self._why: tuple[str, ...] = ()
        self._readings: tuple[Answer, ...] = ()
        """What other meanings of the command come to."""
        self._trajectory: Trajectory | None = None
        self._line = 0
        self._lit: frozenset[int] = frozenset()
        """Objects that are outlined: what the robot goes to, or an answer speaks of."""
        self._was_selected: int | None = None
        self._dims = False
        """Whether all else is dimmed."""
        self._past: list[Past] = []
        self._running = ""
        """The command of the history that has not ended yet."""
        self._sent = ""
        """What was typed when the last command was sent."""
        self._marks, self._hidden = Marks(), False
        self._driven: tuple[Marks, frozenset[int]] = (Marks(), frozenset())
        """What is drawn and outlined of the command that the robot carries out."""
        self._drawing = threading.Lock()
        self._typing: threading.Timer | None = None
        """Runs while what is typed may go on."""
        self._previews = False
        """Whether what is marked is what the typed command would mean."""
        self._outcome = False
        """Whether the message is about a command that was sent."""
        self._waiting: threading.Event | None = None
        self._drive = TrajectoryPlayer(self._moved, self._arrived, lambda: self._show_phase("paused"), self._broke_down)
        self._phase: Phase = "idle"
        self._add_input(page.gui)
        self._add_outcome(page.gui)
        self._add_robot(page.gui)
        self._put_robot(self._start)

    @property
    def driving(self) -> bool:
        """Whether the robot is driving, paused or not."""
        return self._drive.active

    @property
    def uses_model(self) -> bool:
        """Whether the language model reads the commands."""
        return bool(self._model.visible and self._model.value)

    @property
    def texts(self) -> tuple[str, str, str]:
        """The typed command, and the outcome and program of the last one (both HTML)."""
        return str(self._text.value), str(self._result.content), str(self._program.content)

    def style(self, simap: SIMap, style: Style) -> Style:
        """Emphasise what the last answer speaks of."""
        return replace(style, lit=(style.lit or frozenset()) | self._lit) if self._lit and self._dims else style

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """Hide path and labels while an earlier map is shown: they belong to the finished one."""
        hidden = bool(snapshot.badge)
        if hidden != self._hidden:
            self._hidden = hidden
            self._draw(None)

    def ask(self, command: str, paused: bool = False) -> None:
        """Carry out a command from the robot's pose; ``paused`` waits before its first line."""
        model = self._services.model if self.uses_model else None
        self._submit(command, paused=paused, reader=model.name if model else "")

    @property
    def _types_another(self) -> bool:
        """Whether another command is typed than was sent last."""
        text = str(self._text.value).strip()
        return bool(text) and text != self._sent

    def pause(self) -> None:
        """Pause the drive, or resume it."""
        self._drive.pause(not self._drive.paused)
        if self._drive.active:
            self._show_phase("paused" if self._drive.paused else "driving")

    def step(self) -> None:
        """Run one statement of the program, then pause."""
        if self._drive.active:
            self._show_phase("driving")
            self._drive.step()

    def stop(self) -> None:
        """Stop the robot where it is, or the wait for an answer."""
        self._ended("stopped")
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set()
            self._show_result("Stopped", "The wait for an answer has ended; the robot stays where it is.")
        elif self._drive.active:
            self._drive.stop()
            self._show_progress(None)
            self._show_pose()
            self._show_result("Stopped", "The robot stands where it was stopped.", more=self._why)
        self._show_phase("idle")
        self._preview_another()

    def run_other_reading(self) -> None:
        """Return to where the command was given and run another meaning of it; each call runs the next one."""
        if self._readings:
            answers = (*self._readings, *([] if self._answer is None else [self._answer]))
            program, *others = [one.program for one in answers if one.program]
            self._submit(program, at=self._asked_at, readings=tuple(others))

    def built(self) -> None:
        """Read and plan a command behind the page, which takes long the first time only."""
        if self._services.ask is not None:
            self._page.command_worker.submit("prepare", self._prepare)

    def state(self) -> RobotState:
        """Stop the robot, or the wait for an answer, and return the state of the panel."""
        if self.driving or self._waiting is not None:
            self.stop()
        if self._previews:
            self._unmark()
        speed = float(self._speed.value)
        return RobotState(
            self._page.pose, self._start, tuple(self._past), self.texts, speed, self._marks, self._page.robot.height_m
        )

    def restore(self, state: RobotState) -> None:
        """Restore the robot's state."""
        self._start, self._past = state.start, list(state.past)
        self._text.value, self._result.content, self._program.content = state.texts
        self._sent = state.texts[0].strip()
        self._fold.visible = self._program.visible = bool(state.texts[2])
        self._speed.value = self._drive.speed = state.speed
        self._height.value = state.height_m
        self._set_height()
        self._show_past()
        self._put_robot(state.pose)
        self._draw(state.marks)

    def leave_robot(self) -> None:
        """Stop the robot and clear its drawings, as another panel moves it now."""
        self._end()
        self._clear()

    def reset(self) -> None:
        """Put the robot back where it started."""
        self._use()
        self.leave_robot()
        self._put_robot(self._start)

    def place(self) -> None:
        """Take the next two clicks for position and heading."""
        self._use()
        self._end()
        self._placing = []
        self._show_result("Set start pose", "Click where the robot stands, then click where it looks.")

    def waits_for_click(self) -> bool:
        """Whether a click for the start pose is expected."""
        return self._placing is not None

    waits_for_place = waits_for_click

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Use a click for the start pose; False if no click is expected."""
        placing = self._placing
        if placing is None:
            return False
        placing.append((x_m, y_m))
        if len(placing) == 1:
            self._clear()
            self._put_robot(Pose2(x_m, y_m, self._page.pose.yaw_rad))
            self._show_result("Set start pose", "Now click where the robot looks.")
            return True
        (x0, y0), (x1, y1) = placing[:2]
        self._placing = None
        self._start = Pose2(x0, y0, float(np.arctan2(y1 - y0, x1 - x0)))
        self._put_robot(self._start)
        self._show_result("Start pose set", "The next command starts here.", "good")
        return True

    def close(self) -> None:
        """End any drive, and any wait for an answer."""
        self._end_typing()
        self._end()

    def _use(self) -> None:
        """Claim the robot, and show the finished map, on which commands are carried out."""
        self._page.finish()
        self._page.claim_robot(self)

    def _end(self) -> None:
        """End the drive or the wait for an answer without a message."""
        self._ended("stopped")
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set()
        self._drive.stop()
        self._placing = None
        self._show_phase("idle")

    def _submit(
        self,
        command: str,
        *,
        paused: bool = False,
        reader: str = "",
        at: Pose2 | None = None,
        readings: tuple[str, ...] = (),
    ) -> None:
        """Queue a command; ``at`` puts the robot there first, ``readings`` are the other meanings of the command."""
        self._sent = str(self._text.value).strip()
        self._use()
        self._end()
        self._clear()  # at once: what was meant before is not what this one means
        if at is None:
            self._remember(command)
        self._waiting = cancel = threading.Event()
        more = (f"Asking {reader}. Stop ends the wait.",) if reader else ()
        self._show_result("Working on it …", command, more=more)
        self._show_phase("asking")
        job = functools.partial(self._carry_out, command, cancel, paused, bool(reader), at, readings)
        self._page.command_worker.submit("command", job)

    def _carry_out(
        self,
        command: str,
        cancel: threading.Event,
        paused: bool,
        by_model: bool,
        at: Pose2 | None,
        readings: tuple[str, ...],
    ) -> None:
        if cancel.is_set():
            return
        self._clear()
        if at is not None:
            self._put_robot(at)
        simap, self._asked_at = self._page.simap, self._page.pose
        try:
            answer = self._answer_to(simap, command, cancel, by_model)
        except SIMapsError as error:
            if not cancel.is_set():
                self._waiting = None
                self._refuse(str(error), getattr(error, "suggestions", ()))
            return
        except Exception:
            self._ended("failed")
            self._show_phase("idle")
            self._show_result("Failed", "The command met an unexpected error; the robot stays.", "bad")
            raise
        if cancel.is_set():
            return
        self._answer, self._readings = answer, tuple(self._other_readings(simap, answer, readings))
        self._begin(simap, answer, cancel, paused)

    def _answer_to(self, simap: SIMap, command: str, cancel: threading.Event, by_model: bool) -> Answer:
        services = self._services
        if by_model and services.model is not None:

            def show(exchanges: Sequence[Exchange]) -> None:
                if self._waiting in (cancel, None):  # not once another command has taken over
                    self._show_exchanges(exchanges)

            return services.model.ask(simap, command, self._page.pose, cancel, show, robot=self._page.robot)
        if services.ask is None:
            raise SIMapsError("commands: expected a service that carries them out, found none")
        return services.ask(simap, command, self._page.pose, robot=self._page.robot)

    def _begin(self, simap: SIMap, answer: Answer, cancel: threading.Event, paused: bool) -> None:
        """Show an answer, and start the drive if there is one."""
        # Everything that takes long comes before anything is shown, so that a cancelled command shows nothing.
        labels, self._why = self._explain(simap, answer)
        planned = self._trajectory_for(answer) if answer.status == "ok" else None
        if cancel.is_set():
            return
        self._show_program(answer.program or "")
        self._show_other_reading(next(iter(self._readings), None))
        self._waiting = None
        if planned is None:
            self._conclude(answer)
            return
        self._mark(answer, labels)  # all else is dimmed until the robot has arrived
        if answer.answer is not None and not answer.goals and answer.path_length_m == 0.0:  # nothing but a question
            self._conclude(answer)
            return
        self._trajectory = planned
        self._draw(_with_path(self._marks, answer))
        self._driven = self._marks, self._lit
        self._show_progress(0.0)
        self._show_phase("paused" if paused else "driving")
        self._drive.start(planned, paused=paused)
        self._preview_another()

    def _other_readings(self, simap: SIMap, answer: Answer, readings: Sequence[str] = ()) -> Iterator[Answer]:
        """Yield what other meanings come to that can be carried out from where the command was given.

        Those that come to the same as the answer, or as one before them, are left out.
        """
        find, ask = self._services.candidates, self._services.ask
        if ask is None:
            return
        by_others = [] if find is None else by_other_anchors(answer, functools.partial(find, simap), self._asked_at)
        done = [_done(answer)]
        for program in dict.fromkeys((*answer.alternatives, *by_others, *readings)):
            other = ask(simap, program, self._asked_at, robot=self._page.robot)
            is_empty = other.answer is not None and not other.answer["instances"]
            if other.status == "ok" and not is_empty and _done(other) not in done:
                done.append(_done(other))
                yield other

    def _mark(self, answer: Answer, labels: Sequence[Label], stop: str = "") -> None:
        """Outline and number what a command means, or an answer speaks of, and dim all else; ``stop`` names the end."""
        goal = Label(stop, answer.final_pose.x_m, answer.final_pose.y_m, GOAL_M, GOAL_M)
        goals = {number for one in answer.goals for number in (one.instance, one.other_instance) if number}
        stops = [Label("", x, y, GOAL_M, GOAL_M) for x, y in _stops(answer)]  # kept free, as they are ringed
        self._draw(Marks(labels=(*labels, goal, *stops)))
        meant = frozenset((*answer.anchors, *(goals if answer.answer is None else answer.answer["instances"])))
        self._light(meant)
        if not self._follower.on:
            self._bring_in(meant, answer.path_m)

    def _mark_named(self, reason: str) -> None:
        """Outline and name what the robot cannot get to."""
        simap = self._page.simap
        ids = named_in(simap, reason)
        if ids:
            self._previews = True
            self._draw(Marks(labels=answer_labels(simap, ids)))
            self._light(frozenset(ids))
            self._bring_in(ids)

    def _bring_in(self, ids: Collection[int], path_m: Sequence[Any] | NDArray = ()) -> None:
        """Bring objects, and a path, into sight."""
        meant = [one for one in all_instances(self._page.simap) if one.id in ids]
        places = np.array([*(corner[:2] for one in meant for corner in one.aabb_m), *path_m])
        x0, y0, x1, y1 = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
        self._page.viewpoints.bring_in((x0, y0, x1, y1))

    def _meant(self, command: str) -> tuple[Answer, Sequence[Label], tuple[str, ...]]:
        """Read and plan a command without running it.

        Raises:
            SIMapsError: it cannot be carried out, or is not complete.
        """
        simap = self._page.simap
        if self._services.ask is None:
            raise SIMapsError("commands: expected a service that carries them out, found none")
        answer = self._services.ask(simap, command, self._page.pose, robot=self._page.robot)
        return answer, *self._explain(simap, answer)

    def _prepare(self) -> None:
        with contextlib.suppress(SIMapsError):
            self._meant(examples(_counted(self._page))[0])

    def _preview_another(self) -> None:
        """Show what the typed command would mean from where the robot is now, if it is not the one sent last."""
        if self._types_another:
            self._page.command_worker.submit("preview", self._preview)

    def _may_preview(self) -> bool:
        return self._phase == "idle" or (self._phase in _TITLES and self._types_another)

    def _preview(self) -> None:
        """Outline and number what the typed command would mean, draw the path, and say what Go would do."""
        command = str(self._text.value)
        if self.uses_model or not self._may_preview():  # a model is asked only what is sent to it
            return
        if self._hidden:
            self._show_typed("", PAST)
            self._outcome = True  # gone with the next letter
            return
        meant, reason, then = None, "", None
        try:
            meant = self._meant(command.strip()) if command.strip() else None
        except SIMapsError as error:
            reason = str(error)
        if meant is not None and meant[0].status != "ok":
            then, meant, reason = pose_of_sides(meant[0]), None, outcome_text(meant[0])
        if not self._may_preview() or command != str(self._text.value):
            return  # it runs, or goes on, meanwhile
        self._clear_marks()  # also what an earlier command meant; what was typed since is still to be read
        if meant is None:
            self._mark_named(reason)
            reason = _cap(reason.partition(" Try: ")[0])
            more = [sides_text(reason, self._page.pose, then)]
            self._show_typed("Go cannot do this" if reason else "", reason or TYPING, more)
            self._outcome = bool(reason)  # gone with the next letter
            return
        answer, labels, why = meant
        self._previews = True
        moves = answer.path_length_m > 0.0
        self._mark(answer, labels, STOPS if moves else "")
        if moves:
            self._draw(_with_path(self._marks, answer))
        if answer.answer is not None and not answer.goals:
            about = anchors_text(self._page.simap, answer, doubtful_on(self._page))
            self._show_typed("", "A question: Go answers it.", _ordered(about, answer.notes))
        else:
            title = "Go does this" if self._phase == "idle" else "Go ends this drive, and does this"
            self._show_typed(title, outcome_text(answer), _ordered(why, answer.notes))
        if self._phase == "idle":
            self._preview_other_reading(answer, command)

    def _preview_other_reading(self, answer: Answer, command: str) -> None:
        """Offer what else the typed command could mean, before it is sent."""
        simap, self._asked_at = self._page.simap, self._page.pose
        other = next(self._other_readings(simap, answer), None)
        if other is not None and self._previews and self._phase == "idle" and command == str(self._text.value):
            self._answer, self._readings = answer, (other,)
            self._show_other_reading(other)

    def _end_typing(self) -> None:
        if self._typing is not None:
            self._typing.cancel()

    def _unmark(self) -> None:
        self._end_typing()
        self._clear_marks()

    def _clear_marks(self) -> None:
        self._previews = False
        self._marks, lit = self._driven if self.driving else (Marks(), frozenset())
        self._light(lit)
        self._draw(None)

    def _trajectory_for(self, answer: Answer) -> Trajectory:
        """Return the trajectory of an answer, with the lines of the program where its statements are known."""
        if answer.steps:
            return trajectory_of_steps(answer.steps, self._page.pose)
        return trajectory(poses_along(self._page.pose, answer.path_m, answer.final_pose))

    def _explain(self, simap: SIMap, answer: Answer) -> tuple[list[Label], tuple[str, ...]]:
        """Number the objects that the command could mean, and explain why it means this one.

        Without that service, or for goals of several classes, the goals are numbered in their order.
        """
        anchors = anchors_text(simap, answer, doubtful_on(self._page))
        beside = answer_labels(simap, anchors_of(answer))
        if answer.answer is not None:
            told, value = answer.answer["instances"], answer.answer["value"]
            is_count = type(value) is int and value == len(told)  # which may have said it
            counted = self._of_them_doubtful(told) if is_count and "doubtful" not in outcome_text(answer) else ""
            labels = goal_labels(simap, answer.goals) or answer_labels(simap, told)
            return [*labels, *beside], (counted, name_text(simap, answer), *anchors, *self._cautions(simap, answer))
        labels = {goal.label for goal in answer.goals if goal.label}
        of_one_class = len(labels) == 1 and not any(goal.other_label for goal in answer.goals)
        find = self._services.candidates
        if find is None or not of_one_class or not answer.goals[0].instance:  # a room is no instance
            each = [] if find is None else each_why(answer, functools.partial(find, simap), self._page.pose)
            return [*goal_labels(simap, answer.goals), *beside], (
                *each,
                *anchors,
                beyond_text(simap, answer),
                stop_text(simap, answer),
                *self._cautions(simap, answer, *each),
            )
        candidates = in_asked_order(answer, find(simap, labels.pop(), self._page.pose))
        chosen = {goal.instance or 0 for goal in answer.goals}
        why = why_text(answer, candidates)
        why = " ".join(filter(None, [why, why and self._of_them_doubtful([one.instance.id for one in candidates])]))
        what = _from_what(answer.goals[0].words) if answer.goals[0].away_m else "away"
        labels = candidate_labels(candidates, chosen, away=what, also=named_in(simap, " ".join(answer.notes)))
        ends = beyond_text(simap, answer), stop_text(simap, answer)
        return [*labels, *beside], (why, *anchors, *ends, *self._cautions(simap, answer, why))

    def _cautions(self, simap: SIMap, answer: Answer, *why: str) -> list[str]:
        """Return whose left is meant, and what may be wrong about what is meant."""
        meant = dict.fromkeys(goal.instance for goal in answer.goals if goal.instance)
        about = doubts(simap, among=frozenset(meant)) if meant else ()
        known = {one.instance.id: one for one in about if one.strength > DOUBTFUL}
        named = named_in(simap, " ".join(answer.notes))  # which say that it is doubtful
        found, doubtful = [], doubtful_on(self._page)
        for number in meant:
            one = simap.by_id(number)
            if number in doubtful and number not in named:
                seen = f"seen in {plural(one.frames, 'frame')} of {len(simap.frame_names)}"
                found.append(f"{_cap(one.name)} is doubtful, {seen}.")
            elif number in known and number not in doubtful:
                found.append(f"{_cap(one.name)} may be wrong: {known[number].brief}.")
        said = " ".join([outcome_text(answer), *why])
        return [sides_text(said, self._page.pose, pose_of_sides(answer)), *found[:_MAX_LISTED]]

    def _of_them_doubtful(self, ids: Collection[int]) -> str:
        """Return words for how many of several objects are doubtful, as the page counts; empty where none is."""
        faint = doubtful_on(self._page) & set(ids)
        if not faint or len(ids) == 1:
            return ""
        ones = [one for one in all_instances(self._page.simap) if one.id in ids]
        names, labels = [one.name for one in ones if one.id in faint], {one.label for one in ones}
        what = plural(len(ones), labels.pop() if len(labels) == 1 else "thing")
        named = f": {', '.join(names)}" if len(names) <= min(_MAX_LISTED, len(ids) - 1) else ""
        return f"Of these {what}, {len(faint)} {'are' if len(faint) > 1 else 'is'} doubtful{named}."

    def _moved(self, pose: Pose2, share: float, leg: int) -> None:
        self._page.pose = pose
        self._scene.show_robot(pose)
        self._follower.see(pose)
        self._show_progress(share)
        if time.monotonic() - self._told_at > POSE_S:
            self._show_pose()
        planned, answer = self._trajectory, self._answer  # another command may clear them meanwhile
        lines = planned.lines if planned is not None else ()
        line = int(lines[leg]) if leg < len(lines) else 0
        if answer is not None and line != self._line and not self._types_another:
            self._line = line
            self._show_program(answer.program or "", line or None)
            if self._phase == "paused":
                self._show_phase("paused")

    def _arrived(self) -> None:
        answer = self._answer
        if answer is not None:
            self._put_robot(answer.final_pose)
            self._conclude(answer)

    def _broke_down(self, fault: Exception) -> None:
        """Report an error that ended the drive; the robot stays where it is."""

        def report() -> None:
            self._ended("failed")
            self._show_phase("idle")
            self._show_progress(None)
            self._show_result("Failed", "The drive met an unexpected error; the robot stays where it is.", "bad")
            raise fault  # the page's notification, and the log

        self._page.command_worker.submit("broke down", report)

    def _conclude(self, answer: Answer) -> None:
        self._show_program(answer.program or "", answer.line, stuck=answer.line is not None)
        self._show_progress(None)
        self._ended(answer.status)
        self._show_phase("idle")
        if answer.status == "ok":  # the robot is elsewhere now
            self._draw(
                replace(self._marks, labels=[one._replace(text=_undistanced(one.text)) for one in self._marks.labels])
            )
        else:
            self._mark_named(answer.reason or "")
        done = "Done" if answer.answer is None else "Answer"
        title, tone = {"ok": (done, "good"), "refused": ("Refused", "bad")}.get(answer.status, ("Failed", "bad"))
        undone = (NOTHING_DONE,) if answer.status != "ok" and (answer.line or 0) > 1 else ()
        more = (*undone, *_ordered(self._why, answer.notes))
        self._show_result(title, outcome_text(answer), tone, more, answer.suggestions)
        self._preview_another()

    def _refuse(self, reason: str, instead: Sequence[str]) -> None:
        self._ended("refused")
        self._show_phase("idle")
        self._show_result("Refused", _cap(reason), "bad", [sides_text(reason, self._page.pose)], instead)

    def _remember(self, command: str) -> None:
        """Put a command that runs from now on first in the history."""
        self._running = command
        self._past = [Past(command, ""), *(past for past in self._past if past.command != command)][:MAX_REMEMBERED]
        self._show_past()

    def _light(self, ids: frozenset[int], *, dims: bool = True) -> None:
        """Outline some objects, and dim all else where that is wanted; none: dim nothing."""
        if (ids, dims) != (self._lit, self._dims):
            self._lit, self._dims = ids, dims
            self._draw(None)
            self._page.repaint()

    def told(self, event: dict[str, Any]) -> None:
        """Draw what a typed command would mean only while its tab is open."""
        tabs = event.get("open")
        if event.get("type") == "tabs" and isinstance(tabs, list):
            if self._previews and TITLE not in tabs:
                self._unmark()
            elif TITLE in tabs and not self._previews:
                self._preview_another()

    def selection_changed(self, instance_id: int | None) -> None:
        """Name and outline nothing any longer for an old command or answer, once nothing or another is selected."""
        before, self._was_selected = self._was_selected, instance_id
        other = instance_id is None or (instance_id != before and not self._previews)
        if other and not self.driving and self._lit:
            self._marks = replace(self._marks, labels=())
            self._light(frozenset())

    def escape(self) -> None:
        """Take what was drawn for a command off the map, its path too, unless the robot is on its way."""
        self._unmark()

    def _ended(self, status: str) -> None:
        """Note in the history how the command that runs, if one does, has ended."""
        if self._answer is None or self._answer.answer is None:
            self._light(self._lit, dims=False)  # its target stays outlined
        command, self._running = self._running, ""
        if command:
            self._past = [replace(past, status=status) if past.command == command else past for past in self._past]
            self._show_past()

    def _put_robot(self, pose: Pose2) -> None:
        self._page.pose = pose
        self._scene.show_robot(pose)
        self._show_pose()
        self._follower.see(pose, rests=True)

    def _clear(self) -> None:
        self._answer, self._line, self._trajectory, self._why, self._readings = None, 0, None, (), ()
        self._unmark()
        self._show_program("")
        self._show_other_reading(None)
        self._show_exchanges(())
        self._show_progress(None)

    def _draw(self, marks: Marks | None) -> None:
        """Draw other marks, or anew those there are (None)."""
        with self._page.client.atomic(), self._drawing:
            self._marks = self._marks if marks is None else marks
            shown = Marks() if self._hidden else self._marks
            self._scene.show_path(shown.path_m, shown.stops_m)
            lit = () if self._hidden else self._lit
            self._scene.show_target(outline_segments(self._page.simap, *lit, z_m=OUTLINE_M))
            self._scene.show_candidates(shown.labels)

    def _show_phase(self, phase: Phase) -> None:
        """Show the words and buttons that fit what the robot is doing."""
        self._phase = phase
        another = phase in _TITLES and self._types_another  # it is read; the first button sends it
        if phase in _TITLES and self._answer is not None and not another:
            waits = line_text(self._answer.program or "", self._line) if phase == "paused" else ""
            self._show_result(
                _TITLES[phase], outcome_text(self._answer), more=(waits, *_ordered(self._why, self._answer.notes))
            )
        buttons = "Go" if another else _FIRST[phase], _FIRST[phase] if another else "Step", "Stop"
        if tuple(self._run.options) != buttons:
            self._run.options = buttons

    def _show_result(
        self, title: str, text: str, tone: str = "plain", more: Sequence[str] = (), instead: Sequence[str] = ()
    ) -> None:
        """Show the outcome of a command, with further lines, and buttons with commands to give instead.

        The tone is one of plain, good, bad. What the buttons have is not said once more in the text.
        """
        if "doubtful" in " ".join((text, *more)):
            more = (*more, MEANS)
        if instead:
            text, more = text.partition(" Try: ")[0], (*more, NEAREST if tone == "good" else WORKS)
        self._outcome = True
        self._instead = tuple(instead)
        self._result.content = message_html(title, text, tone, more)
        for one, command in zip_longest(self._suggested, self._instead[:MAX_SUGGESTIONS]):
            if command is not None or one.visible:
                one.label, one.visible = command or "", command is not None  # whole, over two lines if need be

    def _show_typed(self, title: str, text: str, more: Sequence[str] = ()) -> None:
        """Show what a command that is still being typed would do, in place of what came of the one before."""
        self._show_program("")
        self._show_other_reading(None)
        self._show_result(title, text, more=more)
        self._outcome = False

    def _show_reading(self) -> None:
        """Show that what is typed is being read, where the letters before were answered; nothing below moves for it."""
        before, was_outcome, words = str(self._result.content), self._outcome, TYPING if self.uses_model else READING
        self._show_typed("", words)
        if not was_outcome and words not in before:
            self._result.content = (
                f'<div style="position:relative"><div style="visibility:hidden">{before}</div>'
                f'<div style="position:absolute;inset:0">{self._result.content}</div></div>'
            )

    def _show_program(self, program: str, line: int | None = None, *, stuck: bool = False) -> None:
        """Show the program; the given line (from 1) is marked as the current one, or as where it got stuck."""
        self._program.content = program_html(program, line, stuck=stuck)
        self._fold.visible = self._program.visible = bool(program)

    def _show_other_reading(self, other: Answer | None) -> None:
        """Offer to run another meaning of the command, and describe what it comes to; None hides the offer."""
        self._other.visible = other is not None
        if other is None:
            self._other_program.content = ""
            return
        numbers = {goal.instance for goal in other.goals if goal.instance}
        name = f" That is {self._page.simap.by_id(*numbers).name}." if len(numbers) == 1 else ""
        words = message_html("", f"{outcome_text(other)}{name}", "plain")
        self._other_program.content = words + program_html(other.program or "")

    def _show_progress(self, share: float | None) -> None:
        """Show how much of the drive is done, 0 to 1; None hides it."""
        if self._progress.visible != (share is not None):
            self._progress.visible = share is not None
        if share is not None:
            self._progress.value = round(100.0 * share, 1)

    def _show_exchanges(self, exchanges: Sequence[Exchange]) -> None:
        """Show the exchanges with a language model; an empty sequence hides them."""
        self._exchanges.content = exchanges_html(exchanges)
        self._conversation.visible = bool(exchanges)

    def _show_past(self) -> None:
        """Show the history, the newest first."""
        self._history.visible = bool(self._past)
        for i, one in enumerate(self._buttons):
            one.visible = i < len(self._past)
            if one.visible:
                one.label = _in_short(self._past[i].command)
                one.icon = _ICONS.get(self._past[i].status, viser.Icon.CLOCK)

    def _show_pose(self) -> None:
        pose, self._told_at = self._page.pose, time.monotonic()
        self._pose.content = (
            '<div style="padding:.2em .8em;font-size:.82em">Robot at '
            f"<b>x {pose.x_m:.2f} m, y {pose.y_m:.2f} m</b>, heading <b>{pose.heading_deg % 360:.0f}°</b></div>"
        )

    def _add_input(self, gui: viser.GuiApi) -> None:
        enabled, model = self._services.ask is not None, self._services.model
        # Multiline, so that Enter becomes part of the text: the browser sends only the last change of any 50 ms, and a
        # separate message about Enter would replace the last letters.
        self._text = gui.add_text(
            "Command", "", multiline=True, hint="In plain English, or a program; Enter sends it.", disabled=not enabled
        )
        self._typed_at = self._told_at = -math.inf
        by_person(self._text, self._typed)
        self._run = gui.add_button_group(
            "Run",
            ("Go", "Step", "Stop"),
            disabled=not enabled,
            hint="Go, pause or play on; run one line of the program; stop, also the wait for an answer.",
        )
        self._run.on_click(lambda event: self._pressed(str(event.target.value)))
        hint = f"Commands are read by {model.name if model else None}; off: by grammar."
        self._model = gui.add_checkbox("Language model", True, visible=model is not None, hint=hint)

    def _add_outcome(self, gui: viser.GuiApi) -> None:
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._result = gui.add_html(message_html("", WELCOME, "plain"))
        self._instead: tuple[str, ...] = ()
        tries = [functools.partial(self._try_instead, i) for i in range(MAX_SUGGESTIONS)]
        icon = viser.Icon.ARROW_RIGHT
        self._suggested = [button(gui, "", do, icon=icon, color="gray", visible=False) for do in tries]
        self._fold = gui.add_folder("Program", expand_by_default=False, visible=False)
        with self._fold:
            self._program = gui.add_html("", visible=False)
        self._other = gui.add_folder("The command could also mean", visible=False)
        with self._other:
            icon = viser.Icon.ARROWS_EXCHANGE
            button(gui, "Run the other reading", self.run_other_reading, icon=icon, color="gray")
            self._other_program = gui.add_html("")
        self._conversation = gui.add_folder("Sent to the language model", expand_by_default=False, visible=False)
        with self._conversation:
            self._exchanges = gui.add_html("")

    def _add_robot(self, gui: viser.GuiApi) -> None:
        # How it drives.
        self._speed = gui.add_slider("Speed (×)", 0.25, 8.0, 0.25, 1.0, hint=SPEED_HINT)
        self._speed.on_update(lambda _: setattr(self._drive, "speed", float(self._speed.value)))
        self._height = gui.add_slider(
            "Robot height (m)", MIN_HEIGHT_M, 2.0, 0.1, self._page.robot.height_m, hint=HEIGHT_HINT
        )
        self._height.on_update(lambda _: self._set_height())
        self._follow = gui.add_checkbox(
            "Follow robot", False, hint="The camera goes along: from above in the top view, behind it in the 3-D view."
        )
        self._follow.on_update(lambda _: self._follower.switch(bool(self._follow.value), self._page.pose))
        # What it may be asked, and was asked before.
        self._examples = gui.add_folder("Examples")
        with self._examples:
            for text in examples(_counted(self._page), EXAMPLES + 1):
                enabled = self._services.ask is not None
                button(gui, text, functools.partial(self.give, text), color="gray", disabled=not enabled)
        self._history = gui.add_folder("History", visible=False)
        with self._history:
            again = [functools.partial(self._try_again, i) for i in range(MAX_PAST)]
            self._buttons = [button(gui, "", do, color="gray", visible=False) for do in again]
        with gui.add_folder("Robot"):
            self._pose = gui.add_html("")
            button_row(gui, "Robot", {"Set on map": self.place, "Reset": self.reset}, hint=PLACE_HINT)

    def _set_height(self) -> None:
        self._page.robot = replace(self._page.robot, height_m=float(self._height.value))

    def give(self, command: str) -> None:
        """Write a command into the box, and carry it out."""
        self._text.value = command
        self.ask(command)

    def _try_again(self, number: int) -> None:
        if number < len(self._past):
            self.give(self._past[number].command)

    def _try_instead(self, number: int) -> None:
        if number < len(self._instead):
            self.give(self._instead[number])

    def _typed(self) -> None:
        self._typed_at = time.monotonic()
        text = str(self._text.value)
        command = entered(text)
        if command is not None:
            self._text.value = command
            self._send(paused=False)
        elif text.strip() and (self._types_another or self._phase not in _TITLES):
            self._end_typing()
            self._show_phase(self._phase)
            if self._phase == "idle":
                self._select_nothing()
            if self._phase != "asking":
                if self._outcome:
                    self._unmark()
                self._show_reading()
            preview = functools.partial(self._page.command_worker.submit, "preview", self._preview)
            self._typing = threading.Timer(PREVIEW_S, preview)
            self._typing.daemon = True
            self._typing.start()
        elif self._phase != "asking":
            self._unmark()
            self._show_typed("", WELCOME)
            self._show_phase(self._phase)
            if self._answer is not None and self.driving:
                self._show_program(self._answer.program, self._line or None)

    def _select_nothing(self) -> None:
        """Take what was selected off the map: the next command is about others."""
        if self._page.selected is not None:
            self._page.select(None)

    def _pressed(self, name: str) -> None:
        if name == "Stop":
            self.stop()
        elif name == "Step" and self.driving:
            self.step()
        elif name in ("Pause", "Play"):
            self.pause()
        else:
            if time.monotonic() - self._typed_at < _KEYS_LATE_S:  # the last keys may come after the press
                time.sleep(_KEYS_LATE_S)
            self._send(paused=name == "Step")

    def _send(self, *, paused: bool) -> None:
        command = str(self._text.value).strip()
        if command:
            self._select_nothing()
            self.ask(command, paused)
        else:
            self._show_result("", "Type a command first, or try an example.")
