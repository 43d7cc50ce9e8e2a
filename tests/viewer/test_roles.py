"""Who may do what at a page: owners and visitors, and the question before what destroys."""

import os

import pytest
from attack_target import TOKEN, toy_target
from attacks.changes import OWN, choose_own, named, press, settle
from attacks.target import ask, page, wait
from browser import free_port, toy_services
from toy_maps import TOY_POSE, toy_map

from simaps_viz.app import workbench
from simaps_viz.console.terminal import console
from simaps_viz.errors import InputError
from simaps_viz.evaluation.judging import JudgingSession
from simaps_viz.viewer.page import panel
from simaps_viz.viewer.panels.judge import JudgePanel
from simaps_viz.viewer.panels.mend import MendPanel
from simaps_viz.viewer.server.access import Access, headers_of
from simaps_viz.viewer.workbench import Workbench

OWNERS = f"{TOKEN}-owner"


def status(access, path, **head):
    """Return the status with which a request is answered."""
    pairs = {"Host": "127.0.0.1:8080", **head}.items()
    refused = access.refuse(headers_of(pairs), path, own_address="127.0.0.1", peer="10.0.0.9")
    return 200 if refused is None else refused[0].value


def roles(access):
    """Return the roles of a browser without a token, with the one for visitors, and with the owner's; None: refused."""
    paths = ("/", f"/?token={access.token}", f"/?token={access.owner_token or 'none'}")
    return [access.role({}, path) if status(access, path) == 200 else None for path in paths]


@pytest.mark.parametrize(
    ("host", "tokens", "options", "expected"),
    [
        ("127.0.0.1", {}, {}, ["owner", "owner", "owner"]),
        ("127.0.0.1", {}, {"read_only": True}, ["visitor", "visitor", "visitor"]),
        ("127.0.0.1", {"SIMAPS_TOKEN": TOKEN}, {}, [None, "owner", None]),
        ("127.0.0.1", {"SIMAPS_OWNER_TOKEN": OWNERS}, {}, [None, "visitor", "owner"]),
        ("0.0.0.0", {}, {}, [None, "visitor", "owner"]),
        ("0.0.0.0", {"SIMAPS_TOKEN": TOKEN}, {}, [None, "visitor", "owner"]),
        ("0.0.0.0", {"SIMAPS_TOKEN": TOKEN, "SIMAPS_OWNER_TOKEN": OWNERS}, {}, [None, "visitor", "owner"]),
        ("0.0.0.0", {"SIMAPS_OWNER_TOKEN": OWNERS}, {"allow_edit": True}, [None, "owner", None]),
        ("0.0.0.0", {"SIMAPS_OWNER_TOKEN": OWNERS}, {"read_only": True}, [None, "visitor", None]),
    ],
)
def test_roles(monkeypatch, host, tokens, options, expected):
    for name in ("SIMAPS_TOKEN", "SIMAPS_OWNER_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    for name, token in tokens.items():
        monkeypatch.setenv(name, token)
    access = Access(host, **options)
    assert roles(access) == expected
    assert [given for given in (access.token, access.owner_token) if given in tokens.values()] == [
        tokens[name] for name, given in (("SIMAPS_TOKEN", access.token), ("SIMAPS_OWNER_TOKEN", access.owner_token))
        if name in tokens and given
    ]  # fmt: skip


def test_what_is_refused(monkeypatch):
    with pytest.raises(InputError, match="one of --allow-edit and --read-only, found both"):
        Access(allow_edit=True, read_only=True)
    monkeypatch.setenv("SIMAPS_OWNER_TOKEN", TOKEN)
    with pytest.raises(InputError, match="SIMAPS_OWNER_TOKEN: expected another token than SIMAPS_TOKEN"):
        Access("0.0.0.0", token=TOKEN)
    monkeypatch.setenv("SIMAPS_OWNER_TOKEN", "short")
    with pytest.raises(InputError, match="SIMAPS_OWNER_TOKEN: expected 16 to 200 letters"):
        Access()


def test_a_visitor_becomes_an_owner_by_the_token_only_and_guesses_are_counted(monkeypatch):
    monkeypatch.setenv("SIMAPS_OWNER_TOKEN", OWNERS)
    access = Access("0.0.0.0", token=TOKEN)

    def cookie(path, **head):
        given = access.entering(headers_of(head.items()), path)
        return None if given is None else given["Set-Cookie"].partition(";")[0]

    visitor = cookie(f"/?token={TOKEN}") or ""
    assert access.role({"cookie": visitor}, "/") == "visitor"
    raised = cookie(f"/?token={OWNERS}", Cookie=visitor)
    assert raised and access.role({"cookie": raised}, "/") == "owner"
    assert cookie(f"/?token={TOKEN}", Cookie=raised) is None  # an owner stays one, whatever address is opened
    assert access.role({"cookie": raised}, f"/?token={TOKEN}") == "owner"
    wrong = [status(access, f"/?token=guess{n}", Cookie=visitor) for n in range(12)]
    assert wrong == [401] * 10 + [429] * 2
    assert status(access, f"/?token={OWNERS}", Cookie=visitor) == 429
    for path in ("/", f"/?token={TOKEN}"):  # who is in stays in
        assert status(access, path, Cookie=visitor) == status(access, path, Cookie=raised) == 200


def test_many_visitors_push_no_owner_out(monkeypatch):
    monkeypatch.setattr("simaps_viz.viewer.server.access.MAX_INSIDE", 3)
    access = Access("0.0.0.0", token=TOKEN)
    passes = [access.entering({}, f"/?token={token}") for token in (access.owner_token, *[TOKEN] * 5)]
    owner = (passes[0] or {})["Set-Cookie"].partition(";")[0]
    assert access.role({"cookie": owner}, "/") == "owner" and len(access._inside) == 3


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"allow_edit": True}, {"read_only": True}])
def test_the_terminal_has_an_address_for_each_role(options):
    access = Access("0.0.0.0", token=TOKEN, **options)
    with Workbench(toy_map(), services=toy_services(), port=free_port(), access=access, start=TOY_POSE) as bench:
        with console.capture() as capture:
            workbench.tell_where(bench)
        told = capture.get()
        assert f"Workbench: {bench.url}/?token={TOKEN} " in told
        assert bool(access.owner_token) == (not options)
        assert (f"can anything be changed: {bench.url}/?token={access.owner_token}\n" in told) == (not options)
        assert ("has the map, and may change it." in told) == ("allow_edit" in options)
        with page(bench) as (_, session):
            assert session.may("edit") == session.may("drive") == ("allow_edit" in options)


