"""The map under a person's hands: names, the object under the pointer, the legend, dragging, the wheel, north."""

import re
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from browser import (
    CLOSE_ALL,
    at_rest,
    free_port,
    mine,
    on_canvas,
    open_workbench,
    page_is_there,
    place_on,
    toy_services,
    until,
    watched_page,
)
from playwright.sync_api import expect
from toy_maps import TOY_POSE, furnished_map, toy_map

from simaps_viz.drawing.texture import MapPicture
from simaps_viz.structures import Pose2
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.map import MapPanel
from simaps_viz.viewer.scene.annotations import Label, label_of
from simaps_viz.viewer.scene.camera import SLANT, TOP
from simaps_viz.viewer.workbench import Workbench

HOSTILE = "<img src=x onerror=alert(1)>"
CHAIR, FLOOR = (1.25, 1.9), (0.3, -0.4)
"""The middle of chair 1, and open floor, metres."""


@pytest.fixture(scope="module")
def opened(browser):
    simap = toy_map()
    plant = simap.of_class("potted plant")[0]
    others = tuple(replace(one, label=HOSTILE) if one is plant else one for one in simap.instances)
    simap = replace(simap, instances=others)
    with Workbench(simap, services=toy_services(), port=free_port(), start=TOY_POSE) as workbench:
        assert workbench.wait_idle()
        with watched_page(browser) as page:
            open_workbench(page, workbench)
            yield workbench, page


@pytest.fixture
def page(page):
    expect(page.locator(".simaps-name:visible").first).to_be_visible()
    return page


def names(page):
    return page.locator(".simaps-name:visible").all_inner_texts()


WERE = """() => {
  const box = document.querySelector('.simaps-names').getBoundingClientRect();
  return [...document.querySelectorAll('.simaps-names > [hidden]')]
    .map((one) => one.style.transform.match(/-?[\\d.]+/g)).map(([x, y]) => [box.x + Number(x), box.y + Number(y)]);
}"""
"""Where names that are not there any more were last."""
BOXES = """() => [...document.querySelectorAll('.simaps-name')].filter((one) => one.checkVisibility())
  .map((one) => one.getBoundingClientRect())"""
"""Of all names at once: they may be moving."""


def drawn(page, place):
    """Whether the overlay has a line within 3 px of a place of the page."""
    return page.evaluate(
        """([x, y]) => {
          const canvas = document.querySelector('.simaps-drawing'), box = canvas.getBoundingClientRect();
          const pixels = canvas.getContext('2d').getImageData(x - box.x - 3, y - box.y - 3, 7, 7).data;
          return pixels.some((value, i) => i % 4 === 3 && value > 100);
        }""",
        list(place),
    )


def test_what_is_under_the_pointer_is_outlined_and_said_as_text(bench, page):
    simap, hint = bench.simap, page.locator(".simaps-hint")

    def says(one):  # a page that has just come may still be fitting its map
        page.mouse.move(*on_canvas(bench, page, *one.centroid_m[:2]))
        area = one.cells * simap.spec.cell_size_m**2
        return hint.count() and hint.inner_text() == f"{one.name} · {area:.2f} m² · confidence {one.score:.2f}"

    for one in simap.instances:
        until(page, lambda one=one: says(one))
        (x0, y0, _), (x1, y1, _) = one.aabb_m
        for corner in ((x0, (y0 + y1) / 2), (x1, (y0 + y1) / 2), ((x0 + x1) / 2, y0), ((x0 + x1) / 2, y1)):
            until(page, lambda corner=corner: drawn(page, on_canvas(bench, page, *corner)))
    assert page.locator(".simaps-over img").count() == 0  # a class is a text, whatever it is
    page.mouse.move(*on_canvas(bench, page, *FLOOR))
    expect(hint).to_have_text("floor")  # and where nothing is, what is there instead
    until(page, lambda: not drawn(page, on_canvas(bench, page, *simap.instances[0].aabb_m[0][:2])))


def test_the_robot_says_what_it_is(bench, page):
    pose = mine(bench).pose
    page.mouse.move(*on_canvas(bench, page, pose.x_m, pose.y_m))
    expect(page.locator(".simaps-hint")).to_have_text("The robot: commands start here, it looks along the arrow")


