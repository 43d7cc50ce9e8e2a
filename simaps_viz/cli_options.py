"""Options that several commands share."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tyro

from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.votes import VoteSettings
from simaps_viz.methods import METHODS
from simaps_viz.pipeline import BuildConfig

Level = Literal["none", "light", "medium", "heavy"]
"""Of simulated network errors."""
MethodName = Literal["evidence", "paper", "components", "vlmaps", "vlmaps+components"]


@dataclass(frozen=True)
class Mapping:
    """How cells become instances."""

    method: MethodName = "evidence"
    """evidence (ours): votes, and how often cells were seen as one or as two. paper: graph of cells seen in one
    segment, Louvain communities, merge by K %. components: connected patches of a class. vlmaps, vlmaps+components:
    the baselines, with a simulated LSeg encoder."""
    k: float = 5.0
    """Method paper: join a community to its neighbour while more than this percentage of its cells touch it (0-100)."""
    affinity: float = 0.6
    """Method evidence: join two communities while more than this share of what was seen of both says they are one
    (0-1)."""
    resolution: float = 1.0
    """Of Louvain: higher gives more and smaller communities."""
    seed: int = 0
    """Of Louvain's random order; the same seed gives the same map."""
    min_cells: int = 4
    """Do not call anything an instance that covers fewer cells than this."""
    votes: bool = True
    """Methods evidence and components: let all frames vote for the class of a cell; --no-votes lets its highest pixel
    decide, as the paper does."""
    literal: bool = False
    """Method paper: also link cells across depth jumps inside a segment, as the paper's text reads."""
    cell_size: float = 0.05
    """Side of a cell, metres."""
    cut_height: float = 2.0
    """Leave out what is higher than this over the floor, metres."""
    max_depth: float = 6.0
    """Leave out what is farther from the camera than this, metres."""

    def config(self) -> BuildConfig:
        """Give everything but the method's name, checked."""
        projection = ProjectionSettings(cell_size_m=self.cell_size, cut_height_m=self.cut_height, far_m=self.max_depth)
        return BuildConfig(
            k_percent=self.k, affinity=self.affinity, resolution=self.resolution, seed=self.seed,
            min_cells=self.min_cells, literal=self.literal, projection=projection,
            votes=replace(VoteSettings(), enabled=self.votes),
        )  # fmt: skip


@dataclass(frozen=True)
class Evaluate:
    """Score methods against the truth of a rendered scene, or against counts by eye; or drive on their maps.

    Example: simaps evaluate demo --errors light,medium --seeds 3 --picture maps.png
    """

    sequence: tyro.conf.Positional[str]
    """Sequence folder or manifest with exact ids, or "demo" for the embedded café."""
    task: Literal["instances", "navigation", "ablation"] = "instances"
    """instances: is every object one instance? navigation: a simulated robot carries out generated commands.
    ablation: what each piece of method evidence is worth."""
    methods: str = ",".join(METHODS)
    """Separated by commas; also components-highest, paper-k9 and paper-literal."""
    errors: str = ""
    """Masks, separated by commas: none (exact), light, medium, heavy (simulated network errors), precomputed (the
    sequence's own). By default light where the sequence's masks are exact."""
    seeds: int = 1
    """Of the simulated errors; more than one gives mean ± spread."""
    counts: str = ""
    """Numbers counted by eye on a real scan, such as chair=11,table=2."""
    truth: Path | None = None
    """Manifest with exact ids, where it is not beside the sequence."""
    commands: int = 100
    """Navigation: how many commands a scene."""
    discrete: bool = False
    """Navigation: move in steps of 0.1 m and turns of 5°, as VLMaps does."""
    judge: Path | None = None
    """Navigation: also write the runs for people to judge in the workbench (simaps judge)."""
    picture: Path | None = None
    """Draw the maps side by side (.png)."""
    record: Path | None = None
    """Write the maps side by side as a recording for rerun (.rrd)."""
    output: Path | None = None
    """Write everything measured (.json)."""
    json: bool = False
    """Print everything measured as one JSON line."""
