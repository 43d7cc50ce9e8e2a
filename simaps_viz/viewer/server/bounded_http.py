"""Python's HTTP server with bounds: so many connections, so long for a request to arrive, IPv6 as well."""

import io
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


class BoundedServer(ThreadingHTTPServer):
    """One thread a connection, so many connections at most; the rest is hung up on at once."""

    daemon_threads = True
    request_queue_size = 64

    def __init__(self, host: str, port: int, handler: type[BaseHTTPRequestHandler]) -> None:
        """Listen; raises OSError."""
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
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

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "simaps", ""

    def setup(self) -> None:
        """Read through a deadline."""
        super().setup()
        self.rfile.close()
        self.connection.settimeout(WRITE_S)
        self._incoming = _Incoming(self.connection)
        self.rfile = io.BufferedReader(self._incoming)

    def handle_one_request(self) -> None:
        """Give the next request its time."""
        self._incoming.deadline = time.monotonic() + REQUEST_S
        try:
            super().handle_one_request()
        except (OSError, ValueError):
            self.close_connection = True


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
