"""Pin what users get: the maps of every method, the JSON of every command, the entities of a recorded build.

    python apps/checks/pins.py --house ../scans/aws-small-house/rgbd      compare with tests/pins.json
    python apps/checks/pins.py --write                                     pin what this version makes

Only the command line is used, so the same program judges any version of the package. Maps never move: their SHA-256
covers every array of the map file but those that came later (`LATER`), heights by their sum (`HEIGHTS`). Everything
else may be pinned anew, in a commit of its own that says why.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

ROOT = Path(__file__).parents[2]
PINS = ROOT / "tests" / "pins.json"

VARIANTS: dict[str, tuple[str, ...]] = {
    "evidence": (),
    "evidence-votes-off": ("--no-votes",),
    "components": ("--method", "components"),
    "paper": ("--method", "paper"),
    "paper-k9": ("--method", "paper", "--k", "9"),
    "paper-literal": ("--method", "paper", "--literal"),
    "vlmaps": ("--method", "vlmaps"),
    "vlmaps+components": ("--method", "vlmaps+components"),
}
"""Name of each pinned map: the options of `simaps build` that make it."""

COMMANDS = (
    "go to the third chair",
    "go to the chair nearest the counter",
    "turn around and then go to the second table",
    "go between the plant and the couch",
    "move 2 m forward",
    "go to the piano",
    "robot.move_to_object('chair', 2)",
)
LATER = ("metadata", "seen_", "embedding", "room", "surface", "hidden")
"""Begin the names of arrays that no pin covers: they came later, and take nothing from the others."""
HEIGHTS = ("height", "lowest")
"""Arrays in metres whose sum is pinned, to a decimetre: processors that add and multiply in one step render one pixel
of millions a millimetre deeper."""
SPOKEN_FIELDS = ("status", "reason", "program", "goals", "path", "final_pose", "path_length_m")
EXPORTS = {
    "map.geojson": "geojson", "map.csv": "csv", "map.ply": "ply", "map.glb": "glb", "map.graphml": "graphml",
    "dsg.json": "spark-dsg", "coco.json": "coco", "map.yaml": "ros", "nav": "nav2",
}  # fmt: skip


@dataclass(frozen=True)
class Pins:
    """What to pin."""

    house: Path | None = None
    """A second place: a sequence with exact ids; its maps are compared if they are pinned."""
    write: bool = False
    """Pin what this version makes instead of comparing."""


def simaps(arguments: list[str], folder: Path) -> list[dict[str, Any]]:
    """Run a command in a folder and return its JSON lines."""
    done = subprocess.run(
        [sys.executable, "-m", "simaps_viz", *arguments], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "SIMAPS_RECORDINGS": str(folder / "recordings")},
    )  # fmt: skip
    if done.returncode not in (0, 1):
        raise SystemExit(f"simaps {' '.join(arguments)}: exit status {done.returncode}\n{done.stderr}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def map_digest(path: Path) -> str:
    """Compute the SHA-256 of the arrays of a map file, by name, with their shapes and dtypes; not of its looks."""
    digest = hashlib.sha256()
    with np.load(path) as arrays:
        for name in sorted(name for name in arrays.files if not name.startswith(LATER)):
            array = np.ascontiguousarray(arrays[name])
            if name in HEIGHTS:
                array = np.round(np.nansum(array, dtype=np.float64), 1)
            digest.update(f"{name} {array.dtype} {array.shape}".encode() + array.tobytes())
        metadata = json.loads(str(arrays["metadata"]))
    digest.update(json.dumps(metadata["instances"], sort_keys=True).encode())
    return digest.hexdigest()


def export_digest(path: Path) -> str:
    """Compute the SHA-256 of a file; of a scene, whose vertices have heights, only its length."""
    return f"{path.stat().st_size} bytes" if path.suffix == ".glb" else hashlib.sha256(path.read_bytes()).hexdigest()


def shape_of(value: Any) -> Any:
    """Reduce JSON to its members and types; lists to the shape of their first item."""
    if isinstance(value, dict):
        return {key: shape_of(one) for key, one in sorted(value.items())}
    if isinstance(value, list):
        return [shape_of(value[0])] if value else []
    return type(value).__name__


def entities(recording: Path) -> list[str]:
    """List the entity paths of a recorded build."""
    import rerun.chunk as rc  # noqa: PLC0415 - slow to import

    chunks = rc.RrdReader(str(recording)).stream().collect()
    return sorted({str(path) for path in chunks.schema().entity_paths()})


def pins_of(sequence: Path, folder: Path, *, maps_only: bool) -> dict[str, Any]:
    """Build every pinned map of a sequence, and use one with every command."""
    maps, pinned = {}, {}
    for name, options in VARIANTS.items():
        recorded = ["--record", "build.rrd"] if name == "evidence" and not maps_only else []
        lines = simaps(["build", str(sequence), "-o", f"{name}.npz", *options, *recorded, "--json"], folder)
        maps[name] = map_digest(folder / f"{name}.npz")
        pinned[f"build {name}"] = [shape_of(lines[0]), shape_of(lines[-1])]
        sys.stderr.write(f"{sequence.parent.name} {name} {maps[name][:12]}\n")
    if maps_only:
        return {"maps": maps}
    the_map = "evidence.npz"
    said = simaps(["query", the_map, *COMMANDS, "--json"], folder)
    pinned["query"] = [{key: line.get(key) for key in SPOKEN_FIELDS} for line in said]
    info = simaps(["info", the_map, "--json"], folder)[0]
    pinned["info"] = [shape_of(info), info.get("counts")]
    pinned["check"] = shape_of(simaps(["check", str(sequence), "--json"], folder)[0])
    pinned["export"] = {}
    for file, format in EXPORTS.items():
        written = simaps(["export", the_map, "-o", file, "--format", format, "--json"], folder)[0]
        pinned["export"][format] = {Path(one).name: export_digest(folder / one) for one in written["files"]}
    pinned["share"] = shape_of(simaps(["share", the_map, "-o", "map.html", "--json"], folder)[0])
    pinned["convert"] = shape_of(simaps(["convert", str(sequence), "-o", "copy", "--every", "50", "--json"], folder)[0])
    pinned["mend"] = shape_of(simaps(["mend", the_map, "delete 1", "undo", "--json"], folder)[0])
    pinned["evaluate"] = [shape_of(one) for one in simaps(
        ["evaluate", str(sequence), "--methods", "evidence,components", "--json"], folder
    )]  # fmt: skip
    pinned["entities"] = entities(folder / "build.rrd")
    return {"maps": maps, "commands": pinned}


def differences(pinned: Any, found: Any, at: str = "") -> list[str]:
    """List where two JSON values differ."""
    if isinstance(pinned, dict) and isinstance(found, dict):
        return [
            line for key in sorted({*pinned, *found})
            for line in differences(pinned.get(key), found.get(key), f"{at} / {key}")
        ]  # fmt: skip
    if isinstance(pinned, list) and isinstance(found, list) and len(pinned) == len(found):
        return [
            line for n, pair in enumerate(zip(pinned, found, strict=True)) for line in differences(*pair, f"{at}[{n}]")
        ]
    return [] if pinned == found else [f"{at}: pinned {str(pinned)[:200]}, found {str(found)[:200]}"]


def main(config: Pins) -> int:
    """Make everything, then write or compare."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        simaps(["demo", "--no-serve"], folder)
        sequence = newest_scene() / "sequence-light.json"
        found = {"cafe": pins_of(sequence, folder, maps_only=False)}
        if config.house is not None:
            found["house"] = pins_of(config.house.resolve(), folder, maps_only=True)
    found = json.loads(re.sub(re.escape(str(folder)), "FOLDER", json.dumps(found)))
    pinned = json.loads(PINS.read_text(encoding="utf-8")) if PINS.is_file() else {}
    if config.write:
        PINS.write_text(json.dumps({**pinned, **found}, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        return 0
    wrong = [line for place in found for line in differences(pinned.get(place), found[place], place)]
    sys.stdout.write("\n".join([*wrong, f"{len(wrong)} differences"]) + "\n")
    return 1 if wrong else 0


def newest_scene() -> Path:
    """Return the folder of the café rendered last."""
    from platformdirs import user_cache_path  # noqa: PLC0415 - as simaps does

    root = Path(os.environ.get("SIMAPS_CACHE") or user_cache_path("simaps"))
    return max(root.glob("scenes/cafe-*"), key=lambda one: one.stat().st_mtime)


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Pins)))
