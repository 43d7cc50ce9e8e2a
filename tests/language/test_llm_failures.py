"""Servers that fail in every way there is, and waits that are given up."""

import json
import socket
import threading

import pytest
from chat_server import (
    COUNTS,
    GOOD,
    KEY,
    ChatServer,
    Reply,
    alone,  # noqa: F401 - a fixture
    breaks_off,
    drips,
    drops,
    fails,
    gives,
    hangs,
    raw,
    reader,
    refusal,
    says,
    serving,
    writes,
)

from simaps_viz.language.llm import LLMReader
from simaps_viz.language.llm_settings import LLMCancelledError, LLMServerError, LLMSettings

pytestmark = pytest.mark.usefixtures("alone")

SHORT_S = (0.3, 3.0, 30.0)
"""Timeouts that are tried until what was sent has also arrived: a slow machine needs a longer one."""


# ---- servers that fail


def _deep() -> bytes:
    return b"[" * 200_000


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (fails(401, f"Incorrect key {KEY[:8]}***"), "unauthorised (401): set the variable OPENAI_API_KEY"),
        (fails(403, "no"), "forbidden (403): no"),
        (
            fails(404, "model 'qwen' not found"),
            "no model of this name there, or no such address (404): model 'qwen' not",
        ),
        (fails(413, "big"), "the request is too large (413): big"),
        (fails(418, "tea\nkettle\x1b[31m"), "refuses the request (418): tea kettle [31m"),
        (fails(429, "quota"), "too many requests (429): quota"),
        (fails(500, "oh"), "the server failed (500): oh"),
        (raw(b"<html>no</html>", 502, {"Content-Type": "text/html"}), "the server failed (502)"),
        (raw(b"\xff\xfe", 503), "the server failed (503)"),
        (gives({"detail": "x" * 5000}, 422), "refuses the request (422): xxx"),
        (raw(b"{nope"), "not JSON"),
        (raw(b""), "not JSON"),
        (raw(b'{"choices": "\xff\xfe\xc3"}'), "not JSON in UTF-8"),
        (raw(_deep()), "not JSON"),
        (raw(b"<html>hello</html>", 200, {"Content-Type": "text/html"}), "not JSON"),
        (gives([]), "the server sent no answer"),
        (gives({"choices": []}), "the server sent no answer"),
        (gives({"choices": None}), "the server sent no answer"),
        (gives({"choices": [{"message": None}]}), "the server sent no answer"),
        (gives({"choices": [7]}), "the server sent no answer"),
        (gives({"error": {"message": "overloaded"}}), "the server sent no answer: overloaded"),
        (says("robot.turn(1", finish="length"), "the answer was cut off at the limit of 2000 tokens"),
        (says("", finish="content_filter"), "the server withheld the answer"),
        (says("x" * 30_000), "the answer is too long: expected at most 20000 characters, found 30000"),
        (raw(b" " * (2 << 20)), "the answer is longer than 1 MiB"),
        (raw(b" " * (2 << 20), 500), "the answer is longer than 1 MiB"),
        (raw(b"xx", 200, {"Content-Encoding": "gzip"}), "packed"),
        (drops, "the connection broke off"),
        (breaks_off, "the connection broke off"),
    ],
)
def test_every_failure_is_one_line(reply: Reply, said: str) -> None:
    line = refusal(reply)
    assert line.startswith("qwen at http://127.0.0.1:")
    assert said in line
    assert KEY[:8] not in line


def test_no_server() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(
        LLMServerError, match=f"^qwen at http://127.0.0.1:{port}/v1: no server answers at this address$"
    ):
        LLMReader(LLMSettings(f"http://127.0.0.1:{port}/v1", "qwen", retries=0)).read("go", COUNTS)


def test_a_server_that_comes_back_is_asked_again() -> None:
    with serving(fails(429, "wait", retry_after_ms="1"), fails(500, "oh", retry_after_ms="1"), writes(GOOD)) as server:
        reading = reader(server, retries=2).read("go to the sofa", COUNTS)
    assert reading.program == GOOD
    assert len(server.received) == 3
    assert len(reading.exchanges) == 1


def test_a_lost_connection_is_tried_again() -> None:
    with serving(drops, writes(GOOD)) as server:
        assert reader(server, retries=1).read("go to the sofa", COUNTS).program == GOOD
    assert len(server.received) == 2


def test_retries_end() -> None:
    with serving(fails(500, "oh", retry_after_ms="1")) as server, pytest.raises(LLMServerError, match="500"):
        reader(server, retries=2).read("go to the sofa", COUNTS)
    assert len(server.received) == 3


@pytest.mark.parametrize("reply", [hangs, drips])
def test_a_slow_server_is_given_up_whole(reply: Reply) -> None:
    for timeout_s in SHORT_S:
        with serving(reply) as server:
            with pytest.raises(LLMServerError, match=f"no answer within {timeout_s:g} s"):
                reader(server, timeout_s=timeout_s, retries=5).read("go to the sofa", COUNTS)
            if server.received:
                assert server.left.wait(60.0), "the connection was closed"
                break
    assert len(server.received) == 1


def test_a_server_that_asks_for_a_long_wait_is_given_up() -> None:
    for timeout_s in SHORT_S:
        said = refusal(fails(429, "quota", retry_after="60"), timeout_s=timeout_s, retries=2)
        if "429" in said:
            break
    assert f"too many requests (429), and no answer within {timeout_s:g} s" in said


@pytest.mark.parametrize("status", [301, 302, 307, 308])
def test_redirects_are_not_followed(status: int) -> None:
    with serving(writes(GOOD)) as other:
        elsewhere = {"Location": f"{other.origin.replace('127.0.0.1', 'localhost')}/v1/chat/completions"}
        said = refusal(raw(b"", status, elsewhere))
    assert f"sends on to another address ({status}), which is not followed" in said
    assert other.received == []


# ---- cancelling


def test_cancel_returns_at_once_and_closes_the_connection() -> None:
    cancel = threading.Event()

    def press(server: ChatServer) -> None:
        server.arrived.wait(60.0)
        cancel.set()

    with serving(hangs) as server:
        threading.Thread(target=press, args=(server,), daemon=True).start()
        with pytest.raises(LLMCancelledError, match="cancelled") as caught:
            reader(server, timeout_s=3600.0).read("go to the sofa", COUNTS, cancel=cancel)
        assert server.left.wait(60.0), "the server can stop working"
    assert caught.value.exchanges[0].error == str(caught.value)


def test_what_is_cancelled_before_it_begins_is_not_sent() -> None:
    cancel = threading.Event()
    cancel.set()
    with serving(writes(GOOD)) as server:
        asking = reader(server)
        with pytest.raises(LLMCancelledError):
            asking.read("go to the sofa", COUNTS, cancel=cancel)
        assert server.received == []
        assert asking.read("go to the sofa", COUNTS, cancel=threading.Event()).program == GOOD


def test_threads_can_share_a_reader() -> None:
    def echo(handler, received) -> None:
        number = json.loads(received.contents[-1].rpartition("Command: ")[2]).split()[1]
        writes(f"robot.turn({number})")(handler, received)

    with serving(echo) as server:
        asking, found = reader(server), {}

        def work(n: int) -> None:
            found[n] = asking.read(f"turn {n}", COUNTS)

        threads = [threading.Thread(target=work, args=(n,)) for n in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert {n: reading.program for n, reading in found.items()} == {n: f"robot.turn({n})" for n in range(6)}
    assert all(f'"turn {n}"' in reading.exchanges[0].messages[-1].content for n, reading in found.items())
