"""Options that several commands share."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from simaps_viz.build.methods import METHODS, MethodName
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.exports.formats import FormatName
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.votes import VoteSettings

if TYPE_CHECKING:
    from simaps_viz.segmentation.recognise import NetworkSettings

Level = Literal["none", "light", "medium", "heavy"]
"""Of simulated network errors."""


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
        """Return everything but the method's name, checked."""
        projection = ProjectionSettings(cell_size_m=self.cell_size, cut_height_m=self.cut_height, far_m=self.max_depth)
        return BuildConfig(
            k_percent=self.k, affinity=self.affinity, resolution=self.resolution, seed=self.seed,
            min_cells=self.min_cells, literal=self.literal, projection=projection,
            votes=replace(VoteSettings(), enabled=self.votes),
        )  # fmt: skip


@dataclass(frozen=True)
class Networks:
    """How a segmentation network (.onnx) is run and its output read."""

    labels: Path | None = None
    """Class names, one a line or JSON; by default from the network's metadata or a file beside it."""
    providers: str = ""
    """What to run it on, separated by commas, best first: cuda, cpu and what else onnxruntime has. By default the
    fastest there is."""
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
        """Return what the network is opened with."""
        from simaps_viz.segmentation.recognise import NetworkSettings  # noqa: PLC0415 - onnxruntime is slow to import

        return NetworkSettings(
            labels=self.labels, providers=tuple(filter(None, self.providers.split(","))), threads=self.threads,
            input_size=self.input_size, score=self.score_threshold, mask=self.mask_threshold,
            overlap=self.overlap_threshold, iou=self.box_overlap,
            rule=None if self.panoptic_rule == "auto" else self.panoptic_rule,
        )  # fmt: skip


@dataclass(frozen=True)
class Demo:
    """Make the embedded café (rendered, with simulated network errors), map it, and open the workbench.

    Example: simaps demo --errors medium --port 9000
    """

    mapping: Annotated[Mapping, tyro.conf.arg(name="")] = field(default_factory=Mapping)
    errors: Level = "light"
    """Simulated errors of the segmentation network."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    host: str = "127.0.0.1"
    """Address to listen on. One that other machines reach, such as 0.0.0.0, demands a token, which is printed or comes
    from SIMAPS_TOKEN; see SECURITY.md."""
    browser: bool = True
    """Open the page in the browser."""
    serve: bool = True
    """Serve the page; with --no-serve only prepare everything."""
    llm: str | None = None
    """A language model for the page's commands: MODEL[@ADDRESS], see simaps query."""


@dataclass(frozen=True)
class View:
    """Open the workbench on a map, or on a sequence (which is mapped first).

    Example: simaps view cafe.npz --port 9000
    """

    path: tyro.conf.Positional[Path]
    """Map file (.npz), sequence (folder, manifest or another format's file); or a recorded build (.rrd) alone."""
    segmentation: str = "precomputed"
    """Of a sequence: "precomputed", a network (.onnx) or a COCO panoptic table (.json), as for simaps build."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    mapping: Annotated[Mapping, tyro.conf.arg(name="")] = field(default_factory=Mapping)
    recording: Path | None = None
    """Recorded build to dock beside the map; by default the .rrd of the map's name."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    host: str = "127.0.0.1"
    """Address to listen on. One that other machines reach, such as 0.0.0.0, demands a token, which is printed or comes
    from SIMAPS_TOKEN; see SECURITY.md."""
    browser: bool = True
    """Open the page in the browser."""
    edits: bool = True
    """Show the map with the edits made by hand (MAP.edits.json), and let people make more."""
    llm: str | None = None
    """A language model for the page's commands: MODEL[@ADDRESS], see simaps query."""


@dataclass(frozen=True)
class Query:
    """Ask a robot on a map to do something, in English or as a program; nothing is shown, the answer is printed.

    Example: simaps query cafe.npz "go to the third chair" "turn left" --pose 1.5 2 90 --json
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    command: tyro.conf.Positional[tuple[str, ...]]
    """One or more commands, each carried out from the given pose."""
    pose: tuple[float, float, float] | None = None
    """Where the robot stands: x and y in metres, heading in degrees clockwise from north. By default where the first
    camera stood that has free floor by it."""
    llm: str | None = None
    """Let a language model read the commands: MODEL, or MODEL@ADDRESS of a chat-completions server, such as
    qwen2.5:7b@http://127.0.0.1:11434/v1. The key comes from OPENAI_API_KEY. Without it, an offline grammar reads."""
    edits: bool = True
    """Ask the map with the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print one JSON line a command."""