HEADING = """() => {
  const arrow = document.querySelector('.simaps-heading :last-child').getBoundingClientRect();
  return [arrow.x + arrow.width / 2, arrow.y + arrow.height / 2, Math.max(arrow.width, arrow.height)];
}"""


DISC = """() => {
  const disc = document.querySelector('.simaps-heading :nth-child(2)');
  const { stroke, strokeWidth } = getComputedStyle(disc);
  return { stroke, rim: parseFloat(strokeWidth) / 2, width: disc.getBoundingClientRect().width };
}"""


def test_an_arrow_as_large_at_every_zoom_shows_where_the_robot_looks(bench, page):
    session, wheel = mine(bench), 0
    for heading, wheel in ((90.0, 0), (180.0, 0), (270.0, 480), (0.0, -960)):
        session.panels[CommandPanel]._put_robot(Pose2.from_heading(0.5, 0.5, heading))
        at = on_canvas(bench, page, 0.5, 0.5)
        page.mouse.move(*at)
        page.mouse.wheel(0, wheel)
        at_rest(page)
        ahead = np.array([np.sin(np.radians(heading)), -np.cos(np.radians(heading))])  # on the screen, y down

        disc = page.evaluate(
            DISC
        )  # as large as the robot at least, rimmed in white, which is seen on a photo of any colour
        assert disc["stroke"] == "rgb(255, 255, 255)" and disc["width"] >= 28 and disc["rim"] >= 2

        def seen(ahead=ahead):
            x, y, long = page.evaluate(HEADING)
            away = np.subtract((x, y), place_on(page, bench.simap, 0.5, 0.5))
            return long >= 18 and away @ ahead > 14 and abs(away @ ahead[::-1]) < 3

        until(page, seen)
    assert page.evaluate("() => Object.keys(window.__viserMutable.nodeRefFromName).includes('/robot/nose')") is False


def test_on_a_map_that_was_cut_anew_nothing_has_the_name_it_had_before(bench, page, monkeypatch):
    """Its names come a moment later; until then there are none."""
    session, hint = mine(bench), page.locator(".simaps-hint")
    whole = session.simap
    page.mouse.move(*on_canvas(bench, page, *CHAIR))
    expect(hint).to_contain_text("chair 1 ")
    monkeypatch.setattr("simaps_viz.viewer.page.page.LATER_S", 3600.0)
    session.cut_map(30.0, 1.0)
    expect(page.locator(".simaps-name:visible")).to_have_count(0)
    expect(hint).to_be_hidden()
    assert session.simap is not whole
    assert "Looking for what changed" in page.locator(".simaps-change").inner_text()
    monkeypatch.setattr("simaps_viz.viewer.page.page.LATER_S", 0.0)
    session.repaint()
    session.submit("steps", lambda: None)
    expect(hint).to_contain_text("chair 1 ")  # though the pointer rests
    expect(page.locator(".simaps-name:visible").first).to_be_visible()
    assert session.wait_idle() and "before)" in page.locator(".simaps-change").inner_text()


CHANGES = """() => new Promise((done) => {
  const changes = [];
  const observer = new MutationObserver((seen) => changes.push(...seen.map((one) =>
    `${one.type} ${one.attributeName} of ${one.target.nodeName} ${one.target.className}`)));
  observer.observe(document, { subtree: true, childList: true, attributes: true, characterData: true });
  let left = 30;
  const draw = () => { if (--left) requestAnimationFrame(draw); else { observer.disconnect(); done(changes); } };
  draw();
})"""


@pytest.mark.parametrize("view", [TOP, SLANT])
def test_a_page_at_rest_changes_nothing_of_itself(bench, page, view):
    """What is set anew at every picture is laid out and drawn at every picture, also to the value that it had."""
    session = mine(bench)
    session.select(session.simap.of_class("chair")[0].id)
    session.look(view)
    assert session.wait_idle()
    page.mouse.move(5, 5)
    at_rest(page)
    found = []
    until(page, lambda: found.append(page.evaluate(CHANGES)) or not found[-1] or len(found) > 20)
    assert found[-1] == []


