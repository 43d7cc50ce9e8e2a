"""Finding an object by what is typed: which one is meant, and what is said when none is."""

import threading
from types import SimpleNamespace

import pytest
from browser import toy_ask
from hypothesis import example, given
from hypothesis import strategies as st
from toy_maps import TOY_POSE, toy_map

from simaps_viz.drawing.legend import object_names
from simaps_viz.drawing.theme import DIM_STYLE
from simaps_viz.navigation.agent import answer
from simaps_viz.viewer.panels import instance
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.instance import FindBox, NotFound, matches
from simaps_viz.viewer.panels.map import MapPanel

SIMAP = toy_map()


@pytest.mark.parametrize(
    ("typed", "label", "nth"),
    [
        ("chair 3", "chair", 2),
        ("  CHAIR   4 ", "chair", 3),
        ("chair #1", "chair", 1),
        ("chairs 3", "chair", 2),
        ("chair 3 of 3", "chair", 2),
        ("table 8", "dining table", 2),
    ],
)
def test_a_class_and_a_number_mean_that_one(typed, label, nth):
    assert matches(SIMAP, typed) == (SIMAP.of_class(label)[nth - 1],)


def test_every_name_of_the_list_and_every_number_is_found():
    for name, number in object_names(SIMAP).items():
        for typed in (name, str(number), f"#{number}"):
            assert [one.id for one in matches(SIMAP, typed)] == [number]


def test_a_class_alone_means_all_of_it_and_steps_go_round_both_ways():
    page = FakePage()
    box = FindBox(page)  # pyright: ignore[reportArgumentType]
    one, two, three = (one.id for one in SIMAP.of_class("chair"))
    page.selected = 5
    assert "chair: 3." in page.type("chai") and "Next" in page.status.content and page.went == []
    assert (page.only, page.selected) == ("chair", None)  # all are lit, and nothing else
    assert f"chair {one}: 1 of 3." in page.type("chai\n")
    assert f"chair {two}: 2 of 3." in page.type("chai\n")
    for step in (1, 1, -1, -1):
        box.told({"type": "find", "step": step})
    assert page.went == [one, two, three, one, three, two]
    page.selected = two  # by a click
    box.selection_changed(two)
    assert f"chair {two}: 2 of 3." in page.status.content
    page.selected = 5  # something else: nothing of what was found is shown any more, and steps begin anew
    box.selection_changed(5)
    assert "chair: 3.</span>" in page.status.content
    box.told({"type": "find", "step": -1})
    assert page.went[-1] == three
    assert "Enter: couch 5" in page.type("couch") and page.only is None and "Next" not in page.status.content
    assert "The north arrow" in page.type("couch\n") and page.went[-1] == 5
    assert page.type("") == page.type("\n") == page.nothing


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("", "Type a class or a number, such as: chair 18."),
        ("chair 2", "There is no chair 2. This map has 3 chairs."),
        ("chair 0", "There is no chair 0. This map has 3 chairs."),
        ("chiar", "No class of this map is called chiar. Did you mean chair?"),
        ("piano", "No class of this map is called piano."),
        ("99999", f"No object has number 99999. This map has {len(SIMAP.instances)} objects."),
    ],
)
def test_what_means_nothing_is_said_in_words(typed, said):
    with pytest.raises(NotFound) as error:
        matches(SIMAP, typed)
    assert str(error.value) == said


def test_a_part_of_several_names_is_not_guessed_at():
    with pytest.raises(NotFound, match=r"^Several classes fit: "):
        matches(SIMAP, "c")


@given(st.text(max_size=40))
@example("#")
@example(" # of 3")
def test_whatever_is_typed_gives_an_object_or_words(typed):
    try:
        found = matches(SIMAP, typed)
        assert found and set(found) <= set(SIMAP.instances)
    except NotFound as error:
        assert str(error)


