"""A workbench on other addresses than 127.0.0.1: its token, its ports, and where its frames are found."""

import socket

import pytest
from browser import free_port, toy_services
from toy_maps import TOY_POSE, toy_map

from simaps_viz.attacking.target import ask, open_socket, page
from simaps_viz.errors import InputError
from simaps_viz.viewer.workbench import Workbench


def opened(tmp_path, host):
    recording = tmp_path / "toy.rrd"
    recording.write_bytes(b"recorded")
    services = toy_services(rerun_page=lambda urls: "<p>no viewer</p>", recordings=(recording,))
    return Workbench(toy_map(), services=services, port=free_port(), host=host, start=TOY_POSE)


def test_open_to_the_network_means_a_token_and_neighbouring_ports(tmp_path, monkeypatch):
    monkeypatch.delenv("SIMAPS_TOKEN", raising=False)
    with opened(tmp_path, "0.0.0.0") as bench:
        first = bench.ports[0]
        assert len(bench.access.token) >= 40
        assert bench.entrance == f"http://127.0.0.1:{first}/?token={bench.access.token}"
        assert bench.ports == [first, first + 1, first + 2]
        for port in bench.ports:
            assert ask(port, "/").status == 401
        reply = ask(first, f"/?token={bench.access.token}")
        assert reply.status == 200 and "Set-Cookie" in reply.head and len(reply.body) < 1000
        cookie = f"{bench.access.cookie}={bench.access.token}"
        assert ask(first, "/", Cookie=cookie).status == 200
        assert ask(bench.ports[2], "/recordings/toy.rrd", Cookie=cookie).body == b"recorded"
        with page(bench) as (_, session):
            assert str(session.recording.url).startswith(f"http://127.0.0.1:{first + 2}/rerun/?session=")
        with open_socket(first, name=socket.gethostname(), additional_headers={"Cookie": cookie}):
            pass


def test_the_frames_have_the_name_the_page_was_asked_by(tmp_path):
    with opened(tmp_path, "127.0.0.1") as bench:
        with page(bench, name="localhost") as (_, session):
            assert str(session.recording.url).startswith(f"http://localhost:{bench.ports[2]}/")
        csp = ask(bench.ports[0], "/", host=f"localhost:{bench.ports[0]}").head
        assert f"frame-src http://localhost:{bench.ports[1]} http://localhost:{bench.ports[2]};" in csp


def test_ipv6_of_this_machine(tmp_path):
    with opened(tmp_path, "::1") as bench:
        assert bench.url == f"http://[::1]:{bench.ports[0]}" and not bench.access.token
        for port, path in zip(bench.ports, ("/", "/tab/", "/rerun/"), strict=True):
            with socket.create_connection(("::1", port), timeout=5) as connection:
                connection.sendall(f"GET {path} HTTP/1.1\r\nHost: [::1]:{port}\r\nConnection: close\r\n\r\n".encode())
                assert connection.recv(20).startswith(b"HTTP/1.1 200")


def test_an_address_of_another_machine_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected an address of this machine"):
        opened(tmp_path, "192.0.2.1")
