"""What stands behind the page's comparison (other methods' maps, the truth, files, settings) and its shared files."""

import hashlib
import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simaps_viz.building import history_beside
from simaps_viz.datasets.posed_frames import PosedFrames
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.evaluation.truth import find_truth, settings_of, truth_as_map, truth_of
from simaps_viz.evaluation.two_maps import compare_two
from simaps_viz.events import BuildStarted, Event, FrameProjected
from simaps_viz.files import write_whole
from simaps_viz.mapping.mapfile import load_map, save_map
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.methods import METHODS, build
from simaps_viz.navigation.agent import Agent, answer
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.pipeline import BuildConfig
from simaps_viz.structures import SIMap

if TYPE_CHECKING:
    from simaps_viz.viewer.panels.compare_services import CompareServices, Tell
    from simaps_viz.viewer.panels.share import ShareServices

_TITLES = {
    "evidence": "Method evidence",
    "paper": "Method paper",
    "components": "Method components",
    "vlmaps": "VLMaps (simulated encoder)",
    "vlmaps+components": "VLMaps + components (simulated encoder)",
}


def compare_services(simap: SIMap, sequence: FrameSource | None, folder: Path) -> "CompareServices":
    """Give what the page's comparison needs.

    Args:
        simap: the map the page was opened on.
        sequence: it was built from; without it there are neither other methods nor the truth.
        folder: where built maps are kept.
    """
    from simaps_viz.viewer.panels.compare_services import TRUTH, CompareServices, Source  # noqa: PLC0415 - viser is slow

    sources = []
    if sequence is not None:
        if _exact(sequence) is not None:
            sources.append(Source(TRUTH, "Ground truth"))
        sources += [Source(name, _TITLES.get(name, name)) for name in METHODS if name != simap.method]
    makers = MapMaker(sequence, folder)
    return CompareServices(
        compare=lambda left, right, truth: compare_two(left, right, truth=truth),
        sources=tuple(sources),
        make=makers.make if sequence is not None else None,
        rejoin=rejoin,
        load=load_bytes,
    )


def share_services(beside: Path | None) -> "ShareServices":
    """Give what the page's files to send need.

    Args:
        beside: the map's recording; the history of its build lies beside it, if there is one.
    """
    from simaps_viz.viewer.panels.share import ShareServices  # noqa: PLC0415 - viser is slow to import

    return ShareServices(
        ask=answer,
        steps=lambda simap, program, pose: Agent(simap, pose).steps(program),
        look=lambda simap: look_back(beside, simap) if beside is not None else None,
        radius_m=RobotShape().radius_m,
    )


def look_back(beside: Path, simap: SIMap) -> Callable[[int], SIMap] | None:
    """Give what shows the map after a frame, from the history beside a map or its recording; None without one."""
    history = history_beside(beside, simap)
    return None if history is None else history.look_at


def rejoin(simap: SIMap, percent: float, resolution: float) -> SIMap:
    """Give the map for another K or evidence (percent), and Louvain resolution.

    Raises:
        InputError: the map's method has neither.
    """
    joined: Any = {"affinity": percent / 100.0} if simap.method == "evidence" else {"k_percent": percent}
    if abs(resolution - float(simap.parameters.get("resolution", 1.0))) < 1e-9:
        return repartition(simap, **joined)
    return recommunity(simap, resolution=resolution, **joined)


def load_bytes(name: str, content: bytes) -> SIMap:
    """Read a map file whose content a browser sent.

    Raises:
        InputError: it is no map file.
    """
    import tempfile  # noqa: PLC0415 - only needed here

    with tempfile.TemporaryDirectory(prefix="simaps-") as folder:
        path = Path(folder) / (Path(name).name or "map.npz")
        write_whole(path, content, "the map that was sent")
        try:
            return load_map(path)
        except SIMapsError as error:
            raise InputError(str(error).replace(str(path), path.name)) from error


class MapMaker:
    """Makes maps of one sequence by name, in the grid of the map they are to be compared with; each only once."""

    def __init__(self, sequence: FrameSource | None, folder: Path) -> None:
        """Take the sequence, and the folder in which maps are kept."""
        self._sequence, self._folder = sequence, folder
        self._made: dict[str, SIMap] = {}

    def make(self, key: str, simap: SIMap, tell: "Tell", cancel: threading.Event) -> SIMap:
        """Give a map by another method, or the true one.

        Args:
            key: name of a method, or "truth".
            simap: whose grid, frames and settings it shall have.
            tell: told how far it is; also called often enough to end the work by raising.
            cancel: set when nobody waits any more; ``tell`` raises then.

        Raises:
            InputError: there is no sequence, or no truth, or it cannot be read.
        """
        sequence = self._sequence
        if sequence is None:
            raise InputError("comparison: expected the sequence the map was built from, found none")
        mark = self._mark(key, simap, sequence)
        if mark not in self._made:
            kept = self._folder / "compare" / f"{mark}.npz"
            self._made[mark] = load_map(kept) if kept.is_file() else self._build(key, simap, sequence, tell, kept)
        return self._made[mark]

    def _build(self, key: str, simap: SIMap, sequence: FrameSource, tell: "Tell", kept: Path) -> SIMap:
        if key == "truth":
            exact = _exact(sequence)
            if exact is None:
                raise InputError(f"{sequence.path}: expected exact ids, here or beside it, found none")
            tell("looking at the exact ids", 0, 1)
            made = truth_as_map(truth_of(simap, exact))
        else:
            made = build(sequence, key, config_like(simap), [_Told(tell, key)])
        kept.parent.mkdir(parents=True, exist_ok=True)
        save_map(made, kept)
        return made

    def _mark(self, key: str, simap: SIMap, sequence: FrameSource) -> str:
        what = [
            key, str(Path(sequence.path).resolve()), Path(sequence.path).stat().st_mtime_ns,
            sequence.segmentation_source, asdict(settings_of(simap)), simap.T_map_world.tolist(),
            list(simap.frame_names), version("simaps-viz"),
        ]  # fmt: skip
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def config_like(simap: SIMap) -> BuildConfig:
    """Give the settings of another method that make its map comparable: the same grid, seed and smallest object."""
    given: Mapping[str, Any] = simap.parameters
    known = {f.name for f in fields(BuildConfig)}
    same = {name: given[name] for name in ("seed", "min_cells") if name in given and name in known}
    return replace(BuildConfig(), projection=settings_of(simap), **same)


class _Told:
    """Watches a build and tells how far it is."""

    wants_color = False

    def __init__(self, tell: "Tell", method: str) -> None:
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
