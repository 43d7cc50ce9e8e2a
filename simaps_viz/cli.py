"""`simaps`: one command line for building, seeing, questioning and driving on Semantic Instance Maps."""

import dataclasses
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from simaps_viz import wiring
from simaps_viz.cli_options import Evaluate, Level, Mapping
from simaps_viz.datasets.posed_frames import open_sequence
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.mapping.mapfile import load_map
from simaps_viz.navigation.agent import answer
from simaps_viz.progress import console, emit, stage_progress
from simaps_viz.structures import Pose2
from simaps_viz.tables import map_tables

OK, NO, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


@dataclass(frozen=True)
class Demo:
    """Make the embedded café (rendered, with simulated network errors), map it, and open the workbench."""

    mapping: Annotated[Mapping, tyro.conf.arg(name="")] = dataclasses.field(default_factory=Mapping)
    errors: Level = "light"
    """Simulated errors of the segmentation network."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    browser: bool = True
    """Open the page in the browser."""
    serve: bool = True
    """Serve the page; with --no-serve only prepare everything."""


@dataclass(frozen=True)
class Build:
    """Build a map from a sequence of posed RGB-D frames.

    Example: simaps build ../scans/breakroom -o breakroom.npz --record breakroom.rrd
    """

    sequence: tyro.conf.Positional[Path]
    """Folder in the posed-frames/1 format, or its manifest (.json)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Map file to write (.npz)."""
    mapping: Annotated[Mapping, tyro.conf.arg(name="")] = dataclasses.field(default_factory=Mapping)
    segmentation: str = "precomputed"
    """Where segments come from: "precomputed", the ones the sequence has."""
    record: Path | None = None
    """Also record the build for rerun (.rrd)."""
    json: bool = False
    """Print JSON lines on stdout."""


@dataclass(frozen=True)
class View:
    """Open the workbench on a map, or on a sequence (which is mapped first)."""

    path: tyro.conf.Positional[Path]
    """Map file (.npz), sequence folder or manifest (.json)."""
    mapping: Annotated[Mapping, tyro.conf.arg(name="")] = dataclasses.field(default_factory=Mapping)
    recording: Path | None = None
    """Recorded build to dock beside the map; by default the .rrd of the map's name."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    browser: bool = True
    """Open the page in the browser."""


@dataclass(frozen=True)
class Query:
    """Ask a robot on a map to do something, in English or as a program; nothing is shown, the answer is printed.

    Example: simaps query cafe.npz "go to the third chair" "turn left" --pose 1.5 2 90 --json
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    command: tyro.conf.Positional[tuple[str, ...]]
    """One or more commands, each carried out from the given pose."""
    pose: tuple[float, float, float] | None = None
    """Where the robot stands: x and y in metres, heading in degrees clockwise from north. By default where the first
    camera stood."""
    llm: str | None = None
    """Let a language model read the commands: MODEL, or MODEL@ADDRESS of a chat-completions server, such as
    qwen2.5:7b@http://127.0.0.1:11434/v1. The key comes from OPENAI_API_KEY. Without it, an offline grammar reads."""
    json: bool = False
    """Print one JSON line a command."""


@dataclass(frozen=True)
class Info:
    """Say what is on a map."""

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    json: bool = False
    """Print it as one JSON line."""


