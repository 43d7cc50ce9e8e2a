"""An Android phone's page over its own protocol, sent by a simulated phone: the map, malformed frames, who may send."""

import socket
import struct
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest
from fake_phone import color_network, phone_message
from sequences import write_tiny_sequence
from waiting import until
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from simaps_viz import open_sequence
from simaps_viz.app.webxr import HEAD, MAX_MESSAGE, TAKEN_OVER, WebXRSource
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.cli.main import main
from simaps_viz.live import phone as phones
from simaps_viz.live.run import LiveRequest, LiveRun
from simaps_viz.live.source import Traffic
from simaps_viz.viewer.server.access import Access

FRAMES = 9
TOKEN = "A-token_of_0123456789_abcdefghij"


@pytest.fixture
def tiny(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    return open_sequence(tmp_path / "tiny")


@pytest.fixture
def open_source(monkeypatch):
    """Opens sources that are closed in the end; every frame is waited for, however slow the machine is."""
    monkeypatch.setattr(phones, "BEHIND", 1000)
    opened = []

    def open_one(network=None, access=None):
        opened.append(WebXRSource("webxr://0", access or Access(token=""), network=network, traffic=Traffic()))
        return opened[-1]

    yield open_one
    for one in opened:
        one.close()


def dial(source, **how):
    return connect(f"ws://localhost:{source.port}/frames", compression=None, proxy=None, **how)


def grow(source, sent, tmp_path, network=None):
    """Return the map of what the phone sends, and the run."""
    request = LiveRequest(
        source, BuildConfig(), tmp_path / "m.npz", network=network, every_frame=True, traffic=source._traffic
    )
    run, cancel, found = LiveRun(request), threading.Event(), []
    thread = threading.Thread(target=lambda: found.append(run.run((), cancel)))
    thread.start()
    with dial(source) as phone:
        for message in sent:
            phone.send(message)
        # The network may still hold the last one.
        until(lambda: run.traffic.placed >= len(sent) - (network is not None), 300.0)
    cancel.set()
    thread.join()
    return found[0], run


def test_a_phones_frames_make_the_map_of_their_sequence(tiny, open_source, tmp_path):
    network = color_network()
    source = open_source(network)
    sent = [phone_message(tiny.read(i, color=True)) for i in range(FRAMES)]
    simap, run = grow(source, sent, tmp_path, network)
    built = build_map(tiny)
    assert run.traffic.named == FRAMES and simap.counts() == {"chair": 2} and not run.traffic.dropped
    assert simap.provenance["segmentation"] == "colours" and not simap.provenance["simulated"]
    # The floor is found where it is, and the chairs stand where the build has them.
    places = [sorted(one.centroid_m for one in m.instances) for m in (simap, built)]
    assert np.allclose(places[0], places[1], atol=0.03)
    assert np.allclose(simap.T_map_camera[0], built.T_map_camera[0], atol=1e-4)


def test_without_a_network_only_what_is_free_and_what_is_not_is_mapped(tiny, open_source, tmp_path):
    simap, run = grow(open_source(), [phone_message(tiny.read(i), picture=False) for i in range(FRAMES)], tmp_path)
    built = build_map(tiny)
    assert not simap.instances and run.traffic.placed == FRAMES and simap.spec == built.spec
    assert np.allclose(simap.grid.lowest_m, built.grid.lowest_m, atol=1e-3, equal_nan=True)


def test_pictures_of_a_phone_on_its_side_are_stood_upright(tiny, open_source, monkeypatch):
    monkeypatch.setattr(phones, "upright_turns", lambda pose: 1)
    source, frame = open_source(color_network()), tiny.read(0, color=True)
    source.feed(phone_message(frame))
    shot = source.take(1.0)
    turned = frame.turned(1)
    assert shot.frame.color.shape == (64, 48, 3) and shot.frame.intrinsics.width == 48
    assert np.array_equal(shot.frame.color[::2, ::2], turned.color)
    assert np.allclose(shot.frame.depth_m[::2, ::2], turned.depth_m, atol=1e-3)
    assert np.allclose(shot.frame.T_world_camera, turned.T_world_camera, atol=1e-6)


def changed(good, at, kind, *values):
    out = bytearray(good)
    struct.pack_into(kind, out, at, *values)
    return bytes(out)


AMISS = {
    "text": lambda good: "frame",
    "nothing": lambda good: b"",
    "magic": lambda good: b"SMX2" + good[4:],
    "cut short": lambda good: good[:-1],
    "too long": lambda good: good + b"\0",
    "no width": lambda good: changed(good, 4, "<H", 0),
    "enormous": lambda good: changed(good, 4, "<HH", 65535, 65535),
    "a picture of another size": lambda good: changed(good, 8, "<I", 2**32 - 1),
    "no time": lambda good: changed(good, 12, "<d", float("nan")),
    "a time to come": lambda good: changed(good, 12, "<d", 1e300),
    "no unit": lambda good: changed(good, 20, "<f", 0.0),
    "endless unit": lambda good: changed(good, 20, "<f", float("inf")),
    "no camera": lambda good: changed(good, 24, "<f", float("nan")),
    "a camera elsewhere": lambda good: changed(good, 32, "<f", 1e6),
    "nowhere": lambda good: changed(good, 40, "<f", float("inf")),
    "far away": lambda good: changed(good, 40, "<f", 1e9),
    "no rotation": lambda good: changed(good, 52, "<4f", 0.0, 0.0, 0.0, 0.0),
    "no picture": lambda good: good[:-40] + bytes(40),
}


@pytest.mark.parametrize("fault", AMISS)
def test_malformed_frames_are_counted_and_the_next_is_taken(tiny, open_source, fault):
    source, good = open_source(color_network()), phone_message(tiny.read(0, color=True))
    source.feed(AMISS[fault](good))
    source.feed(good)
    assert source.take(1.0) is None and source._traffic.dropped == {"malformed": 1}
    assert ", malformed: webxr://0: expected " in source.words()
    assert source.take(1.0) is not None


def test_a_picture_of_another_shape_is_refused(tiny, open_source):
    frame, source = tiny.read(0, color=True), open_source(color_network())
    good = phone_message(frame)
    picture = phone_message(frame.turned(1))[HEAD.size + 2 * frame.depth_m.size :]
    source.feed(changed(good[: HEAD.size + 2 * frame.depth_m.size], 8, "<I", len(picture)) + picture)
    assert source.take(1.0) is None and "expected a picture like 32x24, found 48x64" in source.words()


def test_messages_without_end_are_not_taken(open_source):
    source = open_source()
    with dial(source) as phone, pytest.raises(ConnectionClosed) as closed:
        phone.send(bytes(MAX_MESSAGE + 1))
        phone.recv(timeout=60.0)
    assert closed.value.rcvd is not None and closed.value.rcvd.code == 1009 and not source._frames


def test_a_map_that_is_too_slow_leaves_out_the_oldest_frames(tiny, open_source, monkeypatch):
    monkeypatch.setattr(phones, "BEHIND", 3)
    source = open_source()
    for i in range(5):
        source.feed(phone_message(tiny.read(0), picture=False, ms=1e9 + i))
    assert source._traffic.dropped == {"the map is too slow": 2}
    assert [source.take(0.0).stamp_ns for _ in range(3)] == [int((1e9 + i) * 1e6) for i in (2, 3, 4)]


def test_the_phone_that_comes_last_is_heard_and_the_other_told(open_source):
    source = open_source()
    assert source.words().startswith("waiting for a phone: adb reverse")
    with dial(source) as first:
        until(lambda: source.words() == "connected")
        with dial(source) as second:
            with pytest.raises(ConnectionClosed) as closed:
                first.recv(timeout=60.0)
            assert closed.value.rcvd is not None and closed.value.rcvd.code == TAKEN_OVER
            second.send(b"x")
            until(lambda: len(source._frames) == 1)
            assert source.words() == "connected"
    until(lambda: source.words().startswith("waiting"))


def get(address, **headers):
    with urllib.request.urlopen(urllib.request.Request(address, headers=headers)) as answer:
        return answer.status, dict(answer.headers), answer.read()


def test_the_page_is_served_and_nothing_else(open_source):
    source = open_source()
    status, headers, body = get(source.entrance)
    assert status == 200 and b"/webxr.js" in body and "script-src 'self'" in headers["Content-Security-Policy"]
    assert b"requestSession" in get(f"{source.entrance}webxr.js")[2]
    for path in ("webxr.html", "../pyproject.toml", "frames"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            get(source.entrance + path)


def test_other_sites_and_whoever_lacks_the_token_send_nothing(open_source, monkeypatch):
    source = open_source()
    for how in ({"origin": "http://evil.example"}, {"additional_headers": {"Sec-Fetch-Site": "cross-site"}}):
        with pytest.raises(InvalidStatus, match="403"), dial(source, **how):
            pass
    with pytest.raises(urllib.error.HTTPError, match="403"):
        get(source.entrance, Host="evil.example")
    monkeypatch.setenv("SIMAPS_OWNER_TOKEN", "owner-" + TOKEN)
    locked = open_source(access=Access(token=TOKEN))
    with pytest.raises(InvalidStatus, match="401"), dial(locked):
        pass
    with (
        pytest.raises(InvalidStatus, match="403"),
        connect(f"ws://localhost:{locked.port}/frames?token={TOKEN}", proxy=None),
    ):
        pass
    # Who opens the address that is printed gets a cookie, which opens the connection.
    cookie = get(locked.entrance)[1]["Set-Cookie"].partition(";")[0]
    with dial(locked, additional_headers={"Cookie": cookie}):
        until(lambda: locked.words() == "connected")


@pytest.mark.parametrize("address", ["webxr://", "webxr://phone", "webxr://99999", "webxr://-1", "webxr://٣"])
def test_addresses_that_are_none_are_refused(address, tmp_path, capsys):
    assert main(["live", address, "-o", str(tmp_path / "m.npz")]) == 2
    assert "expected webxr://PORT" in capsys.readouterr().err


def test_the_command_says_what_to_open_and_refuses_what_phones_do_not_have(tmp_path, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"webxr://{taken.getsockname()[1]}"
        assert main(["live", address, "-o", str(tmp_path / "m.npz")]) == 2
        assert "expected a free port" in capsys.readouterr().err
    for options, words in ((["--list"], "found a phone"), (["--view", "--drive"], "--drive: expected a robot")):
        assert main(["live", "webxr://0", "-o", str(tmp_path / "m.npz"), *options]) == 2
        assert words in capsys.readouterr().err
    assert main(["live", "webxr://0", "-o", str(tmp_path / "m.npz"), "--idle-stop", "0.2"]) == 2
    printed = capsys.readouterr().err
    assert (
        "On the phone: http://localhost:" in printed and "expected frames, found none (waiting for a phone" in printed
    )