def test_names_come_with_the_zoom_large_objects_first_and_never_cover_one_another(bench, page):
    session, before = mine(bench), names(page)
    assert {"couch 5", "dining table 6"} <= set(before)
    for _ in range(3):
        boxes = page.evaluate(BOXES)
        assert len(boxes) > 1
        for a, b in combinations(boxes, 2):
            beside = a["right"] <= b["x"] + 0.5 or b["right"] <= a["x"] + 0.5
            assert beside or a["bottom"] <= b["y"] + 0.5 or b["bottom"] <= a["y"] + 0.5
        far = mine(bench).client.camera.position[2]
        page.mouse.move(*on_canvas(bench, page, *CHAIR))
        page.mouse.wheel(0, -240)
        settled(bench, page, lambda camera, far=far: camera.position[2] < 0.95 * far)
    until(page, lambda: "chair 1" in names(page))
    session.select(bench.simap.instances[0].id)
    expect(page.locator(".simaps-hint")).to_contain_text("chair 1")  # it is under the pointer, and said once
    expect(page.locator(".simaps-chosen:visible")).to_have_count(0)
    page.mouse.move(1200, 300)
    expect(page.locator(".simaps-chosen")).to_have_text("chair 1")
    session.select(None)
    expect(page.locator(".simaps-chosen:visible")).to_have_count(0)
    until(page, lambda: "chair 1" in names(page))  # with the others, as why it is one is no longer drawn


def test_where_a_name_was_before_the_map_moved_is_no_longer_its_object(bench, page):
    """A stool was selected by a press on what lay where its name had been."""
    session, hint = mine(bench), page.locator(".simaps-hint")
    many = len(names(page))
    canvas = page.locator("canvas").first.bounding_box()
    page.mouse.move(canvas["x"] + 60, canvas["y"] + 30)
    page.mouse.down()
    page.mouse.move(canvas["x"] + 0.8 * canvas["width"], canvas["y"] + 40, steps=8)
    page.mouse.up()
    until(page, lambda: len(names(page)) < many)
    page.wait_for_timeout(500)
    was = page.evaluate(WERE)
    assert was
    (x0, y0), (x1, y1) = (on_canvas(bench, page, x, x) for x in (0.0, 1.0))
    for x, y in was:
        here = session.simap.at((x - x0) / (x1 - x0), (y - y0) / (y1 - y0))
        page.mouse.move(x, y)
        page.wait_for_timeout(200)
        boxes = dict(zip(names(page), page.evaluate(BOXES), strict=True))
        named = [one for one, box in boxes.items() if box["x"] < x < box["right"] and box["y"] < y < box["bottom"]]
        allowed = {*named, *([here.name] if here else [])}
        said = hint.inner_text() if hint.is_visible() else ""
        assert not re.search(r" \d+ · ", said) or said.partition(" · ")[0] in allowed, (said, allowed)


def test_no_name_stands_on_the_middle_of_another_larger_object(browser):
    """On a phone the refrigerator's own name has no room beside the counter's, and the plant's would lie on it."""
    row = ["counter", 1.0, 6.0, 3.0, 6.9, 0.9], ["refrigerator", 3.0, 6.0, 3.7, 6.9, 1.8]
    simap = furnished_map({"size_m": [8, 8], "walls": [], "things": [*row, ["potted plant", 3.7, 6.2, 4.2, 6.7, 1.0]]})
    counter, refrigerator, plant = (simap.of_class(label)[0] for label in ("counter", "refrigerator", "potted plant"))
    with (
        Workbench(simap, services=toy_services(), port=free_port(), start=Pose2(4.0, 2.0, 0.0)) as bench,
        watched_page(browser, 420, 860) as page,
    ):
        open_workbench(page, bench)
        page.locator(".simaps-name:visible", has_text=counter.name).wait_for()
        at_rest(page)
        assert not {refrigerator.name, plant.name} & set(names(page))
        page.mouse.move(*on_canvas(bench, page, *refrigerator.centroid_m[:2]))

        def both_are_named():  # once one is near enough
            page.mouse.wheel(0, -240)
            at_rest(page)
            return {refrigerator.name, plant.name} <= set(names(page))

        until(page, both_are_named)


