"""Fuzzing targets whose bytes go into libraries that are not Python: networks, recorded builds, plain HTTP."""

import json
import queue
import socket
from pathlib import Path
from random import Random
from typing import Any

from attacks.fuzz_cases import Case, Target
from attacks.fuzz_mutators import mutate_bytes, mutate_json
from attacks.fuzz_readers import one_file

from simaps_viz.errors import InputError

PATIENCE_S = 20.0
_STREAM_S = 0.05


def _network(folder: Path) -> Case:
    """Damage a network file, which is recognised, and run once where it needs to be."""
    from tiny_networks import write_classifier, write_yolo  # noqa: PLC0415 - as below

    from simaps_viz.segmentation.recognise import NetworkSettings, open_network  # noqa: PLC0415 - slow to load

    files = (write_yolo(folder / "yolo.onnx", [(2, 2, 10, 10, 0, 0.9)]), write_classifier(folder / "masks.onnx"))
    whole = [file.read_bytes() for file in files]

    def case(r: Random) -> object:
        path = folder / "case.onnx"
        path.write_bytes(mutate_bytes(r, r.choice(whole)))
        return open_network(path, NetworkSettings(threads=1, providers=("cpu",)))

    return case


def _recorded(folder: Path) -> Case:
    """Damage a recorded build, whose facts are read."""
    import scans_rerun  # noqa: PLC0415 - rerun is slow to load

    from simaps_viz.recorder.facts import read_facts  # noqa: PLC0415 - as above

    (folder / "sample").mkdir()
    data = scans_rerun.rerun_rrd(folder / "sample").path.read_bytes()
    return one_file(data, "case.rrd", read_facts)(folder)


class _Told:
    """What a page tells the server beside it: everything is taken, some of it answered."""

    def __call__(self, event: dict[str, Any], session: str) -> dict[str, Any] | None:
        return {"tab": session} if event.get("type") == "tab" else None


def _http(folder: Path) -> Case:
    """Requests of bytes on a socket; afterwards, a good one must still be answered."""
    from simaps_viz.viewer.server.front_door import FrontDoor  # noqa: PLC0415 - as above
    from simaps_viz.viewer.server.host import Host  # noqa: PLC0415 - as above

    recording = folder / "a b.rrd"
    recording.write_bytes(bytes(range(200)))
    host = Host(page=lambda urls: "<p>page</p>", assets={"v.js": (b"js()", "text/javascript")}, recordings=[recording],
                on_event=_Told())  # fmt: skip
    door = FrontDoor().start([host])
    broken: queue.SimpleQueue[str] = queue.SimpleQueue()
    door._server.handle_error = lambda request, address: broken.put(_raised())  # type: ignore
    here = f"127.0.0.1:{door.port}"
    body = json.dumps({"type": "tab", "tab": "x"}).encode()
    good = f"GET /rerun/v.js HTTP/1.1\r\nHost: {here}\r\nConnection: close\r\n\r\n".encode()
    requests = (
        good,
        f"GET /recordings/a%20b.rrd HTTP/1.1\r\nHost: {here}\r\nRange: bytes=10-19\r\nOrigin: http://{here}\r\n\r\n".encode(),
        f"POST /rerun/event?session=a HTTP/1.1\r\nHost: {here}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body,
        f"GET /rerun/events?session=a HTTP/1.1\r\nHost: {here}\r\n\r\n".encode(),
        b"GET /recordings/../secret HTTP/1.1\r\nHost: evil.example\r\n\r\n",
    )

    def case(r: Random) -> object:
        data = r.choice(requests)
        if data is requests[2] and r.random() < 0.5:
            changed = mutate_json(r, body)
            data = data.partition(b"Content-Length")[0] + b"Content-Length: %d\r\n\r\n" % len(changed) + changed
        else:
            data = mutate_bytes(r, data)
        status = _status(_asked(door.port, data, _STREAM_S))
        if r.random() < 0.02 and _status(_asked(door.port, good, PATIENCE_S)) != 200:
            raise AssertionError("a good request is not answered any more")
        if not broken.empty():
            raise AssertionError(broken.get())
        if status == 200 or status == 206:
            return status
        if status >= 500 and status not in (501, 505):
            raise AssertionError(f"status {status}")
        raise InputError(f"refused with status {status}")

    return case


def _raised() -> str:
    import traceback  # noqa: PLC0415 - only where something is wrong

    return " ".join(traceback.format_exc().split())[-300:]


def _asked(port: int, data: bytes, patience_s: float) -> bytes:
    """Send bytes, say that no more will come, and return what comes back."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as link:
        try:
            link.sendall(data)
            link.shutdown(socket.SHUT_WR)
            link.settimeout(patience_s if b"/events" in data or patience_s > 1 else 2.0)
            answer = b""
            while len(answer) < 1 << 16:
                part = link.recv(1 << 16)
                if not part:
                    break
                answer += part
        except OSError:
            return answer if "answer" in locals() else b""
    return answer


def _status(answer: bytes) -> int:
    words = answer.split(b" ", 2)
    return int(words[1]) if len(words) > 1 and words[0].startswith(b"HTTP/") and words[1].isdigit() else 0


NATIVE_TARGETS = (
    Target("network file", _network, weight=4),
    Target("recorded build", _recorded, weight=4),
    Target("HTTP requests", _http, weight=10),
)
