"""The Command tab as a person meets it: Debian's Chromium on a workbench with a real robot on the toy map."""

import re

import pytest
from browser import (
    PATIENCE_S,
    field_of,
    mine,
    open_workbench,
    toy_workbench,
    until,
    wait_for_color,
    watched_page,
)
from chat_server import hangs, serving, writes
from playwright.sync_api import expect
from services import real_services

from simaps_viz.app import workbench
from simaps_viz.colors.classes import instance_color
from simaps_viz.drawing.texture import cell_colors
from simaps_viz.language.commands import Reading, read_command
from simaps_viz.navigation.agent import answer
from simaps_viz.viewer.panels.command import CommandPanel

MARKED = "[aria-current=step]"


@pytest.fixture(scope="module")
def opened(browser):
    with toy_workbench(real_services()) as bench, watched_page(browser) as page:
        open_workbench(page, bench)
        yield bench, page


@pytest.fixture
def page(page):
    open_tab(page)
    return page


def open_tab(page):
    page.get_by_role("tab", name="Command", exact=True).click()


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def say(session, page, command, *, by="Enter"):
    """Return a command. Each change waits for the one before: viser's page sends only the last of any 50 ms."""
    box = field_of(page, "Command")
    box.fill(command)
    if by == "Enter":
        box.press("Enter")
    else:
        until(page, lambda: session.panels[CommandPanel].texts[0] == command)
        press(page, by)
    until(page, lambda: session.panels[CommandPanel]._past and session.panels[CommandPanel]._past[0].command == command)


def hurry(session, page, speed="8"):
    """Set the speed and wait until the robot has it, for the reason that ``say`` has."""
    box = field_of(page, "Speed")
    box.fill(speed)
    box.press("Enter")
    box.blur()
    until(page, lambda: session.panels[CommandPanel]._drive.speed == float(speed))


CRAWL = 0.02
"""A speed at which a ride is still under way after whatever a page may take."""


def test_a_command_is_explained_numbered_marked_and_driven(bench, page):
    mine(bench).panels[CommandPanel]._drive.speed = CRAWL
    say(mine(bench), page, "go to the third chair from here")
    expect(page.get_by_text("On the way")).to_be_visible()
    expect(page.locator(MARKED)).to_contain_text('robot.move_to_nth_closest("chair", 3)')
    expect(page.locator(".simaps-other:visible")).to_have_count(2)
    numbers = {one.text.split(" · ")[0]: one for one in mine(bench).scene.texts["command"] if one.text}
    assert {one.text for one in numbers.values()} == {*page.locator(".simaps-text:visible").all_inner_texts()}
    chosen = (
        answer(mine(bench).simap, "go to the third chair from here", mine(bench).panels[CommandPanel]._asked_at)
        .goals[0]
        .instance
    )
    assert set(numbers) == {"1", "2", "▶ 3"} and mine(bench).panels[CommandPanel].driving
    assert chosen is not None and numbers["▶ 3"].x == pytest.approx(mine(bench).simap.by_id(chosen).centroid_m[0])
    expect(page.get_by_text("Chair 4 is the farthest of 3 from where the command was given")).to_be_visible()
    simap, rest = mine(bench).simap, next(one.id for one in mine(bench).simap.of_class("chair") if one.id != chosen)
    place, colors = simap.by_id(rest).centroid_m[:2], cell_colors(simap, "instance", lit=frozenset({chosen}))
    wait_for_color(bench, page, place, colors[simap.instance == rest][0])  # all but the target is pale
    page.wait_for_function("() => window.__viserMutable.nodeRefFromName['/target']")  # which is outlined
    hurry(mine(bench), page)
    expect(page.get_by_text("Done")).to_be_visible()
    said = answer(mine(bench).simap, "go to the third chair from here", mine(bench).panels[CommandPanel]._asked_at)
    assert (mine(bench).pose.x_m, mine(bench).pose.y_m) == pytest.approx((said.final_pose.x_m, said.final_pose.y_m))
    expect(page.locator(MARKED)).to_have_count(0)
    wait_for_color(bench, page, place, instance_color(rest))
    expect(page.locator(".simaps-meant:visible")).to_have_text(
        re.compile("^▶ 3 · chair 4")
    )  # the target stays numbered, and outlined, until nothing is selected
    page.wait_for_function("() => window.__viserMutable.nodeRefFromName['/target']")
    page.keyboard.press("Escape")
    page.wait_for_function("() => !window.__viserMutable.nodeRefFromName['/target']")


def test_step_by_step_then_play_then_pause_then_stop(bench, page):
    hurry(mine(bench), page, "4")
    say(mine(bench), page, "turn right, turn right, then go to the couch", by="Step")
    expect(page.locator(MARKED)).to_contain_text("robot.turn(90)")
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible()
    page.wait_for_timeout(400)
    assert mine(bench).pose.heading_deg == pytest.approx(90.0)  # held before the first line
    press(page, "Step")
    until(page, lambda: mine(bench).pose.heading_deg == pytest.approx(180.0))
    until(page, lambda: mine(bench).panels[CommandPanel]._drive.paused)
    press(page, "Step")
    until(page, lambda: mine(bench).pose.heading_deg % 360 == pytest.approx(270.0))
    expect(page.locator(MARKED)).to_contain_text('robot.move_to_object("couch")')
    before = mine(bench).pose
    mine(bench).panels[CommandPanel]._drive.speed = CRAWL
    press(page, "Play")
    until(page, lambda: mine(bench).pose != before)
    expect(page.get_by_role("button", name="Pause", exact=True)).to_be_visible()
    press(page, "Pause")
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible()
    held = mine(bench).pose
    page.wait_for_timeout(400)
    assert mine(bench).pose == held
    press(page, "Stop")
    expect(page.get_by_text("The robot stands where it was stopped.")).to_be_visible()
    assert mine(bench).pose == held and not mine(bench).panels[CommandPanel].driving
    hurry(mine(bench), page)
    say(mine(bench), page, "go to the couch")
    expect(page.get_by_text("Done")).to_be_visible()