def test_of_a_class_shown_alone_all_are_named_where_their_names_have_room_and_what_is_long_has_its_name(browser):
    row = [["refrigerator", 2.0, y, 2.35, y + 0.4, 1.8] for y in (2.0, 2.9, 3.8)]
    beside = [["suitcase", 2.4, y, 2.9, y + 0.45, 0.6] for y in (2.0, 2.9, 3.8)]  # larger, and their middles are near
    things = [*row, *beside, ["coffee table", 6.0, 2.0, 6.4, 3.5, 0.4]]
    simap = furnished_map({"size_m": [8, 8], "walls": [], "things": things})
    fridges, (table,) = {one.name for one in simap.of_class("refrigerator")}, simap.of_class("coffee table")
    assert len(fridges) == 3
    with (
        Workbench(simap, services=toy_services(), port=free_port(), start=Pose2(4.0, 6.0, 0.0)) as bench,
        watched_page(browser) as page,
    ):
        open_workbench(page, bench)
        until(page, lambda: table.name in names(page))
        assert not fridges & set(names(page))
        mine(bench).panels[MapPanel].show_only("refrigerator")
        until(page, lambda: set(names(page)) == fridges)
        boxes = page.evaluate(BOXES)
        assert all(apart(a, b) for a, b in combinations(boxes, 2))


def test_a_neighbour_with_a_number_is_outlined_and_named_once_with_a_line_to_it_where_it_is_away(bench, page):
    session, chair, couch = mine(bench), bench.simap.by_id(1), bench.simap.of_class("couch")[0]
    until(page, lambda: couch.name in names(page))
    x, y, _ = couch.centroid_m
    far = Label("couch · 3 %", x, y, 1.5, 0.2, away_x=-1.0, id=couch.id)
    session.scene.texts.show("why", [far])
    until(page, lambda: [one["text"] for one in page.evaluate(TEXTS)] == ["couch · 3 %"])
    assert couch.name not in names(page) and chair.name != couch.name
    (x0, y0, _), (_, y1, _) = couch.aabb_m
    until(page, lambda: drawn(page, place_on(page, bench.simap, x0, (y0 + y1) / 2)))
    text = page.evaluate(TEXTS)[0]
    end = np.array([text["left"], (text["top"] + text["bottom"]) / 2])
    middle = np.array(place_on(page, bench.simap, x, y))
    end[0] = min(max(middle[0], text["left"]), text["right"])
    end[1] = min(max(middle[1], text["top"]), text["bottom"])
    until(page, lambda: all(drawn(page, end + share * (middle - end)) for share in (0.2, 0.4, 0.6, 0.8)))
    session.scene.texts.show("why", ())
    until(page, lambda: couch.name in names(page))


TEXTS = """() => [...document.querySelectorAll('.simaps-text')].filter((one) => one.checkVisibility())
  .map((one) => ({ text: one.textContent, ...one.getBoundingClientRect().toJSON() }))"""


def apart(a, b):
    """Whether two boxes of the page have nothing in common."""
    beside = a["right"] <= b["left"] + 0.5 or b["right"] <= a["left"] + 0.5
    return beside or a["bottom"] <= b["top"] + 0.5 or b["bottom"] <= a["top"] + 0.5


