"""The cache folder, for files that can be computed again, and the names of the maps in it."""

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

_MAX_NAME = 100
"""Characters of a sequence's name in a file name, which may have 255 bytes."""


def cache_folder() -> Path:
    """Return the cache folder: ``SIMAPS_CACHE``, or the user's cache directory."""
    chosen = os.environ.get("SIMAPS_CACHE")
    return Path(chosen) if chosen else user_cache_path("simaps")


def made_folder(folder: Path) -> Path:
    """Create a folder of the cache unless it exists; raise InputError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder for cached files (SIMAPS_CACHE), found {error.strerror or error}"
        ) from error
    return folder


def cache_key(sequence: FrameSource, *what: Any) -> str:
    """Compute a key for a file made from a sequence: it changes with the content, masks, version and ``what``.

    As for builds that resume, the images are not hashed (`pipeline.content_of`).

    Args:
        sequence: the sequence the file is made from.
        what: everything else it depends on, JSON-able.
    """
    path = str(Path(sequence.path).resolve())
    parts = [path, sequence.segmentation_source, content_of(sequence), *what, version("simaps-viz")]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def map_in_cache(folder: Path, sequence: FrameSource, method: str, config: BuildConfig) -> Path:
    """Return the path in the cache of a method's map of a sequence; its recording is beside it.

    Raises:
        InputError: the cache cannot be written.
    """
    name = re.sub("[^a-z0-9]+", "-", sequence.name.lower()).strip("-")[:_MAX_NAME]
    return made_folder(folder / "maps") / f"{name}-{cache_key(sequence, method, asdict(config))}.npz"
