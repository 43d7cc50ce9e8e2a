"""What people say, in rounds written from pictures of maps by someone who did not know what is understood."""

import json

import pytest
from spoken import ROUNDS, Scene, judge, judge_round, load_round_map

VERDICTS = ("right", "refused", "wrong", "traceback")
CORRIDOR = [5.0, 4.5, 90.0]


REACHED = {
    "round1": (118, 1), "round2": (76, 2), "round3": (75, 2), "round4": (110, 1), "round5": (78, 1), "round6": (38, 0),
    "round7": (26, 0), "round8": (34, 0), "round9": (30, 0),
    "round10": (23, 0), "round11": (23, 0), "round14": (45, 0), "round16": (43, 1), "round17": (12, 1),
    "round18": (11, 1), "round19": (38, 1), "round20": (40, 0),
    "round21": (29, 0), "round22": (24, 1), "round23": (38, 1), "round24": (36, 1),
    "round25": (40, 0), "round26": (29, 0), "round27": (27, 0), "round28": (35, 1),
    "round29": (40, 0), "round36": (38, 0), "round37": (38, 1), "round39": (35, 0),
    "round41": (40, 0), "round43": (36, 0), "round45": (40, 0), "round47": (40, 0),
    "round49": (34, 1), "round50": (31, 0), "round52": (18, 1), "round53": (27, 0), "round55": (18, 0),
    "round56": (22, 0), "round57": (28, 1), "round59": (28, 0), "round60": (30, 0),
    "round61": (30, 0), "round62": (30, 0), "round64": (28, 0),
}  # fmt: skip
"""Of the commands on the maps that are shipped: at least so many right, and at most so many wrong but confident.

Rounds 12, 13, 15, 30, 32, 35, 38, 40, 42, 44, 46, 48, 51, 54, 58 and 63 are on none of them. Round 24 counts the
whole map where "in here" was said.
"""


@pytest.mark.slow
@pytest.mark.parametrize("path", [ROUNDS / f"{name}.json" for name in REACHED], ids=lambda path: path.stem)
def test_what_was_understood_stays_so_and_nobody_sees_a_traceback(path):
    verdicts = judge_round(path)
    shipped = [one for one in json.loads(path.read_text()) if one["map"] in ("cafe", "toy", "toymap")]
    assert len(verdicts) == len(shipped) >= 15
    found = {kind: [one.command["say"] for one in verdicts if one.verdict == kind] for kind in VERDICTS}
    right, wrong = REACHED[path.stem]
    assert found["traceback"] == []
    assert len(found["right"]) >= right, found["refused"]
    assert len(found["wrong"]) <= wrong, found["wrong"]


@pytest.mark.parametrize(
    ("said", "expect", "verdict"),
    [
        ("robot.move_to_object('bed')", {"visits": [[1]]}, "right"),
        ("robot.move_to_object('bed')", {"visits": [[21]]}, "wrong"),
        ("robot.move_to_object('bed')", {"refuse": True}, "wrong"),
        (
            "robot.move_to_object('bed')",
            [{"refuse": True}, {"ends_in_polygon": [[0, 5], [4, 5], [4, 9], [0, 9]]}],
            "right",
        ),
        ("robot.move_to_object('bed')\nrobot.move_to_object('couch')", {"visits": [[1], [21]]}, "right"),
        ("robot.move_to_object('bed')\nrobot.move_to_object('couch')", {"visits": [[21], [1]]}, "wrong"),
        (
            "for c in robot.instances('chair'):\n    robot.move_to_object('chair', c)",
            {"visits_count": [[15, 16, 17], 3]},
            "wrong",
        ),
        ("for c in robot.instances('sink'):\n    robot.move_to_object('sink', c)", {"visits_all": [7, 11]}, "right"),
        ("for c in robot.instances('sink'):\n    robot.move_to_object('sink', c)", {"visits_all": [7]}, "wrong"),
        ("robot.move_to([5.5, 1.2])\nrobot.move_to([6.8, 1.2])", {"laps": [31, 1]}, "wrong"),
        ("robot.face('bench')", {"faces": [44], "stays": True}, "right"),
        ("robot.turn(90)", {"turned": -90}, "wrong"),
        ("robot.turn(90)", {"answer_value": 90}, "wrong"),
        ("robot.move_to_object('piano')", {"or_refuse": True}, "right"),
        ("robot.move_to_object('piano')", {"visits": [[1]]}, "refused"),
    ],
)
def test_the_judge_tells_what_was_done_from_what_was_asked(said, expect, verdict):
    toy = load_round_map("toy")
    assert toy is not None
    assert judge(Scene(toy), {"pose": CORRIDOR, "say": said, "expect": expect}).verdict == verdict