def test_texts_stand_beside_what_they_name_cover_nothing_of_it_and_follow_zoom_and_view(bench, page):
    session, simap = mine(bench), bench.simap

    def written(count):
        found = []
        until(page, lambda: found.append(page.evaluate(TEXTS)) or len(found[-1]) == count)
        assert all(apart(a, b) for a, b in combinations(found[-1], 2))
        return {one["text"]: one for one in found[-1]}

    def seen(one):
        """What an object covers of the page."""
        (x0, y0, _), (x1, y1, _) = one.aabb_m
        (left, bottom), (right, top) = (place_on(page, simap, *at) for at in ((x0, y0), (x1, y1)))
        return {"left": left, "right": right, "top": top, "bottom": bottom}

    chairs = simap.of_class("chair")
    chosen = label_of("▶ 9", simap.of_class("couch")[0])
    session.scene.show_candidates([chosen, *[label_of(f"{n} · {one.name}", one) for n, one in enumerate(chairs, 1)]])
    placed = written(4)
    assert placed.pop("▶ 9")
    for text, box in placed.items():
        assert all(apart(box, seen(one)) for one in chairs)
        thing, wide = seen(chairs[int(text[0]) - 1]), box["width"] / 2 + 60
        assert thing["left"] - wide < box["left"] + box["width"] / 2 < thing["right"] + wide
    for one in map(seen, chairs):  # which are outlined
        until(page, lambda one=one: drawn(page, (one["left"], (one["top"] + one["bottom"]) / 2)))
    pale = page.locator(".simaps-name:visible").all()  # the names of other objects are pale, and where there is room
    assert pale and all("simaps-pale" in one.get_attribute("class") for one in pale)
    boxes = page.evaluate(TEXTS.replace("simaps-text", "simaps-text, .simaps-name"))
    assert all(apart(a, b) for a, b in combinations(boxes, 2))
    x, y, _ = chairs[0].centroid_m
    east = Label("east", x, y, 0.2, 0.2, away_x=1.0)
    session.scene.show_candidates([east])
    assert written(1)["east"]["left"] > place_on(page, simap, x + 0.2, y)[0]
    crowd = [Label(f"{i} · 10.5 m", 1.0 + 0.02 * i, 0.5, 0.01, 0.01) for i in range(60)]
    session.scene.show_candidates(crowd)
    until(page, lambda: "0 · 10.5 m" in [one["text"] for one in page.evaluate(TEXTS)])
    few = len(page.evaluate(TEXTS))
    session.look_at((0.9, 0.3, 2.3, 0.7))
    until(page, lambda: len(page.evaluate(TEXTS)) > few)  # closer up there is room for more
    session.scene.show_candidates(())
    session.scene.texts.show("why", [Label("0.3", x, y)])
    until(page, lambda: [one["text"] for one in page.evaluate(TEXTS)] == ["0.3"])
    session.scene.show_candidates([east])
    until(page, lambda: [one["text"] for one in page.evaluate(TEXTS)] == ["east"])  # numbers of links wait
    session.scene.show_candidates(())
    session.scene.texts.show("why", ())
    session.select(chairs[0].id)
    session.look(SLANT)
    settled(bench, page, lambda camera: not upright(camera))
    name = page.locator(".simaps-chosen:visible")
    expect(name).to_have_text(chairs[0].name)  # above it, also where it stands
    top = chairs[0].aabb_m[1][2]
    until(page, lambda: name.bounding_box()["y"] < on_canvas(bench, page, x, y, z_m=top)[1])
    session.show_picture(MapPicture(simap.spec, np.full((4, 4, 4), 200, np.uint8)))
    expect(page.locator(".simaps-text:visible")).to_have_count(0)
    session.show_picture(None)
    expect(name).to_have_count(1)


def settled(bench, page, changed):
    until(page, lambda: changed(mine(bench).client.camera))
    at_rest(page)
    until(page, lambda: changed(mine(bench).client.camera) and page_is_there(bench, page, bench.simap))


def upright(camera):
    forward = np.subtract(camera.look_at, camera.position)
    return abs(forward[0]) < 0.01 * abs(forward[2]) and abs(forward[1]) < 0.01 * abs(forward[2])


