"""What to say of a folder that no reader knows: what was looked for, what is nearest, and a manifest to begin with."""

import json
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from simaps_viz.datasets.manifest import FORMAT
from simaps_viz.datasets.recording import FormatFacts, Reader
from simaps_viz.errors import InputError

MOST_LISTED = 8
"""Names of a folder that a message shows."""
MOST_SEARCHED = 20_000
"""Files of a folder whose names are looked at."""
DEEPEST, MOST_FOLDERS = 4, 200
"""Levels of folders, and folders in all, that a recording is looked for in."""
_IMAGES = (".png", ".jpg", ".jpeg")


def unknown_folder(path: Path, readers: Sequence[Reader]) -> InputError:
    """Return the error for a folder of no known format; its notes list the formats and a manifest for the folder."""
    names = [f"{p.name}/" if p.is_dir() else p.name for p in _inside(path)]
    shown = ", ".join(names[:MOST_LISTED]) + ", ..." * (len(names) > MOST_LISTED) if names else "an empty folder"
    error = InputError(f"{path}: expected a recording of a format that is read, found {shown}{_nearest(path, readers)}")
    error.add_note("Formats that are read, and the files they are recognised by (docs/FORMATS.md):")
    for reader in readers:
        error.add_note(f"  {reader.facts.title}: {reader.facts.recognised_by.replace('`', '')}")
    error.add_note("Frames of any other kind can be read with this file, sequence.json, beside them:")
    error.add_note(manifest_for(path))
    error.add_note("poses.txt: a frame's name and 16 numbers a line, camera to world, row by row; intrinsics.txt: 3x3.")
    return error


def manifest_for(path: Path) -> str:
    """Return a manifest (JSON) for the pictures in a folder, as far as their names tell."""
    folders = Counter[tuple[str, str]]()
    for _, file in zip(range(MOST_SEARCHED), path.rglob("*"), strict=False):
        if file.suffix.lower() in _IMAGES:
            folders[file.parent.relative_to(path).as_posix(), file.suffix] += 1
    depth = next((key for key, _ in folders.most_common() if "depth" in key[0].lower() and key[1] == ".png"), None)
    color = next((key for key, _ in folders.most_common() if "depth" not in key[0].lower()), None)
    color, depth = (color, depth) if color and depth else (("color", ".jpg"), ("depth", ".png"))
    patterns = [f"{folder}/{{frame}}{suffix}" for folder, suffix in (color, depth)]
    keys = {
        "format": FORMAT, "color": patterns[0], "depth": patterns[1], "depth_unit_m": 0.001,
        "intrinsics": "intrinsics.txt", "poses": "poses.txt", "up": [0, 0, 1],
    }  # fmt: skip
    lines = (f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in keys.items())
    return "{\n" + ",\n".join(lines) + "\n}"


def _nearest(path: Path, readers: Sequence[Reader]) -> str:
    """Return which folder inside is a recording, or else which format has most of its files here, and what it lacks."""
    inside = [folder for folder in _folders(path) if any(reader.recognise(folder) for reader in readers)]
    if inside:
        more = f" (so are {len(inside) - 1} other folders)" if len(inside) > 1 else ""
        return f"; {inside[0]} is one{more}"
    best: tuple[float, str] = (0.0, "")
    for reader in readers:
        for needed in ways(reader.facts):
            lacking = [any_of[0] for any_of in needed if not any(_there(path, pattern) for pattern in any_of)]
            share = 1 - len(lacking) / len(needed)
            if lacking and share > best[0]:
                best = share, f"; nearest is {reader.facts.title}, which also has {', '.join(lacking)}"
    return best[1]


def ways(facts: FormatFacts) -> list[list[list[str]]]:
    """Return what the files of a format are called, from what it is recognised by.

    Returns:
        For each way in which it is written, the files it needs; for each of these, the patterns any of which will do.
    """
    plain = re.sub(r"\([^)]*\)", "", facts.recognised_by)
    parts = [[re.findall(r"`([^`]+)`", part) for part in way.split(",")] for way in plain.split(";")]
    return [needed for way in parts if (needed := [any_of for any_of in way if any_of])]


def _folders(path: Path) -> list[Path]:
    """Return the folders in a folder, down to `DEEPEST` of them, the upper ones first."""
    found, level = [], [path]
    for _ in range(DEEPEST):
        level = [folder for above in level for folder in _inside(above) if folder.is_dir()]
        level = level[: MOST_FOLDERS - len(found)]
        found += level
    return found


def _inside(folder: Path) -> list[Path]:
    """Return what is in a folder, by name; nothing where it cannot be looked into."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _there(path: Path, pattern: str) -> bool:
    return next(path.glob(pattern.rstrip("/")), None) is not None
