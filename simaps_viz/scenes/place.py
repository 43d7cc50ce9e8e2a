"""An embedded place: what is in it, where the camera walks, and the source files that say so."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from simaps_viz.scenes.scene import Scene
from simaps_viz.scenes.walk import Station, Walk, sample_walk

_FOLDER = Path(__file__).parent
_IMPORT = re.compile(r"^\s*from simaps_viz\.scenes(\S*) import (\([^)]*\)|.*)", re.MULTILINE)


@dataclass(frozen=True)
class Place:
    """One place; members of a registry, see ``places``."""

    name: str
    title: str
    """What it is, in a sentence's words: "A flat of our own making"."""
    scene: Callable[[], Scene]
    stations: Callable[[], Sequence[Station]]
    """Where the camera passes and what it turns to, in order."""
    frames: int = 200
    width: int = 640
    """Of the pictures, pixels; they are 4 : 3."""

    def walk(self, frames: int) -> Walk:
        """Return the camera's poses, that many."""
        return sample_walk(self.stations(), frames)

    def sources(self) -> list[Path]:
        """Return the files of this folder that make the place and its frames, each once, sorted.

        They are those that its own file, the renderer and the simulated errors import; so another place, or furniture
        that only another place has, leaves its frames as they are.
        """
        here = _FOLDER / f"{self.name}.py"
        return sorted(_imported({here, *(_FOLDER / f"{name}.py" for name in ("render", "simulated_errors"))}))


def _imported(files: set[Path]) -> set[Path]:
    """Return these files and all of this folder that they import, directly or not."""
    found, left = set(files), list(files)
    while left:
        # not ast: Python 3.11 cannot parse in several threads at once
        for module, names in _IMPORT.findall(left.pop().read_text(encoding="utf-8")):
            base = _FOLDER.joinpath(*module.split(".")[1:])
            named = {base.with_suffix(".py"), *(base / f"{name}.py" for name in re.findall(r"\w+", names))}
            new = {path for path in named if path.is_file()} - found
            found |= new
            left += new
    return found
