"""An iPhone through record3d's interface, played by a module that follows what it publishes: no iPhone was there."""

import sys
import threading
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from fake_phone import color_network, phone_pose
from sequences import write_tiny_sequence
from waiting import until

from simaps_viz import open_sequence
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.live import phone as phones
from simaps_viz.live.phone import NO_PHONE, NO_STREAM, Record3DSource
from simaps_viz.live.run import LiveRequest, LiveRun
from simaps_viz.live.source import Traffic

FRAMES, LARGER = 9, 3


class FakeStream:
    """A device's stream, as record3d 1.4.1 has it: attributes for callbacks, getters for the newest frame."""

    devices, streams, streaming = [], [], True

    @staticmethod
    def get_connected_devices():
        return list(FakeStream.devices)

    def __init__(self):
        self.on_new_frame: Any = None
        self.on_stream_stopped: Any = None
        self.device_type = 1
        FakeStream.streams.append(self)

    def connect(self, device):
        self.connected = FakeStream.streaming
        return self.connected

    def disconnect(self):
        self.connected = False
        self.on_stream_stopped()

    def show(self, frame, **changed):
        """Make a frame the newest one, and call back from a thread that is not the program's."""
        k = frame.intrinsics
        self.depth, self.confidence = frame.depth_m.copy(), np.full(frame.depth_m.shape, 2, np.uint8)
        self.rgb = cv2.resize(frame.color, None, fx=LARGER, fy=LARGER, interpolation=cv2.INTER_NEAREST)
        # Of the picture, and pixels count from its corner's middle.
        self.k = SimpleNamespace(fx=LARGER * k.fx, fy=LARGER * k.fy, tx=LARGER * (k.cx + 0.5) - 0.5,
                                 ty=LARGER * (k.cy + 0.5) - 0.5)  # fmt: skip
        position, xyzw = phone_pose(frame.T_world_camera)
        names = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
        self.pose = SimpleNamespace(**dict(zip(names, (*position, *xyzw), strict=True)))
        for name, value in changed.items():
            setattr(self, name, value)
        thread = threading.Thread(target=self.on_new_frame)
        thread.start()
        thread.join()

    def get_depth_frame(self):
        return self.depth.copy()

    def get_rgb_frame(self):
        return self.rgb.copy()

    def get_confidence_frame(self):
        return self.confidence.copy()

    def get_intrinsic_mat(self):
        return self.k

    def get_camera_pose(self):
        return self.pose

    def get_device_type(self):
        return self.device_type


