"""A robot over the Foxglove protocol: the map it makes, faults of networks and poses, and malformed messages."""

import importlib
import json
import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driving import COMMAND, SIMAP, START
from fake_page import fake_page
from fake_robot import (
    DEPTH,
    LABELS,
    MASKS,
    T_BASE_OPTICAL,
    TOPICS,
    Faults,
    FoxgloveServer,
    Played,
    Wheels,
    ZenohServer,
    play,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from sequences import write_tiny_sequence
from waiting import until

from simaps_viz import open_sequence
from simaps_viz.app import live as app_live
from simaps_viz.app.live import source_workbench
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.live import drive, robot, run
from simaps_viz.live.drive import MAP, OBJECTS, OUT, Driver, MapPublisher
from simaps_viz.live.links import FoxgloveLink, ZenohLink, dds_name, publisher_of
from simaps_viz.live.robot import RobotSource
from simaps_viz.live.run import LiveRequest, LiveRun
from simaps_viz.live.source import Traffic
from simaps_viz.live.topics import TopicNames, choose_topics
from simaps_viz.viewer.panels.live import LivePanel

FRAMES = 45


@pytest.fixture
def tiny(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    return open_sequence(tmp_path / "tiny")


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """Whatever comes is waited for: how fast the machine is decides nothing."""
    monkeypatch.setattr(robot, "LISTEN_S", 0.0)
    monkeypatch.setattr(run, "CORRECT_S", 0.1)
    monkeypatch.setattr(run, "FRAMES_A_PLACE", FRAMES)  # all of them, as in a build
    monkeypatch.setattr(robot, "WAIT_S", dict.fromkeys(robot.WAIT_S, 60.0))
    monkeypatch.setattr(robot, "BUSY", 1000)
    monkeypatch.setattr(robot, "HELD", 1000)


PROBE = b"?"


class Listener(RobotSource):
    """A source that chooses its topics when all are announced, and knows of which of them it hears."""

    def __init__(self, link, traffic):
        self.heard = set()
        super().__init__(link, TopicNames(), color=False, traffic=traffic)

    def _find_topics(self):
        if set(TOPICS) <= set(self.offered):
            super()._find_topics()

    def _on_message(self, topic, data, sent_ns):
        self.heard.add(topic)
        if data != PROBE:
            super()._on_message(topic, data, sent_ns)


class SDKServer:
    """The server that foxglove_bridge is made of, with the fake robot's topics."""

    def __init__(self):
        foxglove = pytest.importorskip("foxglove")
        capability = importlib.import_module("foxglove.websocket").Capability
        types = robot.message_types()
        self.server = foxglove.start_server(
            name="robot", host="127.0.0.1", port=0, capabilities=[capability.ClientPublish], supported_encodings=["cdr"]
        )
        make = lambda kind: foxglove.Schema(  # noqa: E731
            name=kind, encoding="ros2msg", data=types.generate_msgdef(kind, ros_version=2)[0].encode()
        )
        self.channels = {
            topic: foxglove.Channel(topic, schema=make(kind), message_encoding="cdr") for topic, kind in TOPICS.items()
        }
        self.address = f"foxglove://127.0.0.1:{self.server.port}"
        self.received = []

    def publish(self, topic, data):
        self.channels[topic].log(data, log_time=time.time_ns())

    def close(self):
        for channel in self.channels.values():
            channel.close()
        self.server.stop()


def zenoh_with_nav2():
    return ZenohServer(nav2=True)


def humble_server():
    return ZenohServer(humble=True)


def grow(sequence, server, tmp_path, faults=None, *, rate_hz=30.0):
    """Let a map grow from a fake robot until all has come; return it and its run."""
    link = ZenohLink(server.address) if server.address.startswith("zenoh") else FoxgloveLink(server.address)
    source = Listener(link, traffic := Traffic())
    live = LiveRun(
        LiveRequest(source, BuildConfig(), tmp_path / "r.npz", observers=(MapPublisher(source),), traffic=traffic)
    )
    found, enough = [], threading.Event()
    thread = threading.Thread(target=lambda: found.append(live.run((), enough)))
    thread.start()

    def hears(topic):
        server.publish(topic, PROBE)
        return topic in source.heard

    until(lambda: source.chosen is not None)  # after everything is compiled
    assert source.chosen is not None
    for topic in source.chosen.all:
        until(lambda topic=topic: hears(topic))
    play(Played(sequence, faults or Faults(), rate_hz=rate_hz), server)
    if faults is None:
        until(lambda: traffic.placed + sum(traffic.dropped.values()) >= FRAMES or not thread.is_alive())
    else:
        source.heard.clear()
        until(lambda: hears(DEPTH))  # comes after all that was sent before it
        held: Any = source._assembler and source._assembler._held["depth"]
        until(lambda: not held and source._transforms._since_ns is None)
    enough.set()
    thread.join(300.0)
    source.close()
    server.close()
    return found[0], live


def names(simap):
    return np.array(simap.grid.labels)[simap.grid.label]


def same_objects(one, other):
    """Whether two maps have the same objects, whatever their numbers."""
    pairs = set(zip(one.instance.ravel().tolist(), other.instance.ravel().tolist(), strict=True))
    return len(pairs) == len(np.unique(one.instance)) == len(np.unique(other.instance))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [FoxgloveServer, SDKServer, ZenohServer, humble_server])
def test_a_robot_makes_the_map_of_its_build_and_is_sent_maps_alone(tiny, tmp_path, kind):
    if kind in (ZenohServer, humble_server):
        pytest.importorskip("zenoh")
    server = kind()
    simap, live = grow(tiny, server, tmp_path)
    built = build_map(tiny)
    assert live.traffic.placed >= FRAMES - 1  # the first one may come before its transforms
    assert simap.spec == built.spec and np.array_equal(names(simap), names(built))
    assert np.allclose(simap.grid.height_m, built.grid.height_m, atol=1e-6, equal_nan=True)
    assert same_objects(simap, built) and simap.counts() == {"chair": 2}
    assert simap.provenance["segmentation"] == f"masks of {MASKS}"
    if kind is SDKServer:  # keeps nothing of what it is sent
        return
    assert {topic for topic, _ in server.received} == {MAP, OBJECTS}
    grid = robot.message_types().deserialize_cdr(dict(server.received)[MAP], OUT[MAP])
    assert (grid.info.height, grid.info.width) == simap.spec.shape and grid.header.frame_id == "map"


@pytest.mark.parametrize("allowed", [False, True])
def test_the_page_has_the_switch_that_is_off_and_works_only_with_the_option(tmp_path, allowed):
    request = LiveRequest(source_of_nothing(), BuildConfig(), tmp_path / "r.npz")
    with source_workbench(request, drive=allowed) as (bench, _, _), fake_page(bench) as page:
        switch = page.session.panels[LivePanel].drive_switch
        assert switch.value is False and switch.disabled is not allowed


@pytest.mark.slow
@pytest.mark.parametrize("kind", [FoxgloveServer, zenoh_with_nav2])
def test_the_simulated_robot_drives_and_the_page_shows_its_arrival(tiny, tmp_path, kind, monkeypatch):
    if kind is zenoh_with_nav2:
        pytest.importorskip("zenoh")
    drivers: list[Any] = []
    monkeypatch.setattr(app_live, "Driver", lambda *args, **how: drivers.append(Driver(*args, **how)) or drivers[-1])
    server, played, stop = kind(), Played(tiny, Faults()), threading.Event()
    wheels, base = Wheels(played, server), np.eye(4)
    base[:2, 3] = START[:2]
    played.camera = lambda at_s: base @ T_BASE_OPTICAL  # type: ignore[method-assign]
    link = ZenohLink(server.address) if isinstance(server, ZenohServer) else FoxgloveLink(server.address)
    source = Listener(link, traffic := Traffic())
    mover = threading.Thread(target=wheels.drive, args=(0.0, stop), kwargs={"mps": 10.0})
    mover.start()
    request = LiveRequest(source, BuildConfig(), tmp_path / "r.npz", traffic=traffic)
    with source_workbench(request, drive=True) as (bench, build, _), fake_page(bench) as page:
        build.start()
        bench.publish(SIMAP)
        (driver,) = drivers
        until(lambda: (robot := source.robot()) is not None and robot[2] < drive.FRESH_S)
        if isinstance(server, ZenohServer):
            until(lambda: driver._nav2.is_there)
        driver.switch(True)
        driver.go(COMMAND)
        shown: Any = page.session.panels[LivePanel]._driving
        until(lambda: "Arrived." in shown.content)
    stop.set()
    mover.join()
    server.close()
    end = START[2].final_pose
    assert len(wheels.times_ns) > 1 and wheels.goal_m is None
    at = source.robot()
    assert at is not None and np.linalg.norm(at[1][:2, 3] - (end.x_m, end.y_m)) < drive.ARRIVED_M
    if isinstance(server, ZenohServer):
        assert server.nav2 is not None and server.nav2.faults == server.nav2.cancels == []
        assert len(server.nav2.asked) == len(set(server.nav2.asked)) == len(wheels.times_ns)


@pytest.mark.slow
def test_drops_restarts_and_late_transforms_cost_frames_and_no_objects(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(robot, "WAIT_S", dict.fromkeys(robot.WAIT_S, 2.0))  # some of it never comes
    faults = Faults(drop=0.1, restart_s=2.0, tf_late_s=0.2)
    simap, live = grow(tiny, FoxgloveServer(), tmp_path, faults, rate_hz=12.0)
    assert simap.counts() == {"chair": 2} and 10 < live.traffic.placed < FRAMES


@pytest.mark.slow
def test_drift_that_is_corrected_moves_the_frames_back(tiny, tmp_path):
    simap, live = grow(tiny, FoxgloveServer(), tmp_path, Faults(drift_m=0.4, correct_s=1.0), rate_hz=15.0)
    built = build_map(tiny)
    assert live.moved > 10
    true = {name: pose for name, pose in zip(range(FRAMES), built.T_map_camera, strict=True)}
    times = np.array([float(name) for name in simap.frame_names])
    at = np.rint((times - times[-1]) * 15.0).astype(int) + FRAMES - 1
    off_m = [np.linalg.norm(T[:3, 3] - true[i][:3, 3]) for i, T in zip(at, simap.T_map_camera, strict=True)]
    assert max(off_m) < 0.02


def source_of_nothing():
    """A source with its topics chosen, and no robot."""

    class NoLink:
        address, state = "foxglove://nowhere", ""

        def open(self, *calls):
            pass

        def subscribe(self, topics):
            pass

        def listen(self, topic, take):
            pass

        def advertise(self, topic, kind):
            pass

        def close(self):
            pass

    link: Any = NoLink()
    source = RobotSource(link, TopicNames(), color=False, traffic=Traffic())
    source._on_topics(dict(TOPICS))
    source._offered_s = 0.0
    source.take(0.0)
    assert source.chosen is not None
    return source


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiny")
    write_tiny_sequence(folder / "tiny", frames=4)
    return list(Played(open_sequence(folder / "tiny"), Faults()).messages(10**18))


def feed(source, messages):
    for _, topic, data in messages:
        source._on_message(topic, data, 1)
    shots = []
    while (shot := source.take(0.0)) is not None or source._assembler._held["depth"]:
        if shot is None:
            break
        shots.append(shot)
    return shots


def test_what_is_not_malformed_is_all_taken(recorded):
    source = source_of_nothing()
    assert len(feed(source, recorded)) >= 3 and not source._traffic.dropped


@pytest.mark.slow
@settings(max_examples=50, deadline=None)
@given(st.data())
def test_malformed_messages_are_counted_and_nothing_else_happens(recorded, data):
    source, messages = source_of_nothing(), list(recorded)
    for _ in range(data.draw(st.integers(1, 4))):
        i = data.draw(st.integers(0, len(messages) - 1))
        due, topic, body = messages[i]
        kind = data.draw(st.sampled_from(["cut", "flip", "noise", "other"]))
        if kind == "cut":
            body = body[: data.draw(st.integers(0, len(body)))]
        elif kind == "flip":
            at = data.draw(st.integers(0, min(max(len(body) - 1, 0), 200)))  # a cut may have left nothing
            body = body[:at] + bytes([data.draw(st.integers(0, 255))]) + body[at + 1 :]
        elif kind == "noise":
            body = data.draw(st.binary(max_size=200))
        else:
            topic = data.draw(st.sampled_from(sorted(TOPICS)))
        messages[i] = due, topic, body
    for shot in feed(source, messages):
        assert np.isfinite(shot.frame.T_world_camera).all() and shot.frame.depth_m.dtype == np.float32


LABELS_AMISS = (
    "[1]", '{"0": {"label": "a"}}', '{"1": {"label": ""}}', '{"1": {"label": "a", "score": 7}}',
    '{"x": {"label": "a"}}', '{"1": {}}', "{" * 5000, '{"1": {"label": "none"}}',
)  # fmt: skip


@pytest.mark.parametrize("text", LABELS_AMISS)
def test_tables_of_labels_that_make_no_sense_are_refused(text):
    source, types = source_of_nothing(), robot.message_types()
    kind = "std_msgs/msg/String"
    source._on_message(LABELS, bytes(types.serialize_cdr(types.types[kind](text), kind)), 1)
    assert source._labels == {} and sum(source._traffic.dropped.values()) == 1


SAID_AMISS = (
    "{", "[]", '{"op": 3}', '{"op": "advertise"}', '{"op": "advertise", "channels": [{"id": "a"}]}',
    '{"op": "unadvertise", "channelIds": 5}', "[" * 9000,
    '{"op": "unadvertise", "channelIds": [1e999]}',
    '{"op": "advertise", "channels": [{"id": 1e999, "topic": "/a", "schemaName": "b", "encoding": "cdr"}]}',
)  # fmt: skip


@pytest.mark.parametrize("text", SAID_AMISS)
def test_what_a_server_says_amiss_is_ignored(text):
    link = FoxgloveLink("foxglove://127.0.0.1:1")
    link._channels, link._topic_of, link._on_topics = {}, {}, lambda offered: None
    link._take(text)
    link._take(b"")
    link._take(b"\x01\x02")
    assert link._channels == {}


def test_pictures_pair_by_their_stamps_and_not_by_their_order():
    class Poses:
        def pose(self, frame, stamp_ns):
            return "pose"

        def forget(self):
            pass

    poses: Any = Poses()
    one: Any = robot.Assembler(("masks",), poses, Traffic())
    ms = 10**6
    for stamp in (0, 33, 66, 100):
        one.add("depth", robot.Message(stamp * ms, None, 0))
    one.add("masks", robot.Message(33 * ms, None, 0))
    first, second = one.take(), one.take()
    assert first.masks is None and second.depth.stamp_ns == second.masks.stamp_ns == 33 * ms
    assert one.take() is None  # may still come
    one.add("masks", robot.Message(105 * ms, None, 0))
    assert one.take().masks is None and one.take().masks.stamp_ns == 105 * ms
    one.add("depth", robot.Message(200 * ms, None, 0))
    one.add("masks", robot.Message(185 * ms, None, 0))
    assert one.take() is None  # near, but a nearer one may come
    one.add("masks", robot.Message(200 * ms, None, 0))
    assert one.take().masks.stamp_ns == 200 * ms


OFFER = {
    "/cam/color/image_raw": "sensor_msgs/msg/Image",
    "/cam/color/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "/cam/depth/image_raw": "sensor_msgs/msg/Image", "/cam/aligned_depth_to_color/image_raw": "sensor_msgs/msg/Image",
    "/cam/color/camera_info": "sensor_msgs/msg/CameraInfo",
    "/cam/depth/camera_info": "sensor_msgs/msg/CameraInfo",
    "/cam/aligned_depth_to_color/camera_info": "sensor_msgs/msg/CameraInfo",
    "/tf": "tf2_msgs/msg/TFMessage", "/tf_static": "tf2_msgs/msg/TFMessage", "/odom": "nav_msgs/msg/Odometry",
}  # fmt: skip


def test_topics_are_found_by_type_and_name_and_what_is_unclear_is_asked():
    chosen = choose_topics(OFFER, TopicNames(), color=True)
    assert chosen.depth == "/cam/aligned_depth_to_color/image_raw" and chosen.masks == ""
    assert chosen.info == "/cam/aligned_depth_to_color/camera_info" and chosen.poses == ("/tf", "/tf_static")
    assert chosen.color == "/cam/color/image_raw/compressed"
    second = OFFER | {"/rear/aligned_depth_to_color/image_raw": "sensor_msgs/msg/Image"}
    with pytest.raises(InputError, match=r"--depth-topic: expected one topic, found /cam.*, /rear"):
        choose_topics(second, TopicNames(), color=False)
    assert (
        choose_topics(second, TopicNames(depth_topic="/cam/depth/image_raw"), color=False).depth
        == "/cam/depth/image_raw"
    )
    with pytest.raises(InputError, match="--masks-topic /m: expected a topic of the robot"):
        choose_topics(OFFER, TopicNames(masks_topic="/m"), color=False)
    no_tf = {t: kind for t, kind in OFFER.items() if not t.startswith("/tf")}
    assert choose_topics(no_tf, TopicNames(), color=False).poses == ("/odom",)


def test_publishers_of_zenoh_are_told_by_their_tokens():
    token = "@ros2_lv/0/a1b2/0/10/MP/%/%/cam/%camera%depth/sensor_msgs::msg::dds_::Image_/RIHS01_d3/::,10:,:,:,,"
    assert publisher_of(token) == ("/camera/depth", "sensor_msgs/msg/Image")
    assert dds_name("sensor_msgs/msg/Image") in token
    for other in ("", "@ros2_lv/0/a1b2/0/0/NN/%/%/cam", token.replace("/MP/", "/MS/"), token.replace("dds_", "x")):
        with pytest.raises(ValueError, match="no "):
            publisher_of(other)
    types = robot.message_types()
    known = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
    assert types.hash_rihs01("sensor_msgs/msg/Image") == known


@pytest.mark.slow
@pytest.mark.parametrize("kind", [FoxgloveServer, ZenohServer])
def test_the_list_of_what_a_robot_offers(capsys, kind, monkeypatch):
    if kind is ZenohServer:
        pytest.importorskip("zenoh")
    opens, now, announced = robot.RobotLink.open, [0.0], threading.Event()

    def open_and_watch(link, on_topics, on_message):
        def told(offered):
            on_topics(offered)
            if set(TOPICS) <= set(offered):
                announced.set()

        opens(link, told, on_message)

    def clock():
        now[0] += 0.1 * announced.is_set()  # stands still until all are announced, however long that takes
        return now[0]

    monkeypatch.setattr(robot.RobotLink, "open", open_and_watch)
    monkeypatch.setattr(robot, "time", SimpleNamespace(monotonic=clock, sleep=time.sleep))
    monkeypatch.setattr(robot, "LISTEN_S", 0.5)
    server = kind()
    assert main(["live", server.address, "--list", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["topics"] == TOPICS and found["used"][DEPTH] == "depth" and found["used"][MASKS] == "masks"
    server.close()
    assert main(["live", "foxglove://", "--list"]) == 2