def test_a_refusal_names_what_the_map_lacks(bench, page):
    say(mine(bench), page, "go to the piano")
    expect(page.get_by_text("Refused")).to_be_visible()
    expect(page.get_by_text("There is no piano on this map.")).to_be_visible()
    examples = page.get_by_text("Examples", exact=True)
    expect(examples).to_be_visible()
    expect(page.get_by_text("These work here, for example:")).to_be_visible()
    say(mine(bench), page, "sing me a song")
    expect(page.get_by_text("Not understood").first).to_be_visible()
    assert not page.get_by_text("Try: ").all()  # what a button has is not said once more
    say(mine(bench), page, "go to the piano")
    offered = page.get_by_role("button", name="go to the couch", exact=True)
    expect(offered.first).to_be_visible()
    command = offered.first.inner_text()
    offered.first.click()
    expect(page.get_by_text("Done")).to_be_visible()
    expect(page.get_by_text("These work here")).to_be_hidden()
    assert (
        mine(bench).panels[CommandPanel]._past[0].command == command
        and field_of(page, "Command").input_value() == command
    )
    say(mine(bench), page, "go to the ninth chair")
    expect(page.get_by_text("There are only 3 chairs on this map; the 9th was asked for.")).to_be_visible()


def test_the_history_runs_again_and_outlives_a_reload(bench, page):
    hurry(mine(bench), page)
    say(mine(bench), page, "turn left")
    expect(page.get_by_text("Done")).to_be_visible()
    say(mine(bench), page, "go to the piano")
    expect(page.get_by_text("Refused")).to_be_visible()
    page.reload()
    open_tab(page)
    expect(page.get_by_text("There is no piano")).to_be_visible()
    expect(page.get_by_role("button", name="go to the piano")).to_be_attached()
    turned = (mine(bench).pose.heading_deg - 90.0) % 360.0
    page.get_by_role("button", name="turn left").click()
    until(page, lambda: mine(bench).pose.heading_deg % 360.0 == pytest.approx(turned))
    expect(page.get_by_text("Done")).to_be_visible()
    assert [past.command for past in mine(bench).panels[CommandPanel]._past] == ["turn left", "go to the piano"]


def two_readings(text, counts):
    """Read "there" in two ways, everything else by grammar."""
    if text != "go there":
        return read_command(text, counts)
    return Reading('robot.move_to_object("couch")', ("there is the couch",), ('robot.move_to_object("potted plant")',))


@pytest.fixture
def read_in_two_ways(bench):
    """Let the robot of the page take "there" for either of two things."""
    before = bench.services.ask
    object.__setattr__(bench.services, "ask", lambda *asked, robot: answer(*asked, reader=two_readings))
    yield
    object.__setattr__(bench.services, "ask", before)


def test_the_other_reading_starts_where_the_command_was_given(bench, page, read_in_two_ways):
    hurry(mine(bench), page)
    say(mine(bench), page, "go there")
    expect(page.get_by_text("there is the couch")).to_be_visible()
    expect(page.get_by_text('robot.move_to_object("potted plant")')).to_be_visible()
    expect(page.get_by_text("Done")).to_be_visible()
    start, couch = mine(bench).panels[CommandPanel]._asked_at, mine(bench).pose
    press(page, "Run the other reading")
    plant = answer(mine(bench).simap, 'robot.move_to_object("potted plant")', start).final_pose
    until(page, lambda: mine(bench).pose == plant)
    expect(page.get_by_text('robot.move_to_object("couch")')).to_be_visible()
    press(page, "Run the other reading")  # and back again
    until(page, lambda: mine(bench).pose == couch)


def test_a_language_model_is_asked_shown_and_stopped(browser):
    with serving(writes('robot.move_to_object("couch")'), hangs) as server:
        services = real_services(model=workbench.language_model(f"polyglot@{server.url}"))
        with toy_workbench(services) as bench, watched_page(browser) as page:
            open_workbench(page, bench)
            open_tab(page)
            hurry(mine(bench), page)
            say(mine(bench), page, "va au canapé")
            expect(page.get_by_text("Done")).to_be_visible()
            expect(page.get_by_text("by polyglot")).to_be_visible()
            page.get_by_text("Sent to the language model").click()
            expect(page.get_by_text("sent (system)")).to_be_visible()
            say(mine(bench), page, "encore")
            expect(page.get_by_text("Asking polyglot")).to_be_visible()
            until(page, lambda: len(server.received) == 2)
            press(page, "Stop")
            expect(page.get_by_text("The wait for an answer has ended")).to_be_visible()
            assert server.left.wait(PATIENCE_S)
            field_of(page, "Language model").uncheck()
            until(page, lambda: not mine(bench).panels[CommandPanel].uses_model)
            say(mine(bench), page, "turn left")
            expect(page.get_by_text("Done")).to_be_visible()
            assert len(server.received) == 2
