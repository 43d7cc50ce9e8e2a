"""Options that several commands share."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from simaps_viz.build import MethodName
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.build.pipeline import BuildConfig
    from simaps_viz.segmentation.recognise import NetworkSettings


@dataclass(frozen=True)
class MappingOptions:
    """How a map is built."""

    method: MethodName = "evidence"
    """evidence (ours): votes, and how often cells were seen as one or as two. paper: graph of cells seen in one
    segment, Louvain communities, merge by K %. components: connected patches of a class. vlmaps, vlmaps+components:
    the baselines, with a simulated LSeg encoder."""
    k: float = 5.0
    """Method paper: join a community to its neighbour while more than this percentage of its cells touch it (0-100)."""
    affinity: float = 0.6
    """Method evidence: merge two communities while their affinity, the share of the evidence that says they are one,
    exceeds this (0-1)."""
    resolution: float = 1.0
    """Louvain's resolution: higher gives more and smaller communities."""
    seed: int = 0
    """Seed of Louvain's random order; the same seed gives the same map."""
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

    def config(self) -> "BuildConfig":
        """Return everything but the method's name, checked."""
        from simaps_viz.build.pipeline import BuildConfig
        from simaps_viz.mapping.accumulator import ProjectionSettings
        from simaps_viz.mapping.votes import VoteSettings

        projection = ProjectionSettings(cell_size_m=self.cell_size, cut_height_m=self.cut_height, far_m=self.max_depth)
        return BuildConfig(
            k_percent=self.k, affinity=self.affinity, resolution=self.resolution, seed=self.seed,
            min_cells=self.min_cells, literal=self.literal, projection=projection,
            votes=replace(VoteSettings(), enabled=self.votes),
        )  # fmt: skip


@dataclass(frozen=True)
class WorldFrame:
    """Which way is up and where the floor is, for recordings that do not say so or say it wrongly."""

    up: str | None = None
    """The world's up direction as X,Y,Z (--up=-1,0,0 where it begins with a minus). By default what the recording says,
    else what its pictures show: floor, walls, how the camera was held."""
    floor_height: float | None = None
    """Height of the floor along up, metres. By default what the recording says, else the lowest large plane."""

    def stated(self) -> "Stated":
        """Return what `open_sequence` takes; raises InputError unless up is three numbers."""
        up = None
        if self.up is not None:
            try:
                x, y, z = map(float, self.up.split(","))
            except ValueError as error:
                raise InputError(f"--up: expected three numbers X,Y,Z, found {self.up}") from error
            up = (x, y, z)
        return {"up": up, "floor_height_m": self.floor_height}


class Stated(TypedDict):
    """What a person says of a recording's world frame; None = as the recording says."""

    up: tuple[float, float, float] | None
    floor_height_m: float | None


@dataclass(frozen=True)
class Networks:
    """How a segmentation network (.onnx) is run and its output read."""

    labels: Path | None = None
    """Class names, one a line or JSON; by default from the network's metadata or a file beside it."""
    providers: str = ""
    """What to run it on, separated by commas, best first: cuda, tensorrt, openvino, coreml, directml, cpu, as far as
    the installed onnxruntime has them. By default the fastest there is; tensorrt, which compiles for minutes, only
    when it is named."""
    threads: int = 0
    """On the CPU; 0: one for each core."""
    input_size: tuple[int, int] | None = None
    """Height and width, for networks that leave them open."""
    score_threshold: float | None = None
    """Least confidence; by default what the network's family uses (YOLO 0.25, mask classifiers 0.5, EoMT 0.8)."""
    mask_threshold: float = 0.5
    """Least probability of a pixel of a mask."""
    overlap_threshold: float = 0.8
    """Mask classifiers: drop what others cover so much that less than this share of its mask is left."""
    box_overlap: float = 0.5
    """YOLO: of two boxes of a class that overlap more than this (IoU), the less confident one goes."""
    panoptic_rule: Literal["auto", "transformers", "original"] = "auto"
    """Mask classifiers: transformers gives every pixel to a mask, original only where the mask says at least
    --mask-threshold. By default what the family uses in transformers."""
    stuff: Literal["auto", "geometry", "none"] = "auto"
    """Floor and walls by height and surface normals where nothing was found; by default for networks that know only
    things."""

    def settings(self) -> "NetworkSettings":
        """Return the settings with which the network is opened, checked."""
        from simaps_viz.segmentation.recognise import NetworkSettings

        return NetworkSettings(
            labels=self.labels, providers=tuple(filter(None, self.providers.split(","))), threads=self.threads,
            input_size=self.input_size, score=self.score_threshold, mask=self.mask_threshold,
            overlap=self.overlap_threshold, iou=self.box_overlap,
            rule=None if self.panoptic_rule == "auto" else self.panoptic_rule,
        )  # fmt: skip


@dataclass(frozen=True)
class Serving:
    """Where the page is served."""

    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    host: str = "127.0.0.1"
    """Address to listen on. One that other machines reach, such as 0.0.0.0, demands a token. Two addresses are printed:
    one for visitors, who look, ask and simulate, one for you. Tokens of your own: SIMAPS_TOKEN, SIMAPS_OWNER_TOKEN; see
    SECURITY.md."""
    allow_edit: bool = False
    """Let all who are let in do what otherwise only the owner's address may: mend, judge, rename and delete files."""
    read_only: bool = False
    """Let nobody change anything, for a talk or a kiosk."""
    browser: bool = True
    """Open the page in the browser."""

    def options(self) -> "dict[str, Any]":
        """Return the options of a function that serves: port, access and browser."""
        from simaps_viz.viewer.server.access import Access

        access = Access(self.host, allow_edit=self.allow_edit, read_only=self.read_only)
        return {"port": self.port, "access": access, "browser": self.browser}