class FakePage:
    """A page of which only the box is there; jobs run at once."""

    def __init__(self):
        self.simap, self.pose, self.selected, self.went, self.given = SIMAP, TOY_POSE, None, [], []
        self.services, self.reveal = SimpleNamespace(ask=toy_ask), self.given.append
        shown = SimpleNamespace(show_only=self.show_only, doubtful=lambda simap: simap.doubtful)
        self.panels, self.only = {CommandPanel: SimpleNamespace(give=self.given.append), MapPanel: shown}, None
        self.typed = lambda event: None
        self.worker = SimpleNamespace(submit=lambda name, job: job())
        self.box = SimpleNamespace(value="", on_update=lambda then: setattr(self, "typed", then))
        self.status = SimpleNamespace(content="", visible=False)
        self.gui = SimpleNamespace(
            add_text=lambda *_, **__: self.box,
            add_html=lambda *_, **__: self.status,
        )

    def show_only(self, label):
        self.only = label
        return label is not None

    def select(self, number):
        self.selected = number

    def go_to(self, one):
        self.selected = one.id
        self.went.append(one.id)

    @property
    def nothing(self):
        """What the line has while there is nothing to say."""
        return f'<div class="simaps-found" style="{DIM_STYLE}"><span role="status"></span></div>'

    def type(self, text):
        self.box.value = text
        self.typed(SimpleNamespace(client_id=1))
        return self.status.content


def test_free_words_go_from_rank_to_rank_on_enter_alone():
    page = FakePage()
    FindBox(page)  # pyright: ignore[reportArgumentType]
    seats = [found.instance.id for found in SIMAP.search("somewhere to sit")]
    assert "Enter searches for what fits" in page.type("somewhere to sit") and page.went == []
    assert "1. chair 1 (fits 100 %), shown; 2. chair 3 (fits 100 %)" in page.type("somewhere to sit\n")
    for _ in seats:
        shown = page.type("somewhere to sit\n")
    assert len(seats) > 2 and page.went == [*seats, seats[0]] and "1. chair 1 (fits 100 %), shown" in shown
    assert "is called flying carpet." in page.type("flying carpet\n") and len(page.went) == len(seats) + 1
    assert page.type("chair 3\n") and page.went[-1] == SIMAP.of_class("chair")[1].id


def test_words_that_commands_know_are_found_on_enter_as_well_and_what_is_not_there_is_said():
    page = FakePage()
    page.services.ask = answer
    FindBox(page)  # pyright: ignore[reportArgumentType]
    by_table = (answer(SIMAP, "which chairs are next to the dining tables?", TOY_POSE).answer or {})["instances"]
    assert len(by_table) > 1
    said = page.type("chairs next to the dining tables\n")
    assert f"chair {by_table[0]}: 1 of {len(by_table)}." in said and page.went == by_table[:1] and page.only is None
    assert "Next" in page.type("chairs next to the dining tables\n") and page.went == by_table[:2]
    assert "No, there is no cup on this map" in page.type("cup next to the couch\n")
    assert "No, there is no gizmo on this map." in page.type("gizmo\n") and page.went == by_table[:2]


def test_what_was_typed_last_has_the_last_word_however_long_words_before_it_take(monkeypatch):
    page, begun, go_on = FakePage(), threading.Event(), threading.Event()
    FindBox(page)  # pyright: ignore[reportArgumentType]

    def slowly(simap, text):
        if text == "chair":
            begun.set()
            assert go_on.wait(60.0)
        return matches(simap, text)

    monkeypatch.setattr(instance, "matches", slowly)
    first, second = (threading.Thread(target=page.type, args=(text,)) for text in ("chair", "chair 4"))
    first.start()
    assert begun.wait(60.0)
    second.start()
    second.join(0.3)
    go_on.set()
    for one in (first, second):
        one.join()
    assert "Enter: chair 4" in page.status.content


def test_a_command_goes_to_the_robot_and_a_name_does_not():
    page = FakePage()
    FindBox(page)  # pyright: ignore[reportArgumentType]
    assert "Enter gives the robot this command" in page.type("go to the second chair") and page.given == []
    assert page.type("go to the second chair\n") == page.nothing
    assert page.given == ["Command", "go to the second chair"] and page.box.value == "" and page.went == []
    for name in ("the couch by the table", "somewhere to sit", "flying carpet"):
        page.type(f"{name}\n")
    assert len(page.given) == 2
