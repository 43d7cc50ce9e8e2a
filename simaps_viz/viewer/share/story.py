"""What a shared file shows: the growth of the map in time steps, then a robot that carries out a command."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.drawing.frame_pictures import communities_unseen_until, owner_of_community
from simaps_viz.errors import CommandError
from simaps_viz.mapping.methods import method_of
from simaps_viz.navigation.agent import Answer, outcome_text
from simaps_viz.navigation.trajectory import Trajectory, poses_along, trajectory, trajectory_of_steps
from simaps_viz.structures import Pose2, SIMap

Look = Callable[[int], SIMap | None]
"""Returns the map as it was after a frame, on the grid and in the colours of the finished one; None = not known."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A command as a robot carries it out on the map, in simulation."""

    command: str
    trajectory: Trajectory
    path_m: NDArray
    """float64 [n, 2], map frame."""
    outcome: str
    """Where the robot ended, or why it stopped, in words."""
    done: bool
    """Whether it was carried out to its end."""

    @property
    def caption(self) -> str:
        """Command and outcome."""
        return f"“{self.command}” · {self.outcome}"


@dataclass(frozen=True, eq=False)
class TimeStep:
    """The map after some frames."""

    frame: int
    """Index of the last of them."""
    simap: SIMap
    """What to draw: the map of that time, or the finished one with ``hidden`` left out."""
    hidden: NDArray
    """int32 [n], communities not to draw."""
    words: str
    """Such as "Frame 40 of 200 · 31 objects"."""


def drive_of(
    simap: SIMap,
    command: str,
    pose: Pose2,
    *,
    ask: Callable[[SIMap, str, Pose2], Answer],
) -> Drive:
    """Carry out a command in simulation.

    Args:
        simap: the map.
        command: English, or a program.
        pose: where the robot is.
        ask: carries it out.

    Raises:
        CommandError: it was refused, or the robot did not move.
    """
    answer = ask(simap, command, pose)
    if answer.status == "refused":
        raise CommandError(f'"{command}": {answer.reason or "refused"}')
    if answer.steps:
        driven = trajectory_of_steps(answer.steps, pose)
    elif len(answer.path_m):
        driven = trajectory(poses_along(pose, answer.path_m, answer.final_pose))
    else:
        raise CommandError(f'"{command}": {answer.reason or "the robot does not move"}')
    path_m = np.asarray(answer.path_m, np.float64).reshape(-1, 2)
    return Drive(command, driven, path_m, outcome_text(answer), answer.status == "ok")


def time_steps(simap: SIMap, most: int, look: Look | None = None) -> Iterator[TimeStep]:
    """Yield time steps of the build, evenly spaced, the last being the finished map.

    Args:
        simap: the finished map.
        most: at most so many; at least 1.
        look: the map after a frame, where that is known; else objects appear once a frame has named them.
    """
    frames = len(simap.frame_names)
    if not frames:
        return
    for frame in np.unique(np.linspace(0, frames - 1, min(most, frames)).round().astype(int)).tolist():
        then = simap if frame == frames - 1 else (look(frame) if look is not None else None)
        hidden = communities_unseen_until(simap, frame) if then is None else np.zeros(0, np.int32)
        count = _count_left(simap, hidden) if then is None else len(then.instances)
        words = f"Frame {frame + 1} of {frames} · {plural(count, 'object')}"
        yield TimeStep(frame, simap if then is None else then, hidden, words)


def is_simulated(simap: SIMap) -> bool:
    """Whether anything that the map was made from is simulated."""
    return bool(simap.provenance.get("simulated"))


def origin_text(simap: SIMap) -> str:
    """Describe how the map was made: method with its parameter, frames, cell size, masks."""
    slider = method_of(simap.method).slider
    method = f"method {simap.method}"
    if slider is not None and slider.parameter in simap.parameters:
        method += ", " + slider.setting.format(float(simap.parameters[slider.parameter]))
    masks = simap.provenance.get("segmentation", "unknown")
    frames = plural(len(simap.frame_names), "frame")
    return f"{method} · {frames} · cells of {simap.spec.cell_size_m * 100:g} cm · masks: {masks}"


def _count_left(simap: SIMap, hidden: NDArray) -> int:
    """Count the instances of which a community is not hidden."""
    owner = owner_of_community(simap)
    shown = np.setdiff1d(np.unique(simap.community[simap.community > 0]), hidden)
    return len(np.unique(owner[shown][owner[shown] > 0]))
