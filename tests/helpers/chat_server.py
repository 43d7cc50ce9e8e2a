"""A chat-completions server on 127.0.0.1 that answers as it is told to, also badly, and keeps what it was sent."""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from simaps_viz.language.llm import LLMReader
from simaps_viz.language.llm_settings import LLMError, LLMServerError, LLMSettings

KEY = "sk-test-5ecret-0123456789"
COUNTS = {"chair": 3, "dining table": 2, "couch": 1, "potted plant": 1}
GOOD = 'robot.move_to_object("couch")'


@dataclass(frozen=True)
class Received:
    """One request, as it arrived."""

    path: str
    headers: dict[str, str]
    """Names in lower case."""
    text: str
    """The body."""

    @property
    def body(self) -> dict[str, Any]:
        return json.loads(self.text)

    @property
    def structured(self) -> bool:
        return "response_format" in self.body

    @property
    def contents(self) -> list[str]:
        return [message["content"] for message in self.body["messages"]]


class ChatServer:
    """Sends its replies one after the other, the last one for ever."""

    def __init__(self, *replies: "Reply") -> None:
        self.replies = list(replies)
        self.received: list[Received] = []
        self.closing = threading.Event()
        self.arrived = threading.Event()
        """A request has come."""
        self.left = threading.Event()
        """A client closed its connection before it had an answer."""
        self._http = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (_Handler,), {"chat": self}))
        self._http.daemon_threads = True
        self._lock = threading.Lock()

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self._http.server_port}"

    @property
    def url(self) -> str:
        return f"{self.origin}/v1"

    def next_reply(self, received: Received) -> "Reply":
        with self._lock:
            reply = self.replies[min(len(self.received), len(self.replies) - 1)]
            self.received.append(received)
        self.arrived.set()
        return reply

    def start(self) -> None:
        threading.Thread(target=self._http.serve_forever, args=(0.02,), daemon=True).start()

    def stop(self) -> None:
        self.closing.set()
        self._http.shutdown()
        self._http.server_close()


class _Handler(BaseHTTPRequestHandler):
    chat: ChatServer
    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        text = self.rfile.read(int(self.headers["Content-Length"])).decode("utf-8")
        received = Received(self.path, {k.lower(): v for k, v in self.headers.items()}, text)
        reply = self.chat.next_reply(received)
        try:
            (reply if self.path == "/v1/chat/completions" else fails(404, "page not found"))(self, received)
        except OSError:
            self.chat.left.set()
            self.close_connection = True

    def send(self, status: int, body: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": "application/json", **(headers or {})}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        pass


Reply = Callable[[_Handler, Received], None]


def says(content: Any, *, finish: str = "stop", **message: Any) -> Reply:
    """A good response with this text."""
    choice = {"index": 0, "message": {"role": "assistant", "content": content, **message}, "finish_reason": finish}
    return gives({"id": "1", "object": "chat.completion", "created": 0, "model": "m", "choices": [choice]})


def writes(program: str, refusal: str | None = None) -> Reply:
    """A good response that holds to the schema."""
    return says(json.dumps({"program": program, "refusal": refusal}))


def block(program: str) -> Reply:
    """A good response with a code block in some chatter."""
    return says(f"Sure! Here is the program:\n\n```python\n{program}\n```\nIt drives there.")


def gives(body: object, status: int = 200, headers: dict[str, str] | None = None) -> Reply:
    return raw(json.dumps(body).encode(), status, headers)


def raw(body: bytes, status: int = 200, headers: dict[str, str] | None = None) -> Reply:
    return lambda handler, _: handler.send(status, body, headers)


def fails(status: int, message: str, **headers: str) -> Reply:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return gives({"error": {"message": message, "type": "e", "param": None, "code": None}}, status, named)


def rejects_schemas(otherwise: Reply, status: int = 400) -> Reply:
    """Refuse every request with a response_format."""
    refuse = fails(status, "response_format is not supported by this server")
    return lambda handler, received: (refuse if received.structured else otherwise)(handler, received)


def hangs(handler: _Handler, _: Received) -> None:
    """Never answer; notices when the client leaves."""
    handler.connection.settimeout(0.02)
    while not handler.chat.closing.is_set():
        try:
            gone = handler.connection.recv(1) == b""
        except TimeoutError:
            continue
        if gone:
            raise ConnectionResetError
    handler.close_connection = True


def drips(handler: _Handler, _: Received) -> None:
    """Send a byte now and then, so that no single read waits for long."""
    handler.send_response(200)
    handler.send_header("Content-Type", "application/json")
    handler.send_header("Content-Length", "100000")
    handler.end_headers()
    while not handler.chat.closing.wait(0.02):
        handler.wfile.write(b" ")
        handler.wfile.flush()


def drops(handler: _Handler, _: Received) -> None:
    """Close the connection without a word."""
    handler.close_connection = True


def breaks_off(handler: _Handler, _: Received) -> None:
    """Close the connection in the middle of the body."""
    handler.send_response(200)
    handler.send_header("Content-Length", "1000")
    handler.end_headers()
    handler.wfile.write(b'{"choices": [')
    handler.close_connection = True


@contextmanager
def serving(*replies: Reply) -> Iterator[ChatServer]:
    server = ChatServer(*replies)
    server.start()
    try:
        yield server
    finally:
        server.stop()


def reader(server: ChatServer, **settings) -> LLMReader:
    return LLMReader(LLMSettings(server.url, "qwen", **{"retries": 0, "timeout_s": 60.0, **settings}))


def refusal(*replies: Reply, kind: type[LLMError] = LLMServerError, **settings) -> str:
    """What the reader says; one line, without the key, with all exchanges at hand."""
    with serving(*replies) as server, pytest.raises(kind) as caught:
        reader(server, **settings).read("go to the sofa", COUNTS)
    said = str(caught.value)
    assert type(caught.value) is kind
    assert "\n" not in said and KEY not in said and "Traceback" not in said
    assert len(said) < 1000
    assert caught.value.exchanges
    assert KEY not in repr(caught.value.exchanges)
    return said


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A key, proxies that would swallow every request, and no way to any machine but this one."""
    for name in ("OPENAI_BASE_URL", "OPENAI_CUSTOM_HEADERS", "NO_PROXY", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
    for name in ("HTTP_PROXY", "http_proxy", "HTTPS_PROXY", "ALL_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setenv("OPENAI_ORG_ID", "org-private")
    look_up, connect, strangers = socket.getaddrinfo, socket.socket.connect, []

    def connect_here(self, address) -> None:
        if address[0] not in ("127.0.0.1", "::1"):
            strangers.append(address)
            raise OSError("not from the tests")
        connect(self, address)

    def only_here(host, *rest, **more):
        if host not in ("127.0.0.1", b"127.0.0.1", "localhost"):
            strangers.append(host)
            raise socket.gaierror("not from the tests")
        return look_up(host, *rest, **more)

    monkeypatch.setattr(socket, "getaddrinfo", only_here)
    monkeypatch.setattr(socket.socket, "connect", connect_here)
    yield
    assert strangers == []
