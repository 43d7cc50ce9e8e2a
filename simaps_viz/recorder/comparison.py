"""Maps side by side as a recording, to pan and zoom all of them together in rerun."""

from collections.abc import Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from simaps_viz.io.files import check_output, replacing
from simaps_viz.recorder.map_pictures import north_up, object_picture

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
    check_output(path)
    stream = rr.RecordingStream("simaps_comparison")
    with replacing(path, "the recording") as partial:
        stream.set_sinks(rr.FileSink(str(partial)))
        stream.send_recording_name(name)
        views = []
        for number, (title, colors, instance) in enumerate(pictures):
            origin = f"/{number:02d}"
            stream.log(f"{origin}/map", rr.Image(north_up(colors)), static=True)
            ids = rr.SegmentationImage(object_picture(instance), opacity=0.0)
            stream.log(f"{origin}/instance", ids, static=True)
            views.append(rrb.Spatial2DView(origin=origin, name=title))
        columns = max(1, round(len(views) ** 0.5))
        stream.send_blueprint(rrb.Blueprint(rrb.Grid(*views, grid_columns=columns), collapse_panels=True))
        stream.flush()
        stream.disconnect()
