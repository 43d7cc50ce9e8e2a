"""What the page's help says: keys, mouse, tabs, and the words of the field."""

from collections.abc import Sequence
from html import escape

from simaps_viz.viewer.drawing.theme import DIM_STYLE

MEND = "Mend"
BOX_KEYS = (
    ("/", "to the command box"),
    ("F", "to the box that finds objects"),
    ("Ctrl K", "all commands, to search"),
)
MEND_KEYS = (
    ("J", "join the selected object with another"),
    ("X", "cut it in two"),
    ("Delete", "delete it"),
    ("Ctrl Z", "undo the last edit; with Shift, redo it"),
)
"""On pages where the map can be mended."""
MOUSE = (
    ("Click", "select the object; on open floor, select nothing"),
    ("Drag", "turn the view"),
    ("Right drag", "move the view"),
    ("Wheel", "come closer, go back"),
)
TABS = (
    ("Map", "how the map is cut into objects, what its colours mean, top or 3-D view"),
    ("Command", "tell the robot where to go, in plain English, and watch it drive"),
    ("Build", "go back in time, frame by frame, or merge by merge; the map shows what it was then"),
    ("Judge", "judge recorded runs blind, where there are any: keys Y, N and S"),
    ("Instance", "find an object; the selected one: where it is, how it looked, why it is one"),
)
OTHER_TABS = {
    "Compare": "this map beside another: of another method, other parameters, or the truth",
    "Masks": "what the network saw on a frame, and what other thresholds would make of it",
    "Share": "one file of map and build that opens without a server; pictures and films",
    "Recordings": "recorded builds at hand: show one beside the map, rename, delete",
    MEND: "put the map right by hand: join, cut in two, rename, delete, undo",
    "Progress": "how far the build is; stop it, and go on with it",
}
"""Of the panels that a page may have."""
WORDS = (
    ("Instance", "one object on the map: this chair, not chairs"),
    ("Class", "what kind of thing it is: chair, dining table"),
    ("Cell", "a small square of the floor; the map is a grid of them"),
    ("Frame", "one picture of the camera, with depth and the place it was taken from"),
    ("Mask", "the pixels of one object in one frame"),
    ("Community", "cells that frames kept seeing in the same mask; objects are joined from them"),
    ("Evidence (%)", "the share of what frames saw of two parts that says they are one; parts above it are joined"),
    ("K (%)", "a community joins another while more than K % of its cells neighbour it"),
    ("Resolution", "the higher, the smaller the communities"),
)
GRID_STYLE = "display:grid;grid-template-columns:max-content 1fr;gap:.1em 1em;font-size:.95em;line-height:1.45"


def help_html(keys: Sequence[tuple[str, str]], *, others: Sequence[tuple[str, str]] = ()) -> str:
    """Write the help.

    Args:
        keys: (key, what it does).
        others: (tab, what it is for) of tabs that are not on every page.
    """
    parts = (("Keys", keys), ("Mouse, on the map", MOUSE), ("Tabs", (*TABS, *others)), ("Words", WORDS))
    return "".join(
        f'<div style="font-weight:650;margin:.6em 0 .2em">{escape(title)}</div>'
        f'<div style="{GRID_STYLE}">'
        + "".join(_row(left, right, key=title == "Keys") for left, right in rows)
        + "</div>"
        for title, rows in parts
    )


def _row(left: str, right: str, *, key: bool) -> str:
    tag = "kbd" if key else "span"
    frame = (
        "border:1px solid currentColor;border-radius:4px;padding:0 .45em;font-size:.95em" if key else "font-weight:550"
    )
    return f'<div><{tag} style="{frame}">{escape(left)}</{tag}></div><div style="{DIM_STYLE}">{escape(right)}</div>'
