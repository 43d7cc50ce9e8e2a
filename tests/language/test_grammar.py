"""The grammar holds together: every name in a pattern is a rule or a token, and what it gives has a taker."""

import inspect
import threading

import pytest

from simaps_viz.errors import CommandError
from simaps_viz.language import grammar
from simaps_viz.language.commands import read_command
from simaps_viz.language.grammar import Chart, Edge, Grammar
from simaps_viz.language.orders import GRAMMAR
from simaps_viz.language.words import PHRASES

MADE = {"CLAUSE", "FINITE", "INTER", "MOST", "NOUN", "NOUNS", "NUM", "ONE", "ORD", "PLACE", "WORD"}
"""Tokens that are made of the map's names and of numbers."""


def symbols(part) -> list:
    match part:
        case grammar._Symbol():
            return [part]
        case grammar._Sequence(parts=parts) | grammar._Choice(parts=parts):
            return [symbol for one in parts for symbol in symbols(one)]
    return symbols(part.part)


@pytest.mark.parametrize("name", list(GRAMMAR._rules))
def test_every_name_is_known_and_every_value_is_taken(name: str) -> None:
    tokens = {kind for found in PHRASES.values() for kind, _ in found} | MADE
    for rule in GRAMMAR.rules_of(name):
        taken = inspect.signature(rule.make).parameters
        for symbol in symbols(rule.pattern):
            assert symbol.name in (tokens if symbol.name.isupper() else GRAMMAR._rules), (rule.make, symbol)
            assert not symbol.key or symbol.key in taken or "_" in taken, (rule.make, symbol)


def test_a_chart_keeps_the_likeliest_readings_of_a_pattern() -> None:
    toy = Grammar()
    toy.rule("pair", "a:N (AND b:N)+")(lambda a, b: (a, b))
    toy.rule("pair", "&N a:N AND? rest:pair", cost=1.0)(lambda a, rest: (a, *rest))
    lattice = [
        [Edge("N", word, at + 1)] if word != "and" else [Edge("AND", word, at + 1)]
        for at, word in enumerate(("x", "and", "y", "and", "z"))
    ]
    found = Chart(toy, [*lattice, []]).parse("pair")
    assert [(one.end, one.value, one.cost) for one in found] == [
        (5, ("x", ("y", "z")), 0.0),
        (5, ("x", "y", ("z",)), 1.0),
        (3, ("x", ("y",)), 0.0),
    ]


