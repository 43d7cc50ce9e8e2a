"""Fuzzing target: what a browser tab tells the page's server, message by message, over its WebSocket."""

import contextlib
import io
import logging
import threading
import time
import traceback
from pathlib import Path
from random import Random
from typing import Any

from attacks.fuzz_cases import Case, Target
from attacks.fuzz_mutators import VALUES, mutate_bytes, mutate_value

from simaps_viz.errors import InputError

PATIENCE_S = 30.0
_ALIVE_EVERY = 100


class _Heard:
    """Errors that nobody caught, as logs, threads and the terminal get them; those of this program count."""

    def __init__(self) -> None:
        self.raised: list[str] = []
        handler = logging.Handler()
        handler.emit = self._log  # type: ignore[method-assign]
        logging.getLogger().addHandler(handler)
        threading.excepthook = lambda args: self._take("".join(traceback.format_exception(args.exc_value)))

    def _log(self, record: logging.LogRecord) -> None:
        if record.exc_info and record.exc_info[1] is not None:
            self._take("".join(traceback.format_exception(record.exc_info[1])))

    def _take(self, text: str) -> None:
        if "simaps_viz/" in text and "InputError" not in text.splitlines()[-1]:
            self.raised.append(" ".join(text.split())[-400:])


def _messages(session: Any) -> list[dict[str, Any]]:
    """Return good messages of every kind, to every control of the page."""
    from fake_page import CAMERA  # noqa: PLC0415 - as below

    ray = {"ray_origin": [0.0, 0.0, 5.0], "ray_direction": [0.0, 0.0, -1.0], "modifier": None}
    found: list[dict[str, Any]] = [
        CAMERA,
        {"type": "ScenePointerMessage", "event_type": "click", "screen_pos": [[0.5, 0.5]], **ray},
        {"type": "SceneNodeClickMessage", "name": "/map", "instance_index": 0, "screen_pos": [0.5, 0.5], "owner": "",
         **ray},
        {"type": "FileTransferStartUpload", "source_component_uuid": "x", "transfer_uuid": "t", "filename": "../a",
         "mime_type": "text/plain", "part_count": 1, "size_bytes": 3},
        {"type": "FileTransferPart", "source_component_uuid": "x", "transfer_uuid": "t", "part_index": 0,
         "content": b"abc"},
        {"type": "GuiCloseModalMessage", "uuid": "x"},
        {"type": "TransformControlsUpdateMessage", "name": "/robot", "wxyz": [1.0, 0.0, 0.0, 0.0],
         "position": [0.0, 0.0, 0.0], "owner": ""},
    ]  # fmt: skip
    for uuid, handle in list(session.client.gui._gui_input_handle_from_uuid.items()):
        value = getattr(handle, "value", None)
        if isinstance(value, str | int | float | bool | tuple):
            found.append({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})
    return found


def _page(folder: Path) -> Case:
    import msgspec.msgpack  # noqa: PLC0415 - the page's libraries are slow to load
    from browser import toy_workbench  # noqa: PLC0415 - as above
    from fake_page import FakePage  # noqa: PLC0415 - as above
    from services import all_services  # noqa: PLC0415 - as above
    from websockets.exceptions import ConnectionClosed  # noqa: PLC0415 - as above

    heard, kept = _Heard(), contextlib.ExitStack()  # until the process ends
    with contextlib.redirect_stdout(io.StringIO()):
        bench = kept.enter_context(toy_workbench(all_services()))
    pages: list[FakePage] = [FakePage(bench)]
    good = _messages(pages[0].session)
    count = 0

    def connect() -> None:
        pages[0].close()
        pages[0] = FakePage(bench)
        good[:] = _messages(pages[0].session)

    def case(r: Random) -> object:
        nonlocal count
        assert kept is not None
        count += 1
        message = dict(r.choice(good))
        if r.random() < 0.5 and "updates" in message:
            message["updates"] = {"value": r.choice(VALUES)}
        elif r.random() < 0.9:
            message = mutate_value(r, {k: list(v) if isinstance(v, tuple) else v for k, v in message.items()})
        data = msgspec.msgpack.encode(_small(message))
        if r.random() < 0.15:
            data = mutate_bytes(r, data)
        try:
            pages[0]._socket.send(data if r.random() < 0.98 else data.decode("latin-1"))
            closed = _hung_up(pages[0]._socket)
        except ConnectionClosed:
            closed = True
        if closed or count % _ALIVE_EVERY == 0:
            connect()
        if heard.raised:
            raise AssertionError(heard.raised.pop())
        if closed:
            raise InputError("the server hung up")
        return None

    return case


def _hung_up(link: Any) -> bool:
    """Ask whether the server is still there; True when it has closed the connection."""
    answered, end = link.ping(), time.monotonic() + PATIENCE_S
    while not answered.wait(0.02):
        if link.state.name == "CLOSED":
            return True
        if time.monotonic() > end:
            raise AssertionError("the server does not answer any more")
    return False


def _small(value: Any) -> Any:
    """Leave out numbers that the protocol cannot write."""
    if isinstance(value, dict):
        return {str(k).encode("utf-8", "replace").decode(): _small(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_small(v) for v in value]
    if isinstance(value, int) and not isinstance(value, bool) and not -(2**63) <= value < 2**64:
        return 2**63
    return value.encode("utf-8", "replace").decode() if isinstance(value, str) else value


PAGE_TARGETS = (Target("page messages", _page, weight=6),)
