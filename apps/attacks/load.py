"""Many people on one server: pages without a browser move a slider, click, and ask, each for things of its own."""

import asyncio
import html
import os
import random
import re
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec.msgpack
import viser
import zstandard
from attacks.target import CAMERA
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from simaps_viz.drawing.legend import facts_html
from simaps_viz.language.commands import read_command
from simaps_viz.mapping.simap import joining_at, joining_percent, repartition, slider_of
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.shared import keep_numbers
from simaps_viz.viewer.panels.command import program_html
from simaps_viz.viewer.panels.map import counts_html, doubtful_of

PATIENCE_S = 60.0
"""An answer that takes longer is lost."""
THINKING_S = (0.3, 1.2)
"""Between an answer and what is asked next."""
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
PERCENTS = (5.0, 20.0, 35.0, 50.0, 60.0, 70.0, 85.0, 95.0)


def plain(content: str) -> str:
    """Return the words of a piece of HTML."""
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", content)).split())


@dataclass(frozen=True, eq=False)
class Expected:
    """What the right answers are, computed here and not on the server; the words of each."""

    slider: str
    percent: float
    """Where the slider stands at first."""
    counts: dict[float, str]
    """Percentage to the counts of the map that is cut so."""
    facts: dict[tuple[float, int], str]
    """Percentage and number of a place to what is said of the object there."""
    places: Sequence[tuple[float, float]]
    commands: Sequence[tuple[str, str]]
    """Command and its program."""


def expected_of(simap: SIMap) -> Expected:
    """Compute the right answers for a map."""
    # As on the page, an object that stays the same keeps its number.
    maps = {percent: keep_numbers(repartition(simap, **joining_at(simap, percent)), simap) for percent in PERCENTS}
    doubtful = {percent: doubtful_of(cut, cut.frames_to_count) for percent, cut in maps.items()}
    centres = [(float(i.centroid_m[0]), float(i.centroid_m[1])) for i in simap.instances]
    places = [place for place in centres if all(m.at(*place) is not None for m in maps.values())]
    facts = {}
    for percent, cut in maps.items():
        for n, place in enumerate(places):
            found = cut.at(*place)
            assert found is not None
            facts[percent, n] = plain(facts_html(cut, found, doubtful[percent]))
    fewest = {label: min(m.counts().get(label, 0) for m in maps.values()) for label in simap.counts()}
    commands = []
    for label, count in fewest.items():
        for ordinal in ORDINALS[:count]:
            command = f"go to the {ordinal} {label}"
            commands.append((command, plain(program_html(read_command(command, fewest).program))))
    return Expected(
        slider_of(simap).title,
        joining_percent(simap),
        {percent: plain(counts_html(cut, doubtful[percent])) for percent, cut in maps.items()},
        facts,
        places,
        commands,
    )


@dataclass
class Tally:
    """What came of it."""

    seconds: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    lost: list[str] = field(default_factory=list)
    crossed: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        asked = sum(map(len, self.seconds.values())) + len(self.lost)
        return f"{asked} asked, {len(self.lost)} lost, {len(self.crossed)} crossed"

    def line(self, kind: str) -> str:
        """Sum up one kind of request."""
        times = sorted(self.seconds[kind]) or [0.0]
        p95 = times[min(len(times) - 1, int(0.95 * len(times)))]
        return f"{kind}: {len(self.seconds[kind])} answered, p50 {statistics.median(times):.2f} s, p95 {p95:.2f} s"