@pytest.mark.parametrize(
    ("said", "program"),
    [
        ("how many red chairs are there in the kitchen?",
         'tell(inside(colored(things("chair"), "red"), room("kitchen")), "count")'),
        ("is there a piano", 'tell(search("piano"), "whether")'),
        ("what is on the couch?", 'tell(on(things("anything"), "couch"), "what")'),
        ("which table is the largest?", 'tell(first(order(things("dining table"), "large")), "which")'),
        ("is the couch bigger than the plant?", 'tell(things("couch"), "compare", "potted plant", "large")'),
        ("how much taller is the couch than the plant?", 'tell(things("couch"), "compare", "potted plant", "tall")'),
        ("how far is the couch from the plant?", 'tell(things("couch"), "distance", "potted plant")'),
        ("are there more chairs than tables?",
         'tell(count(things("chair")) > count(things("dining table")), "whether")'),
        ("what can you see?", 'tell(visible(things("anything")), "list")'),
        ("which room am I in?", 'tell(room(), "which")'),
        ("go to a chair that is neither red nor near a table",
         'robot.move_to_object(minus(minus(things("chair"), colored(things("chair"), "red")), '
         'near(minus(things("chair"), colored(things("chair"), "red")), "dining table")))'),
        ("visit the chairs around the table",
         'for chair in near(things("chair"), the(things("dining table"))):\n    robot.move_to_object(chair)'),
        ("go to every chair near a table",
         'for chair in near(things("chair"), "dining table"):\n    robot.move_to_object(chair)'),
        ("two and a half laps around the couch",
         'for point in lap("couch", 2.5):\n    robot.move_to(point)'),
        ("visit two of the chairs near the plant",
         'for chair in nearest(near(things("chair"), "potted plant", 3), 2, "potted plant"):\n'
         "    robot.move_to_object(chair)"),
        ("I'd be ever so grateful if you could go to the couch", 'robot.move_to_object("couch")'),
        ("you go couch please", 'robot.move_to_object("couch")'),
        ("any plants here?", 'tell(things("potted plant"), "whether")'),
        ("how far is it from here to the couch?", 'tell(things("couch"), "distance")'),
        ("where did I leave my plant?", 'tell(things("potted plant"), "where")'),
        ("look at the couch and then at the plant", 'robot.face("couch")\nrobot.face("potted plant")'),
        ("go to the table with only two chairs",
         'robot.move_to_object(minus(having(things("dining table"), "chair", 2), '
         'having(things("dining table"), "chair", 3)))'),
        ("go to the table with a plant but no chair at it",
         'robot.move_to_object(without(having(things("dining table"), "potted plant"), "chair"))'),
        ("not the near chair, the other one",
         'robot.move_to_object(minus(things("chair"), nearest(things("chair"))))'),
        ("the chair I mean is the one by the plant: go there",
         'robot.move_to_object(nearest(near(things("chair"), "potted plant", 3), 1, "potted plant"))'),
        ("which table is larger, the near one or the far one?",
         'tell(first(order(union(nearest(things("dining table")), farthest(things("dining table"))), "large")), '
         '"which")'),
        ("is there a room with both a couch and a plant?",
         'tell(having(having(rooms(), "couch"), "potted plant"), "whether")'),
        ("go to the couch, then back", 'robot.move_to_object("couch")\nrobot.move_to(pose("start"))'),
        ("go to the end of the corridor", 'robot.move_to(spot(room("hall"), "end"))'),
        ("go to the second or the third chair",
         'robot.move_to_object(union(nth(things("chair"), 2), nth(things("chair"), 3)))'),
        ("go to the couch, actually turn left", "robot.turn(-90)"),
        ("don't go to the couch, go to the plant", 'robot.move_to_object("potted plant")'),
        ("go to the couch unless there is a plant closer to you",
         'couch = things("couch")\nif not distance("potted plant") < distance(couch):\n'
         "    robot.move_to_object(couch)"),
        ("I want to sit down", 'robot.move_to_object("place to sit")'),
        ("go to the couch but keep away from the plant", 'avoid("potted plant")\nrobot.move_to_object("couch")'),
        ("without entering the kitchen go to the plant, then face the couch",
         'avoid(room("kitchen"))\nrobot.move_to_object("potted plant")\nrobot.face("couch")'),
        ("go to the couch, staying at least half a metre away from the tables",
         'avoid("dining table", 0.5)\nrobot.move_to_object("couch")'),
        ("how do I get from the couch to the plant?", 'tell(things("potted plant"), "way", "couch")'),
        ("which way should I take to the kitchen?", 'tell(room("kitchen"), "way")'),
        ("go to the chair across from the couch",
         'robot.move_to_object(nearest(opposite(things("chair"), "couch"), 1, "couch"))'),
        ("which of the tables is darker?", 'tell(first(order(things("dining table"), "dark")), "which")'),
        ("which two chairs are farthest apart?", 'tell(first(order(things("chair"), "apart"), 2), "which")'),
        ("there are two chairs at the couch: go to the one on the right",
         'robot.move_to_object(first(order(nearest(near(things("chair"), "couch", 3), 2, "couch"), "right")))'),
        ("how many rooms are there and what are they?",
         'thing = rooms()\ntell(thing, "count")\ntell(thing, "list")'),
        ("how many chairs are in the kitchen and how many in the office?",
         'tell(inside(things("chair"), room("kitchen")), "count")\n'
         'tell(inside(things("chair"), room("office")), "count")'),
        ("how many chairs does the kitchen have?", 'tell(inside(things("chair"), room("kitchen")), "count")'),
        ("count the chairs at the couch, then go to the one nearest the plant",
         'tell(near(things("chair"), "couch"), "count")\n'
         'robot.move_to_object(nearest(near(things("chair"), "couch"), 1, "potted plant"))'),
        ("go to the couch, then back to the plant",
         'robot.move_to_object("couch")\nrobot.move_to_object("potted plant")'),
        ("go to the plant in the hall, and if there is none, to the couch",
         'if count(inside(things("potted plant"), room("hall"))) > 0:\n'
         '    robot.move_to_object(inside(things("potted plant"), room("hall")))\n'
         'else:\n    robot.move_to_object("couch")'),
        ("drive to office 2.", 'robot.move_to_object(room("office 2"))'),
        ("visit the chairs in bedroom number 3",
         'for chair in inside(things("chair"), room("bedroom 3")):\n    robot.move_to_object(chair)'),
        ("go to the plant that is not in the big bedroom",
         'robot.move_to_object(minus(things("potted plant"), inside(things("potted plant"), '
         'first(order(rooms("bedroom"), "large")))))'),
        ("go to the other bedroom", 'robot.move_to_object(first(minus(rooms("bedroom"), room())))'),
        ("there are two chairs beside the couch. Go to the one that is farther from you",
         'robot.move_to_object(farthest(nearest(near(things("chair"), "couch", 3), 2, "couch")))'),
        ("at the couch there is one chair which is red. Go there.",
         'chair = nearest(near(colored(things("chair"), "red"), "couch", 3), 1, "couch")\nrobot.move_to_object(chair)'),
        ("you see the plant here in the kitchen? Not that. I want the other one.",
         'robot.move_to_object(minus(things("potted plant"), first(inside(things("potted plant"), room("kitchen")))))'),
        ("go to the chair, not the big one, the other one",
         'robot.move_to_object(minus(things("chair"), first(order(things("chair"), "large"))))'),
        ("go to the plant, halt exactly one metre before it and keep it in front of you",
         'plant = things("potted plant")\nrobot.move_to(spot(plant, "beside", 1))\nrobot.face(plant)'),
        ("go to the chair at the north end of the couch",
         'robot.move_to_object(first(order(near(things("chair"), "couch"), "north")))'),
        ("couch first, plant second, chair last",
         'robot.move_to_object("couch")\nrobot.move_to_object("potted plant")\nrobot.move_to_object("chair")'),
        ("are there more chairs in the kitchen or in the office?",
         'tell(first(order(union(room("kitchen"), room("office")), "many", "chair")), "which")'),
        ("if in the kitchen there is a plant, face it, and if it isn't, face the couch",
         'plant = inside(things("potted plant"), room("kitchen"))\nif count(plant) > 0:\n    robot.face(plant)\n'
         'else:\n    robot.face("couch")'),
        ("how many tables have a plant underneath them?",
         'tell(having(things("dining table"), under("potted plant", things("dining table"))), "count")'),
        ("Two chairs in front of you, right? Take the left one.",
         'robot.move_to_object(first(order(nearest(side(things("chair"), "front"), 2), "left")))'),
        ("chairs: how many of them are there?", 'tell(things("chair"), "count")'),
        ("which chair is nearest the couch? That's where I'd like you.",
         'chair = nearest(things("chair"), 1, "couch")\ntell(chair, "which")\nrobot.move_to_object(chair)'),
        ("one of the chairs is not at the couch but at a table. That's the one I'd like you to drive to.",
         'chair = first(near(minus(things("chair"), near(things("chair"), "couch")), "dining table"))\n'
         'robot.move_to_object(chair)'),
        ("is there a plant on one of the chairs at the couch?",
         'tell(on(things("potted plant"), near(things("chair"), "couch")), "whether")'),
        ("let me see the couch", 'robot.move_to_object("couch")'),
        ("right, over to the couch, I want to know what's left on it",
         'couch = things("couch")\nrobot.move_to_object(couch)\ntell(on(things("anything"), couch), "what")'),
        ("at the couch, which chairs are on the east side?", 'tell(side(things("chair"), "east", "couch"), "list")'),
        ("how many chairs have the people left in the kitchen?",
         'tell(inside(things("chair"), room("kitchen")), "count")'),
        ("the chairs at the couch: the left one first, then the right one",
         'chair = first(order(near(things("chair"), "couch"), "right"))\n'
         'robot.move_to_object(first(order(near(things("chair"), "couch"), "left")))\nrobot.move_to_object(chair)'),
        ("go to the couch, no, the plant I meant", 'robot.move_to_object("potted plant")'),
        ("go to the couch, oops, I meant to say the plant", 'robot.move_to_object("potted plant")'),
        ("the couch is your next stop", 'robot.move_to_object("couch")'),
        ("squeeze in between the couch and the plant", 'robot.move_in_between("couch", "potted plant")'),
        ("plonk yourself next to the couch", 'robot.move_to_object("couch")'),
        ("on how many of the tables is there a plant?",
         'tell(having(things("dining table"), "potted plant"), "count")'),
        ("are there two or three chairs?", 'tell(things("chair"), "count")'),
        ("how many people can sit at the table?", 'tell(near(things("seat"), the(things("dining '
        'table"))), "count")'),
        ("what else is on the table with the plant?",
         'tell(minus(on(things("anything"), the(having(things("dining table"), "potted plant"))), '
         '"potted plant"), "what")'),
        ("compare the couch with the plant: which one's taller?",
         'tell(first(order(union("couch", "potted plant"), "tall")), "which")'),
        ("look at the couch, but don't drive there", 'robot.face("couch")'),
        ("go straight on until the couch is on your right", 'robot.move_to(spot("couch", "level"))'),
        ("go to the kitchen's plant", 'robot.move_to_object(inside(things("potted plant"), room("kitchen")))'),
        ("go to the corner by the couch", 'robot.move_to(corner(room(), "", "couch"))'),
        ("go to whichever is closer, the couch or the plant",
         'robot.move_to_object(first(order(union("couch", "potted plant"), "near")))'),
    ],
)  # fmt: skip
def test_questions_logic_and_relations(said: str, program: str) -> None:
    labels = {"chair": 3, "dining table": 2, "couch": 1, "potted plant": 1}
    assert read_command(said, labels).program == program


