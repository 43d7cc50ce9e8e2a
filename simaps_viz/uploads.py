"""Reading what a browser sent."""

import tempfile
from pathlib import Path

from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.files import write_whole
from simaps_viz.mapping.mapfile import load_map
from simaps_viz.structures import SIMap


def load_bytes(name: str, content: bytes) -> SIMap:
    """Read a map file whose content a browser sent.

    Raises:
        InputError: it is no map file.
    """
    with tempfile.TemporaryDirectory(prefix="simaps-") as folder:
        path = Path(folder) / (Path(name).name or "map.npz")
        write_whole(path, content, "the map that was sent")
        try:
            return load_map(path)
        except SIMapsError as error:
            raise InputError(str(error).replace(str(path), path.name)) from error
