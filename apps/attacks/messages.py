"""Attacks over a page's WebSocket: others' widgets, attributes, broadcasts, uploads, messages that are none."""

import contextlib
import os
import random
from pathlib import Path
from typing import Any

import msgspec.msgpack
from attacks.target import CAMERA, Target, Tries, hung_up, open_socket, page, say, wait
from viser import _messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.connection import Connection

from simaps_viz.viewer.server.page_socket import MAX_UPLOAD
from simaps_viz.viewer.session import Session

MAX_GROWTH = 200 << 20
"""Bytes of memory that an attack may make the server take."""


SENT = {repr(kind(value)) for value in (True, 77, 0.5, "evil") for kind in (bool, str, type(value))} | {
    "77.0",
    "0",
    "1",
}
"""What widgets hold that were set by ``widgets_of_others``; the page itself goes on setting some of its own."""


def widgets(session: Session) -> dict[str, Any]:
    """Return a page's widgets by their ids; a real attacker cannot ask for those of others."""
    return dict(session.gui._gui_input_handle_from_uuid)


def values(session: Session) -> dict[str, Any]:
    """Return what each of them shows."""
    return {uuid: repr(handle._impl.value) for uuid, handle in widgets(session).items()}


def _settled(session: Session) -> dict[str, Any]:
    """Return the values once the page itself changes none of them any more."""
    before = values(session)
    for _ in range(20):
        wait(lambda: False, 0.4)
        if before == (before := values(session)):
            break
    return before


def memory() -> int:
    """Return the memory of this process, bytes; 0 where it is not known."""
    pages = int(Path("/proc/self/statm").read_text().split()[1]) if Path("/proc/self/statm").is_file() else 0
    return pages * 4096


def widgets_of_others(target: Target) -> Tries:
    """One page sets, presses and holds the widgets of another, whose ids it was given."""
    with page(target.bench) as (mine, attacker), page(target.bench) as (_, victim):
        victim.wait_idle()
        before, shown = _settled(victim), victim.simap
        for uuid in widgets(victim):
            for value in (True, 77, 0.5, "evil", [1, 2, 3]):
                say(mine, type="GuiUpdateMessage", uuid=uuid, updates={"value": value})
            say(mine, type="GuiButtonHoldMessage", uuid=uuid, frequency=10.0)
        for uuid in victim.gui._command_handle_from_uuid:
            say(mine, type="CommandTriggerMessage", uuid=uuid)
        attacker.wait_idle()
        wait(lambda: False, 0.5)
        victim.wait_idle()
        after = values(victim)
        yield from (
            f"a widget was set: {value:.60} -> {after[uuid]:.60}"
            if after[uuid] != value and after[uuid] in SENT
            else None
            for uuid, value in before.items()
        )
        yield None if victim.simap is shown else "another map is shown"


def attributes_of_widgets(target: Target) -> Tries:
    """A page sets what viser would let it: any attribute of its widgets, such as callbacks."""
    names = ("update_cb", "sync_cb", "removed", "is_button", "props", "gui_api", "uuid", "parent_container_id",
             "update_timestamp", "__class__", "__dict__", "_impl", "value.__class__")  # fmt: skip
    with page(target.bench) as (mine, session):
        for uuid, handle in widgets(session).items():
            before = {name: getattr(handle._impl, name, None) for name in names}
            for name in names:
                say(mine, type="GuiUpdateMessage", uuid=uuid, updates={name: [], "value": handle._impl.value})
            wait(lambda: False, 0.02)
            for name in names:
                yield None if getattr(handle._impl, name, None) is before[name] else f"{name} was set"
            break_off = hung_up(mine, 0.05)
            if break_off:
                return


