"""A workbench on other addresses than 127.0.0.1: its token, its ports, and where its frames are found."""

import socket
import time

import pytest
from attacks.target import ask, enter, open_socket, page, send_raw, wait
from browser import free_port, toy_services
from toy_maps import TOY_POSE, toy_map

from simaps_viz.app import workbench
from simaps_viz.console.terminal import console
from simaps_viz.errors import InputError
from simaps_viz.viewer.server.access import Access
from simaps_viz.viewer.workbench import Workbench

pytestmark = pytest.mark.slow


def opened(tmp_path, host):
    recording = tmp_path / "toy.rrd"
    recording.write_bytes(b"recorded")
    services = toy_services(rerun_page=lambda urls: "<p>no viewer</p>", recordings=(recording,))
    return Workbench(toy_map(), services=services, port=free_port(), access=Access(host), start=TOY_POSE)


def test_open_to_the_network_means_a_token_and_neighbouring_ports(tmp_path, monkeypatch):
    monkeypatch.delenv("SIMAPS_TOKEN", raising=False)
    with opened(tmp_path, "0.0.0.0") as bench:
        first = bench.port
        assert len(bench.access.token) >= 40
        assert bench.entrance == f"http://127.0.0.1:{first}/?token={bench.access.token}"
        for path in ("/", "/tab/", "/rerun/", "/recordings/toy.rrd"):
            assert ask(first, path).status == 401
        reply = ask(first, f"/?token={bench.access.token}")
        assert reply.status == 200 and "Set-Cookie" in reply.head and len(reply.body) < 1000
        cookie = enter(bench)
        assert ask(first, "/", Cookie=cookie).status == 200
        assert ask(first, "/recordings/toy.rrd", Cookie=cookie).body == b"recorded"
        with page(bench) as (_, session):
            assert str(session.recording.url).startswith("/rerun/?session=")
        with open_socket(first, name=socket.gethostname(), additional_headers={"Cookie": cookie}):
            pass


def test_the_page_names_no_other_server(tmp_path):
    with opened(tmp_path, "127.0.0.1") as bench:
        with page(bench, name="localhost") as (_, session):
            assert str(session.recording.url).startswith("/rerun/?session=")
        reply = ask(bench.port, "/", host=f"localhost:{bench.port}")
        assert "frame-src 'self';" in reply.head and f" ws://localhost:{bench.port} " in reply.head
        assert str(bench.server.get_port()) not in reply.head


def test_ipv6_of_this_machine(tmp_path):
    with opened(tmp_path, "::1") as bench:
        assert bench.url == f"http://[::1]:{bench.port}" and not bench.access.token
        port = bench.port
        for path in ("/", "/tab/", "/rerun/"):
            with socket.create_connection(("::1", port), timeout=60) as connection:
                connection.sendall(f"GET {path} HTTP/1.1\r\nHost: [::1]:{port}\r\nConnection: close\r\n\r\n".encode())
                assert connection.recv(20).startswith(b"HTTP/1.1 200")


def test_an_address_of_another_machine_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected an address of this machine"):
        opened(tmp_path, "192.0.2.1")


def test_a_taken_port_is_gone_around_and_reported(tmp_path):
    with opened(tmp_path, "127.0.0.1") as bench:
        assert told(bench) == f"Workbench: http://127.0.0.1:{bench.port}  (Ctrl-C to stop)\n"
        with Workbench(toy_map(), services=toy_services(), port=bench.port, start=TOY_POSE) as second:
            assert second.port > bench.port and told(second).startswith(f"Workbench: {second.url} ")
            assert ask(second.port, "/tab/").status == 200
    with Workbench(toy_map(), services=toy_services(), port=0, start=TOY_POSE) as anywhere:
        assert anywhere.port > 0


def told(bench):
    with console.capture() as capture:
        workbench.tell_where(bench)
    return capture.get()


def test_methods_that_are_none_of_ours_are_answered(tmp_path):
    with opened(tmp_path, "127.0.0.1") as bench:
        first = bench.port
        for method in ("HEAD", "POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "TRACE", "PATCH", "PROPFIND"):
            reply = ask(first, "/<evil>", method=method, body=b"x" * (100_000 if method == "POST" else 0))
            assert reply.status == 405 and reply.body == b"", method
            assert "Allow: GET" in reply.head.splitlines() and "evil" not in reply.head
            assert "nosniff" in reply.head and "frame-ancestors 'none'" in reply.head
        assert bench.door.refused["a request that is no GET"] == 9
        for request in (b"get / HTTP/1.1", b"A" * 17 + b" /", b"<a> /", b"POST", b""):
            assert send_raw(first, request + b"\r\n\r\n", finish=True).status in (0, 400)
        with socket.create_connection(("127.0.0.1", first), timeout=60) as slow:
            for part in ("G", "E", "T", " ", f"/ HTTP/1.1\r\nHost: 127.0.0.1:{first}\r\n\r\n"):
                slow.sendall(part.encode())
                time.sleep(0.1)
            assert slow.recv(20).startswith(b"HTTP/1.1 200")
        assert ask(first, "/").status == 200 and wait(lambda: bench.door.connections == 0)
