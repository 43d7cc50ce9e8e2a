"""The true map: which object every cell shows, from exact ids, by the rule the judged map was made by.

Also windows of one endless grid: where the cells of one map lie in another. Only whole cells are ever moved.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.floors import SomeFrames
from simaps_viz.datasets.manifest import few
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource, read_ahead
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.geometry import moved, shared_cells
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.partition import empty_log, empty_views
from simaps_viz.mapping.simap import Origin, assemble
from simaps_viz.structures import Grid, GridSpec, Segment, Segmentation, SIMap


def whole_cells(old: GridSpec, new: GridSpec) -> tuple[int, int]:
    """Return (rows, cols) to add to a cell of one window to find it in another.

    Raises:
        InputError: the cells have another size or do not coincide.
    """
    if abs(old.cell_size_m - new.cell_size_m) > 1e-9:
        raise InputError(f"windows: expected cells of one size, found {old.cell_size_m:g} and {new.cell_size_m:g} m")
    shift = np.array([old.y0_m - new.y0_m, old.x0_m - new.x0_m]) / new.cell_size_m
    whole = np.rint(shift)
    if np.abs(shift - whole).max() > 1e-3:
        raise InputError(
            f"windows: expected cells that coincide, found them {shift[0] - whole[0]:+.3f} rows and "
            f"{shift[1] - whole[1]:+.3f} columns off"
        )
    return int(whole[0]), int(whole[1])


def joint_window(one: GridSpec, other: GridSpec) -> GridSpec:
    """Return the smallest window that holds two windows of the same endless grid."""
    row, col = whole_cells(other, one)
    low = (min(0, row), min(0, col))
    high = (max(one.rows, row + other.rows), max(one.cols, col + other.cols))
    s = one.cell_size_m
    x0, y0 = one.x0_m + low[1] * s, one.y0_m + low[0] * s
    return GridSpec(high[0] - low[0], high[1] - low[1], s, round(x0, 9), round(y0, 9))


def moved_grid(grid: Grid, spec: GridSpec) -> Grid:
    """Copy a grid to another window of the same endless grid; raises InputError if the cells do not coincide."""
    shift = whole_cells(grid.spec, spec)
    return replace(
        grid,
        spec=spec,
        label=moved(grid.label, shift, spec.shape, 0),
        height_m=moved(grid.height_m, shift, spec.shape, np.nan),
        lowest_m=moved(grid.lowest_m, shift, spec.shape, np.nan),
        observations=moved(grid.observations, shift, spec.shape, 0),
    )


def partners(cells: NDArray, reference: NDArray) -> dict[int, int]:
    """Return {id: the id of the reference with which it shares most cells}, the lower of equals; none without any.

    Args:
        cells: int, any shape, 0 = none.
        reference: the same cells.
    """
    mine, theirs, shared = shared_cells(cells, reference)
    best: dict[int, int] = {}
    for at in np.argsort(-shared, kind="stable").tolist():
        best.setdefault(int(mine[at]), int(theirs[at]))
    return best


_MAX_IDS = np.iinfo(np.int16).max
_SLOTS = tuple(str(i) for i in range(_MAX_IDS + 1))
_SAME_FRAME = 1e-3
"""Map frames whose transforms differ by no more than this (metres, or sines) are one."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The true topmost object of every cell."""

    grid: Grid
    """Its ``label`` is the true class of each cell's highest pixel."""
    instance: NDArray
    """int32 [rows, cols], world-wide id of the thing on top, 0 = none (nothing there, or stuff)."""
    names: Mapping[int, str]
    """{world-wide id: class} of every thing of the masks."""
    T_map_world: NDArray
    """float64 [4, 4], world to map frame."""
    source: str
    """Where the masks come from, in words."""

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie."""
        return self.grid.spec

    @property
    def label(self) -> NDArray:
        """int16 [rows, cols], index into ``labels``, 0 = none."""
        return self.grid.label

    @property
    def labels(self) -> tuple[str, ...]:
        """Class names; index 0 is "none"."""
        return self.grid.labels

    def on(self, spec: GridSpec) -> "Truth":
        """Return the truth on another window of the same endless grid; what lies outside it is cut off.

        Raises:
            InputError: the cells have another size or do not coincide.
        """
        shift = whole_cells(self.spec, spec)
        return replace(self, grid=moved_grid(self.grid, spec), instance=moved(self.instance, shift, spec.shape, 0))


def truth_map(
    sequence: FrameSource,
    settings: ProjectionSettings | None = None,
    *,
    T_map_world: NDArray | None = None,
    frame_names: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Truth:
    """Make the true map of a sequence with exact ids.

    Every id is mapped as if it were a class of its own, by the very code that maps classes: so the highest pixel
    names the cell, with the same depth range, cut, window and ties.

    Args:
        sequence: its masks are the truth and hold world-wide ids.
        settings: those of the map to be judged.
        T_map_world: map frame of the map to be judged; by default the sequence's.
        frame_names: use only these frames; by default all.
        progress: notified of every frame.

    Raises:
        InputError: the masks are not the truth, an id has two classes, or a frame is missing or damaged.
    """
    check_exact(sequence)
    frame_of_map = np.asarray(sequence.T_map_world if T_map_world is None else T_map_world, dtype=np.float64)
    accumulator = MapAccumulator(_SLOTS, (False,) * len(_SLOTS), settings or ProjectionSettings())
    known: dict[int, Segment] = {}
    slot_of: dict[int, int] = {}
    wanted = None if frame_names is None else set(frame_names)
    for done, (frame, segmentation) in enumerate(read_ahead(sequence, color=False), 1):
        if progress:
            progress("making the true map of the exact ids", done, len(sequence))
        if wanted is None or frame.name in wanted:
            _note(sequence, segmentation, known, slot_of)
            slots = tuple(Segment(s.id, _SLOTS[slot_of[s.id]]) for s in segmentation.segments)
            accumulator.add_frame(frame, Segmentation(segmentation.ids, slots), frame_of_map @ frame.T_world_camera)
    return _truth(sequence, accumulator.snapshot(), known, slot_of, frame_of_map)


def find_truth(sequence: PosedFrames, given: Path | None = None) -> PosedFrames:
    """Find the sequence with exact ids of the same frames.

    That is the given one, else the sequence itself if its masks are exact, else ``sequence.json`` of its folder.

    Raises:
        InputError: there is none, or it lacks frames.
    """
    folder = sequence.path.parent / "sequence.json"
    if given is not None:
        found = open_sequence(given)
    elif sequence.ground_truth or not folder.is_file():
        found = sequence
    else:
        found = open_sequence(folder)
    try:
        check_exact(found)
    except InputError as error:
        if given is not None:
            raise
        raise InputError(
            f"{sequence.path}: expected exact ids to judge by, here or in {folder.name} beside it, found masks by "
            f'"{sequence.segmentation_source}"; name their manifest with --truth, or give counts with --counts'
        ) from error
    missing = sorted(set(sequence.frame_names) - set(found.frame_names))
    if missing:
        raise InputError(f"{found.path}: expected the frames of {sequence.path}, found none of {few(missing)}")
    return found


def exact_of(sequence: FrameSource) -> PosedFrames | None:
    """Return the sequence with exact ids of the same frames, as `find_truth` does; None when there is none.

    Of the frames of a floor, it is the complete sequence.
    """
    if isinstance(sequence, SomeFrames):
        sequence = sequence.complete
    if not isinstance(sequence, PosedFrames):
        return None
    try:
        return find_truth(sequence)
    except InputError:
        return None


def settings_of(simap: SIMap) -> ProjectionSettings:
    """Return the projection settings a map was made with; what its file does not say is the default."""
    known = {f.name: simap.parameters[f.name] for f in fields(ProjectionSettings) if f.name in simap.parameters}
    return ProjectionSettings(**{**known, "cell_size_m": simap.spec.cell_size_m})


def truth_of(simap: SIMap, exact: FrameSource, progress: Progress | None = None) -> Truth:
    """Make the truth for a finished map: its settings, its map frame, its frames."""
    names = simap.frame_names
    return truth_map(exact, settings_of(simap), T_map_world=simap.T_map_world, frame_names=names, progress=progress)


def check_same_frame(simap: SIMap, truth: Truth) -> None:
    """Raise InputError unless map and truth lie in the same map frame."""
    apart = float(np.abs(np.asarray(simap.T_map_world) - truth.T_map_world).max())
    if not apart <= _SAME_FRAME:
        raise InputError(f"map and truth: expected the same map frame, found T_map_world to differ by {apart:.3g}")


def truth_as_map(truth: Truth) -> SIMap:
    """Return the truth as a Semantic Instance Map, to be looked at or scored; it has neither graph nor merges."""
    origin = Origin(
        T_map_world=truth.T_map_world,
        method="truth",
        parameters={"k_percent": 0.0, "cell_size_m": truth.spec.cell_size_m},
        provenance={"segmentation": truth.source},
        frame_names=(),
        T_map_camera=np.zeros((0, 4, 4)),
    )
    made = assemble(truth.grid, (), truth.instance, empty_log(), empty_views(), origin)
    return replace(made, instances=tuple(replace(one, score=1.0) for one in made.instances))


def check_exact(sequence: FrameSource) -> None:
    """Raise InputError unless a sequence's masks are the truth and its ids the same in every frame."""
    if not getattr(sequence, "ground_truth", False):
        raise InputError(
            f'{sequence.path}: expected exact ids (ground_truth), found masks by "{sequence.segmentation_source}"'
        )
    if isinstance(sequence, PosedFrames) and sequence.world_segments() is None:
        raise InputError(f'{sequence.path}: expected world-wide ids ("instances"), found ids that change every frame')


