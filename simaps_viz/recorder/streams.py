"""Writing pictures of the grid, and texts, to a rerun stream."""

from collections.abc import Iterable, Sequence

import rerun as rr
from numpy.typing import NDArray

from simaps_viz.recorder.map_pictures import Entry, picture_corner
from simaps_viz.structures import GridSpec


def log_entries(stream: rr.RecordingStream, path: str, entries: Iterable[Entry]) -> None:
    """Say once and for all times what the values of the pictures at an entity stand for."""
    stream.log(path, annotations(entries), static=True)


def annotations(entries: Iterable[Entry]) -> rr.AnnotationContext:
    """Turn entries into rerun's names and colours."""
    return rr.AnnotationContext([rr.AnnotationInfo(id=i, label=name, color=color) for i, name, color in entries])


def log_map_picture(
    stream: rr.RecordingStream, path: str, picture: NDArray, spec: GridSpec, *, draw_order: float
) -> None:
    """Lay a picture of the grid on the plane of the pictures, where its cells are."""
    s = spec.cell_size_m
    stream.log(
        path,
        rr.SegmentationImage(picture, opacity=1.0, draw_order=draw_order),
        rr.Transform3D(translation=(*picture_corner(spec), 0.0), scale=(s, s, 1.0)),
    )


def markdown(text: str) -> rr.TextDocument:
    """Take a text as Markdown."""
    return rr.TextDocument(text, media_type="text/markdown")


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Write a table whose first column is text and whose others are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