@pytest.mark.slow
def test_a_page_has_what_its_person_may(tmp_path):
    with toy_target(tmp_path) as target:
        bench = target.closed
        for owner in (False, True):
            with page(bench, owner=owner) as (_, session):
                assert session.wait_idle() and session.role == ("owner" if owner else "visitor")
                assert session.may("edit") == session.may("drive") == (MendPanel in session.panels) == owner
                for label in ("Delete …", "Rename …", "Restore …", "Stop …", "Resume", "Drive the real robot"):
                    assert bool(named(session, label)) == owner
                assert all(named(session, label) for label in ("Recording", "Command", "Colours"))
                if not owner:
                    with pytest.raises(InputError, match="expected the owner's page, found a visitor's"):
                        panel.Question(session, "Delete?", "", {})
        assert ask(bench.port, "/", Simaps_Role="owner").status == 401
        bench.services = toy_services(judging=JudgingSession(tmp_path / "runs.jsonl", []))
        for owner in (False, True):
            with page(bench, owner=owner) as (_, session):
                assert (JudgePanel in session.panels) == owner


@pytest.mark.slow
def test_what_an_owner_does_is_done_and_can_be_undone(tmp_path):
    """The messages that the attacks forge are those that work on the page of who may."""
    with toy_target(tmp_path) as target:
        library, edits = tmp_path / "library", tmp_path / "toy.edits.json"
        own, trashed = library / f"{OWN}.rrd", library / ".trash" / f"{OWN}.rrd"
        with page(target.closed, owner=True) as (mine, session):
            assert session.wait_idle()
            there = len(session.simap.instances)
            session.select(session.simap.instances[0].id)
            press(mine, session, "Divide, remove", "Delete")
            assert wait(lambda: len(session.simap.instances) == there - 1) and edits.is_file()
            press(mine, session, "Last edit", "Undo")
            assert wait(lambda: len(session.simap.instances) == there)

            choose_own(mine, session)
            settle(mine, session)
            before = own.read_bytes()
            press(mine, session, "Delete …")
            assert wait(lambda: named(session, "Move to the trash")) and own.is_file()
            press(mine, session, "Move to the trash")
            press(mine, session, "Move to the trash")  # once is enough, and twice does no more
            assert wait(lambda: trashed.is_file() and not own.exists())
            settle(mine, session)
            press(mine, session, "Restore …")
            label = f"{OWN} · {trashed.stat().st_size / 1e6:.1f} MB"
            assert wait(lambda: named(session, label)) and press(mine, session, label)
            assert wait(lambda: own.is_file() and not trashed.exists()) and own.read_bytes() == before

            press(mine, session, "Stop …")
            assert wait(lambda: named(session, "Stop now")) and not (tmp_path / "stopped").exists()
            press(mine, session, "Stop now")
            assert wait((tmp_path / "stopped").is_file)


@pytest.mark.slow
def test_an_answer_counts_for_the_file_as_it_was_and_for_a_while(tmp_path, monkeypatch):
    with toy_target(tmp_path) as target, page(target.bench) as (mine, session):
        done: list[str] = []
        asked = panel.Question(session, "Twice?", "", {"Yes": lambda: done.append("once")})
        for _ in range(2):  # two presses that arrive before the dialog is gone
            asked._answer(lambda: done.append("once"))
        assert session.wait_idle() and done == ["once"]
        own = tmp_path / "library" / f"{OWN}.rrd"
        assert session.wait_idle()
        monkeypatch.setattr(session, "_notify", lambda title, text, *_: told.append(text))
        told: list[str] = []
        choose_own(mine, session)
        settle(mine, session)
        for change, words in (
            (lambda: os.utime(own, (1, 1)), "expected the file as it was when you were asked"),
            (lambda: monkeypatch.setattr(panel, "ANSWER_S", 0.0), "nothing was done"),
        ):
            press(mine, session, "Delete …")
            assert wait(lambda: named(session, "Move to the trash"))
            change()
            press(mine, session, "Move to the trash")
            assert wait(lambda words=words: told and words in told[-1]) and own.is_file()
            assert not named(session, "Move to the trash")
