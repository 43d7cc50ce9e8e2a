"""How a map is built: all settings of a build, checked, and as JSON."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from simaps_viz.errors import InputError
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.evidence import AFFINITY, EvidenceSettings
from simaps_viz.mapping.methods import METHODS, method_of
from simaps_viz.mapping.paper import K_PERCENT
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.votes import VoteSettings


@dataclass(frozen=True)
class BuildConfig:
    """How a map is built."""

    method: str = "evidence"
    """How cells become instances, by name: see `methods.METHODS`."""
    k_percent: float = 5.0
    """Method paper: two communities merge while more than this percentage of one's cells neighbour the other."""
    affinity: float = 0.6
    """Method evidence: two communities merge while their affinity (see `pooling.affinity`) exceeds this."""
    resolution: float = 1.0
    """Louvain's resolution: higher gives more and smaller communities."""
    seed: int = 0
    """Seed of Louvain's random order."""
    min_cells: int = 4
    """Instances of fewer cells are dropped; 4 cells of 5 cm are a cup."""
    literal: bool = False
    """Method paper, its literal reading: depth jumps inside a segment link cells too."""
    projection: ProjectionSettings = field(default_factory=ProjectionSettings)
    """Which pixels count, and how fine the grid is."""
    votes: VoteSettings = field(default_factory=VoteSettings)
    """Methods evidence and components: how frames vote for the class of a cell."""
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    """Method evidence: which pairs of cells are looked at."""
    pooling: PoolSettings = field(default_factory=PoolSettings)
    """Method evidence: the belief before any evidence."""

    def __post_init__(self) -> None:
        _check_kinds(self, finite=False)  # each is looked at below
        for settings in (self.projection, self.votes, self.evidence, self.pooling):
            _check_kinds(settings, finite=True)
        if self.method not in METHODS:
            raise InputError(f"method: expected one of {', '.join(METHODS)}, found {str(self.method)[:60]!r}")
        K_PERCENT.check(self.k_percent)
        AFFINITY.check(self.affinity)
        if not 0.0 < self.resolution < float("inf"):
            raise InputError(f"resolution: expected a number above 0, found {self.resolution:g}")
        ranges = self.evidence.ranges
        if len(set(ranges)) != len(ranges) or not all(type(r) is int and 1 <= r <= 1000 for r in ranges):
            raise InputError(f"ranges of evidence: expected different numbers of cells from 1, found {ranges}")
        if not 0 <= self.votes.rounds <= 100:
            raise InputError(f"rounds of learning: expected 0 to 100, found {self.votes.rounds}")
        if self.min_cells < 1:
            raise InputError(f"smallest instance: expected at least 1 cell, found {self.min_cells}")
        if not 0.005 <= self.projection.cell_size_m <= 1.0:
            raise InputError(f"cell size: expected 0.005 to 1 m, found {self.projection.cell_size_m:g} m")
        near_m, far_m, cut_m = self.projection.near_m, self.projection.far_m, self.projection.cut_height_m
        if not near_m < far_m:
            raise InputError(f"largest depth: expected more than {near_m:g} m, the smallest, found {far_m:g} m")
        if not cut_m > -self.projection.below_floor_m:
            raise InputError(f"cut height: expected a height over the floor, metres, found {cut_m:g} m")

    def parameters(self) -> dict[str, Any]:
        """Return what a map keeps of the settings: those that its method uses."""
        common = {"min_cells": self.min_cells, **asdict(self.projection)}
        return common | method_of(self.method).parameters(self)

    def to_json(self) -> dict[str, Any]:
        """Return all settings, JSON-able; `config_from_json` reads them."""
        kept = asdict(self)
        kept["evidence"]["ranges"] = list(self.evidence.ranges)
        return kept


def _check_kinds(settings: Any, *, finite: bool) -> None:
    """Raise InputError where a setting has the wrong type: settings also come from files."""
    for field_ in fields(settings):
        value, kind = getattr(settings, field_.name), field_.type
        number = isinstance(value, int | float) and not isinstance(value, bool)
        number = number and (abs(value) < 1e9 or (not finite and isinstance(value, float)))
        wrong = (kind is float and not number) or (kind is int and not (number and isinstance(value, int)))
        if wrong or (kind is bool and not isinstance(value, bool)):
            wanted = "true or false" if kind is bool else "a number"
            raise InputError(f"{field_.name}: expected {wanted}, found {value!r}")
    if getattr(settings, "seed", 0) < 0:
        raise InputError(f"seed: expected a whole number from 0, found {settings.seed}")


def config_from_json(values: Mapping[str, Any]) -> BuildConfig:
    """Rebuild what `BuildConfig.to_json` returned.

    Raises:
        InputError: a setting makes no sense.
        KeyError, TypeError: a setting is missing or unknown.
    """
    evidence = dict(values["evidence"])
    evidence["ranges"] = tuple(evidence["ranges"])
    parts = {
        "projection": ProjectionSettings(**values["projection"]),
        "votes": VoteSettings(**{"rounds": 0, **values["votes"]}),  # maps of before nothing was learned
        "evidence": EvidenceSettings(**evidence),
        "pooling": PoolSettings(**values["pooling"]),
    }
    return BuildConfig(**{**values, **parts})
