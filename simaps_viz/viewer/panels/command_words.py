"""What came of a command, in words and as small pieces of HTML."""

import re
from collections.abc import Collection, Mapping, Sequence
from html import escape
from typing import Any

from simaps_viz.labels import plural
from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.drawing.label_layout import Label
from simaps_viz.viewer.drawing.theme import (
    BAD_PAPER_STYLE,
    DIM_STYLE,
    GOOD_PAPER_STYLE,
    NESTED_EM,
    PAPER_STYLE,
    SENT_PAPER_STYLE,
)
from simaps_viz.viewer.services import AnswerLike, CandidateLike, ExchangeLike

_NTH = ("", "", "second ", "third ", "fourth ", "fifth ", "sixth ", "seventh ", "eighth ", "ninth ", "tenth ")
_MOST_LISTED = 4
_CHOICES = (
    (re.compile(r'robot\.closest_to\("([^"]*)", "([^"]*)"'), "It was chosen for lying nearest to the {}."),
    (re.compile(r'robot\.nth_from\("([^"]*)", "([^"]*)"'), "It was chosen by counting from the {}."),
    (
        re.compile(r'robot\.between\("([^"]*)", "([^"]*)", "([^"]*)"'),
        "It was chosen for lying between the {} and the {}.",
    ),
    (re.compile(r'robot\.in_view\("([^"]*)"'), "Only what the robot could see from there was counted."),
)
"""How a program may choose among the instances of a class other than by closeness, and how to say so."""


def result_text(answer: AnswerLike) -> str:
    """Say why not, or where the robot goes and how far."""
    if answer.status != "ok":
        return str(answer.reason or "")
    names = [_name_of(goal) for goal in answer.goals if field_of(goal, "label")]
    parts = [", then ".join(f"to the {name}" for name in dict.fromkeys(names))] if names else []
    pose = answer.final_pose
    parts += [
        f"{answer.path_length_m:.2f} m",
        f"ends at x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, heading {pose.heading_deg % 360:.0f}°",
    ]
    text = ", ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


def why_text(answer: AnswerLike, candidates: Sequence[CandidateLike]) -> str:
    """Say why the robot goes to this instance and to no other of its class; empty when there was nothing to choose.

    Args:
        answer: with the goals.
        candidates: all instances of the goals' class, the closest to where the command was given first.
    """
    chosen = dict.fromkeys(int(field_of(goal, "instance") or 0) for goal in answer.goals)
    mine = [c for c in candidates if c.instance.id in chosen]
    if not mine:
        return ""
    label = mine[0].instance.label
    if len(mine) > 1:
        if len(mine) == len(candidates):
            return f"All {plural(len(mine), label)} on this map are meant."
        several = _listed(mine, label)
        return f"{several[0].upper()}{several[1:]} are meant, of {len(candidates)} on this map."
    one = mine[0]
    if len(candidates) == 1:
        return f"It is the only {label} on this map, {one.distance_m:.2f} m from where the command was given."
    nth = _NTH[one.rank] if one.rank < len(_NTH) else f"{one.rank}th "
    closest = f"the {nth}closest to"
    if one.rank == len(candidates) > 2:
        closest = f"the farthest of {len(candidates)} from"
    text = f"{label} {one.rank} is {closest} where the command was given: {one.distance_m:.2f} m;"
    return " ".join([text[0].upper() + text[1:], _others(one, candidates), *_choice(answer.program or "", label)])


def candidate_labels(candidates: Sequence[CandidateLike], chosen: Collection[int], most: int = 5) -> list[Label]:
    """Number what a command could have meant: "▶ 3 · 2.6 m" is the chosen one, "1 · 1.2 m" one that lies closer.

    Args:
        candidates: the closest first.
        chosen: ids of those that are meant.
        most: how many besides them; none of them is farther than the last that is meant.

    Returns:
        the chosen ones first.
    """
    mine = [c for c in candidates if c.instance.id in chosen]
    last = max((c.rank for c in mine), default=len(candidates))
    others = [c for c in candidates if c.instance.id not in chosen and c.rank <= last][:most]
    texts = [(f"{'▶ ' if c in mine else ''}{c.rank} · {c.distance_m:.1f} m", c.instance) for c in (*mine, *others)]
    return [label_of(text, one) for text, one in texts]


