"""What the page can ask for. The app hands these in; no computing lives in the page's callbacks."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from simaps_viz.structures import Instance, Pose2, SIMap

Asset = tuple[bytes | Path, str]
"""Content (or the file that holds it) and its media type."""


class AnswerLike(Protocol):
    """What carrying out a command gave."""

    @property
    def status(self) -> str:
        """Either ok, refused or failed."""
        ...

    @property
    def reason(self) -> str | None:
        """Why not, or what is worth knowing, in words."""
        ...

    @property
    def program(self) -> str | None:
        """The program that was run; empty when the command was not understood."""
        ...

    @property
    def goals(self) -> Sequence[Any]:
        """Where the robot was sent: mappings or objects with ``label``, ``instance`` and ``point``."""
        ...

    @property
    def path_m(self) -> NDArray:
        """Points [n, 2], map frame, metres, as far as the robot came; may be empty."""
        ...

    @property
    def final_pose(self) -> Pose2:
        """Where the robot ends."""
        ...

    @property
    def path_length_m(self) -> float:
        """Length of the path, metres."""
        ...

    @property
    def notes(self) -> Sequence[str]:
        """How words were read."""
        ...

    @property
    def alternatives(self) -> Sequence[str]:
        """Other programs the command could mean."""
        ...


class StepLike(Protocol):
    """One statement of a program as it was run."""

    @property
    def line(self) -> int:
        """Counted from 1."""
        ...

    @property
    def poses(self) -> NDArray:
        """float64 [n, 3], x, y (metres), yaw (radians), map frame: what the statement drove; may be empty."""
        ...


class CandidateLike(Protocol):
    """One of the objects a command could have meant."""

    @property
    def instance(self) -> Instance:
        """The object."""
        ...

    @property
    def rank(self) -> int:
        """1 is the closest to where the command was given."""
        ...

    @property
    def distance_m(self) -> float:
        """How far from there, metres."""
        ...


@dataclass(frozen=True)
class Services:
    """Plain functions behind the page; what is None is greyed out or said to be missing."""

    repartition: Callable[[SIMap, float], SIMap] | None = None
    """(map, percent) -> the map with another K (method paper) or affinity (method evidence); fast."""
    recommunity: Callable[[SIMap, float, float], SIMap] | None = None
    """(map, resolution, percent) -> the map with communities found anew."""
    ask: Callable[[SIMap, str, Pose2], AnswerLike] | None = None
    """(map, command, where the robot stands) -> answer. May raise SIMapsError."""
    steps: Callable[[SIMap, str, Pose2], Iterable[StepLike]] | None = None
    """(map, program, where the robot stands) -> its statements as they are run, to mark the line during the ride."""
    candidates: Callable[[SIMap, str, Pose2], Sequence[CandidateLike]] | None = None
    """(map, class, where the command is given) -> all objects of the class, the closest first, to number them."""
    view: Callable[[int], tuple[NDArray, NDArray] | None] | None = None
    """frame index -> (RGB uint8 [H, W, 3], segment ids int32 [H, W]); None when the sequence is not at hand."""
    rerun_page: Callable[[Sequence[str]], str] | None = None
    """(addresses of the recordings) -> HTML of the page that shows the recorded build; None when there is none."""
    rerun_assets: Mapping[str, Asset] = field(default_factory=dict)
    """File name -> asset, served beside that page."""
    csp: str = ""
    """Content-Security-Policy of that page; empty takes a strict one."""
    recordings: tuple[Path, ...] = ()
    """The .rrd files that page may load, as /recordings/<name>."""
