"""Recorded builds in a real browser: the list beside the map, and a recording on a page of its own."""

from pathlib import Path

import pytest
import rerun as rr
from browser import field_of, until, watched_page
from playwright.sync_api import Browser, Locator, Page, expect
from stub_page import StubPage, stub_page
from toy_maps import toy_map

from simaps_viz.cli.recordings import open_alone
from simaps_viz.errors import InputError
from simaps_viz.recorder.facts import finished_facts, send_facts
from simaps_viz.recorder.library import RecordingLibrary
from simaps_viz.viewer.panels.recordings import RecordingsPanel
from simaps_viz.viewer.server.access import Access


def record(path: Path, name: str) -> Path:
    stream = rr.RecordingStream("simaps", recording_id=name)
    stream.set_sinks(rr.FileSink(str(path)))
    stream.set_log_time_enabled(False)
    stream.send_recording_name(name)
    send_facts(stream, finished_facts(toy_map()))
    for frame in range(3):
        stream.set_time("frame", sequence=frame)
        stream.log("/note", rr.TextLog(f"{name}, frame {frame}"))
    stream.flush()
    stream.disconnect()
    return path


@pytest.fixture
def library(tmp_path) -> RecordingLibrary:
    record(tmp_path / "café.rrd", "the café")
    (tmp_path / "broken.rrd").write_bytes(b"RRF2")
    return RecordingLibrary([tmp_path])


def open_page(page: Page, desk: StubPage) -> None:
    assert desk.wait_idle()  # the list is made
    page.goto(desk.url)
    page.get_by_text("Recorded builds", exact=True).click()
    page.get_by_role("button", name="List again").wait_for()


def button(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=name, exact=True)


def choose(page: Page, text: str) -> None:
    field_of(page, "Recording").click()
    page.get_by_role("option", name=text).click()


def test_list_open_rename_delete(browser: Browser, library: RecordingLibrary):
    folder = library.folders[0]
    with stub_page(toy_map()) as desk, watched_page(browser) as page:
        desk.recording.url = ""
        panel = RecordingsPanel(desk, library)
        open_page(page, desk)
        choose(page, "café")
        table = page.locator("table")
        for words in (
            "the café",
            "paper (K 5 %, resolution 1)",
            "frames\t5",
            "seen from above\t7 instances",
            "simulated\tyes",
        ):
            until(page, lambda words=words: words in table.inner_text())
        assert str(folder / "café.rrd") in table.inner_text() and "0.0 MB" in table.inner_text()
        button(page, "Show it beside the map").click()
        until(page, lambda: desk.said[-1:] == [("Recording", "café is shown beside the map.")])
        assert desk.opened == [folder / "café.rrd"]

        button(page, "Rename …").click()
        expect(field_of(page, "New name")).to_have_value("café")
        field_of(page, "New name").fill("bar")
        typed = desk.gui._gui_input_handle_from_uuid
        until(page, lambda: "bar" in [one._impl.value for one in typed.values()])  # viser sends it a moment later
        button(page, "Save the name").click()
        until(page, lambda: str(folder / "bar.rrd") in table.inner_text())
        assert (folder / "bar.rrd").is_file() and not (folder / "café.rrd").exists()
        assert panel.chosen is not None and panel.chosen.name == "bar"

        button(page, "Delete …").click()
        expect(page.get_by_role("dialog")).to_contain_text("It can be restored from the trash")
        button(page, "Cancel").click()
        expect(page.get_by_role("dialog")).to_have_count(0)
        assert (folder / "bar.rrd").is_file()
        expect(button(page, "Restore …")).to_have_count(0)
        button(page, "Delete …").click()
        button(page, "Move to the trash").click()
        until(page, lambda: desk.said[-1] == ("Recording", "bar was moved to the trash."))
        assert sorted(p.name for p in folder.glob("*.rrd")) == ["broken.rrd"]
        button(page, "Restore …").click()
        page.get_by_role("dialog").get_by_role("button", name="bar").click()
        until(page, lambda: desk.said[-1] == ("Recording", "bar was restored."))
        assert sorted(p.name for p in folder.glob("*.rrd")) == ["bar.rrd", "broken.rrd"] and desk.errors == []


def test_what_ships_is_shown_without_the_buttons(browser: Browser, library: RecordingLibrary):
    (library.folders[0] / ".git").mkdir()
    with stub_page(toy_map()) as desk, watched_page(browser) as page:
        RecordingsPanel(desk, library)
        open_page(page, desk)
        choose(page, "café")
        expect(page.locator("table")).to_contain_text("lies under version control")
        for name in ("Rename …", "Delete …", "Restore …"):
            expect(button(page, name)).to_have_count(0)


def test_what_cannot_be_opened_says_so_and_nothing_at_all_too(browser: Browser, library: RecordingLibrary):
    folder = library.folders[0]
    with stub_page(toy_map()) as desk, watched_page(browser) as page:
        desk.recording.url = ""
        RecordingsPanel(desk, library)
        open_page(page, desk)
        choose(page, "broken")
        expect(page.get_by_text("It cannot be opened")).to_be_visible()
        expect(button(page, "Show it beside the map")).to_be_disabled()
        (folder / "broken.rrd").unlink()
        button(page, "Delete …").click()
        button(page, "Move to the trash").click()
        until(page, lambda: desk.errors)
        assert isinstance(desk.errors[-1], InputError) and "found none" in str(desk.errors[-1])
        (folder / "café.rrd").unlink()
        button(page, "List again").click()
        expect(page.get_by_text("simaps build SEQUENCE -o MAP.npz --record MAP.rrd")).to_be_visible()
        expect(button(page, "Delete …")).to_have_count(0)


def test_who_has_the_token_sees_a_recording_alone_and_another_in_its_place(browser: Browser, tmp_path: Path):
    one, two = record(tmp_path / "one.rrd", "first"), record(tmp_path / "two.rrd", "second")
    door = open_alone(one, access=Access(token="A-token_of_0123456789_abcdefghij"))
    host = door.hosts["rerun"]
    host.recordings["two.rrd"] = two
    try:
        with watched_page(browser) as page:
            page.goto(door.entrance)
            note = "first (simulated). A recorded build alone, without its map"
            assert page.locator("#note").inner_text().startswith(note)

            def front() -> str | None:
                events = page.evaluate("window.simapsEvents")
                return events[-1]["recording_id"] if events else None

            until(page, lambda: front() == "first")
            host.push({"show": "/recordings/two.rrd"})
            until(page, lambda: front() == "second")
            host.push({"show": "/recordings/one.rrd"})
            until(page, lambda: front() == "first")
            box, canvas = page.locator("#note").bounding_box(), page.locator("canvas").bounding_box()
            assert box and canvas and canvas["y"] >= box["y"] + box["height"] - 1
            assert canvas["y"] + canvas["height"] == pytest.approx(800, abs=1)
    finally:
        door.close()