def servers_own_messages(target: Target) -> Tries:
    """A page says what only the server says (scripts to run, scenes to remove, forms to spread), to reach others."""
    made = [_made_up(kind) for kind in _messages.Message.get_subclasses()]
    with page(target.bench) as (_, victim):
        victim.wait_idle()
        buffer = target.bench.server._websock_server.get_message_buffer()
        held = len(buffer.message_from_id)
        for start in range(0, len(made), 15):
            with open_socket(target.port) as mine:
                for message in made[start : start + 15]:
                    for _ in range(3):
                        say(mine, **message)
                wait(lambda: False, 0.1)
        for message in made:
            yield None if len(buffer.message_from_id) <= held else f"{message['type']} was spread to all pages"
        yield None if victim.wait_idle() and target.bench.server._share_tunnel is None else "a way out was opened"


def _made_up(kind: type) -> dict[str, Any]:
    fields = getattr(kind, "__dataclass_fields__", {})
    return {"type": kind.__name__, **{name: "evil" for name in fields if name != "excluded_self_client"}}


def values_of_any_type(target: Target) -> Tries:
    """A page sets its own widgets to what they cannot show: no numbers, endless ones, long texts, lists, nothing."""
    numbers = (float("nan"), float("inf"), -float("inf"), 1e308, -1e12, 1e12, 2**62, -1, 0)
    others = ("", "\x00", "<script>", "a" * 90_000, "é" * 9000, [], [[]], {}, None, b"x")
    for value in (*numbers, *others, [1e308] * 64, [None] * 64, True):
        with page(target.bench) as (mine, session):
            session.wait_idle()
            for uuid in widgets(session):
                say(mine, type="GuiUpdateMessage", uuid=uuid, updates={"value": value})
            done = session.wait_idle(30.0)
            yield None if done else f"the page hangs after {value!r:.30}"
    yield target.is_well()


