"""Judges what the robot makes of commands as people say them, by the map's cells and the answer alone.

A round is a JSON list of ``{"map", "pose": [x, y, heading], "say", "level", "kind", "expect"}``. ``expect`` is one
expectation, or a list of which any will do; all keys of an expectation have to hold:

- ``visits`` [[ids], ...]: one stop after the other, each at one of its ids, and at no other object of their classes;
  ``visits_all`` [ids]: a stop at each, in any order; ``visits_count`` [[ids], n]: at n different ones of them.
- ``ends_near`` [ids]; ``ends_off`` [[ids], least, most]: distance to the nearest of them at the end;
  ``ends_at`` [x, y, within]; ``ends_in_polygon`` [[x, y], ...].
- ``faces`` [ids]; ``heading`` degrees at the end; ``turned`` degrees, to the right; ``moved_m`` length of the path.
- ``laps`` [id, n]; ``passes`` [[ids], ...] in this order; ``avoids`` [[ids], metres].
- ``answer_value`` one value or a list of acceptable ones; ``answer_number`` [value, within]; ``answer_any`` [ids], some
  of these and no other; ``answer_instances`` [ids], exactly these; ``stays``.
- ``refuse``: nothing else is right; ``or_refuse``: a refusal is right as well.

Run it: ``python tests/helpers/spoken.py ROUND.json... [--wrong] [--maps FOLDER]``; FOLDER holds house.npz and
breakroom.npz, built of the shared sequences (the break room with ``VoteSettings(rounds=0)``, as it was when most rounds
were written, and as breakroom-built.npz as `simaps build` makes it); without it their commands are left out. home.npz,
office.npz, canteen.npz and shop.npz are the embedded places with light errors.
"""

import argparse
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from toy_maps import furnished_map, toy_map

import simaps_viz
from simaps_viz.structures import Pose2, SIMap

ROOT = Path(__file__).parents[2]
ROUNDS = ROOT / "tests/language/rounds"
VERDICTS = ("right", "refused", "wrong", "traceback")
_NEAR_M = 1.0  # this far from an object is at it
_CROWDED_M = 1.6  # the planner may stop this far from what it was sent to
_TURNS = ("turn", "turn_absolute", "face", "with_object_on_left", "with_object_on_right")


class Verdict(NamedTuple):
    """What came of one command."""

    command: Mapping[str, Any]
    verdict: str  # one of VERDICTS
    why: str


@cache  # what is worked out of a map, such as its objects in space, is worked out once for all rounds
def load_round_map(name: str, folder: Path | None = None) -> SIMap | None:
    """Load the map that a round calls by this name; None where it is not at hand."""
    if name == "toy":
        return furnished_map(json.loads((ROUNDS / "flat.json").read_text()))
    if name == "toymap":
        return toy_map()
    path = ROOT / "recordings/cafe-evidence.npz" if name == "cafe" else (folder or ROUNDS) / f"{name}.npz"
    return simaps_viz.load_map(path) if path.is_file() else None


class Scene:
    """Distances on one map, from its cells."""

    def __init__(self, simap: SIMap) -> None:
        self.simap = simap
        self.label = {one.id: one.label for one in (*simap.instances, *simap.hidden)}
        self._trees: dict[int, KDTree] = {}

    def tree(self, number: int) -> KDTree:
        """Return the centres of an instance's cells, as a tree."""
        if number not in self._trees:
            cells, spec = np.argwhere(self.simap.instance == number)[:, ::-1], self.simap.spec
            centres = (cells + 0.5) * spec.cell_size_m + [spec.x0_m, spec.y0_m]
            # Of what lies below something else no cell shows anything.
            self._trees[number] = KDTree(centres if len(centres) else [self.simap.by_id(number).centroid_m[:2]])
        return self._trees[number]

    def off(self, ids: Iterable[int], points: Any) -> NDArray:
        """Return how far each point is from the nearest cell of any of the instances, metres, float64 [n]."""
        return np.min([self.tree(number).query(np.atleast_2d(points))[0] for number in ids], axis=0)

    def at(self, ids: Sequence[int], point: Any) -> bool:
        """Whether a point is at one of the instances, and no other of their classes is clearly nearer."""
        off, classes = self.off(ids, point)[0], {self.label[number] for number in ids}
        others = [number for number, label in self.label.items() if label in classes and number not in ids]
        return off <= _NEAR_M and (not others or off <= self.off(others, point)[0] + 0.25)


