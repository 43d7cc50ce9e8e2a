"""Fuzzing targets: programs, spoken commands, a language model's answers, and files of class names."""

import json
from pathlib import Path
from random import Random

from attacks.fuzz_cases import Case, Target
from attacks.fuzz_mutators import WORDS as ODD_WORDS
from attacks.fuzz_mutators import mutate_bytes, mutate_json, mutate_text
from attacks.fuzz_readers import one_file
from hostile_programs import HARMLESS, REFUSED, STOPPED
from program_words import VALID, WORDS, random_program
from toy_maps import TOY_POSE, toy_map

from simaps_viz.evaluation.judging import resume_session, start_session
from simaps_viz.language.commands import read_command
from simaps_viz.language.interpreter import Budget
from simaps_viz.language.llm import check_names, read_answer
from simaps_viz.language.llm_chat import _answer_of
from simaps_viz.language.llm_settings import LLMSettings
from simaps_viz.language.program import parse_program
from simaps_viz.navigation.agent import Agent
from simaps_viz.segmentation.class_names import names_beside, read_class_names
from simaps_viz.segmentation.coco_panoptic import read_coco_panoptic
from simaps_viz.segmentation.mask_classification import picture_beside

BUDGET = Budget(steps=60, loop_turns=8, path_m=10.0)
HOSTILE = (*(text for text, _ in (*REFUSED.values(), *STOPPED.values())), *HARMLESS.values())
SPOKEN = (
    "go to the chair", "move to the second chair on your left, then face the couch", "turn right 90 degrees",
    "move between the table and the couch", "move three meters forward and turn around", "go north of the sofa",
    "find the closest plant to the tv", "Geh zum Stuhl", "with the table on your left, go to the 3rd chair",
)  # fmt: skip
ANSWER = {"choices": [{"message": {"content": json.dumps({"program": "robot.turn(90)", "refusal": None})},
                       "finish_reason": "stop"}], "id": "x"}  # fmt: skip


def _text(r: Random) -> str:
    kind = r.random()
    if kind < 0.35:
        return mutate_text(r, "\n".join(r.choices(VALID, k=r.randint(1, 3))).encode()).decode("utf-8", "replace")
    if kind < 0.65:
        return "".join(r.choices(WORDS, k=r.randrange(30)))
    if kind < 0.8:
        return mutate_bytes(r, r.choice(HOSTILE).encode("utf-8", "replace")).decode("utf-8", "replace")
    text = r.choice(VALID)
    for _ in range(r.randint(1, 3)):
        at = r.randrange(len(text) + 1)
        text = text[:at] + r.choice((*WORDS, *ODD_WORDS)) + text[at + r.choice((0, 1, 8)) :]
    return text


def _program(folder: Path) -> Case:
    """Parse, and carry out what passes."""
    simap = toy_map()

    def case(r: Random) -> object:
        text = _text(r)
        program = parse_program(text)
        if r.random() < 0.2:
            for _ in Agent(simap, TOY_POSE, budget=BUDGET).steps(text):
                pass
        return program

    return case


def _sets(folder: Path) -> Case:
    """Carry out programs of functions, nested at random."""
    simap = toy_map()

    def case(r: Random) -> object:
        text = random_program(r)
        return Agent(simap, TOY_POSE, budget=BUDGET).rehearse(text).robot.answer

    return case


def _command(folder: Path) -> Case:
    counts = toy_map().counts()
    words = [word for line in SPOKEN for word in line.split()]

    def case(r: Random) -> object:
        if r.random() < 0.5:
            text = " ".join(r.choices((*words, *ODD_WORDS), k=r.randrange(12)))
        else:
            text = mutate_bytes(r, r.choice(SPOKEN).encode()).decode("utf-8", "replace")
        return read_command(text, counts)

    return case


def _llm(folder: Path) -> Case:
    """Damage the body that a model's server sends, down to the program in it."""
    counts = toy_map().counts()
    settings = LLMSettings("http://127.0.0.1:1/v1", "model")

    def case(r: Random) -> object:
        if r.random() < 0.5:
            return _answer_of(mutate_json(r, json.dumps(ANSWER).encode()), "", settings)
        text = json.dumps({"program": _text(r), "refusal": None})
        program, _ = read_answer(mutate_json(r, text.encode()).decode("utf-8", "replace"))
        check_names(parse_program(program), counts)
        return program

    return case


def _names(folder: Path) -> Case:
    tables: list[tuple[str, bytes]] = [
        ("a.txt", b"chair\ntable\nfloor\n"),
        ("a.json", b'["chair", "table"]'),
        ("b.json", b'{"id2label": {"0": "chair", "1": "table", "2": "floor"}}'),
        ("c.json", b'{"categories": [{"id": 1, "name": "chair", "isthing": 1}, {"id": 2, "name": "floor"}]}'),
    ]

    def case(r: Random) -> object:
        if r.random() < 0.3:
            text = mutate_text(r, b"{0: 'chair', 1: 'table'}").decode("utf-8", "replace")
            return names_beside(folder / "net.onnx", {r.choice(("names", "id2label")): text})
        name, data = r.choice(tables)
        path = folder / name
        path.write_bytes((mutate_text if name == "a.txt" else mutate_json)(r, data))
        return read_class_names(path)

    return case


def _session(folder: Path) -> Case:
    """Damage a session of blind judging, one JSON object a line."""
    path = folder / "session.jsonl"
    runs = [{"errors": "none", "method": method, "command": "go"} for method in ("evidence", "paper")]
    session = start_session(path, runs, seed=0)
    session.judge(str(session.runs[0]["run_id"]), "yes")
    lines = path.read_bytes().splitlines()

    def case(r: Random) -> object:
        damaged = list(lines)
        at = r.randrange(len(damaged))
        damaged[at] = mutate_json(r, damaged[at])
        if r.random() < 0.2:
            r.shuffle(damaged)
        path.write_bytes(b"\n".join(damaged) + b"\n" * r.randrange(2))
        again = resume_session(path)
        again.next_run()
        return again.summary()

    return case


def _picture(folder: Path) -> Case:
    """Damage the settings of a transformers image processor."""
    good = b'{"size": {"height": 32, "width": 32}, "image_mean": [0.4, 0.4, 0.4], "image_std": [0.2, 0.2, 0.2]}'
    path = folder / "preprocessor_config.json"

    def case(r: Random) -> object:
        path.write_bytes(mutate_json(r, good))
        return picture_beside(folder / "net.onnx")

    return case


COCO = {
    "images": [{"id": 1, "file_name": "a.jpg", "width": 4, "height": 4}],
    "annotations": [{"image_id": 1, "file_name": "a.png", "segments_info": [{"id": 5, "category_id": 1, "area": 3}]}],
    "categories": [{"id": 1, "name": "chair", "isthing": 1}, {"id": 2, "name": "floor", "isthing": 0}],
}

LANGUAGE_TARGETS = (
    Target("program", _program, weight=60, guided=True),
    Target("program of sets", _sets, weight=20),
    Target("spoken command", _command, weight=8, guided=True),
    Target("model's answer", _llm, weight=50, guided=True),
    Target("class names", _names, weight=40, guided=True),
    Target("picture settings", _picture, weight=20),
    Target("judging session", _session, weight=20),
    Target("COCO panoptic", one_file(json.dumps(COCO).encode(), "a.json", lambda p: read_coco_panoptic(p, ["a"])),
           weight=40, guided=True),
)  # fmt: skip
