"""The small server beside the page."""

import http.client
import json
import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simaps_viz.errors import InputError
from simaps_viz.viewer.server.front_door import FrontDoor
from simaps_viz.viewer.server.host import Host, parse_range


@pytest.fixture
def served(tmp_path):
    recording, secret = tmp_path / "a b.rrd", tmp_path / "secret.txt"
    recording.write_bytes(bytes(range(200)))
    secret.write_text("secret")
    events, addresses = [], []
    host = Host(
        page=lambda urls: addresses.extend(urls) or "<p>page</p>",
        assets={"v.js": (b"js()", "text/javascript"), "v.wasm": (recording, "application/wasm")},
        recordings=[recording],
        on_event=lambda event, _session: events.append(event),
    )
    door = FrontDoor().start([host])
    vars(host)["port"] = door.port
    yield host, events, addresses
    door.close()


def ask(host, path, *, method="GET", body=None, headers=None):
    connection = http.client.HTTPConnection("127.0.0.1", host.port, timeout=60)
    connection.request(method, path, body=body, headers=headers or {})
    response = connection.getresponse()
    content = response.read()
    connection.close()
    return response.status, content, response.headers


def test_serves_what_it_was_given_and_nothing_else(served):
    host, _, addresses = served
    assert addresses == ["/recordings/a%20b.rrd"]
    status, body, headers = ask(host, "/rerun/?x=1")
    assert (status, body) == (200, b"<p>page</p>")
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert ask(host, "/rerun/v.js")[1] == b"js()"
    assert ask(host, "/rerun/v.wasm")[2]["Content-Type"] == "application/wasm"
    assert ask(host, "/recordings/a%20b.rrd")[1] == bytes(range(200))
    for path in ("/no", "/recordings/secret.txt", "/recordings/../secret.txt", "/rerun/a%20b.rrd", "/recordings/"):
        assert ask(host, path)[0] == 404


def test_its_address_alone_leads_to_the_page(served):
    for path in ("/", "/?any=thing"):
        status, body, headers = ask(served[0], path)
        assert (status, headers["Location"], body) == (302, "/rerun/", b"")


def test_serves_parts(served):
    host, _, _ = served
    status, body, headers = ask(host, "/recordings/a%20b.rrd", headers={"Range": "bytes=10-19"})
    assert (status, body, headers["Content-Range"]) == (206, bytes(range(10, 20)), "bytes 10-19/200")
    assert ask(host, "/recordings/a%20b.rrd", headers={"Range": "bytes=-5"})[1] == bytes(range(195, 200))
    assert ask(host, "/recordings/a%20b.rrd", headers={"Range": "bytes=200-"})[0] == 416


@given(st.integers(1, 500), st.integers(0, 600), st.integers(0, 600))
def test_ranges_lie_inside_the_file(size, first, last):
    try:
        found = parse_range(f"bytes={first}-{last}", size)
    except ValueError:
        assert first >= size or last < first
    else:
        assert found == (first, min(last, size - 1))
    assert parse_range("", size) is None


def test_refuses_other_names_and_other_sites(served):
    host, events, _ = served
    assert ask(host, "/rerun/", headers={"Host": "evil.example"})[0] == 403
    event = json.dumps({"type": "time_update"})
    assert ask(host, "/rerun/event", method="POST", body=event, headers={"Origin": "http://evil.example"})[0] == 403
    assert events == []
    assert ask(host, "/rerun/", headers={"Host": f"localhost:{host.port}"})[0] == 200


def test_takes_events_and_refuses_nonsense(served):
    host, events, _ = served
    assert ask(host, "/rerun/event", method="POST", body='{"type": "time_update", "time": 3}')[0] == 200
    assert events == [{"type": "time_update", "time": 3}]
    assert ask(host, "/rerun/event", method="POST", body="{")[0] == 400
    assert ask(host, "/rerun/event", method="POST", body="x" * 70_000)[0] == 400
    assert ask(host, "/other", method="POST", body="{}")[0] == 405
    assert len(events) == 1


def test_an_event_that_fails_does_not_end_the_server(served):
    host, _, _ = served
    host.on_event = lambda event, session: 1 // 0
    assert ask(host, "/rerun/event", method="POST", body="{}")[0] == 200
    assert ask(host, "/rerun/")[0] == 200


def test_pushes_to_those_who_listen(served):
    host, _, _ = served
    connection = http.client.HTTPConnection("127.0.0.1", host.port, timeout=60)
    heard = []
    host.on_listen = heard.append
    connection.request("GET", "/rerun/events?session=a%20b")
    response = connection.getresponse()
    assert response.headers["Content-Type"] == "text/event-stream"
    host.push({"set_time": {"timeline": "frame", "time": 3}}, "another")
    host.push({"set_time": {"timeline": "frame", "time": 4}}, "a b")
    assert response.fp.readline() == b'data: {"set_time": {"timeline": "frame", "time": 4}}\n'
    assert response.fp.readline() == b"\n"
    host.push({"all": True})
    assert response.fp.readline() == b'data: {"all": true}\n'
    assert heard == ["a b"]
    host.push(None, "a b")
    assert response.read() == b"\n"
    connection.close()