@dataclass(frozen=True)
class Info:
    """Describe what is on a map.

    Example: simaps info cafe.npz
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    edits: bool = True
    """Of the map with the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print it as one JSON line."""


@dataclass(frozen=True)
class Segment:
    """Segment the frames of a sequence with a network, and write the masks as files.

    Example: simaps segment ../scans/breakroom yolo.onnx; simaps build ../scans/breakroom/sequence-yolo.json
    """

    sequence: tyro.conf.Positional[Path]
    """Folder in the posed-frames/1 format, or its manifest (.json); with --format coco also a recording in another
    format."""
    segmentation: tyro.conf.Positional[str]
    """Network (.onnx), COCO panoptic table (.json), or "precomputed" to write the sequence's own masks anew."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Manifest to write (.json), or with --format coco the table; the images go to a folder of its name. By default
    beside the sequence, named after the network."""
    format: Literal["posed-frames", "coco", "coco-ids"] = "posed-frames"
    """coco: panoptic table with coloured PNGs; coco-ids: with plain 16-bit id images."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    json: bool = False
    """Print the outcome as one JSON line."""


@dataclass(frozen=True)
class ExportNetwork:
    """Write a Mask2Former, MaskFormer, OneFormer or EoMT checkpoint of transformers as a network for --segmentation.

    Needs the extra: pip install "simaps-viz[export]".

    Example: simaps export-network ./my-mask2former -o mask2former.onnx
    """

    checkpoint: tyro.conf.Positional[str]
    """Folder written by save_pretrained, or a name on the Hugging Face hub (which is downloaded)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Network to write (.onnx)."""
    size: tuple[int, int] | None = None
    """Height and width of its input; by default what the checkpoint's image processor says."""
    json: bool = False
    """Print the outcome as one JSON line."""


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


@dataclass(frozen=True)
class Judge:
    """Judge runs of a robot by eye: did it do what was asked? They come blind and in random order.

    Example: simaps evaluate demo --task navigation --judge runs.jsonl; simaps judge runs.jsonl demo
    """

    session: tyro.conf.Positional[Path]
    """File of runs and answers, made with simaps evaluate --task navigation --judge FILE."""
    map: tyro.conf.Positional[str]
    """The world they were driven in: sequence folder or manifest with exact ids, "demo" for the embedded café, or a
    map file (.npz) of it."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    host: str = "127.0.0.1"
    """Address to listen on. One that other machines reach, such as 0.0.0.0, demands a token, which is printed or comes
    from SIMAPS_TOKEN; see SECURITY.md."""
    browser: bool = True
    """Open the page in the browser."""


@dataclass(frozen=True)
class Export:
    """Write a map in the formats of other programs: all files of one format, or none.

    Example: simaps export cafe.npz -o cafe.geojson; simaps export cafe.npz -o cafe.tum --trajectory "go to the sofa"
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """File to write; formats of several files use its name. Its ending tells the format where only one fits."""
    format: FormatName | None = None
    """ros: occupancy map (.yaml, .pgm). nav2: the same, a keepout mask and an inflated costmap. geojson, csv: instances
    with their outlines. glb, ply: coloured scene with named instances. coco: panoptic top view (.json, .png).
    graphml: cell graph. spark-dsg: scene graph (.json). tum: trajectory of a command."""
    trajectory: str | None = None
    """tum: the command, or program, to drive in simulation."""
    pose: tuple[float, float, float] | None = None
    """tum: where the robot starts: x and y in metres, heading in degrees clockwise from north. By default where the
    first camera stood that has free floor by it."""
    llm: str | None = None
    """tum: let a language model read the command, as in simaps query."""
    label: Annotated[str | None, tyro.conf.arg(name="class")] = None
    """graphml: the graph of this class only."""
    points: bool = False
    """glb, ply: the recording's points in their own colours, instead of columns; the sequence must still be there."""
    robot_radius: float = 0.2
    """ros, nav2, tum: of the robot, metres."""
    robot_height: float = 1.5
    """ros, nav2, tum: of the robot, metres; what is higher does not block it."""
    edits: bool = True
    """With the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print the format and the files written as one JSON line."""


@dataclass(frozen=True)
class Convert:
    """Write a recording in another format as a sequence folder (posed-frames/1); docs/FORMATS.md lists the formats.

    Example: simaps convert rgbd_dataset_freiburg3_long_office_household -o office --every 5
    """

    source: tyro.conf.Positional[Path]
    """Folder or file of the recording."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder to write; new or empty."""
    every: int = 1
    """Take the first of every so many frames."""
    json: bool = False
    """Print what was written as one JSON line."""


@dataclass(frozen=True)
class Check:
    """Return whether a sequence is usable and, if not, what is wrong with it and what would put it right.

    Neighbouring frames have to see the same surfaces in the same places: tried are inverted poses, other axes, depth
    units, a wrong camera matrix, shifted and dropped frames, up and the floor. Exit status 1 means faults were found.

    Example: simaps check ../scans/breakroom --fix --picture evidence.png
    """

    sequence: tyro.conf.Positional[Path]
    """Folder in the posed-frames/1 format, or its manifest (.json)."""
    fix: bool = False
    """Write the corrected manifest beside the old one, which stays: sequence-fixed.json, with its own poses and
    intrinsics where these change."""
    picture: Path | None = None
    """Draw the evidence (.png): how well each explanation fits, and two frames laid over one another."""
    json: bool = False
    """Print what was found as one JSON line."""
