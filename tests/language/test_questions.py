"""Questions are read by what they name, however they are asked; what else they say is never left out."""

import pytest

from simaps_viz.errors import CommandError
from simaps_viz.language.commands import read_command

LABELS = {"cup": 4, "table": 3, "lamp": 2, "teddy bear": 1, "clock": 2}


@pytest.mark.parametrize(
    ("said", "program"),
    [
        ("Please do tell how many cups have been left behind", 'tell(things("cup"), "count")'),
        ("how many cups did we end up with?", 'tell(things("cup"), "count")'),
        ("What quantity of cups do you see in the office?", 'tell(inside(things("cup"), room("office")), "count")'),
        ("I need a count on the lamps", 'tell(things("lamp"), "count")'),
        ("do you have a rough idea how many clocks there are?", 'tell(things("clock"), "count")'),
        ("how many clocks does the kitchen hold?", 'tell(inside(things("clock"), room("kitchen")), "count")'),
        ("where exactly in the office is the lamp standing?", 'tell(inside(things("lamp"), room("office")), "where")'),
        ("I'm looking for the teddy, any clue where?", 'tell(things("teddy bear"), "where")'),
        ("where did the kids leave the teddy?", 'tell(things("teddy bear"), "where")'),
        ("in which of the rooms can I find the teddy", 'tell(things("teddy bear"), "room")'),
        ("describe the colour of the teddy", 'tell(things("teddy bear"), "color")'),
        ("how far must I walk to get to the teddy?", 'tell(things("teddy bear"), "distance")'),
        ("can you confirm there's a clock?", 'tell(things("clock"), "whether")'),
        ("what's all that stuff on the table?", 'tell(on(things("anything"), the(things("table"))), "what")'),
        (
            "is there a cup on every table?",
            'tell(count(minus(things("table"), having(things("table"), "cup"))) == 0, "whether")',
        ),
        (
            "how many cups or lamps stand on the table?",
            'tell(union(on(things("cup"), the(things("table"))), on(things("lamp"), the(things("table")))), "count")',
        ),
        ("the office: how many lamps does it have?", 'tell(inside(things("lamp"), room("office")), "count")'),
        ("the teddy is on the table, right?", 'tell(on(things("teddy bear"), the(things("table"))), "whether")'),
        ("I'm worn out, where's the teddy?", 'tell(things("teddy bear"), "where")'),
        ("is it in the office, the teddy?", 'tell(inside(things("teddy bear"), room("office")), "whether")'),
    ],
)
def test_a_question_is_read_by_what_it_names(said: str, program: str) -> None:
    assert read_command(said, LABELS).program == program


@pytest.mark.parametrize(
    "said",
    [
        "how many cups did you wash today?",
        "how many cups are broken?",
        "how many more cups do we need?",
        "where should I put the cup?",
        "is any lamp on?",
        "does the clock work?",
        "why is there a cup on the table?",
        "is there a cup that nobody uses?",
        "do I need a lamp?",
        "is there enough room for a lamp?",
        "are there cups I should not touch?",
        "how many cups are there if I add two?",
        "how many cups can you carry?",
        "where was the cup made?",
        "is there a dirty cup?",
    ],
)
def test_a_question_is_not_answered_as_another_one(said: str) -> None:
    with pytest.raises(CommandError):
        read_command(said, LABELS)


def test_a_room_of_an_unknown_kind_is_not_the_room_at_hand() -> None:
    assert "rooms()" not in read_command("is there a server room?", LABELS).program


@pytest.mark.parametrize("said", ["where can I sit?", "where can I sit", "Where could I sit "])
def test_where_something_can_be_done_is_asked_without_a_mark_too(said: str) -> None:
    assert read_command(said, {"chair": 2}).program == 'tell(things("chair"), "where")'


def test_somewhere_to_sit_is_driven_to() -> None:
    assert read_command("I want to sit", {"chair": 2}).program.startswith("robot.move_to")
