"""Python's HTTP server with bounds: so many connections, so long for a request to arrive, IPv6 as well.

And stricter: a request that two programs could read as two different ones (request smuggling) is refused, and its
connection closed, so that nothing of it is taken for the next one.
"""

import errno
import io
import re
import socket
import threading
import time
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

MOST_CONNECTIONS, MOST_OF_ADDRESS = 256, 192
REQUEST_S = 10.0
"""How long a request may take to arrive, and a connection may be kept without one."""
WRITE_S = 30.0
"""How long the other side may take none of what is sent."""

MOST_TRIED = 1000
"""Ports that are tried in the place of one that is taken, as viser does."""

_REQUEST_LINE = re.compile(rb"[A-Z]+ [!-~]+ HTTP/1\.[01]\r\n")
_HEADER_LINE = re.compile(rb"[!#$%&'*+.^_`|~0-9A-Za-z-]+:[\t -~\x80-\xff]*\r\n")
"""RFC 9112: no blank before the colon, no line that goes on with the one before it, no bare carriage return."""


def first_free(host: str, port: int) -> int:
    """Return the first port from ``port`` on that can be listened on, 0 for any; ``port`` itself when there is none."""
    for tried in range(port, min(port + MOST_TRIED, 65536)):
        with socket.socket(_family(host)) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host, tried))
            except OSError as error:
                if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                    break
            else:
                return int(probe.getsockname()[1])
    return port


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


class BoundedServer(ThreadingHTTPServer):
    """One thread a connection, so many connections at most; the rest is hung up on at once."""

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, host: str, port: int, handler: type[BaseHTTPRequestHandler]) -> None:
        """Listen; raises OSError."""
        self.address_family = _family(host)
        self._open: Counter[str] = Counter()
        self._counting = threading.Lock()
        super().__init__((host, port), handler)

    def server_bind(self) -> None:
        """Bind without asking the name service who we are."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start the thread of a connection, unless there are too many."""
        peer = str(client_address[0])
        with self._counting:
            welcome = self._open.total() < MOST_CONNECTIONS and self._open[peer] < MOST_OF_ADDRESS
            self._open[peer] += welcome
        if welcome:
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, and count it no longer."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            peer = str(client_address[0])
            with self._counting:
                self._open[peer] -= 1
                if self._open[peer] <= 0:
                    del self._open[peer]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: connections break off."""


class BoundedHandler(BaseHTTPRequestHandler):
    """Hangs up on who sends a request too slowly, however he drips it."""

    protocol_version = default_request_version = "HTTP/1.1"
    server_version, sys_version = "simaps", ""
    raw_requestline: bytes

    def setup(self) -> None:
        """Read through a deadline."""
        super().setup()
        self.rfile.close()
        self.connection.settimeout(WRITE_S)
        self._incoming = _Incoming(self.connection)
        self.rfile = io.BufferedReader(self._incoming)

    def parse_request(self) -> bool:
        """Read the head of a request; refuses one that is not written as the standard has it, or whose body is odd."""
        stream, head = self.rfile, _Head(self.rfile)
        self.rfile = head
        try:
            fine = super().parse_request()
        finally:
            self.rfile = stream
        if not fine:
            return False
        *fields, end = head.lines
        exact = _REQUEST_LINE.fullmatch(self.raw_requestline) and end == b"\r\n"
        if exact and all(map(_HEADER_LINE.fullmatch, fields)) and self._has_one_length():
            return True
        self.send_error(400)
        return False

    def _has_one_length(self) -> bool:
        """Return whether it is certain where the request ends: with its head, or a body of one length after a POST."""
        lengths = self.headers.get_all("Content-Length", [])
        if self.headers.get_all("Transfer-Encoding"):
            return False
        if self.command == "POST":
            return len(lengths) == 1 and re.fullmatch("[0-9]{1,9}", lengths[0]) is not None
        return lengths in ([], ["0"])

    def handle_one_request(self) -> None:
        """Return the next request its time."""
        self._incoming.deadline = time.monotonic() + REQUEST_S
        try:
            super().handle_one_request()
        except (OSError, ValueError):
            self.close_connection = True


class _Head(io.BufferedIOBase):
    """Gives the lines of a request's head, and keeps them as they came."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.lines: list[bytes] = []

    def readline(self, size: int | None = -1, /) -> bytes:
        self.lines.append(self._stream.readline(size))
        return self.lines[-1]


class _Incoming(io.RawIOBase):
    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self.deadline = 0.0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        self._connection.settimeout(max(0.001, self.deadline - time.monotonic()))
        try:
            return self._connection.recv_into(buffer)
        finally:
            self._connection.settimeout(WRITE_S)
