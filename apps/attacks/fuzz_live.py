"""Fuzzing targets: what a robot, or whoever answers at its address, sends to `simaps live`."""

import json
from pathlib import Path
from random import Random
from typing import Any

from attacks.fuzz_cases import Case, Target
from attacks.fuzz_mutators import mutate_bytes, mutate_json
from fake_phone import color_network, phone_message
from fake_robot import TOPICS, Faults, Played
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.app.webxr import read_frame
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.errors import InputError
from simaps_viz.live.links import FoxgloveLink, RobotLink, publisher_of
from simaps_viz.live.phone import PhoneFrame, PhoneSource
from simaps_viz.live.robot import RobotSource
from simaps_viz.live.run import GrowingMap
from simaps_viz.live.source import Traffic
from simaps_viz.live.topics import TopicNames

FRAMES = 6


class _Nowhere(RobotLink):
    """A connection to nobody: messages are handed over by the target."""

    def _run(self) -> None:
        self._state = ""

    def _subscribe(self) -> None:
        pass


def _messages(folder: Path) -> Case:
    """Damage a few of the messages of some frames, and let a map grow from all of them."""
    write_tiny_sequence(folder / "tiny", frames=FRAMES)
    good = [(topic, data) for _, topic, data in Played(open_sequence(folder / "tiny"), Faults()).messages(10**18)]

    def case(r: Random) -> None:
        traffic = Traffic()
        source = RobotSource(_Nowhere("robot"), TopicNames(), color=False, traffic=traffic)
        source._on_topics(dict(TOPICS))
        source._offered_s = 0.0  # no more topics will be announced
        source.take(0.0)
        messages = list(good)
        for _ in range(r.randint(1, 5)):
            at = r.randrange(len(messages))
            topic, data = messages[at]
            messages[at] = (r.choice(list(TOPICS)), data) if r.random() < 0.1 else (topic, mutate_bytes(r, data))
        for topic, data in messages:
            source._on_message(topic, data, r.choice((0, 1, 2**63)))
        growing = GrowingMap(source, BuildConfig())
        for _ in range(FRAMES):
            shot = source.take(0.0)
            if shot is not None:
                growing.add(shot)  # one line where it lies too far away
        source.close()
        if traffic.dropped:
            raise InputError(next(iter(traffic.dropped)))
        growing.finish_waiting()

    return case


def _server(folder: Path) -> Case:
    """Send damaged messages as a server of the Foxglove protocol, and damaged tokens as a node of Zenoh."""
    channels = [{"id": i, "topic": topic, "encoding": "cdr", "schemaName": kind} for i, (topic, kind) in
                enumerate(TOPICS.items())]  # fmt: skip
    said = [
        {"op": "serverInfo", "name": "robot", "capabilities": ["clientPublish"], "supportedEncodings": ["cdr"]},
        {"op": "advertise", "channels": channels}, {"op": "unadvertise", "channelIds": [1, 2]},
    ]  # fmt: skip
    token = "@ros2_lv/0/a1b2/0/10/MP/%/%/cam/%camera%depth/sensor_msgs::msg::dds_::Image_/RIHS01_d3/::,10:,:,:,,"

    def case(r: Random) -> None:
        link, offered = FoxgloveLink("foxglove://127.0.0.1:1"), []
        link._on_topics, link._on_message = offered.append, lambda *message: None
        for one in said:
            text = mutate_json(r, json.dumps(one).encode()).decode(errors="replace")
            link._take(text)
        link._take(mutate_bytes(r, b"\x01" + bytes(20)))
        kinds: dict[Any, Any] = offered[-1] if offered else {}
        if any(not isinstance(part, str) for pair in kinds.items() for part in pair):
            raise TypeError("a topic that is no text")
        try:
            publisher_of(mutate_bytes(r, token.encode()).decode(errors="replace"))
        except ValueError as error:
            raise InputError(str(error)) from error

    return case


class _Phone(PhoneSource):
    """A phone whose messages are handed over by the target."""

    def decode(self, frame: bytes) -> PhoneFrame:
        return read_frame(self.name, frame, color=True)

    def state(self) -> str:
        return "connected"


def _phone(folder: Path) -> Case:
    """Send damaged frames as a phone's page, and let a map grow from those that are taken."""
    write_tiny_sequence(folder / "tiny", frames=FRAMES)
    sequence = open_sequence(folder / "tiny")
    good = [phone_message(sequence.read(i, color=True), picture=i % 2 == 0) for i in range(FRAMES)]

    def case(r: Random) -> None:
        traffic = Traffic()
        source = _Phone("phone", network=color_network(), traffic=traffic)
        growing = GrowingMap(source, BuildConfig())
        for one in good:
            # Most damage is a wrong length, so numbers of the head are also changed in place.
            at = r.randrange(68)
            head = one[:at] + r.randbytes(1) + one[at + 1 :]
            source.feed(r.choice((one, mutate_bytes(r, one), head)))
            if (shot := source.take(0.0)) is not None:
                growing.add(shot)
        if traffic.dropped:
            raise InputError(source.words())
        growing.finish_waiting()

    return case


LIVE_TARGETS = (
    Target("robot messages", _messages, 6), Target("robot server", _server, 30), Target("phone frames", _phone, 6),
)  # fmt: skip
