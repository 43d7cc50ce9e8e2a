"""What the page can ask for. The app hands these in; no computing lives in the page's callbacks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import NDArray

from simaps_viz.evaluation.judging import JudgingSession
from simaps_viz.language.grounding import Candidate
from simaps_viz.navigation.agent import Answer
from simaps_viz.recorder.web_viewer import rerun_page
from simaps_viz.structures import Pose2, SIMap

if TYPE_CHECKING:
    from simaps_viz.viewer.page.panel import PanelSpec


@dataclass(frozen=True)
class LanguageModel:
    """A language model that can read the commands."""

    name: str
    """Name of the model, and where it runs."""
    ask: Callable[..., Answer]
    """(map, command, pose of the robot, event that ends the wait, called with what was sent and received,
    robot=RobotShape) -> answer."""


@dataclass(frozen=True)
class Services:
    """Plain functions behind the page; what is None is greyed out or reported as missing."""

    repartition: Callable[[SIMap, float], SIMap] | None = None
    """(map, percent) -> the map with another K (method paper) or affinity (method evidence); fast."""
    recommunity: Callable[[SIMap, float, float], SIMap] | None = None
    """(map, resolution, percent) -> the map with communities found anew."""
    ask: Callable[..., Answer] | None = None
    """(map, command, pose of the robot, robot=RobotShape) -> answer. May raise SIMapsError."""
    candidates: Callable[[SIMap, str, Pose2], Sequence[Candidate]] | None = None
    """(map, class, pose where the command is given) -> all objects of the class, the closest first, to number them."""
    model: LanguageModel | None = None
    """Reads commands instead of ``ask`` while it is switched on."""
    judging: JudgingSession | None = None
    """Runs for a person to judge, in a tab in front of all others."""
    view: Callable[[int], tuple[NDArray, NDArray] | None] | None = None
    """frame index -> (RGB uint8 [H, W, 3], segment ids int32 [H, W]); None when the sequence is not at hand."""
    look_back: Callable[[SIMap, int], SIMap | None] | None = None
    """(map, frame) -> the map as it was after that frame; None when the history of this map is not at hand."""
    recordings: tuple[Path, ...] = ()
    """The .rrd files of the build, which the page docks."""
    rerun_page: Callable[[Sequence[str]], str] = rerun_page
    """(addresses of the recordings) -> HTML of the page that shows them."""
    recorded_levels: int | None = None
    """Time on timeline "louvain" at which the recording has the final communities; None = after the last level."""
    panels: "Sequence[PanelSpec]" = ()
    """Panels besides those that are always there, in their order."""
    stream: str = ""
    """Address of a live recording to show, ``rerun+http://127.0.0.1:9876/proxy``; empty = none."""
    building: bool = False
    """The map is still being built; `Workbench.finish` ends that."""
