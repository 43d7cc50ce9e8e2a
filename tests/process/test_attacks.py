"""Every attack that is known here is tried on a workbench, on this machine; none may succeed."""

import logging

import pytest
from attack_target import toy_target
from attacks import floods
from attacks.files import Watched
from attacks.run import ATTACKS, run_attack

from simaps_viz.viewer.server import front_door, page_socket

TRIED = 15
"""Attacks below which some have gone missing."""


@pytest.fixture(scope="module")
def target(tmp_path_factory):
    patch = pytest.MonkeyPatch()
    patch.setattr(front_door, "REQUEST_S", 5.0)
    # What counts here is that nothing is held for ever, and not how busy the machine is.
    for name, seconds in (("AWAY_S", 60.0), ("SERVED_S", 60.0), ("ANSWERED_S", 60.0), ("HUNG_UP_S", 60.0)):
        patch.setattr(floods, name, seconds)
    with toy_target(tmp_path_factory.mktemp("attacked")) as made:
        yield made
    patch.undo()


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
def test_is_withstood(target, attack, caplog, monkeypatch):
    if attack is floods.unused_connections:  # are not to go by themselves before they are hung up on
        monkeypatch.setattr(front_door, "REQUEST_S", 2 * floods.HUNG_UP_S)
    if attack is floods.pages_that_break_off:  # waits until none is left: what a flood sent is read at once
        monkeypatch.setattr(page_socket, "MESSAGES_PER_S", 1e6)
    for name in ("simaps_viz", "websockets.server", "asyncio"):
        caplog.set_level(logging.DEBUG, name)
    outcome = run_attack(attack, target, Watched([target.secret.parent]))
    assert outcome.tried > 1
    assert outcome.succeeded == ()
    token = target.closed.access.token
    assert not any(token in record.getMessage() for record in caplog.records)
    assert not any(record.exc_info for record in caplog.records if record.name.startswith("asyncio"))


def test_an_attack_that_touches_a_file_has_succeeded(target, tmp_path):
    kept, gone = tmp_path / "kept.rrd", tmp_path / "below" / "gone.rrd"
    gone.parent.mkdir()
    for path in (kept, gone):
        path.write_bytes(b"recording")
    watched = Watched([tmp_path])

    def deletes(target):
        """Delete one file, change another and leave a third."""
        gone.unlink()
        kept.write_bytes(b"Recording")
        (tmp_path / "new").touch()
        yield None

    def looks(target):
        """Read."""
        yield None if kept.read_bytes() else "empty"

    assert run_attack(looks, target, watched).succeeded == ()
    assert run_attack(deletes, target, watched).succeeded == (
        f"{gone} is gone", f"{kept} was changed", f"{tmp_path / 'new'} is new",
    )  # fmt: skip


def test_there_are_many():
    assert len(ATTACKS) >= TRIED
