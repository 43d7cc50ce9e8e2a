"""`simaps`: one command line for building, seeing, questioning and driving on Semantic Instance Maps."""

import sys
from collections.abc import Sequence
from typing import Any

import tyro
from rich.table import Table

from simaps_viz import __version__
from simaps_viz.app import workbench
from simaps_viz.cli.build import Build, build
from simaps_viz.cli.doctor import Doctor, doctor
from simaps_viz.cli.mend import Mend, mend_map
from simaps_viz.cli.options import (
    Check,
    Convert,
    Demo,
    Evaluate,
    Export,
    ExportNetwork,
    Info,
    Judge,
    Query,
    Segment,
    View,
)
from simaps_viz.cli.recordings import Recordings, is_recorded_build, recordings, view_alone
from simaps_viz.cli.segment import open_segmented, write_segmented
from simaps_viz.cli.share import Share, share
from simaps_viz.console.logs import HELP, logged, logged_command, logger, take_log_options
from simaps_viz.console.progress import stage_progress
from simaps_viz.console.terminal import answering, console, drop_answers, emit, say, show
from simaps_viz.datasets.posed_frames import is_sequence, open_sequence
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.io.limits import check_port
from simaps_viz.mapping.edit_log import people_in_words
from simaps_viz.mapping.mending import load_mended, open_mending
from simaps_viz.navigation.agent import answer
from simaps_viz.structures import Pose2


def map_tables(facts: dict[str, Any]) -> list[Table]:
    """Lay out a map's facts, as `wiring.summary` gives them: the map, then its instances."""
    head = Table(show_header=False, box=None, title=f"{facts['name']}", title_justify="left")
    rows = {
        "method": _method(facts),
        "grid": f"{facts['rows']} x {facts['cols']} cells of {facts['cell_size_m']:g} m",
        "seen": f"{facts['seen_m2']:.1f} m² in {facts['frames']} frames",
        "segmentation": str(facts["provenance"].get("segmentation")),
        "from": str(facts["provenance"].get("sequence")),
    }
    if edits := people_in_words(facts["provenance"].get("edits", [])):
        rows["mended"] = edits
    for key, value in rows.items():
        head.add_row(key, value)
    body = Table("id", "class", "cells", "area m²", "x m", "y m", "frames", "score", title_justify="left")
    for one in facts["instances"]:
        x, y, _ = one["centroid_m"]
        area = one["cells"] * facts["cell_size_m"] ** 2
        body.add_row(str(one["id"]), one["label"], str(one["cells"]), f"{area:.2f}", f"{x:.2f}", f"{y:.2f}",
                     str(one["frames"]), f"{one['score']:.2f}")  # fmt: skip
    return [head, body]


def _method(facts: dict[str, Any]) -> str:
    parameters = facts["parameters"]
    if "k_percent" in parameters:
        return f"{facts['method']}, K = {parameters['k_percent']:g} %"
    if "affinity" in parameters:
        return f"{facts['method']}, joined above affinity {parameters['affinity']:g}"
    return str(facts["method"])


OK, NO, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

