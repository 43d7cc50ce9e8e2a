"""Keeps the texts on the map from covering each other."""

from collections.abc import Sequence

Label = tuple[str, float, float]
"""A text and where it stands on the map, x and y in metres."""

ROWS = 38.0
"""Lines of text that fit on a page as high as the map."""
WIDTH_OF_A_LETTER = 0.42
"""In heights of a line."""
_TRIES = (0, 1, -1, 2, -2, 3, -3)


def spread(labels: Sequence[Label], map_height_m: float) -> list[Label]:
    """Move texts up or down by whole lines where they would cover one that comes before them.

    Texts keep their size on the screen, so this holds for a page that shows the whole map; closer up, there is more
    room. A text that finds no free place stays where it is.

    Args:
        labels: the most important first.
        map_height_m: what the page shows, from south to north.
    """
    line = map_height_m / ROWS
    placed: list[Label] = []
    for text, x, y in labels:
        free = (y + k * line for k in _TRIES if not any(_cover((text, x, y + k * line), p, line) for p in placed))
        placed.append((text, x, next(free, y)))
    return placed


def _cover(a: Label, b: Label, line_m: float) -> bool:
    width = (len(a[0]) + len(b[0]) + 2) / 2.0 * WIDTH_OF_A_LETTER * line_m
    return abs(a[1] - b[1]) < width and abs(a[2] - b[2]) < 0.95 * line_m