class _Outcome:
    """An answer, and what is asked of its path."""

    def __init__(self, scene: Scene, answer: simaps_viz.Answer) -> None:
        self.scene, self.answer, self.pose = scene, answer, answer.final_pose
        self.end = (self.pose.x_m, self.pose.y_m)
        self.stops: list[tuple[frozenset[int], tuple[float, float]]] = []
        """The instances that each goal names (none: a place only), and where it is; repetitions once."""
        for goal in answer.goals:
            ids = frozenset(i for i in (goal.instance, goal.other_instance) if i is not None)
            if goal.primitive not in _TURNS and not (self.stops and ids and self.stops[-1][0] == ids):
                self.stops.append((ids, goal.point_m))

    @cached_property
    def path(self) -> NDArray:
        """The path, a point every few centimetres."""
        legs = [np.linspace(a, b, 2 + int(math.dist(a, b) / 0.05)) for a, b in pairwise(self.answer.path_m)]
        return np.concatenate([self.answer.path_m[:1], *legs])

    def visits(self, wanted: Sequence[Sequence[int]]) -> bool:
        """Whether the stops are these, in this order; one at another object of these classes is one too many."""
        classes = {self.scene.label[number] for ids in wanted for number in ids}
        stops = [s for s in self.stops if not s[0] or any(self.scene.label[number] in classes for number in s[0])]

        def fits(stop: int, want: int) -> bool:
            if stop == len(stops):
                return want == len(wanted)
            ids, point = stops[stop]
            hit = want < len(wanted) and (ids & set(wanted[want]) if ids else self.scene.at(wanted[want], point))
            return bool(hit and fits(stop + 1, want + 1)) or (not ids and fits(stop + 1, want))

        return fits(0, 0)

    def visits_all(self, wanted: Sequence[int], count: int | None = None) -> bool:
        """Whether there is a stop at each (or at so many) of these, and at no other of their classes."""
        classes = {self.scene.label[number] for number in wanted}
        named = {number for ids, _ in self.stops for number in ids if self.scene.label[number] in classes}
        return named <= set(wanted) and len(named) == (len(wanted) if count is None else count)

    def stops_at(self, wanted: Sequence[int]) -> bool:
        """Whether the path ends where it was sent to one of these, as near as the robot can get to it."""
        at_last = bool(self.stops) and self.stops[-1][0] & set(wanted) and math.dist(self.stops[-1][1], self.end) < 0.05
        return bool(at_last) and bool(self.scene.off(wanted, self.end)[0] <= _CROWDED_M)

    def faces(self, ids: Iterable[int]) -> bool:
        """Whether the robot ends looking at a cell of one of the instances, within 15 degrees."""
        to = np.concatenate([self.scene.tree(number).data for number in ids]) - self.end
        off = np.arctan2(to[:, 1], to[:, 0]) - self.pose.yaw_rad
        return bool((np.cos(off) > math.cos(math.radians(15.0))).any())

    def laps(self, number: int) -> float:
        """Return how many times the path winds round an instance's middle."""
        to = self.path - np.array(self.scene.simap.by_id(number).centroid_m[:2])
        return float(np.ptp(np.unwrap(np.arctan2(to[:, 1], to[:, 0])))) / math.tau

    def passes(self, wanted: Sequence[Sequence[int]]) -> bool:
        """Whether the path comes near one object of each group, group after group."""
        at = 0
        for ids in wanted:
            near = np.flatnonzero(self.scene.off(ids, self.path[at:]) <= _NEAR_M)
            if len(near) == 0:
                return False
            at += int(near[0])
        return True