def goal_labels(simap: SIMap, goals: Sequence[Any]) -> list[Label]:
    """Number the objects the robot was sent to, in order, those that are on the map."""
    places: dict[int, list[str]] = {}
    for number, goal in enumerate(goals, start=1):
        for name in ("instance", "other_instance"):
            if field_of(goal, name):
                places.setdefault(int(field_of(goal, name)), []).append(str(number))
    known = {instance.id: instance for instance in simap.instances}
    return [label_of(", ".join(texts), known[i]) for i, texts in places.items() if i in known]


def label_of(text: str, one: Instance) -> Label:
    """Give a text that stands beside an instance."""
    (x0, y0, _), (x1, y1, _) = one.aabb_m
    return Label(text, (x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0) / 2, (y1 - y0) / 2)


def message_html(title: str, text: str, tone: str, more: Sequence[str] = ()) -> str:
    """Say something: a bold title and a text, tinted by tone (plain, good, bad), and further lines, smaller."""
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
    """Show a program as code, with line numbers; the given line (from 1) is marked, in red when it got stuck there."""
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


def exchanges_html(exchanges: Sequence[ExchangeLike]) -> str:
    """Show what a language model was sent, and what it wrote back."""
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


def field_of(goal: Any, name: str) -> Any:
    """Give a field of a goal, whether it is a mapping or an object; None when it has none of that name."""
    return goal.get(name) if isinstance(goal, Mapping) else getattr(goal, name, None)


def _name_of(goal: Any) -> str:
    other = field_of(goal, "other_label")
    return f"{field_of(goal, 'label')} and the {other}" if other else str(field_of(goal, "label"))


def _others(one: CandidateLike, candidates: Sequence[CandidateLike]) -> str:
    """Say where the closer ones are, or the next when there is none closer."""
    label = one.instance.label
    if one.rank == 1:
        return f"the next {label} is at {candidates[1].distance_m:.2f} m."
    closer = candidates[: one.rank - 1]
    distances = [f"{c.distance_m:.2f}" for c in closer]
    if len(closer) == 1:
        return f"{label} 1 is at {distances[0]} m."
    if len(closer) > _MOST_LISTED:
        return f"{_listed(closer, label)} are at {distances[0]} to {distances[-1]} m."
    return f"{_listed(closer, label)} are at {', '.join(distances[:-1])} and {distances[-1]} m."


def _listed(candidates: Sequence[CandidateLike], label: str) -> str:
    """Name several by their numbers: "chairs 1, 2 and 5"; a long row that has no holes as "chairs 1 to 9"."""
    ranks = sorted(c.rank for c in candidates)
    name = plural(2, label).removeprefix("2 ")
    if len(ranks) > _MOST_LISTED and ranks == list(range(ranks[0], ranks[-1] + 1)):
        return f"{name} {ranks[0]} to {ranks[-1]}"
    return f"{name} {', '.join(map(str, ranks[:-1]))} and {ranks[-1]}"


def _choice(program: str, label: str) -> list[str]:
    """Say how the program chose, where it did not go by closeness alone."""
    for pattern, words in _CHOICES:
        found = pattern.search(program)
        if found:
            # a look-up of another class only helped to find the one
            return [words.format(*found.groups()[1:])] if found[1] == label else ["The program says how it was chosen."]
    return ["The program says how it was chosen."] if "for candidate in " in program else []


def _box(title: str, text: str, paper: str) -> str:
    return (
        f'<div style="{DIM_STYLE};margin-top:.3em">{escape(title)}</div>'
        f'<div style="{paper};border-radius:4px;padding:.3em .5em;max-height:14em;overflow:auto;'
        f'white-space:pre-wrap;overflow-wrap:anywhere;font:12px/1.45 ui-monospace,monospace">{escape(text)}</div>'
    )
