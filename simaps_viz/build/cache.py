"""What can be made again is kept in a cache: the folder, and the names under which maps lie there."""

import hashlib
import json
import os
import re
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from simaps_viz.build.pipeline import BuildConfig, content_of
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError

_LONGEST_NAME = 100
"""Of a sequence, in a file's name, which ends at 255 bytes."""


def cache_folder() -> Path:
    """Return the folder for what can be made again: ``SIMAPS_CACHE``, or the user's cache directory."""
    chosen = os.environ.get("SIMAPS_CACHE")
    return Path(chosen) if chosen else user_cache_path("simaps")


def made_folder(folder: Path) -> Path:
    """Make a folder of the cache unless it is there; raises InputError where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder for what can be made again (SIMAPS_CACHE), found {error.strerror or error}"
        ) from error
    return folder


def cache_key(sequence: FrameSource, *what: Any) -> str:
    """Name what is made from a sequence: another name for other content or masks, another version or ``what``.

    As for builds that go on, the images are not looked at (`pipeline.content_of`).

    Args:
        sequence: made from this.
        what: all else that goes in, JSON-able.
    """
    path = str(Path(sequence.path).resolve())
    parts = [path, sequence.segmentation_source, content_of(sequence), *what, version("simaps-viz")]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def map_in_cache(folder: Path, sequence: FrameSource, method: str, config: BuildConfig) -> Path:
    """Return where in the cache a method's map of a sequence lies, once it was made; its recording lies beside it.

    Raises:
        InputError: the cache cannot be written.
    """
    name = re.sub("[^a-z0-9]+", "-", sequence.name.lower()).strip("-")[:_LONGEST_NAME]
    return made_folder(folder / "maps") / f"{name}-{cache_key(sequence, method, asdict(config))}.npz"
