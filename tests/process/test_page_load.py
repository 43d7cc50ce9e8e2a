"""Several people on one server, each asking for things of its own: nothing lost, nothing crossed."""

import asyncio
import re

from attacks import load as page_load
from browser import free_port
from toy_maps import toy_map

from simaps_viz.mapping.file import save_map


def test_six_pages_get_their_own_answers(tmp_path):
    path, simap = tmp_path / "toy.npz", toy_map()
    save_map(simap, path)
    server, states = page_load.Server(path, free_port()), []
    try:
        tally = asyncio.run(
            page_load.load(server.url, simap, clients=6, seconds=4.0, tell=lambda when: states.append(server.state()))
        )
    finally:
        server.close()
    assert tally.lost == []
    assert tally.crossed == []
    assert all(len(tally.seconds[kind]) >= 6 for kind in ("slider", "click", "command"))
    # viser keeps up to 32 for all callbacks; of its own, a page has some only while it works
    assert max(int(n) for state in states for n in re.findall(r"(\d+) threads", state)) < 64


def test_answers_of_others_are_noticed():
    """The check itself: a page that is sent another's counts, object or program says so."""
    expected = page_load.expected_of(toy_map())
    tally = page_load.Tally()
    visitor = page_load.Visitor(0, 6, expected, tally)
    shown = expected.counts[5.0]
    other = next(counts for counts in expected.counts.values() if counts != shown)
    fact = next(fact for (percent, n), fact in expected.facts.items() if n == 1)
    program = expected.commands[0][1]
    for words in (shown, other, fact, program, "something else"):
        visitor._take({"type": "GuiUpdateMessage", "updates": {"content": f"<b>{words}</b>"}})
    assert len(tally.crossed) == 3
