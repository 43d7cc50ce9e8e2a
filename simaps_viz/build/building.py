"""Build a building: the floors of a recording, a map for each, and the file that holds them together."""

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from simaps_viz.build.build_log import frames_logged, log_path
from simaps_viz.build.methods import config_of, keeps_log
from simaps_viz.build.pipeline import fingerprint
from simaps_viz.build.to_file import BuildRequest, build_to_file, resume_hint
from simaps_viz.console.progress import StageProgress
from simaps_viz.datasets.floors import find_floors, find_stairs, split_floors
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole
from simaps_viz.mapping.building import MAX_NAME, Building, Floor, Stairs, floor_path, is_building, save_building
from simaps_viz.mapping.file import check_writable, load_map
from simaps_viz.structures import SIMap


def build_building(
    sequence: FrameSource,
    request: BuildRequest,
    progress: StageProgress,
    *,
    json_lines: bool = False,
    finish: Callable[[SIMap, FrameSource, Path], SIMap] = lambda simap, part, path: simap,
) -> tuple[Building, list[dict[str, int]]]:
    """Build a map for each floor of a recording, beside the building file, which is written last.

    A recording of one floor makes a building of one floor, whose map is that of `build_to_file`. A killed build can
    resume: maps that are done stay, and the one that was begun goes on.

    Args:
        sequence: what to build from.
        request: what to make of it; its output is the building file, recordings and histories are of its floors.
        progress: shows how far the build is.
        json_lines: print events on stdout.
        finish: called with each map, its frames and its path, once it is written; returns the map.

    Returns:
        The building, and of each floor {class: number of objects}.

    Raises:
        InputError: as for `build_to_file`.
        BuildCancelled: as for `build_to_file`.
    """
    output = request.output
    check_writable(output)
    if output.exists() and not is_building(output):
        raise InputError(f"{output}: expected the building file of an earlier build or nothing, found another file")
    progress("looking for floors", 0, 1)
    heights = find_floors(sequence)
    stairs = find_stairs(sequence, heights)
    parts = split_floors(sequence, heights) if len(heights) > 1 else [sequence]
    progress("looking for floors", 1, 1)
    # An earlier building's file goes before its maps do: what there is must not name maps of another one.
    output.unlink(missing_ok=True)
    begun = output.with_name(f".{output.name}.building")
    done: dict[str, str] = {}
    if request.resume and begun.is_file():
        with suppress(OSError, ValueError):
            done = dict(json.loads(begun.read_bytes()))
    counts, maps = [], [floor_path(output.with_suffix(".npz"), i) for i in range(1, len(parts) + 1)]
    for number, (part, path) in enumerate(zip(parts, maps, strict=True), start=1):
        key = _key(part, request)
        if key and done.get(path.name) == key and path.is_file() and not frames_logged(log_path(path)):
            simap = load_map(path)
        else:
            record = request.record and (floor_path(request.record, number) if len(parts) > 1 else request.record)
            with resume_hint(path):
                simap = build_to_file(
                    part, replace(request, output=path, record=record), progress, json_lines=json_lines
                )
            simap = finish(simap, part, path)
            done[path.name] = key
            write_whole(begun, json.dumps(done).encode(), "the state of the build")
        counts.append(simap.counts())
    name = "".join(c for c in sequence.name if c.isprintable())[:MAX_NAME]
    building = Building(
        name,
        tuple(Floor(i, path, h) for i, (path, h) in enumerate(zip(maps, heights, strict=True), start=1)),
        tuple(
            Stairs(lower + 1, (float(foot[0]), float(foot[1])), (float(head[0]), float(head[1])))
            for lower, foot, head in stairs
        ),
    )
    save_building(building, output)
    begun.unlink(missing_ok=True)
    return building, counts


def _key(part: FrameSource, request: BuildRequest) -> str:
    """Hash all that a floor's map depends on; "" where its method cannot resume."""
    if not keeps_log(request.method):
        return ""
    facts = [fingerprint(part, config_of(request.method, request.config)), request.history, str(request.record)]
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