@pytest.fixture
def tiny(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    return open_sequence(tmp_path / "tiny")


@pytest.fixture
def plugged(monkeypatch):
    """Plugs in an iPhone that streams; gives what opens sources."""
    monkeypatch.setattr(phones, "RETRY_S", 0.01)
    monkeypatch.setattr(phones, "BEHIND", 1000)
    FakeStream.devices, FakeStream.streams, FakeStream.streaming = [SimpleNamespace(product_id=1, udid="a")], [], True
    monkeypatch.setitem(sys.modules, "record3d", SimpleNamespace(Record3DStream=FakeStream))
    opened = []

    def open_one(network=None):
        opened.append(Record3DSource("record3d://", network=network, traffic=Traffic()))
        return opened[-1]

    yield open_one
    for one in opened:
        one.close()


def stream_of(source):
    until(lambda: source.words() == "connected")
    return FakeStream.streams[-1]


def test_an_iphones_frames_make_the_map_of_their_sequence(tiny, plugged, tmp_path):
    network = color_network()
    source = plugged(network)
    request = LiveRequest(source, BuildConfig(), tmp_path / "m.npz", network=network, every_frame=True)
    run, cancel, found = LiveRun(request), threading.Event(), []
    thread = threading.Thread(target=lambda: found.append(run.run((), cancel)))
    thread.start()
    for i in range(FRAMES):
        stream_of(source).show(tiny.read(i, color=True))
    until(lambda: run.traffic.placed >= FRAMES - 1, 300.0)  # the network may hold the last one
    cancel.set()
    thread.join()
    built = build_map(tiny)
    assert run.traffic.named == FRAMES and found[0].counts() == {"chair": 2}
    places = [sorted(one.centroid_m for one in simap.instances) for simap in (found[0], built)]
    assert np.allclose(places[0], places[1], atol=0.03)


def test_depth_smaller_than_the_picture_lies_where_the_picture_has_it(tiny, plugged):
    source, frame = plugged(color_network()), tiny.read(1, color=True)
    confidence = np.full(frame.depth_m.shape, 2, np.uint8)
    confidence[:5] = 0
    stream_of(source).show(frame, confidence=confidence)
    shot = source.take(60.0)
    middle = slice(LARGER // 2, None, LARGER)
    assert shot.frame.color.shape == (24 * LARGER, 32 * LARGER, 3)
    assert np.array_equal(shot.frame.depth_m[middle, middle][5:], frame.depth_m[5:])
    assert not shot.frame.depth_m[: 5 * LARGER].any()  # the sensor did not trust it
    assert np.array_equal(shot.frame.color[middle, middle], frame.color)
    assert np.allclose(shot.frame.T_world_camera, frame.T_world_camera, atol=1e-6)
    assert shot.segmentation is None
    plain = plugged()
    stream_of(plain).show(frame)
    shot = plain.take(60.0)
    assert shot.frame.color is None and np.array_equal(shot.frame.depth_m, frame.depth_m)
    k, expected = shot.frame.intrinsics, frame.intrinsics
    assert (k.fx, k.cx, k.cy) == pytest.approx((expected.fx, expected.cx, expected.cy))


@pytest.mark.parametrize(
    "changed",
    [
        {"device_type": 0}, {"depth": np.zeros((0, 0), np.float32)}, {"rgb": np.zeros((4, 4), np.uint8)},
        {"k": SimpleNamespace(fx=0.0, fy=1.0, tx=1.0, ty=1.0)},
        {"pose": SimpleNamespace(tx=0.0, ty=np.nan, tz=0.0, qx=0.0, qy=0.0, qz=0.0, qw=1.0)},
        {"pose": SimpleNamespace(tx=0.0, ty=0.0, tz=0.0, qx=0.0, qy=0.0, qz=0.0, qw=0.0)},
        {"depth": None},
    ],
)  # fmt: skip
def test_frames_that_make_no_sense_are_counted(tiny, plugged, changed):
    source = plugged()
    stream_of(source).show(tiny.read(0, color=True), **changed)
    stream_of(source).device_type = 1
    stream_of(source).show(tiny.read(0, color=True))
    shots = [source.take(0.1), source.take(0.1)]
    assert source._traffic.dropped == {"malformed": 1} and sum(shot is not None for shot in shots) == 1


def test_what_the_phone_lacks_is_said_and_a_stream_that_stops_is_found_again(tiny, plugged):
    FakeStream.devices, phone = [], FakeStream.devices
    source = plugged()
    assert source.words() == NO_PHONE
    FakeStream.streaming, FakeStream.devices = False, phone
    until(lambda: source.words() == NO_STREAM)
    FakeStream.streaming = True
    first = stream_of(source)
    FakeStream.streaming = False
    first.on_stream_stopped()
    until(lambda: source.words() == NO_STREAM)
    FakeStream.streaming = True
    second = stream_of(source)
    assert second is not first
    second.show(tiny.read(0, color=True))
    assert source.take(60.0) is not None
    source.close()
    assert not second.connected and source.take(0.0) is None and source.ended


def test_without_the_package_the_line_that_installs_it_is_shown(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "record3d", None)
    assert main(["live", "record3d://", "-o", str(tmp_path / "m.npz")]) == 2
    assert "pip install 'simaps-viz[record3d]'" in capsys.readouterr().err
    with pytest.raises(InputError, match="expected record3d://, as the device is found by itself"):
        Record3DSource("record3d://phone", network=None, traffic=Traffic())


def test_the_package_has_what_is_called():
    stream = pytest.importorskip("record3d").Record3DStream
    called = [name for name in vars(FakeStream) if name.startswith("get_")]
    assert {"connect", "disconnect", "on_new_frame", "on_stream_stopped", *called} <= set(dir(stream))
    assert stream.get_connected_devices() == []
