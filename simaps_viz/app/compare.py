"""Maps for the page's comparison: by other methods or settings, the ground truth, and maps read from files."""

import tempfile
import threading
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simaps_viz.build.cache import cache_key, made_folder, map_in_cache
from simaps_viz.build.methods import build
from simaps_viz.build.names import METHOD_NAMES
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.evaluation.truth import find_truth, settings_of, truth_as_map, truth_of
from simaps_viz.evaluation.two_maps import compare_two
from simaps_viz.events import BuildStarted, Event, FrameProjected, Progress
from simaps_viz.io.files import write_whole
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.mending import Mending
from simaps_viz.mapping.simap import joining_at, recommunity, repartition
from simaps_viz.structures import SIMap

if TYPE_CHECKING:
    from simaps_viz.viewer.panels.compare import CompareServices


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


_BASELINES: Mapping[str, str] = {
    "vlmaps": "VLMaps (simulated encoder)",
    "vlmaps+components": "VLMaps + components (simulated encoder)",
}


def compare_services(simap: SIMap, sequence: FrameSource | None, folder: Path) -> "CompareServices":
    """Return the services of the page's comparison.

    Args:
        simap: the map the page was opened on.
        sequence: it was built from; without it there are neither other methods nor the truth.
        folder: where built maps are kept.
    """
    from simaps_viz.viewer.panels.compare import TRUTH, CompareServices, Source  # noqa: PLC0415 - viser is slow

    sources = []
    if sequence is not None:
        if _exact(sequence) is not None:
            sources.append(Source(TRUTH, "Ground truth"))
        others = (name for name in METHOD_NAMES if name != simap.method)
        sources += [Source(name, _BASELINES.get(name, f"Method {name}")) for name in others]
    makers = MapMaker(sequence, folder)
    return CompareServices(
        compare=lambda left, right, truth: compare_two(left, right, truth=truth),
        sources=tuple(sources),
        make=makers.make if sequence is not None else None,
        rejoin=rejoin,
        load=load_bytes,
    )


def rejoin(simap: SIMap, percent: float, resolution: float) -> SIMap:
    """Return the map for another K or evidence (percent), and Louvain resolution.

    Raises:
        InputError: the map's method has neither.
    """
    if abs(resolution - float(simap.parameters.get("resolution", 1.0))) < 1e-9:
        return repartition(simap, **joining_at(simap, percent))
    return find_again(simap, resolution, percent)


def find_again(simap: SIMap, resolution: float, percent: float, edits: Mending | None = None) -> SIMap:
    """Return the map with its communities found again for a Louvain resolution, and its edits where they cover it."""
    find = recommunity if edits is None or not edits.covers(simap) else edits.recommunity
    return find(simap, resolution=resolution, **joining_at(simap, percent))


class MapMaker:
    """Makes maps of one sequence by name, in the grid of the map they are to be compared with; each only once."""

    def __init__(self, sequence: FrameSource | None, folder: Path) -> None:
        """Take the sequence, and the folder in which maps are kept."""
        self._sequence, self._folder = sequence, folder
        self._made: dict[Path, SIMap] = {}

    def make(self, key: str, simap: SIMap, tell: Progress, cancel: threading.Event) -> SIMap:
        """Return a map by another method, or the true one.

        Args:
            key: name of a method, or "truth".
            simap: the map whose grid, frames and settings the new one takes over.
            tell: called with the progress, often enough that raising in it ends the work soon.
            cancel: set when the result is no longer wanted; ``tell`` raises then.

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

    def _build(self, key: str, simap: SIMap, sequence: FrameSource, tell: Progress, kept: Path) -> SIMap:
        if key == "truth":
            exact = _exact(sequence)
            if exact is None:
                raise InputError(f"{sequence.path}: expected exact ids, here or beside it, found none")
            tell("looking at the exact ids", 0, 1)
            made = truth_as_map(truth_of(simap, exact))
        else:
            made = build(sequence, key, config_like(simap), [_Told(tell, key)])
        save_map(made, kept)
        return made

    def _kept(self, key: str, simap: SIMap, sequence: FrameSource) -> Path:
        """Return the path of the map; that of another method is where its own build would have written it."""
        if key != "truth":
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


def _exact(sequence: FrameSource) -> PosedFrames | None:
    """Find the same frames with exact ids; None when there are none."""
    if not isinstance(sequence, PosedFrames):
        return None
    try:
        return find_truth(sequence)
    except SIMapsError:
        return None