def test_a_drag_moves_the_map_the_wheel_comes_closer_and_north_stays_up(bench, page):
    simap, camera = bench.simap, mine(bench).client.camera
    first = np.array(camera.position)
    start = on_canvas(bench, page, *CHAIR)
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + 60, start[1] - 40, steps=4)
    at_rest(page)  # of several moves between two pictures the controls take the first, and the rest with the next one
    page.mouse.move(start[0] + 120, start[1] - 80)
    page.mouse.up()
    settled(bench, page, lambda camera: np.abs(np.array(camera.position) - first)[:2].max() > 0.1)
    assert place_on(page, simap, *CHAIR) == pytest.approx((start[0] + 120, start[1] - 80), abs=4)
    assert mine(bench).selected is None  # a drag is no click
    assert upright(camera) and camera.up_direction == pytest.approx((0, 0, 1), abs=1e-6)
    # The wheel: what is under the pointer stays there.
    far = camera.position[2]
    here = (start[0] + 120, start[1] - 80)
    page.mouse.wheel(0, -300)
    settled(bench, page, lambda camera: camera.position[2] < 0.9 * far)
    assert place_on(page, simap, *CHAIR) == pytest.approx(here, abs=6)
    # Arrow keys move the map too.
    before = place_on(page, simap, *CHAIR)
    page.keyboard.press("ArrowLeft")
    until(page, lambda: place_on(page, simap, *CHAIR)[0] > before[0] + 30)
    at_rest(page)
    assert upright(camera)
    # The arrow of the north leads back to the whole map.
    page.get_by_role("button", name="North up").click()
    settled(bench, page, lambda camera: np.allclose(camera.position, first, atol=0.05))
    # On a slider the same keys move the slider, and leave the map where it is.
    before, percent = place_on(page, simap, *CHAIR), mine(bench).cut.percent
    page.get_by_role("slider", name="K (%)").first.focus()
    page.keyboard.down("ArrowRight")
    until(page, lambda: mine(bench).cut.percent > percent)
    page.wait_for_timeout(500)
    page.keyboard.up("ArrowRight")
    assert place_on(page, simap, *CHAIR) == pytest.approx(before, abs=1)


def test_the_scale_bar_is_as_long_as_it_says_and_follows_the_zoom(bench, page):
    bar = page.get_by_role("img", name="Scale")

    def length_m():
        number, unit = bar.inner_text().split()
        return float(number) * {"m": 1.0, "cm": 0.01}[unit]

    def fits():
        """Whether it is as long as that length on the floor, in pixels, a round one, and neither long nor short."""
        west, east = (place_on(page, bench.simap, x, CHAIR[1])[0] for x in (CHAIR[0], CHAIR[0] + length_m()))
        width = bar.bounding_box()["width"]
        return abs(width - (east - west)) < 1.0 and 40 <= width <= 111 and f"{length_m():.0e}"[0] in "125"

    until(page, fits)
    before = length_m()
    page.mouse.move(*on_canvas(bench, page, *CHAIR))
    for _ in range(4):
        far = mine(bench).client.camera.position[2]
        page.mouse.wheel(0, -300)
        settled(bench, page, lambda camera, far=far: camera.position[2] < 0.9 * far)
        until(page, fits)
    assert length_m() < before
    mine(bench).look(SLANT)
    expect(bar).to_be_hidden()  # a length is no longer the same everywhere


def test_the_north_arrow_turns_with_the_3d_view_and_turns_it_back(bench, page):
    needle = page.locator(".simaps-north svg")
    mine(bench).look(SLANT)
    settled(bench, page, lambda camera: not upright(camera))
    before = np.array(mine(bench).client.camera.position)
    x, y = on_canvas(bench, page, 2.0, 0.5)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 150, y, steps=5)
    page.mouse.up()
    until(page, lambda: abs(float(re.findall(r"-?[\d.]+", needle.get_attribute("style"))[0])) > 0.2)
    page.get_by_role("button", name="North up").click()
    settled(bench, page, lambda camera: np.allclose(camera.position, before, atol=0.05))
    until(page, lambda: abs(float(re.findall(r"-?[\d.]+", needle.get_attribute("style"))[0])) < 0.02)