@pytest.mark.parametrize(
    ("said", "program"),
    [
        ("how many chairs are in the kitchen and the bedroom together?",
         'tell(inside(things("chair"), union(room("kitchen"), room("bedroom"))), "count")'),
        ("go to the chairs next to the couch except the one furthest to the left",
         'for chair in minus(near(things("chair"), "couch"), first(order(near(things("chair"), "couch"), '
         '"left"))):\n'
         '    robot.move_to_object(chair)'),
        ("go to a chair, but not in the bedrooms",
         'robot.move_to_object(minus(things("chair"), inside(things("chair"), rooms("bedroom"))))'),
        ("if the plant is on the table, stop there, otherwise go to the couch",
         'plant = on(things("potted plant"), the(things("dining table")))\n'
         'if count(plant) > 0:\n'
         '    robot.move_to_object(plant)\n'
         'else:\n'
         '    robot.move_to_object("couch")'),
        ("go to the chair at the couch which is nearest to the plant",
         'robot.move_to_object(nearest(near(things("chair"), "couch", 3), 1, "potted plant"))'),
        ("turn round and go to the chair behind you", 'robot.move_to_object(side(things("chair"), "behind"))'),
        ("turn left and go to the chair behind you",
         'robot.turn(-90)\n'
         'robot.move_to_object(side(things("chair"), "behind"))'),
        ("visit the tables: first the one in the kitchen, then the one in the hall",
         'robot.move_to_object(inside(things("dining table"), room("kitchen")))\n'
         'robot.move_to_object(inside(things("dining table"), room("hall")))'),
        ("on the table, what is between the couch and the plant?",
         'tell(on(between(things("anything"), "couch", "potted plant"), the(things("dining table"))), '
         '"what")'),
        ("which chair is the one in the middle?", 'tell(first(order(things("chair"), "middle")), "which")'),
        ("the chair that stands on the floor", 'robot.move_to_object(at(things("chair"), "floor"))'),
        ("before to go to the couch, pass by the plant",
         'robot.move_to_object("potted plant")\n'
         'robot.move_to_object("couch")'),
        ("set your heading to due west", 'robot.turn_absolute(270)'),
        ("which of the chairs is the farthest away from you?", 'tell(farthest(things("chair")), "which")'),
        ("somewhere soft to sit", 'robot.move_to_object("couch")'),
        ("I left my keys on the chair with the plant on it, would you go there?",
         'chair = first(under(things("chair"), "potted plant"))\n'
         'robot.move_to_object(chair)'),
        ("go to the couch first and then to the chair in the other room",
         'robot.move_to_object("couch")\n'
         'robot.move_to_object(minus(things("chair"), inside(things("chair"), room())))'),
        ("run this milk over to the couch", 'robot.move_to_object("couch")'),
        ("show me all three chairs, one after the other",
         'for chair in nearest(things("chair"), 3):\n'
         '    robot.move_to_object(chair)'),
        ("how many chairs are in all rooms except the kitchen and the hall?",
         'tell(inside(things("chair"), minus(minus(rooms(), room("kitchen")), room("hall"))), "count")'),
    ],
)  # fmt: skip
def test_what_a_clause_speaks_of_is_what_english_makes_it(said: str, program: str) -> None:
    labels = {"chair": 3, "dining table": 2, "couch": 1, "potted plant": 1}
    assert read_command(said, labels).program == program


