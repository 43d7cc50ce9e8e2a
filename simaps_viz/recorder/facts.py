"""The facts of a recording: written as its properties, read without the rest of it."""

import json
import warnings
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import rerun as rr

from simaps_viz.errors import InputError, one_line
from simaps_viz.events import BuildStarted
from simaps_viz.structures import SIMap

PROPERTY = "simaps"
"""Name of the property; rerun keeps it at /__properties/simaps."""
LEVELS = "louvain_levels"
"""Name of the fact that holds how far timeline "louvain" goes."""
_PATHS = ["/__properties", "/__properties/**"]
_SHOWN = {"k_percent": "K {:g} %", "affinity": "affinity {:g}", "resolution": "resolution {:g}"}


@dataclass(frozen=True)
class RecordingFacts:
    """The properties of a recording; None = unknown."""

    title: str | None = None
    application: str | None = None
    frames: int | None = None
    simulated: bool | None = None
    segmentation: str | None = None
    method: str | None = None
    parameters: str | None = None
    """In words: "affinity 0.6, resolution 1"."""
    instances: int | None = None
    version: str | None = None
    """Version of this program."""


def started_facts(event: BuildStarted) -> dict[str, Any]:
    """Return the properties that are known when a build begins."""
    return {
        "frames": len(event.frame_names),
        "simulated": event.simulated,
        "segmentation": event.segmentation_source,
        "version": version("simaps-viz"),
    }


def finished_facts(simap: SIMap) -> dict[str, Any]:
    """Return the properties of the recording of a map."""
    provenance = simap.provenance
    return {
        "frames": len(simap.frame_names),
        "simulated": bool(provenance.get("simulated", False)),
        "segmentation": str(provenance.get("segmentation", "unknown")),
        "method": simap.method,
        "parameters": json.dumps(dict(simap.parameters)),
        "instances": len(simap.instances),
        "version": version("simaps-viz"),
    }


def send_facts(stream: rr.RecordingStream, facts: dict[str, Any]) -> None:
    """Write facts into a recording; later ones are read in the place of earlier ones."""
    stream.send_property(PROPERTY, rr.AnyValues(**facts))


def read_facts(path: Path) -> RecordingFacts:
    """Read the facts of a recording, but not its pictures (some milliseconds, whatever its size).

    Raises:
        InputError: it is no rerun recording, or was not finished.
    """
    application, values = _read(path)
    kinds = {"frames": int, "simulated": bool, "segmentation": str, "method": str, "instances": int, "version": str}
    return RecordingFacts(
        title=_of(values, "RecordingInfo:name", str),
        application=application,
        parameters=_in_words(_of(values, "parameters", str)),
        **{name: _of(values, name, kind) for name, kind in kinds.items()},
    )


def read_levels(path: Path) -> int:
    """Read at which time of timeline "louvain" a recording has the final communities.

    Recordings of earlier versions have nothing between them and the classes, at time 0; so it is where nothing can be
    read.
    """
    try:
        return _of(_read(path)[1], LEVELS, int) or 1
    except InputError:
        return 1


def _read(path: Path) -> tuple[str | None, dict[str, Any]]:
    """Return the application of a recording, and its properties by name."""
    import rerun.chunk as rc  # noqa: PLC0415 - only needed here

    values: dict[str, Any] = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of a file without its end rerun only warns
            reader = rc.RrdReader(path)
            entries = [entry for entry in reader.recordings() if entry.kind == "recording"]
            for chunk in reader.store().stream().filter(content=_PATHS) if entries else ():
                batch = chunk.to_record_batch()
                for name in batch.schema.names:
                    rows = batch.column(name).to_pylist()
                    if not name.startswith("rerun.") and rows and rows[-1]:
                        values[name] = rows[-1][0]
    except (ValueError, RuntimeError, OSError, Warning) as error:
        found = "another kind of file" if "Not an RRD file" in str(error) else one_line(error)
        raise InputError(f"{path}: expected a finished rerun recording, found {found}") from error
    return entries[0].application_id if entries else None, values


def _of(values: dict[str, Any], name: str, kind: type) -> Any:
    value = values.get(name)
    return value if isinstance(value, kind) else None


def _in_words(parameters: str | None) -> str | None:
    try:
        values = json.loads(parameters or "null")
    except (ValueError, RecursionError):
        return None
    if not isinstance(values, dict):
        return None
    told = [(words, values.get(key)) for key, words in _SHOWN.items()]
    shown = [words.format(value) for words, value in told if isinstance(value, int | float) and abs(value) < 1e300]
    return ", ".join(shown) or None