def test_the_legend_points_shows_alone_and_fades(bench, page):
    simap, session = bench.simap, mine(bench)
    chairs = simap.of_class("chair")
    row = page.locator(".simaps-class[data-class=chair]")
    row.hover()
    until(page, lambda: all(drawn(page, on_canvas(bench, page, *one.aabb_m[0][:2])) for one in chairs))
    square = page.locator(f'.simaps-chip[data-one="{chairs[1].id}"]')  # of one chair: so are its colours
    square.hover()
    until(page, lambda: not drawn(page, on_canvas(bench, page, *chairs[0].aabb_m[0][:2])))
    assert drawn(page, on_canvas(bench, page, *chairs[1].aabb_m[0][:2]))
    square.click()
    until(page, lambda: session.selected == chairs[1].id)
    expect(page.get_by_role("tab", name="Instance", exact=True)).to_have_attribute("aria-selected", "true")
    session.select(None)
    page.get_by_role("tab", name="Map", exact=True).click()
    row.click()
    expect(row).to_have_attribute("aria-pressed", "true")
    page.mouse.move(5, 5)
    until(page, lambda: set(names(page)) <= {"chair", "chair 1", "chair 3", "chair 4"})
    row.click()
    expect(row).to_have_attribute("aria-pressed", "false")
    for back in (
        lambda: page.get_by_role("button", name="Only chairs are shown · show all").click(),
        lambda: page.keyboard.press("Escape"),
    ):
        page.get_by_role("tab", name="Map", exact=True).click()
        row.click()
        expect(page.locator(".simaps-alone")).to_be_visible()
        back()
        expect(page.locator(".simaps-alone")).to_be_hidden()
        expect(row).to_have_attribute("aria-pressed", "false")
    session.select(None)
    page.get_by_role("tab", name="Map", exact=True).click()
    expect(page.locator(".simaps-name", has_text="couch").first).to_be_visible()
    page.locator(".simaps-class[data-class=couch]").hover()
    page.get_by_role("button", name="Fade couch").click()
    expect(page.locator(".simaps-name", has_text="couch").first).to_be_hidden()
    assert session.panels[MapPanel].faded == {"couch"}
    row.click()  # beside a class that is shown alone, nothing would be seen of it
    expect(row).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Fade couch").click()
    expect(row).to_have_attribute("aria-pressed", "false")
    expect(page.locator(".simaps-name", has_text="couch").first).to_be_visible()


@pytest.fixture
def touched(browser, bench, opened):
    """A page of its own, on a touch screen of the width of a phone, and what puts fingers on it."""
    with watched_page(browser, 420, 860, has_touch=True) as page:
        open_workbench(page, bench)
        page.evaluate(CLOSE_ALL)  # what lies over the map
        expect(page.locator(".mantine-Notification-root")).to_have_count(0)
        cdp = page.context.new_cdp_session(page)

        def fingers(kind, *places):
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            cdp.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        yield page, fingers
    until(opened[1], lambda: len(bench.sessions) == 1)


def test_one_finger_moves_the_map_two_come_closer_and_a_tap_selects(bench, touched):
    page, fingers = touched
    simap, camera = bench.simap, mine(bench).client.camera
    start, far = np.array(on_canvas(bench, page, *CHAIR)), camera.position[2]
    fingers("touchStart", start)
    for step in (10, 20, 30, 40):
        at_rest(page)  # as above
        fingers("touchMove", np.add(start, (step, step / 2)))
    fingers("touchEnd")
    until(page, lambda: place_on(page, simap, *CHAIR) == pytest.approx(np.add(start, (40, 20)), abs=4))
    settled(bench, page, lambda camera: camera.position[2] == pytest.approx(far, rel=0.01))
    assert mine(bench).selected is None and upright(camera)
    # Two fingers: what is between them stays there, and is twice as large when they are twice as far apart.
    middle, (west, east) = np.array(place_on(page, simap, *CHAIR)), (np.array((-30.0, 0.0)), np.array((30.0, 0.0)))
    fingers("touchStart", middle + west, middle + east)
    for more in (1.25, 1.5, 1.75, 2.0):
        fingers("touchMove", middle + more * west, middle + more * east)
    fingers("touchEnd")
    settled(bench, page, lambda camera: camera.position[2] == pytest.approx(far / 2, rel=0.02))
    assert place_on(page, simap, *CHAIR) == pytest.approx(tuple(middle), abs=4)
    assert mine(bench).selected is None and upright(camera)
    fingers("touchStart", place_on(page, simap, *CHAIR))
    fingers("touchEnd")
    until(page, lambda: mine(bench).selected == simap.at(*CHAIR).id)


