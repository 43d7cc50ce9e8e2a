"""`simaps live`: frames come in from a robot, or a sequence at its own pace, and the map grows."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from simaps_viz.cli import NO, OK
from simaps_viz.cli.options import MappingOptions, Networks
from simaps_viz.errors import InputError
from simaps_viz.live.topics import TopicNames

if TYPE_CHECKING:
    from simaps_viz.live.links import RobotLink
    from simaps_viz.live.source import Source, Traffic
    from simaps_viz.recorder.recorder import RerunRecorder
    from simaps_viz.segmentation.protocol import Network
    from simaps_viz.structures import SIMap

LIVE_METHODS = ("evidence", "components")
"""Those whose frames can be placed again."""
PHONES = ("webxr", "record3d")


@dataclass(frozen=True)
class Live:
    """Build a map while frames arrive from a robot, a phone or a recording; Ctrl-C ends it and saves the map.

    Example: simaps live ../scans/breakroom -o breakroom.npz --view
    """

    source: tyro.conf.Positional[str]
    """Where frames come from: foxglove://HOST:PORT, a robot that runs foxglove_bridge; zenoh://HOST:PORT[/DOMAIN], one
    on rmw_zenoh (extra "ros2"); webxr://PORT, an Android phone's browser; record3d://, an iPhone by USB (extra
    "record3d"); or a sequence that simaps build reads, played at its own pace. See docs/ROBOT.md."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Map file to write (.npz)."""
    map: Path | None = None
    """Go on with an earlier map of the same place (.npz): the new one takes its frame once it is known where on it the
    frames are, and says what has moved, gone or come since. Without a sure place it stays a map of its own."""
    mapping: Annotated[MappingOptions, tyro.conf.arg(name="")] = field(default_factory=MappingOptions)
    segmentation: str = "precomputed"
    """Where segments come from: "precomputed" (the source has them) or a network (.onnx), which looks at the newest
    picture whenever it is free; the others show what is free and what is not."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    topics: Annotated[TopicNames, tyro.conf.arg(name="")] = field(default_factory=TopicNames)
    list: bool = False
    """Only list what the robot offers, and what would be used of it."""
    publish: bool = True
    """Send the robot the map (/si_map), its objects and planned paths; --no-publish sends drives' paths only."""
    drive: bool = False
    """Let the page's switch "Drive the real robot" send goals to the robot's Nav2; needs --view."""
    pace: Literal["real", "fast"] = "real"
    """A sequence: its frames come at their own times, or as fast as they can be read, and then none goes without
    masks."""
    idle_stop: float | None = None
    """End when nothing has come for so many seconds; by default it is waited for."""
    record: Path | None = None
    """Also record the map's growth for rerun (.rrd)."""
    view: bool = False
    """Open the page: the map grows in it."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""
    browser: bool = True
    """Open the page in the browser."""
    json: bool = False
    """Print JSON lines on stdout."""

    def run(self) -> int:
        """Let the map grow, and print what is on it."""
        from simaps_viz.app.live import run_source, watch_source
        from simaps_viz.app.workbench import all_counts
        from simaps_viz.console.terminal import note, report
        from simaps_viz.drawing.legend import counted
        from simaps_viz.io.files import check_ending
        from simaps_viz.live.drive import MapPublisher
        from simaps_viz.live.robot import RobotSource
        from simaps_viz.live.run import LiveRequest
        from simaps_viz.live.source import Traffic
        from simaps_viz.mapping.changes import as_json

        if self.list:
            return self._list()
        if self.output is None:
            raise InputError("live: expected a map to write (-o MAP.npz), found none")
        check_ending(self.output, ".npz", "a map's name")
        if self.idle_stop is not None and not 0.0 < self.idle_stop < 1e6:
            raise InputError(f"--idle-stop: expected seconds, more than 0, found {self.idle_stop:g}")
        if self.view and self.json:
            raise InputError("--view: expected a page for people, found --json")
        if self.drive and not (self.view and self._kind and self._kind not in PHONES):
            raise InputError(
                "--drive: expected a robot and --view, where a switch allows it, found one of them missing"
            )
        if self.mapping.method not in LIVE_METHODS:
            raise InputError(f"--method: expected {' or '.join(LIVE_METHODS)}, found {self.mapping.method}")
        config = replace(self.mapping.config(), method=self.mapping.method)
        earlier = self._earlier(config.projection.cell_size_m)
        network = self._network()
        traffic = Traffic()
        source = self._source(network, traffic)
        request = LiveRequest(
            source, config, self.output, idle_stop_s=self.idle_stop, network=network,
            every_frame=self.pace == "fast" and not self._kind, earlier=earlier, traffic=traffic,
        )  # fmt: skip
        with self._recorder() as recorder:
            observers = () if recorder is None else (recorder,)
            if self.publish and isinstance(source, RobotSource):
                observers = (*observers, MapPublisher(source))
            request = replace(request, observers=observers)
            if self.view:
                watch_source(request, port=self.port, browser=self.browser, drive=self.drive)
                return OK
            simap, live = run_source(request, tell=(lambda line: None) if self.json else note)
        record = {"event": "done", "map": str(self.output), "record": str(self.record) if self.record else None,
                  "counts": counted(simap), "instances": len(simap.instances), "shots": live.traffic.placed,
                  "with_masks": live.traffic.named, "dropped": live.traffic.dropped, "moved": live.moved,
                  "notes": live.growing.notes, "earlier": simap.provenance["live"].get("earlier"),
                  "changes": as_json(live.growing.changes())}  # fmt: skip
        lines = [*live.growing.notes, *filter(None, [live.place_words()])]
        lines += [f"{one.label}: {one.words()}" for one in live.growing.changes()]
        lines += [f"{self.output}: {all_counts(simap)}"]
        report(record, *lines, f"Look at it: simaps view {self.output}", json=self.json)
        return OK

    def _earlier(self, cell_size_m: float) -> "SIMap | None":
        """Open the map to go on with."""
        from simaps_viz.mapping.mending import load_mended

        if self.map is None:
            return None
        earlier = load_mended(self.map)
        if earlier.spec.cell_size_m != cell_size_m:
            raise InputError(
                f"{self.map}: expected cells of {cell_size_m:g} m, as the new map has, found "
                f"{earlier.spec.cell_size_m:g} m"
            )
        return earlier

    def _network(self) -> "Network | None":
        from simaps_viz.console.terminal import note
        from simaps_viz.segmentation.recognise import open_network

        if self.segmentation == "precomputed":
            return None
        if not self.segmentation.lower().endswith(".onnx"):
            raise InputError(f'--segmentation {self.segmentation}: expected "precomputed" or a network (.onnx)')
        network, device = open_network(Path(self.segmentation), self.network.settings())
        if not self.json:
            note(f"{network.name}, on {device}")
        return network

    def _source(self, network: "Network | None", traffic: "Traffic") -> "Source":
        """Open the source; nothing has come yet."""
        from simaps_viz.app.webxr import WebXRSource
        from simaps_viz.console.terminal import note
        from simaps_viz.datasets.open import open_sequence
        from simaps_viz.live.phone import Record3DSource
        from simaps_viz.live.robot import RobotSource
        from simaps_viz.live.source import PlayedSequence
        from simaps_viz.viewer.server.access import Access

        if self._kind == "webxr":
            phone = WebXRSource(self.source, Access(), network=network, traffic=traffic)
            if not self.json:
                note(f"On the phone: {phone.entrance}")
            return phone
        if self._kind == "record3d":
            return Record3DSource(self.source, network=network, traffic=traffic)
        if self._kind:
            return RobotSource(self._link(), self.topics, color=network is not None, traffic=traffic)
        sequence = open_sequence(Path(self.source))
        if network is None:
            sequence.segmentation(0)  # raises InputError where there are no masks
        return PlayedSequence(sequence, at_pace=self.pace == "real", network=network)

    @property
    def _kind(self) -> str:
        """The kind of the address; "" for a sequence."""
        kind, found, _ = self.source.partition("://")
        return kind if found else ""

    def _link(self) -> "RobotLink":
        from simaps_viz.live.links import FoxgloveLink, ZenohLink

        kind = {"foxglove": FoxgloveLink, "zenoh": ZenohLink}.get(self._kind)
        if kind is None:
            raise InputError(
                f"{self.source}: expected a sequence, foxglove://HOST:PORT, zenoh://HOST:PORT, webxr://PORT or "
                "record3d://, found an address of another kind"
            )
        return kind(self.source)

    def _list(self) -> int:
        """List a robot's topics and which would be used."""
        from simaps_viz.console.terminal import emit, say
        from simaps_viz.live.robot import topics_of
        from simaps_viz.live.topics import choose_topics

        if not self._kind or self._kind in PHONES:
            found = "a phone" if self._kind else "a sequence"
            raise InputError(f"{self.source}: expected the address of a robot with --list, found {found}")
        offered = topics_of(self._link())
        try:
            chosen = choose_topics(offered, self.topics, color=self.segmentation != "precomputed")
        except InputError as error:
            chosen, unclear = None, str(error)
        else:
            unclear = ""
        used = {} if chosen is None else chosen.uses()
        if self.json:
            emit({"topics": offered, "used": used, "unclear": unclear})
        else:
            width = max(map(len, offered), default=0)
            for topic in sorted(offered):
                say(f"{topic:<{width}}  {offered[topic]}{'  <- ' + used[topic] if topic in used else ''}\n")
            if unclear:
                say(f"{unclear}\n")
        return NO if unclear else OK

    def _recorder(self) -> "AbstractContextManager[RerunRecorder | None]":
        if self.record is None:
            return nullcontext()
        from simaps_viz.recorder.recorder import RerunRecorder
        from simaps_viz.recorder.settings import SMALL

        return RerunRecorder(self.record, settings=SMALL)
