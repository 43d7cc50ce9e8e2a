"""Maps to compare a map with: by other methods, or the ground truth; each is made once."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from simaps_viz.build import METHOD_NAMES
from simaps_viz.build.cache import cache_key, made_folder, map_in_cache
from simaps_viz.build.methods import build
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.evaluation.space import SpaceTruth, origin_of_voxels, space_truth
from simaps_viz.evaluation.truth import exact_of, settings_of, truth_as_map, truth_of
from simaps_viz.events import BuildStarted, Event, FrameProjected, Progress
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.structures import SIMap

_BASELINES: Mapping[str, str] = {
    "vlmaps": "VLMaps (simulated encoder)",
    "vlmaps+components": "VLMaps + components (simulated encoder)",
}


TRUTH = "truth"
"""Key of the source that is the ground truth."""


@dataclass(frozen=True)
class Source:
    """A map that can be compared with another."""

    key: str
    title: str
    """Such as "Method paper" or "Ground truth"."""


class MapMaker:
    """Makes maps of one sequence by name, in the grid of the map they are to be compared with; each only once."""

    def __init__(self, sequence: FrameSource | None, folder: Path) -> None:
        """Take the sequence, and the folder in which maps are kept."""
        self._sequence, self._folder = sequence, folder
        self._made: dict[Path, SIMap] = {}
        self._in_space: dict[Path, SpaceTruth] = {}

    def sources(self, simap: SIMap) -> tuple[Source, ...]:
        """Return the maps that ``make`` can make for a map; none without a sequence."""
        if self._sequence is None:
            return ()
        truth = () if exact_of(self._sequence) is None else (Source(TRUTH, "Ground truth"),)
        others = (name for name in METHOD_NAMES if name != simap.method)
        return *truth, *(Source(name, _BASELINES.get(name, f"Method {name}")) for name in others)

    def make(self, key: str, simap: SIMap, tell: Progress) -> SIMap:
        """Return a map by another method, or the true one.

        Args:
            key: of one of the ``sources``.
            simap: the map whose grid, frames and settings the new one takes over.
            tell: called with the progress, often enough that raising in it ends the work soon.

        Raises:
            InputError: there is no sequence, or no truth, or it cannot be read.
        """
        sequence = self._sequence
        if sequence is None:
            raise InputError("comparison: expected the sequence the map was built from, found none")
        kept = self._kept(key, simap, sequence)
        if kept not in self._made:
            self._made[kept] = load_map(kept) if kept.is_file() else self._build(key, simap, sequence, tell, kept)
        return self._made[kept]

    def truth_in_space(self, simap: SIMap, tell: Progress) -> SpaceTruth:
        """Return the true objects in space for a map; arguments and errors as of `make`."""
        exact = None if self._sequence is None else exact_of(self._sequence)
        if exact is None:
            raise InputError("comparison: expected the sequence the map was built from, with exact ids, found none")
        kept = self._kept(TRUTH, simap, exact)
        if kept not in self._in_space:
            self._in_space[kept] = space_truth(
                exact, simap.T_map_world, origin_of_voxels(simap), settings_of(simap),
                frame_names=simap.frame_names, progress=tell,
            )  # fmt: skip
        return self._in_space[kept]

    def _build(self, key: str, simap: SIMap, sequence: FrameSource, tell: Progress, kept: Path) -> SIMap:
        if key == TRUTH:
            exact = exact_of(sequence)
            if exact is None:
                raise InputError(f"{sequence.path}: expected exact ids, here or beside it, found none")
            made = truth_as_map(truth_of(simap, exact, tell))
        else:
            made = build(sequence, key, config_like(simap), [_Told(tell, key)])
        save_map(made, kept)
        return made

    def _kept(self, key: str, simap: SIMap, sequence: FrameSource) -> Path:
        """Return the path of the map; that of another method is where its own build would have written it."""
        if key != TRUTH:
            return map_in_cache(self._folder, sequence, key, config_like(simap))
        what = asdict(settings_of(simap)), simap.T_map_world.tolist(), list(simap.frame_names)
        return made_folder(self._folder / "compare") / f"{cache_key(sequence, key, *what)}.npz"


def config_like(simap: SIMap) -> BuildConfig:
    """Return the settings of another method that make its map comparable: the same grid, seed and smallest object."""
    given: Mapping[str, Any] = simap.parameters
    known = {f.name for f in fields(BuildConfig)}
    same = {name: given[name] for name in ("seed", "min_cells") if name in given and name in known}
    return replace(BuildConfig(), projection=settings_of(simap), **same)


class _Told:
    """Watches a build and tells how far it is."""

    wants_color = False

    def __init__(self, tell: Progress, method: str) -> None:
        self._tell, self._what, self._total = tell, f"mapping frames by method {method}", 1

    def on_event(self, event: Event) -> None:
        """Take one event of the build."""
        if isinstance(event, BuildStarted):
            self._total = len(event.frame_names)
        elif isinstance(event, FrameProjected):
            self._tell(self._what, event.frame.index + 1, self._total)
