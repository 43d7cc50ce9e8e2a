"""The ways in which people write poses, and what each takes to become ``T_world_camera`` with OpenCV axes."""

from dataclasses import dataclass
from functools import cache
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

FORMS = ("camera-to-world", "world-to-camera", "rotation world-to-camera", "position world-to-camera")
"""What of a pose file is written the other way round: nothing, all, only the rotation, only the position."""

Turn = tuple[tuple[int, ...], ...]
"""A signed permutation: three rows of three, each with one entry of ±1."""

PLAIN: Turn = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
OPENGL: Turn = ((1, 0, 0), (0, -1, 0), (0, 0, -1))
ROS: Turn = ((0, 0, 1), (-1, 0, 0), (0, -1, 0))

_NAMED_AXES: dict[Turn, str] = {
    PLAIN: "x right, y down, z forward",
    OPENGL: "OpenGL camera axes (x right, y up, z backward)",
    ROS: "ROS body axes (x forward, y left, z up)",
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)): "axes x down, y forward, z right",
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)): "axes x right, y forward, z up",
    ((-1, 0, 0), (0, -1, 0), (0, 0, 1)): "a camera upside down (x left, y up, z forward)",
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)): "a camera on its side",
    ((0, 1, 0), (-1, 0, 0), (0, 0, 1)): "a camera on its other side",
    ((1, 0, 0), (0, -1, 0), (0, 0, 1)): "a camera with y flipped (x right, y up, z forward: left-handed)",
    ((1, 0, 0), (0, 1, 0), (0, 0, -1)): "a camera with z flipped (left-handed)",
    ((-1, 0, 0), (0, 1, 0), (0, 0, 1)): "a camera with x flipped (left-handed)",
}
"""By the matrix that takes OpenCV camera points to the named axes' numbers."""


@dataclass(frozen=True)
class Convention:
    """One way of writing poses."""

    form: str = FORMS[0]
    axes: Turn = PLAIN
    """A: takes a point's OpenCV camera coordinates to those the poses were written for; a signed permutation."""
    world: Turn = PLAIN
    """W: takes a point's world coordinates as written to those wanted; mirrors a mirrored world back."""
    turned_positions: Turn = PLAIN
    """Q: takes positions as written to the axes of the rotations."""

    @property
    def plain(self) -> bool:
        """Nothing has to be done."""
        return self == Convention()

    @property
    def changes(self) -> int:
        """How many things it says are unusual; the simplest one that fits is believed."""
        plain = Convention()
        named = self.axes in _NAMED_AXES
        return (
            (self.form != plain.form) * (1 if self.form == FORMS[1] else 2)
            + (self.axes != plain.axes) * (1 if named else 2)
            + (self.world != plain.world)
            + (self.turned_positions != plain.turned_positions) * 2
        )

    def apply(self, matrices: NDArray) -> NDArray:
        """Turn poses [n, 4, 4] as written into T_world_camera."""
        rotation = matrices[:, :3, :3]
        position = matrices[:, :3, 3] @ np.array(self.turned_positions, float).T
        back = -np.einsum("nji,nj->ni", rotation, position)
        if self.form in (FORMS[1], FORMS[2]):
            rotation = rotation.transpose(0, 2, 1)
        if self.form in (FORMS[1], FORMS[3]):
            position = back if self.form == FORMS[1] else -np.einsum("nij,nj->ni", rotation, position)
        world = np.array(self.world, float)
        out = np.tile(np.eye(4), (len(matrices), 1, 1))
        out[:, :3, :3] = world @ rotation @ np.array(self.axes, float)
        out[:, :3, 3] = position @ world.T
        return out

    def in_words(self) -> str:
        """Describe what the poses look like."""
        plain = Convention()
        parts = [self.form] if self.form != plain.form else []
        if self.axes != plain.axes:
            parts.append(f"for {_NAMED_AXES.get(self.axes, f'other camera axes {list(map(list, self.axes))}')}")
        if self.turned_positions != plain.turned_positions:
            parts.append("with positions in other axes than rotations")
        if self.world != plain.world:
            parts.append("of a mirrored world")
        return ", ".join(parts) or "camera-to-world with OpenCV axes"


@cache
def signed_permutations(determinant: int) -> tuple[Turn, ...]:
    """Return the 24 matrices of zeros and ±1 with that determinant, the identity first where it is among them."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            matrix = np.zeros((3, 3), int)
            matrix[range(3), order] = signs
            if round(float(np.linalg.det(matrix))) == determinant:
                found.append(tuple(tuple(int(x) for x in row) for row in matrix))
    return tuple(found)


MIRRORS: tuple[Turn, ...] = tuple(
    tuple(tuple(row) for row in matrix)
    for matrix in (
        ((1, 0, 0), (0, 0, 1), (0, 1, 0)), ((0, 1, 0), (1, 0, 0), (0, 0, 1)), ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
        ((1, 0, 0), (0, 1, 0), (0, 0, -1)), ((1, 0, 0), (0, -1, 0), (0, 0, 1)), ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    )
)  # fmt: skip
"""Swapping two world axes, or turning one round; the frames agree alike after each."""


def conventions(*, mirrored: bool) -> list[Convention]:
    """Return the ways worth trying, for poses whose rotations are proper or mirrored, the simplest first."""
    proper, improper = signed_permutations(1), signed_permutations(-1)
    if mirrored:
        found = [Convention(form, axes) for form in FORMS for axes in improper]
        found += [Convention(form, axes, MIRRORS[0]) for form in FORMS for axes in proper]
    else:
        found = [Convention(form, axes) for form in FORMS for axes in proper]
        turns = (*proper[1:], *improper)
        found += [Convention(turned_positions=turn) for turn in turns if turn != Convention().axes]
    return sorted(found, key=lambda convention: convention.changes)
