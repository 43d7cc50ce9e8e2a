"""A planned drive as a TUM trajectory, for evo and other trajectory tools."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import CommandError, InputError
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.navigation.agent import Agent, CommandReader, is_program
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.navigation.robot import Motion
from simaps_viz.structures import Pose2, SIMap


class TUMTrajectory(Exporter):
    """A drive as timed poses."""

    endings = (".tum", ".txt")
    own_endings = (".tum",)
    options = ("command",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Drive the command and return its poses."""
        if options.command is None or options.pose is None:
            raise InputError('tum: expected a command to drive, such as --trajectory "go to the sofa", found none')
        poses = driven_poses(simap, options.command, options.pose, robot=options.robot, reader=options.reader)
        return {path: tum_bytes(poses)}


def driven_poses(
    simap: SIMap, command: str, pose: Pose2, *, robot: RobotShape | None = None, reader: CommandReader | None = None
) -> NDArray:
    """Drive a command in simulation and return its poses; without a reader the grammar reads it.

    Returns:
        float64 [n, 4]: time in seconds from 0, x, y in metres, yaw in radians; map frame.

    Raises:
        CommandError: the command is not understood, or the map lacks what it asks for.
        PlanningError: there is no path.
    """
    if reader is None:
        from simaps_viz.language.commands import read_command as reader  # noqa: PLC0415 - its word tables take long
    program = command if is_program(command) else reader(command, simap.counts(hidden=True)).program
    motion = Motion()
    agent = Agent(simap, pose, robot, motion=motion)
    pieces = [event.poses.reshape(-1, 3) for event in agent.steps(program) if event.done]
    poses = np.concatenate([[[pose.x_m, pose.y_m, pose.yaw_rad]], *pieces])
    moved = np.r_[True, np.any(np.diff(poses, axis=0) != 0.0, axis=1)]  # a statement begins where the last one ended
    poses = poses[moved]
    if len(poses) < 2:
        raise CommandError(
            f"{command!r}: expected a command that moves the robot, found one that leaves it where it is"
        )
    return np.column_stack([np.arange(len(poses)) * motion.dt_s, poses])


def tum_bytes(poses: NDArray) -> bytes:
    """Write timed poses as ``timestamp tx ty tz qx qy qz qw`` lines; the robot's base on the floor, z = 0.

    ``poses`` is float64 [n, 4] as `driven_poses` returns it: seconds, x and y in metres, yaw in radians; map frame.
    """
    lines = ["# timestamp tx ty tz qx qy qz qw", "# map frame: metres, x east, y north, z up; simulated drive"]
    for time, x, y, yaw in poses + 0.0:  # which has no -0
        lines.append(f"{time:.6f} {x:.6f} {y:.6f} 0.000000 0 0 {np.sin(yaw / 2):.9f} {np.cos(yaw / 2):.9f}")
    return ("\n".join(lines) + "\n").encode()