Command = (
    Demo
    | Build
    | View
    | Query
    | Info
    | Mend
    | Check
    | Export
    | Share
    | Convert
    | Evaluate
    | Judge
    | Segment
    | ExportNetwork
    | Recordings
    | Doctor
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run it; see `run` for the exit status."""
    commands = tyro.conf.OmitSubcommandPrefixes[Command]
    about = f"{__doc__} {HELP} simaps --version says which program this is."
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        if list(arguments) == ["--version"]:
            say(f"simaps {__version__}\n")
            return OK
        rest, logging = take_log_options(arguments)
        with answering():
            command = tyro.cli(commands, prog="simaps", description=about, args=rest)
        with logged(logging, console):
            return run(command)  # pyright: ignore[reportArgumentType] - the annotation is the union
    except InputError as error:  # of the log itself, or of a page of help
        _show_error(str(error))
        return BAD_INPUT
    except BrokenPipeError:  # of a page of help
        return _leave_quietly()


def run(command: Command) -> int:
    """Run one command; the exit status is 0 done, 1 the answer is no, 2 bad input or usage, 130 interrupted."""
    with logged_command(type(command).__name__.lower(), command) as log:
        log.status = _carry_out(command)
        return log.status


def _carry_out(command: Command) -> int:
    try:
        check_port(getattr(command, "port", 0))
        return _RUN[type(command)](command)
    except SIMapsError as error:
        _say_error(str(error))
        return BAD_INPUT
    except KeyboardInterrupt as stopped:
        _say_error(str(stopped) or "interrupted; nothing was left half-written")
        return INTERRUPTED
    except BrokenPipeError:
        return _leave_quietly()


def _leave_quietly() -> int:
    """The reader of our output has gone."""
    drop_answers()
    return BAD_INPUT


def _say_error(message: str) -> None:
    logger.error("%s", message, extra={"event": "error", "people": False})
    _show_error(message)


def _show_error(message: str) -> None:
    console.print(f"simaps: {message}", markup=False, soft_wrap=True, style="red")


def _demo(command: Demo) -> int:
    from simaps_viz.scenes.demo import ensure_demo  # noqa: PLC0415 - the ray caster is only needed here

    with stage_progress() as progress:
        manifest = ensure_demo(level=command.errors, cache_dir=workbench.cache_folder(), progress=progress)
        simap, recording = workbench.cached_build(
            open_sequence(manifest), command.mapping.method, command.mapping.config(), progress
        )
    console.print(f"On the map: {workbench.counts_in_words(simap.counts())}", markup=False)
    if command.serve:
        mending = open_mending(recording.with_suffix(".npz"), simap)
        workbench.serve(
            simap, recording=recording, port=command.port, browser=command.browser, llm=command.llm, mending=mending,
            host=command.host,
        )  # fmt: skip
    return OK


def _build(command: Build) -> int:
    build(command)
    return OK


def _segment(command: Segment) -> int:
    with stage_progress(quiet=command.json) as progress:
        written = write_segmented(command, workbench.cache_folder(), progress)
    if command.json:
        emit(written)
    else:
        console.print(
            f"{written['output']}: {written['segments']} segments in {written['frames']} frames", markup=False
        )
        if command.format == "posed-frames":
            console.print(f"Map it: simaps build {written['output']} -o map.npz", markup=False, soft_wrap=True)
    return OK


def _export_network(command: ExportNetwork) -> int:
    from simaps_viz.segmentation.network_export import export_network  # noqa: PLC0415 - needs the extra

    done = export_network(command.checkpoint, command.output, size=command.size)
    if command.json:
        emit({"event": "done", "output": str(done.path), "family": done.family, "input_size": list(done.size),
              "difference": done.difference})  # fmt: skip
    else:
        console.print(
            f"{done.path}: {done.family}, input {done.size[0]} x {done.size[1]}, torch and onnxruntime differ by "
            f"{done.difference:.1g} at most", markup=False, soft_wrap=True,
        )  # fmt: skip
    return OK


def _view(command: View) -> int:
    if is_recorded_build(command.path):
        view_alone(command.path, port=command.port, browser=command.browser, host=command.host)
        return OK
    if is_sequence(command.path):
        with stage_progress() as progress:
            sequence = open_segmented(
                command.path, command.segmentation, command.network, workbench.cache_folder(), progress
            )
            simap, recording = workbench.cached_build(
                sequence, command.mapping.method, command.mapping.config(), progress
            )
        map_path = recording.with_suffix(".npz")
        recording = workbench.recording_beside(command.path, command.recording) or recording
    else:
        if not command.path.exists():
            raise InputError(
                f"{command.path}: expected a map file (.npz), a sequence or a recorded build (.rrd), found nothing"
            )
        if command.segmentation != "precomputed":
            raise InputError(f"{command.path}: expected a sequence with --segmentation, found a map")
        simap = load_mended(command.path, edits=False)
        recording = workbench.recording_beside(command.path, command.recording)
        map_path = command.path
    mending = open_mending(map_path, simap) if command.edits else None
    workbench.serve(
        simap, recording=recording, port=command.port, browser=command.browser, llm=command.llm, mending=mending,
        host=command.host, map_path=map_path,
    )  # fmt: skip
    return OK


def _query(command: Query) -> int:
    if not command.command:
        raise InputError('query: expected at least one command, for example "go to the second chair", found none')
    simap = load_mended(command.map, edits=command.edits)
    pose = Pose2.from_heading(*command.pose) if command.pose else workbench.start_pose(simap)
    reader = workbench.reader(command.llm, simap, pose)
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
    lines = [f"> {record['command']}", *(f"    {line}" for line in (record["program"] or "").strip().splitlines())]
    if record["status"] != "ok":
        lines.append(f"{record['status']}: {record['reason']}")
    else:
        x, y, heading = record["final_pose"]
        lines.append(f"ok: drove {record['path_length_m']:.2f} m to x {x:.2f} m, y {y:.2f} m, heading {heading:.0f}°")
    say("\n".join(lines) + "\n")


def _info(command: Info) -> int:
    facts = workbench.summary(load_mended(command.map, edits=command.edits))
    if command.json:
        emit(facts)
        return OK

    show(*map_tables(facts))
    return OK


def _export(command: Export) -> int:
    from simaps_viz.cli.export import export  # noqa: PLC0415 - not needed to build and view

    with stage_progress(quiet=command.json) as progress:
        format, files = export(command, progress)
    if command.json:
        emit({"format": format, "files": [str(path) for path in files]})
    else:
        console.print(f"{format}: wrote {', '.join(str(path) for path in files)}", markup=False, soft_wrap=True)
    return OK


def _mend(command: Mend) -> int:
    lines, record = mend_map(command)
    if command.json:
        emit(record)
    else:
        say("\n".join(lines) + "\n")
    return OK


def _share(command: Share) -> int:
    with stage_progress(quiet=command.json) as progress:
        written = share(command, progress)
    if command.json:
        emit(written)
    else:
        console.print(f"{written['output']}: {written['bytes'] / 1e6:.1f} MB", markup=False, soft_wrap=True)
        if written["done"] is False:
            console.print(f'"{command.command}" failed: {written["outcome"]}', markup=False, soft_wrap=True)
    return NO if written["done"] is False else OK


def _convert(command: Convert) -> int:
    from simaps_viz.datasets.convert import write_posed_frames  # noqa: PLC0415 - not needed to build and view

    with stage_progress(quiet=command.json) as progress:
        sequence = open_sequence(command.source)
        manifest = write_posed_frames(
            sequence, command.output, every=command.every, progress=lambda done, total: progress("frames", done, total)
        )
    frames = len(range(0, len(sequence), command.every))
    if command.json:
        emit({"event": "done", "manifest": str(manifest), "name": sequence.name, "frames": frames,
              "segmentation": sequence.segmentation_source, "notes": list(sequence.notes)})  # fmt: skip
        return OK
    for note in sequence.notes:
        console.print(f"{command.source}: {note}", markup=False, soft_wrap=True)
    console.print(
        f"{manifest}: {frames} frames, segmentation {sequence.segmentation_source}", markup=False, soft_wrap=True
    )
    return OK


def _check(command: Check) -> int:
    from simaps_viz.checking.run import check  # noqa: PLC0415 - compiled kernels are only needed here

    with stage_progress(quiet=command.json) as progress:
        ok, text, record = check(command.sequence, fix=command.fix, picture=command.picture, progress=progress)
    if command.json:
        emit(record)
    else:
        say(text + "\n")
    return OK if ok else NO


def _evaluate(command: Evaluate) -> int:
    from simaps_viz.cli.evaluate import evaluate  # noqa: PLC0415 - not needed to build and view

    with stage_progress(quiet=command.json) as progress:
        text, record = evaluate(command, progress)
    if command.json:
        emit(record)
    else:
        say(text + "\n")
    return OK


def _judge(command: Judge) -> int:
    with stage_progress() as progress:
        session, simap = workbench.judging(command.session, command.map, progress)
    workbench.serve(
        simap, recording=None, port=command.port, browser=command.browser, judging=session, host=command.host
    )
    return OK


def _recordings(command: Recordings) -> int:
    recordings(command)
    return OK


def _doctor(command: Doctor) -> int:
    return OK if doctor(command) else NO


_RUN = {Demo: _demo, Build: _build, View: _view, Query: _query, Info: _info, Mend: _mend,
        Recordings: _recordings, Doctor: _doctor,
        Evaluate: _evaluate, Judge: _judge, Segment: _segment, ExportNetwork: _export_network,
        Export: _export, Convert: _convert, Share: _share, Check: _check}  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