def _note(
    sequence: FrameSource, segmentation: Segmentation, known: dict[int, Segment], slot_of: dict[int, int]
) -> None:
    """Remember the ids of a frame, each with a slot of its own."""
    for segment in segmentation.segments:
        first = known.setdefault(segment.id, segment)
        if first.label != segment.label:
            raise InputError(
                f"{sequence.path}: expected one class for id {segment.id}, found {first.label} and {segment.label}"
            )
        if slot_of.setdefault(segment.id, len(slot_of) + 1) > _MAX_IDS:
            raise InputError(f"{sequence.path}: expected at most {_MAX_IDS} ids, found more")


def _truth(
    sequence: FrameSource, slots: Grid, known: Mapping[int, Segment], slot_of: Mapping[int, int], T_map_world: NDArray
) -> Truth:
    """Turn slots back into ids and classes."""
    index_of = {name: i for i, name in enumerate(sequence.labels)}
    label = np.zeros(len(slot_of) + 1, dtype=np.int16)
    thing_id = np.zeros(len(slot_of) + 1, dtype=np.int32)
    for number, slot in slot_of.items():
        label[slot] = index_of[known[number].label]
        thing_id[slot] = number if known[number].is_thing else 0
    grid = replace(slots, labels=tuple(sequence.labels), is_thing=tuple(sequence.is_thing), label=label[slots.label])
    names = {number: segment.label for number, segment in sorted(known.items()) if segment.is_thing}
    return Truth(grid, thing_id[slots.label], names, T_map_world, sequence.segmentation_source)