def messages_that_are_none(target: Target) -> Tries:
    """Bytes that are no msgpack, or deep, or of wrong types; text; at random, from a seed."""
    draw = random.Random(5)
    deep, huge = b"\x91" * 100_000, b"\xdd\xff\xff\xff\xff"
    right = msgspec.msgpack.encode(CAMERA)
    broken = [b"", b"\xc1", deep, huge, b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", right[:-3], right + right]
    broken += [bytes(draw.randrange(256) for _ in range(draw.randrange(1, 200))) for _ in range(200)]
    for _ in range(200):
        spoilt = bytearray(right)
        spoilt[draw.randrange(len(spoilt))] = draw.randrange(256)
        broken.append(bytes(spoilt))
    before = memory()
    for start in range(0, len(broken), 16):
        with open_socket(target.port) as mine:
            try:
                for one in broken[start : start + 16]:
                    mine.send(one)
                mine.send("text")
            except ConnectionClosed:
                pass
            wait(lambda: False, 0.02)
        for _ in broken[start : start + 16]:
            yield None if memory() - before < MAX_GROWTH else "memory was taken"
    with open_socket(target.port) as mine:
        with contextlib.suppress(ConnectionClosed):  # it hangs up before the last of them
            for _ in range(60):
                say(mine, type="No such message")
        yield None if hung_up(mine) else "a page that talks nonsense is heard for ever"
    yield target.is_well()


def enormous_messages(target: Target) -> Tries:
    """A message of 64 MB, one whose size is only announced, and one in parts that never ends."""
    before = memory()
    with open_socket(target.port) as mine:
        with contextlib.suppress(ConnectionClosed):
            say(mine, type="GuiUpdateMessage", uuid="a", updates={"value": "a" * (64 << 20)})
        yield None if hung_up(mine) else "a message of 64 MB was taken"
    with open_socket(target.port) as mine:
        mine.socket.sendall(b"\x82\xff" + (1 << 40).to_bytes(8) + b"\x00" * 4 + b"a" * 1000)
        yield None if hung_up(mine) else "a message of 1 TB was waited for"
    with open_socket(target.port) as mine:
        try:
            mine.send((b"a" * 65_536 for _ in range(4096)), text=False)
            yield "a message without an end was taken"
        except (ConnectionClosed, OSError):
            yield None
    yield None if memory() - before < MAX_GROWTH else "memory was taken"


def compressed_bombs(target: Target) -> Tries:
    """A message that unpacks to a thousand times its size: compression is not offered, and its bit is refused."""
    with open_socket(target.port, compression="deflate") as mine:
        yield "compression was agreed on" if mine.protocol.extensions else None
        mine.socket.sendall(b"\xc2\xfe\x07\xd0" + b"\x00" * 4 + b"\xcb\x00" * 1000)
        yield None if hung_up(mine) else "a compressed message was taken"
    with open_socket(target.port) as mine:
        mine.socket.sendall(b"\x82\x01a")
        yield None if hung_up(mine) else "a message without a mask was taken"


def uploads_without_bounds(target: Target) -> Tries:
    """Uploads that announce a gigabyte, or a thousand files, or little and then send much, or nothing before."""
    before = memory()
    with page(target.bench) as (mine, session):
        some = next(iter(widgets(session)))
        for size, parts in (
            (1 << 30, 2048),
            (MAX_UPLOAD + 1, 513),
            (-1, 1),
            (1 << 62, 1),
            (100, 0),
            (0, 5),
            (5, 1 << 40),
        ):
            _announce(mine, some, f"a{size}", size, parts)
        for n in range(100):
            _announce(mine, some, f"many{n}", 1 << 24, 32)
        wait(lambda: False, 0.3)
        states = session.gui._current_file_upload_states
        yield None if len(states) <= 16 else f"{len(states)} uploads were begun"
        total = sum(state["total_bytes"] for state in states.values())
        yield None if total <= MAX_UPLOAD else f"{total} bytes were promised room"
    for transfer in ("nobody's", "short"):
        with page(target.bench) as (mine, session):
            some = next(iter(widgets(session)))
            _announce(mine, some, "short", 1000, 50)
            for part in range(40):
                say(mine, type="FileTransferPart", source_component_uuid=some, transfer_uuid=transfer,
                    part_index=part, content=b"a" * 500_000)  # fmt: skip
            wait(lambda: False, 0.3)
            held = sum(len(p) for s in session.gui._current_file_upload_states.values() for p in s["parts"].values())
            yield None if held <= 1000 else f"{held} bytes are held that were never announced"
    yield None if wait(lambda: target.bench.door.uploads.taken == 0) else "room for uploads is lost when pages go"
    yield None if memory() - before < MAX_GROWTH else "memory was taken"


def _announce(mine: Connection, component: str, transfer: str, size: int, parts: int) -> None:
    say(mine, type="FileTransferStartUpload", source_component_uuid=component, transfer_uuid=transfer,
        filename="../../" * 20 + "evil.npz", mime_type="a/b", part_count=parts, size_bytes=size)  # fmt: skip


def tabs_of_others(target: Target) -> Tries:
    """A page says it is in the tab of another, or guesses the names of tabs, to get what its person did."""
    tabs = target.bench.tabs
    with page(target.bench) as (_, victim), page(target.bench) as (_, attacker):
        name, _ = tabs.claim(None, victim.token)
        given, state = tabs.claim(name, attacker.token)
        yield None if given != name and state is None else "a tab that is open was taken over"
        yield None if tabs.claim(name, victim.token)[0] == name else "a person lost the tab"
        guesses = [os.urandom(9).hex() for _ in range(200)] + [
            name[:-1],
            name + "a",
            name.swapcase(),
            "",
            "*",
            None,
            [],
            {},
        ]
        for guess in guesses:
            yield None if tabs.claim(guess, attacker.token)[1] is None else f"{guess} was somebody's"
        yield None if len(name) >= 16 and name != victim.token else "names of tabs can be guessed"
    yield (
        None if wait(lambda: len(target.bench.sessions) == 0) and len(tabs) <= 32 else "tabs are remembered without end"
    )
