"""Maps side by side as a recording, to pan and zoom all of them together in rerun."""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from simaps_viz.errors import InputError

Picture = tuple[str, NDArray, NDArray]
"""Title; colours uint8 [rows, cols, 3] with row 0 at the south; instance ids int32 [rows, cols]."""


def record_comparison(name: str, pictures: Sequence[Picture], path: Path) -> None:
    """Write a recording with one view a picture; pointing at a cell tells its instance.

    Args:
        name: of the recording.
        pictures: all of the same shape.
        path: the .rrd; replaced only once the new one is whole.

    Raises:
        InputError: it cannot be written there.
    """
    path = Path(path)
    if path.is_dir() or not os.access(path.absolute().parent, os.W_OK):
        raise InputError(f"{path}: expected a file in a folder that can be written, found none")
    handle, partial = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.absolute().parent)
    os.close(handle)
    stream = rr.RecordingStream("simaps_comparison")
    try:
        stream.set_sinks(rr.FileSink(partial))
        stream.send_recording_name(name)
        views = []
        for number, (title, colors, instance) in enumerate(pictures):
            origin = f"/{number:02d}"
            stream.log(f"{origin}/map", rr.Image(np.ascontiguousarray(colors[::-1])), static=True)
            ids = np.ascontiguousarray(instance[::-1].astype(np.uint16))  # as many as rerun tells apart
            stream.log(f"{origin}/instance", rr.SegmentationImage(ids, opacity=0.0), static=True)
            views.append(rrb.Spatial2DView(origin=origin, name=title))
        columns = max(1, round(len(views) ** 0.5))
        stream.send_blueprint(rrb.Blueprint(rrb.Grid(*views, grid_columns=columns), collapse_panels=True))
        stream.flush()
        stream.disconnect()
        os.chmod(partial, 0o644)
        os.replace(partial, path)
    finally:
        Path(partial).unlink(missing_ok=True)