def test_a_toilet_alone_is_the_thing_where_the_map_has_one() -> None:
    for labels, goal in ((("toilet", "couch"), '"toilet"'), (("couch",), 'room("bathroom")')):
        program = read_command("Toilet, then the sofa", labels).program
        assert program == f'robot.move_to_object({goal})\nrobot.move_to_object("couch")'


def test_a_verb_takes_a_bare_name_unless_it_would_move_the_thing() -> None:
    for said in ("move chair", "move the chair to the couch", "go sofa the"):
        with pytest.raises(CommandError, match="Not understood"):
            read_command(said, ("chair", "couch"))
    assert read_command("go sofa", ("chair", "couch")).program == 'robot.move_to_object("couch")'


def test_a_thread_does_not_take_half_of_the_first_tokens_for_all(monkeypatch) -> None:
    """Two pages that open at once read their first commands at once; one left the other without a verb for good."""
    toy, looking, go_on = Grammar(), threading.Event(), threading.Event()
    toy.words("order", "verb N")
    toy.words("verb", "GO")
    finish = Grammar._either

    def slowly(self, parts):
        looking.set()
        go_on.wait(10.0)
        return finish(self, parts)

    monkeypatch.setattr(Grammar, "_either", slowly)
    found = []
    one, other = (threading.Thread(target=lambda: found.append(toy.first(grammar._compiled("order")))) for _ in "12")
    one.start()
    assert looking.wait(10.0)
    other.start()
    other.join(0.3)
    go_on.set()
    one.join(10.0)
    other.join(10.0)
    assert found == [(frozenset(["GO"]), False)] * 2