def _degrees_off(a: float, b: float) -> float:
    return abs((a - b + 180.0) % 360.0 - 180.0)


def _says(said: Mapping[str, Any], wanted: Any) -> bool:
    """Whether an answer's value is the wanted one; where it has no such value, whether its text holds it."""
    value, text = said.get("value"), str(said.get("text", "")).lower()
    if isinstance(wanted, bool):
        return bool(value) == wanted if isinstance(value, bool | int) else text.startswith("yes" if wanted else "no")
    if isinstance(wanted, int):
        return value == wanted if isinstance(value, int | float) else re.search(rf"\b{wanted}\b", text) is not None
    return str(wanted).lower() in f"{value} {text}".lower()


def _unmet(o: _Outcome, start: Pose2, expect: Mapping[str, Any]) -> str | None:
    """Name the first key of an expectation that does not hold; None when all do."""
    scene, heading, moved = o.scene, o.pose.heading_deg, o.answer.path_length_m
    said: Mapping[str, Any] = o.answer.to_json().get("answer") or {}
    names = set(said.get("instances") or ())
    checks = {
        "visits": lambda v: o.visits(v) and ("ends" in str([*expect]) or scene.off(v[-1], o.end)[0] <= _CROWDED_M),
        "visits_all": o.visits_all,
        "visits_count": lambda v: o.visits_all(*v),
        "ends_near": lambda v: scene.at(v, o.end) or o.stops_at(v),
        "ends_off": lambda v: v[1] <= scene.off(v[0], o.end)[0] <= v[2],
        "ends_at": lambda v: math.dist(v[:2], o.end) <= v[2],
        "ends_in_polygon": lambda v: cv2.pointPolygonTest(np.float32(v), o.end, True) >= -0.1,  # pyright: ignore
        "faces": o.faces,
        "heading": lambda v: _degrees_off(heading, v) <= 10.0,
        "turned": lambda v: moved <= 0.05 and _degrees_off(heading, start.heading_deg + v) <= 6.0,
        "moved_m": lambda v: abs(moved - v) <= max(0.1, 0.05 * v),
        "laps": lambda v: v[1] - 0.15 <= o.laps(v[0]) <= v[1] + 0.6,
        "passes": o.passes,
        "avoids": lambda v: scene.off(v[0], o.path).min() >= v[1],
        "answer_value": lambda v: any(_says(said, one) for one in (v if isinstance(v, list) else [v])),
        "answer_number": lambda v: isinstance(n := said.get("value"), int | float) and abs(n - v[0]) <= v[1],
        "answer_instances": lambda v: names == set(v),
        "answer_any": lambda v: bool(names) and names <= set(v),
        "stays": lambda v: (moved <= 0.05) == v,
        "or_refuse": lambda _: True,
        "refuse": lambda _: False,
    }
    if "answer" in str([*expect]) and (moved > 0.05 or _degrees_off(heading, start.heading_deg) > 1.0 or not said):
        return "an answer, without a move"
    return next((f"{key} {wanted}" for key, wanted in expect.items() if not checks[key](wanted)), None)


