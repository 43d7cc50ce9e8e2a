"""What a shared file tells: the map's growth in a few moments, then a robot's ride, with the words that go with it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.colors.instances import take_over
from simaps_viz.drawing.picking import communities_unseen_until, owner_of_community
from simaps_viz.errors import CommandError
from simaps_viz.mapping.simap import JOINING
from simaps_viz.navigation.agent import Answer, StepEvent, outcome_text
from simaps_viz.navigation.trajectory import Trajectory, poses_along, ride_of_steps, trajectory
from simaps_viz.structures import Pose2, SIMap

Look = Callable[[int], SIMap | None]
"""Gives the map as it was after a frame; None when that is not known."""


@dataclass(frozen=True, eq=False)
class Ride:
    """A command as a robot carries it out on the map."""

    command: str
    trajectory: Trajectory
    path_m: NDArray
    """float64 [n, 2], map frame."""
    outcome: str
    """What came of it, in words."""
    done: bool
    """Whether it was carried out to its end."""


@dataclass(frozen=True, eq=False)
class Moment:
    """The map after some frames."""

    frame: int
    """Index of the last of them."""
    simap: SIMap
    """What to draw: the map of that time, or the finished one with ``hidden`` left out."""
    hidden: NDArray
    """int32 [n], communities not to draw."""
    words: str
    """Such as "Frame 40 of 200 · 31 objects"."""


def ride_of(
    simap: SIMap,
    command: str,
    pose: Pose2,
    *,
    ask: Callable[[SIMap, str, Pose2], Answer],
    steps: Callable[[SIMap, str, Pose2], Iterable[StepEvent]] | None = None,
) -> Ride:
    """Carry out a command in simulation.

    Args:
        simap: the map.
        command: English, or a program.
        pose: where it is given.
        ask: carries it out.
        steps: runs its program again, statement by statement, so that the robot turns as it really does.

    Raises:
        CommandError: it was refused, or the robot did not move.
    """
    answer = ask(simap, command, pose)
    if answer.status == "refused":
        raise CommandError(f'"{command}": {answer.reason or "refused"}')
    if answer.status == "ok" and answer.program and steps is not None:
        ride = ride_of_steps(list(steps(simap, answer.program, pose)), pose)
    elif len(answer.path_m):
        ride = trajectory(poses_along(pose, answer.path_m, answer.final_pose))
    else:
        raise CommandError(f'"{command}": {answer.reason or "the robot does not move"}')
    done = answer.status == "ok"
    return Ride(command, ride, np.asarray(answer.path_m, np.float64).reshape(-1, 2), outcome_text(answer), done)


def moments(simap: SIMap, most: int, look: Look | None = None) -> Iterator[Moment]:
    """Return at most so many moments of the build, evenly spaced, the last being the finished map.

    Args:
        simap: the finished map.
        most: at least 1.
        look: the map after a frame, where that is known; else the finished map without what nobody had named yet.
    """
    frames = len(simap.frame_names)
    if not frames:
        return
    for frame in np.unique(np.linspace(0, frames - 1, min(most, frames)).round().astype(int)).tolist():
        then = simap if frame == frames - 1 else (look(frame) if look is not None else None)
        if then is None:
            hidden = communities_unseen_until(simap, frame)
            count = _left_over(simap, hidden)
            then = simap
        else:
            then = _dressed(then, simap)
            hidden, count = np.zeros(0, np.int32), len(then.instances)
        yield Moment(frame, then, hidden, f"Frame {frame + 1} of {frames} · {plural(count, 'object')}")


def _dressed(then: SIMap, simap: SIMap) -> SIMap:
    """Return the objects of an earlier map the colours that they have on the finished one."""
    if then is simap:
        return simap
    seen = then.instance > 0
    if then.spec == simap.spec and np.array_equal(then.instance[seen], simap.instance[seen]):
        # Colours go by communities and merges: with the finished map's, the same ids have the same colours.
        return replace(then, community=simap.community, merges=simap.merges)
    take_over(then, simap)
    return then


def title_of(simap: SIMap) -> str:
    """Name a map by what it shows."""
    sequence = PurePath(str(simap.provenance.get("sequence", "unknown sequence")))
    folder = sequence.parent.name if sequence.suffix == ".json" and sequence.parent.name else sequence.name
    return str(simap.provenance.get("name") or folder)


def is_simulated(simap: SIMap) -> bool:
    """Return whether any of what the map was made from is simulated."""
    return bool(simap.provenance.get("simulated"))


def origin_text(simap: SIMap) -> str:
    """Describe how a map was made: method with its parameter, frames, cell size, masks."""
    joining = JOINING.get(simap.method)
    method = f"method {simap.method}"
    if joining is not None and joining in simap.parameters:
        words = {"affinity": "affinity {:g}", "k_percent": "K = {:g} %"}[joining]
        method += ", " + words.format(float(simap.parameters[joining]))
    masks = simap.provenance.get("segmentation", "unknown")
    frames = plural(len(simap.frame_names), "frame")
    return f"{method} · {frames} · cells of {simap.spec.cell_size_m * 100:g} cm · masks: {masks}"


def _left_over(simap: SIMap, hidden: NDArray) -> int:
    """Count the instances of which something is not hidden."""
    owner = owner_of_community(simap)
    shown = np.setdiff1d(np.unique(simap.community[simap.community > 0]), hidden)
    return len(np.unique(owner[shown][owner[shown] > 0]))