Command = Demo | Build | View | Query | Info | Evaluate


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run it; see `run` for the exit status."""
    commands = tyro.conf.OmitSubcommandPrefixes[Command]
    return run(tyro.cli(commands, prog="simaps", description=__doc__, args=arguments))  # pyright: ignore


def run(command: Command) -> int:
    """Run one command; the exit status is 0 done, 1 the answer is no, 2 bad input or usage, 130 interrupted."""
    try:
        return _RUN[type(command)](command)
    except SIMapsError as error:
        _say_error(str(error))
        return BAD_INPUT
    except KeyboardInterrupt:
        _say_error("interrupted; nothing was left half-written")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BAD_INPUT


def _say_error(message: str) -> None:
    console.print(f"simaps: {message}", markup=False, soft_wrap=True, style="red")


def _demo(command: Demo) -> int:
    from simaps_viz.scenes.demo import ensure_demo  # noqa: PLC0415 - the ray caster is only needed here

    with stage_progress() as progress:
        manifest = ensure_demo(level=command.errors, cache_dir=wiring.cache_folder(), progress=progress)
        simap, recording = wiring.cached_build(
            open_sequence(manifest), command.mapping.method, command.mapping.config(), progress
        )
    console.print(f"On the map: {wiring.counts_in_words(simap.counts())}", markup=False)
    if command.serve:
        wiring.serve(simap, recording=recording, port=command.port, browser=command.browser)
    return OK


def _build(command: Build) -> int:

    if command.segmentation != "precomputed":
        raise InputError(f"--segmentation {command.segmentation}: expected precomputed, the only source so far")
    config = command.mapping.config()
    with stage_progress(quiet=command.json) as progress:
        simap = wiring.build_to_file(
            open_sequence(command.sequence), command.mapping.method, config, command.output,
            record=command.record, progress=progress, json_lines=command.json,
        )  # fmt: skip
    if command.json:
        emit({"event": "done", "map": str(command.output), "record": str(command.record) if command.record else None,
              "counts": simap.counts(), "instances": len(simap.instances)})  # fmt: skip
    else:
        console.print(f"{command.output}: {wiring.counts_in_words(simap.counts())}", markup=False)
        console.print(f"Look at it: simaps view {command.output}", markup=False)
    return OK


def _view(command: View) -> int:

    if command.path.is_dir() or command.path.suffix == ".json":
        with stage_progress() as progress:
            simap, recording = wiring.cached_build(
                open_sequence(command.path), command.mapping.method, command.mapping.config(), progress
            )
        recording = wiring.recording_beside(command.path, command.recording) or recording
    else:
        simap = load_map(command.path)
        recording = wiring.recording_beside(command.path, command.recording)
    wiring.serve(simap, recording=recording, port=command.port, browser=command.browser)
    return OK


def _query(command: Query) -> int:

    if not command.command:
        raise InputError('query: expected at least one command, for example "go to the second chair", found none')
    simap = load_map(command.map)
    pose = Pose2.from_heading(*command.pose) if command.pose else wiring.start_pose(simap)
    reader = wiring.reader(command.llm, simap, pose)
    good = True
    for text in command.command:
        result = answer(simap, text, pose, reader=reader)
        good = good and result.status == "ok"
        record = {"command": text, **result.to_json()}
        if command.json:
            emit(record)
        else:
            _print_answer(record)
    return OK if good else NO


def _print_answer(record: dict) -> None:
    out = sys.stdout
    out.write(f"> {record['command']}\n")
    for line in (record["program"] or "").strip().splitlines():
        out.write(f"    {line}\n")
    if record["status"] != "ok":
        out.write(f"{record['status']}: {record['reason']}\n")
        return
    x, y, heading = record["final_pose"]
    out.write(f"ok: drove {record['path_length_m']:.2f} m to x {x:.2f} m, y {y:.2f} m, heading {heading:.0f}°\n")


def _info(command: Info) -> int:

    facts = wiring.summary(load_map(command.map))
    if command.json:
        emit(facts)
        return OK

    for table in map_tables(facts):
        Console(highlight=False).print(table)
    return OK


def _evaluate(command: Evaluate) -> int:
    from simaps_viz.evaluating import evaluate  # noqa: PLC0415 - not needed to build and view

    with stage_progress(quiet=command.json) as progress:
        text, record = evaluate(command, progress)
    if command.json:
        emit(record)
    else:
        sys.stdout.write(text + "\n")
    return OK


_RUN = {Demo: _demo, Build: _build, View: _view, Query: _query, Info: _info, Evaluate: _evaluate}

if __name__ == "__main__":
    sys.exit(main())