def test_names_a_missing_recording_and_a_taken_port(served, tmp_path):
    host, _, _ = served
    with pytest.raises(InputError, match=r"none\.rrd: expected a recording"):
        Host(page=lambda _: "", assets={}, recordings=[tmp_path / "none.rrd"])
    with pytest.raises(InputError, match=f"port {host.port}: expected a free one"):
        FrontDoor(port=host.port, tried=1)
    door = FrontDoor(port=host.port)
    assert door.port > host.port
    door.close()


def test_frees_its_port():
    first = FrontDoor()
    first.close()
    second = FrontDoor(port=first.port, tried=1).start([])
    second.close()
    FrontDoor(port=first.port, tried=1).close()


def connect(host):
    connection = socket.create_connection(("127.0.0.1", host.port), timeout=60)
    return connection, connection.makefile("rb")


def everything(host, request):
    """Send bytes, and give all that is answered until the server hangs up."""
    connection, reading = connect(host)
    with connection, reading:
        connection.sendall(request)
        return reading.read()


def test_what_follows_a_refused_request_is_not_read_as_another(served):
    host, events, _ = served
    head = f"Host: 127.0.0.1:{host.port}\r\n".encode()
    inner = b"GET /rerun/ HTTP/1.1\r\n" + head + b"\r\n"
    length = b"Content-Length: %d\r\n" % len(inner)
    for odd in (length, length + b"Transfer-Encoding: chunked\r\n", b"Transfer-Encoding: chunked\r\n",
                b"Origin : http://evil.example\r\n", b"X: 1\r\n folded\r\n", b"X: 1\nY: 2\r\n",
                b"X: 1\rY: 2\r\n"):  # fmt: skip
        answer = everything(host, b"GET /rerun/ HTTP/1.1\r\n" + head + odd + b"\r\n" + inner)
        assert answer.startswith(b"HTTP/1.1 400 ") and answer.count(b"HTTP/1.1 ") == 1, odd
        assert b"Connection: close" in answer and b"<p>page</p>" not in answer
    for line in (b"GET /rerun/ HTTP/1.1\n", b"GET  /rerun/ HTTP/1.1\r\n", b"GET\t/rerun/ HTTP/1.1\r\n",
                 b"GET /rerun/ HTTP/1.1\r\r\n", b" GET /rerun/ HTTP/1.1\r\n", b"GET /rerun/\x85HTTP/1.1\r\n",
                 b"GET /rerun/\r\n"):  # fmt: skip
        answer = everything(host, line + head + b"\r\n" + inner)
        assert answer.startswith(b"HTTP/1.1 400 ") and answer.count(b"HTTP/1.1 ") == 1, line
    for odd in (b"Content-Length: 2\r\nContent-Length: 2\r\n", b"Content-Length: 2\r\nTransfer-Encoding: chunked\r\n",
                b"Content-Length: +2\r\n", b"Content-Length : 2\r\n", b"\r\n"):  # fmt: skip
        answer = everything(host, b"POST /rerun/event HTTP/1.1\r\n" + head + odd + b"\r\n{}" + inner)
        assert answer.startswith(b"HTTP/1.1 400 ") and answer.count(b"HTTP/1.1 ") == 1, odd
    assert events == []


def test_honest_requests_share_a_connection(served):
    host, events, _ = served
    head = f"Host: 127.0.0.1:{host.port}\r\n".encode()
    get = b"GET /rerun/ HTTP/1.1\r\nAccept-Language: d\xe9, en;q=0.5\r\nX:\r\nContent-Length: 0\r\n" + head + b"\r\n"
    post = b"POST /rerun/event HTTP/1.1\r\n" + head + b'Content-Length: 11\r\n\r\n{"type": 1}'
    last = get.replace(b"X:", b"Connection: close\r\nX:")
    answer = everything(host, get + post + get + last)
    assert answer.count(b"HTTP/1.1 200 OK") == 4 and answer.count(b"<p>page</p>") == 3
    assert events == [{"type": 1}]


def test_the_log_has_the_status_and_no_query(served, caplog):
    host, _, _ = served
    caplog.set_level("DEBUG", "simaps_viz")
    ask(host, "/rerun/?session=secret")
    ask(host, "/other?session=secret")
    said = [record.getMessage() for record in caplog.records]
    assert said == ['"GET /rerun/?… HTTP/1.1" 200 -', '"GET /other?… HTTP/1.1" 404 -']
