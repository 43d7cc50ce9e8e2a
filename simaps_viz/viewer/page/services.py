"""What the page can ask for. The app hands these in; no computing lives in the page's callbacks."""

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from numpy.typing import NDArray

from simaps_viz.structures import Instance, Pose2, SIMap

if TYPE_CHECKING:
    from simaps_viz.viewer.page.panel import PanelSpec

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


class MessageLike(Protocol):
    """One turn of a conversation with a language model."""

    @property
    def role(self) -> str:
        """Either system, user or assistant."""
        ...

    @property
    def content(self) -> str:
        """The text."""
        ...


class ExchangeLike(Protocol):
    """One question to a language model, and what came back."""

    @property
    def messages(self) -> Sequence[MessageLike]:
        """What was sent."""
        ...

    @property
    def response(self) -> str:
        """What came back; empty when nothing did."""
        ...

    @property
    def seconds(self) -> float:
        """How long that took."""
        ...

    @property
    def error(self) -> str | None:
        """Why nothing came back, in words."""
        ...


@dataclass(frozen=True)
class LanguageModel:
    """A language model that can read the commands."""

    name: str
    """Which, and where it runs."""
    ask: Callable[[SIMap, str, Pose2, threading.Event, Callable[[Sequence[ExchangeLike]], None]], AnswerLike]
    """(map, command, where the robot stands, set to end the wait, told what was sent and received) -> answer."""


class RunLike(Protocol):
    """One run that a person judges."""

    @property
    def run_id(self) -> str:
        """Names the run in the session."""
        ...

    @property
    def shown(self) -> Mapping[str, Any]:
        """Command, start (x, y, heading in degrees), track and stops (lists of [x, y]), status, collision."""
        ...

    @property
    def number(self) -> int:
        """From 1."""
        ...

    @property
    def total(self) -> int:
        """Runs of the session."""
        ...


class ScoreLike(Protocol):
    """What people say of one method."""

    @property
    def yes(self) -> int:
        """Runs that did what was asked."""
        ...

    @property
    def no(self) -> int:
        """Runs that did not."""
        ...

    @property
    def skipped(self) -> int:
        """Runs of which the judge could not tell."""
        ...

    @property
    def share(self) -> float | None:
        """Share of yes among yes and no; None before the first."""
        ...


class JudgingLike(Protocol):
    """A session in which a person judges runs, blind and in random order; it saves every answer at once."""

    def next_run(self) -> RunLike | None:
        """Return the first run without an answer; None when all are done."""
        ...

    def judge(self, run_id: str, answer: Literal["yes", "no", "skip"]) -> None:
        """Save an answer; may raise SIMapsError."""
        ...

    def summary(self) -> Mapping[tuple[str, str], ScoreLike]:
        """Return {(kind of errors, method): what people say}."""
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
    model: LanguageModel | None = None
    """Reads commands in the place of ``ask`` while it is switched on."""
    judging: JudgingLike | None = None
    """Runs for a person to judge, on a page of their own in front of all others."""
    view: Callable[[int], tuple[NDArray, NDArray] | None] | None = None
    """frame index -> (RGB uint8 [H, W, 3], segment ids int32 [H, W]); None when the sequence is not at hand."""
    picture_divide: Mapping[str, int] = field(default_factory=dict)
    """Entity path of a recorded picture -> how many times smaller it is than its frame, so that it can be clicked."""
    look_back: Callable[[SIMap, int], SIMap | None] | None = None
    """(map, frame) -> what it looked like after that frame; None when the history of this map is not at hand."""
    rerun_page: Callable[[Sequence[str]], str] | None = None
    """(addresses of the recordings) -> HTML of the page that shows the recorded build; None when there is none."""
    rerun_assets: Mapping[str, Asset] = field(default_factory=dict)
    """File name -> asset, served beside that page."""
    csp: str = ""
    """Content-Security-Policy of that page; empty takes a strict one."""
    recordings: tuple[Path, ...] = ()
    """The .rrd files that page may load, as /recordings/<name>."""
    recorded_levels: int | None = None
    """At which time of timeline "louvain" the recording has the final communities; None = after all of its levels."""
    panels: "Sequence[PanelSpec]" = ()
    """Panels besides those that are always there, in their order."""
    stream: str = ""
    """Address of a live recording to show, ``rerun+http://127.0.0.1:9876/proxy``; empty = none."""
    building: bool = False
    """The map is still being built; `Workbench.finish` ends that."""