def judge(scene: Scene, command: Mapping[str, Any]) -> Verdict:
    """Give a command to the robot and judge what it does."""
    expects = command["expect"] if isinstance(command["expect"], list) else [command["expect"]]
    start = Pose2.from_heading(*command["pose"])
    try:
        answer = simaps_viz.ask(scene.simap, command["say"], pose=start)
    except Exception as error:
        return Verdict(command, "traceback", f"{type(error).__name__}: {error}")
    if answer.status != "ok" and answer.path_length_m > 0.05:
        return Verdict(command, "wrong", f"gave up after {answer.path_length_m:.1f} m: {answer.reason}")
    if answer.status != "ok":
        may_refuse = any(one.get("refuse") or one.get("or_refuse") for one in expects)
        return Verdict(command, "right" if may_refuse else "refused", answer.reason or "")
    outcome = _Outcome(scene, answer)
    unmet = [_unmet(outcome, start, one) for one in expects]
    if None in unmet:
        return Verdict(command, "right", "")
    stops = [(sorted(ids), *(round(v, 1) for v in point)) for ids, point in outcome.stops]
    did = answer.to_json().get("answer") or f"stops {stops}, ends {outcome.end[0]:.2f} {outcome.end[1]:.2f}"
    return Verdict(command, "wrong", f"wanted {' or '.join(filter(None, unmet))}; did {did}")


_IDS: Final = {
    "visits": lambda v: [number for ids in v for number in ids],
    "passes": lambda v: [number for ids in v for number in ids],
    "visits_count": lambda v: v[0],
    "ends_off": lambda v: v[0],
    "avoids": lambda v: v[0],
    "laps": lambda v: v[:1],
} | dict.fromkeys(("visits_all", "ends_near", "faces"), lambda v: v)
"""Of the keys of an expectation that look instances up on the map: where their ids are."""


def lacking(simap: SIMap, command: Mapping[str, Any]) -> list[int]:
    """Return the ids that a command's expectations name and that the map does not have."""
    expects = command["expect"] if isinstance(command["expect"], list) else [command["expect"]]
    known = {one.id for one in (*simap.instances, *simap.hidden)}
    named = [number for one in expects for key in one.keys() & _IDS.keys() for number in _IDS[key](one[key])]
    return sorted({*named} - known)


def judge_round(path: Path, folder: Path | None = None, left_out: list[str] | None = None) -> list[Verdict]:
    """Judge a round's commands, but for those whose map is not at hand, or on a map built anew under other ids.

    The latter are added to ``left_out``.
    """
    commands = json.loads(path.read_text())
    maps = {name: load_round_map(name, folder) for name in dict.fromkeys(one["map"] for one in commands)}
    scenes = {name: Scene(simap) for name, simap in maps.items() if simap is not None}
    verdicts = []
    for one in (one for one in commands if one["map"] in scenes):
        if missing := lacking(scenes[one["map"]].simap, one):
            (left_out if left_out is not None else []).append(f"{path.stem} {one['map']} {one['say']!r}: no {missing}")
        else:
            verdicts.append(judge(scenes[one["map"]], one))
    return verdicts


def main() -> None:
    """Print how many commands of each map, level and kind came out how."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("rounds", nargs="+", type=Path)
    parser.add_argument("--maps", type=Path, help="folder of house.npz and breakroom.npz")
    parser.add_argument("--wrong", action="store_true", help="print each command that did not come out right")
    options = parser.parse_args()
    left_out: list[str] = []
    verdicts = [verdict for path in options.rounds for verdict in judge_round(path, options.maps, left_out)]
    for one in verdicts:
        if options.wrong and one.verdict != "right":
            print(
                f"{one.verdict:9} {one.command['map']} {one.command['pose']} {one.command['say']!r}\n{'':10}{one.why}"
            )
    for heading in ("map", "level", "kind"):
        for value in dict.fromkeys(one.command[heading] for one in verdicts):
            came = Counter(one.verdict for one in verdicts if one.command[heading] == value)
            print(f"{heading:6} {value:10}", *(f"{came[name]:4} {name}" for name in VERDICTS))
    came = Counter(one.verdict for one in verdicts)
    print(f"all    {len(verdicts):<10}", *(f"{came[name]:4} {name}" for name in VERDICTS))
    for one in left_out:
        print("left out: the map has its instances under other ids:", one)
    print(f"left out {len(left_out)}")


if __name__ == "__main__":
    main()