def test_two_fingers_come_closer_in_the_3d_view_as_well_as_far_as_they_move_apart(bench, touched):
    page, fingers = touched
    mine(bench).look(SLANT)
    settled(bench, page, lambda camera: not upright(camera))
    camera, middle, reach = mine(bench).client.camera, np.array((210.0, 230.0)), np.array((30.0, 0.0))
    far = np.linalg.norm(np.subtract(camera.position, camera.look_at))
    fingers("touchStart", middle - reach, middle + reach)
    for more in (1.25, 1.5, 1.75, 2.0):
        fingers("touchMove", middle - more * reach, middle + more * reach)
    fingers("touchEnd")

    def near(camera):
        return np.linalg.norm(np.subtract(camera.position, camera.look_at)) == pytest.approx(far / 2, rel=0.03)

    settled(bench, page, near)


@pytest.mark.parametrize("by", ["mouse", "finger"])
def test_a_press_on_a_name_selects_what_is_named_and_not_what_lies_under_it(bench, touched, by):
    page, fingers = touched
    couch, session = bench.simap.of_class("couch")[0], mine(bench)
    session.scene.show_candidates([label_of("Here", couch)])  # beside it
    name = page.locator(".simaps-text", has_text="Here")
    box = name.bounding_box()
    place = box["x"] + 4, box["y"] + box["height"] / 2

    def press():
        if by == "mouse":
            page.mouse.click(*place)
        else:
            fingers("touchStart", place)
            fingers("touchEnd")

    if by == "mouse":
        page.mouse.move(*place)
        expect(page.locator(".simaps-hint")).to_contain_text(couch.name)  # it says so before
    press()
    until(page, lambda: session.selected == couch.id)
    page.wait_for_timeout(500)
    assert session.selected == couch.id  # and the click went nowhere else
    # Who sets the start pose means the place, name or not.
    session.select(None)
    panel = session.panels[CommandPanel]
    panel._placing = placing = []
    name.wait_for()
    press()
    until(page, lambda: placing)
    assert place_on(page, bench.simap, *placing[0]) == pytest.approx(place, abs=4)
    assert session.selected is None
    panel._placing = None


def test_a_press_on_the_name_of_what_is_selected_already_selects_what_lies_under_it(bench, page):
    """Nothing else could be meant: a chair under the name of the selected table was not to be had."""
    session, couch, (chair, *_) = mine(bench), bench.simap.of_class("couch")[0], bench.simap.of_class("chair")
    session.select(couch.id)
    page.locator(".simaps-chosen:visible", has_text=couch.name).wait_for()
    x, y, _ = chair.centroid_m
    session.scene.texts.show("selection", [Label(couch.name, x, y, id=couch.id)])
    place = place_on(page, bench.simap, x, y)

    def lies_there():
        box = page.locator(".simaps-chosen:visible").bounding_box()
        return box["x"] < place[0] < box["x"] + box["width"] and box["y"] < place[1] < box["y"] + box["height"]

    until(page, lies_there)
    page.mouse.move(*place)
    expect(page.locator(".simaps-hint")).to_contain_text(chair.name)
    page.mouse.click(*place)
    until(page, lambda: session.selected == chair.id)
    session.select(None)


def test_a_finger_that_scrolls_over_a_slider_leaves_it_and_one_on_its_thumb_drags_it(bench, touched):
    page, fingers = touched
    track, thumb = (page.locator(f".mantine-Slider-{part}:visible").first for part in ("root", "thumb"))

    def drag(box, share, step):
        at = np.array((box["x"] + share * box["width"], box["y"] + box["height"] / 2))
        fingers("touchStart", at)
        for i in range(1, 9):
            fingers("touchMove", at + i * np.array(step))
            page.wait_for_timeout(20)
        fingers("touchEnd")

    page.get_by_text("Resolution", exact=True).first.scroll_into_view_if_needed()
    before, percent = track.bounding_box(), mine(bench).cut.percent
    drag(before, 0.6, (1, -12))
    until(page, lambda: track.bounding_box()["y"] < before["y"] - 20)
    page.wait_for_timeout(500)
    assert mine(bench).cut.percent == percent
    thumb.scroll_into_view_if_needed()
    drag(thumb.bounding_box(), 0.5, (10, 0))
    until(page, lambda: mine(bench).cut.percent > percent)