class Visitor:
    """One person's page. Of everything that could be asked, this one asks its own share."""

    def __init__(self, number: int, of: int, expected: Expected, tally: Tally) -> None:
        """Take which of how many it is, and where to write down how it fares."""
        self._expected, self._tally, self._number = expected, tally, number
        self._draw = random.Random(number)
        self._percent, self._place = expected.percent, -1
        self._percents = {self._percent}
        self._places = range(number % len(expected.places), len(expected.places), of)
        self._commands = list(expected.commands)[number % len(expected.commands) :: of]
        self._asked: set[str] = set()
        self._widgets: dict[tuple[str, str], str] = {}
        self._waited_for: Callable[[str], bool] = lambda words: False
        self._answered = asyncio.Event()
        self._counts = set(expected.counts.values())
        self._all_facts, self._all_programs = set(expected.facts.values()), {p for _, p in expected.commands}

    async def visit(self, url: str, until: float) -> None:
        """Ask one thing after another until a time of the monotonic clock; at least everything once."""
        protocol: Any = [f"viser-v{viser.__version__}"]
        options: Any = {"max_size": None, "proxy": None, "open_timeout": PATIENCE_S}
        async with connect(url, subprotocols=protocol, **options) as connection:
            await self._send(connection, **CAMERA)
            reading = asyncio.create_task(self._read(connection))
            async with asyncio.timeout(PATIENCE_S):
                while ("Command", "Text") not in self._widgets:
                    await asyncio.sleep(0.1)
            await asyncio.sleep(3.0)  # the page is painted first
            over = False
            while not over:
                for ask in (self._move_slider, self._click, self._command):
                    await ask(connection)
                    await asyncio.sleep(self._draw.uniform(*THINKING_S))
                over = time.monotonic() >= until
            reading.cancel()

    async def _move_slider(self, connection: ClientConnection) -> None:
        shown = self._expected.counts.get(self._percent)  # the page says nothing new where these are the same
        others = [p for p in PERCENTS if self._expected.counts[p] != shown]
        self._percent = self._draw.choice(others)
        self._percents.add(self._percent)
        words = self._expected.counts[self._percent]
        await self._ask(connection, "slider", words, self._expected.slider, "Slider", value=self._percent)

    async def _click(self, connection: ClientConnection) -> None:
        n = self._draw.choice([n for n in self._places if n != self._place] or list(self._places))
        if n == self._place:  # the page says nothing new
            return
        self._place = n
        x, y = self._expected.places[n]
        self._expect(self._expected.facts[self._percent, n])
        await self._send(connection, type="ScenePointerMessage", event_type="click", ray_origin=(x, y, 9.0),
                         ray_direction=(0.0, 0.0, -1.0), screen_pos=((0.5, 0.5),), modifier=None)  # fmt: skip
        await self._answer("click")

    async def _command(self, connection: ClientConnection) -> None:
        command, program = self._draw.choice(self._commands)
        self._asked.add(program)
        await self._ask(connection, "command", program, "Command", "Text", value=f"{command}\n")

    async def _ask(
        self, connection: ClientConnection, kind: str, words: str, label: str, what: str, value: Any
    ) -> None:
        self._expect(words)
        await self._send(connection, type="GuiUpdateMessage", uuid=self._widgets[label, what], updates={"value": value})
        await self._answer(kind)

    def _expect(self, words: str) -> None:
        self._answered.clear()
        self._begun, self._words = time.monotonic(), words

        def is_it(found: str) -> bool:
            return found.replace("▶ ", "") == words

        self._waited_for = is_it

    async def _answer(self, kind: str) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self._answered.wait(), PATIENCE_S)
        if self._answered.is_set():
            self._tally.seconds[kind].append(time.monotonic() - self._begun)
        else:
            self._tally.lost.append(f"visitor {self._number}, {kind}: {self._words}")

    async def _read(self, connection: ClientConnection) -> None:
        unpack = zstandard.ZstdDecompressor()
        with suppress(ConnectionClosed):
            async for raw in connection:
                assert isinstance(raw, bytes)
                packed = raw[16 : 16 + int.from_bytes(raw[8:16], "little")]
                for message in msgspec.msgpack.decode(unpack.decompress(packed))["messages"]:
                    self._take(message)

    def _take(self, message: dict[str, Any]) -> None:
        kind = str(message["type"])
        if kind in ("GuiSliderMessage", "GuiTextMessage"):
            self._widgets[message["props"]["label"], kind[3:-7]] = message["uuid"]
        content = message.get("updates", {}).get("content") if kind == "GuiUpdateMessage" else None
        if not isinstance(content, str):
            return
        words = plain(content)
        if self._waited_for(words):
            self._answered.set()
        self._check(words.replace("▶ ", ""))

    def _check(self, words: str) -> None:
        """Note what was meant for somebody else."""
        facts = {self._expected.facts.get((p, n)) for p in self._percents for n in self._places}
        mine = {self._expected.counts.get(p) for p in self._percents}
        foreign = (
            (words in self._all_programs and words not in self._asked)
            or (words in self._all_facts and words not in facts)
            or (words in self._counts and words not in mine)
        )
        if foreign:
            self._tally.crossed.append(f"visitor {self._number}: {words}")

    async def _send(self, connection: ClientConnection, **message: Any) -> None:
        await connection.send(msgspec.msgpack.encode(message))


class Server:
    """`simaps view` in a process of its own."""

    def __init__(self, map_path: Path, port: int) -> None:
        """Start it, and wait until it answers."""
        command = [sys.executable, "-m", "simaps_viz", "view", str(map_path), "--no-browser", "--no-edits"]
        self._process = subprocess.Popen([*command, "--port", str(port)], stderr=subprocess.PIPE, text=True)
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if found := re.search(r"Workbench: http://([\w.:]+)", line):
                self.url = f"ws://{found[1]}"
                break
        else:
            raise RuntimeError("the server did not start")

    def state(self) -> str:
        """Describe what memory and how many threads it has."""
        text = Path(f"/proc/{self._process.pid}/status").read_text()
        found = dict(re.findall(r"^(VmRSS|Threads):\s+(\d+)", text, re.MULTILINE))
        return f"{int(found['VmRSS']) / 1024:.0f} MB, {found['Threads']} threads"

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait(timeout=20)
        assert self._process.stderr is not None
        self._process.stderr.close()


async def load(url: str, simap: SIMap, *, clients: int, seconds: float, tell: Callable[[str], None]) -> Tally:
    """Let so many people use a server for so long; ``tell`` is called with each quarter of it, the start included."""
    tally, expected = Tally(), expected_of(simap)
    until = time.monotonic() + seconds
    visits = [asyncio.create_task(Visitor(n, clients, expected, tally).visit(url, until)) for n in range(clients)]
    tell("start")
    for quarter in ("25 %", "50 %", "75 %", "end"):
        await asyncio.sleep(seconds / 4.0)
        tell(quarter)
    for outcome in await asyncio.gather(*visits, return_exceptions=True):
        if isinstance(outcome, BaseException):
            tally.lost.append(f"a page broke off: {outcome!r}")
    return tally


def busy() -> str:
    """Describe what else the machine does."""
    return f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}"
