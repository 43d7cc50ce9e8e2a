"""Programs that mean harm, or only nonsense: each is refused or stopped, none reaches Python."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from hostile_programs import HARMLESS, REFUSED, SENTINEL, STOPPED
from toy_maps import TOY_POSE, toy_map

from simaps_viz.errors import CommandError
from simaps_viz.language.program import MAX_ITEMS, MAX_SOURCE, parse_program
from simaps_viz.navigation.agent import answer

pytestmark = pytest.mark.slow

HERE = Path(__file__).parents[1] / "helpers"


@pytest.fixture(scope="module")
def simap():
    return toy_map()


@pytest.mark.parametrize(("program", "says"), REFUSED.values(), ids=REFUSED.keys())
def test_refused(simap, program: str, says: str) -> None:
    said = answer(simap, "", TOY_POSE, program=program)
    assert said.status == "refused"
    assert said.reason and said.reason.isprintable() and len(said.reason) < 600
    assert said.reason.startswith(f"line {says}")
    assert said.path_length_m == 0.0
    assert said.goals == ()
    assert said.final_pose == TOY_POSE


@pytest.mark.parametrize(("program", "says"), STOPPED.values(), ids=STOPPED.keys())
def test_stopped(simap, program: str, says: str) -> None:
    said = answer(simap, "", TOY_POSE, program=program)
    assert said.status == "failed"
    assert said.reason and said.reason.startswith("line ") and says in said.reason
    assert said.path_length_m <= 1000.0


@pytest.mark.parametrize("program", HARMLESS.values(), ids=HARMLESS.keys())
def test_harmless(simap, program: str) -> None:
    assert answer(simap, "", TOY_POSE, program=program).reason is None


@pytest.mark.parametrize("size", [0, 1, MAX_SOURCE, MAX_SOURCE + 1])
def test_length_of_a_program(size: int) -> None:
    text = "#" * size
    expected = f"at most {MAX_SOURCE} characters, found {size}" if size > MAX_SOURCE else "at least one line"
    with pytest.raises(CommandError, match=expected):
        parse_program(text)


def test_longest_list() -> None:
    assert parse_program(f"x = [{'1,' * MAX_ITEMS}]")
    with pytest.raises(CommandError, match=f"^line 1: lists have at most {MAX_ITEMS} items, found {MAX_ITEMS + 1}$"):
        parse_program(f"x = [{'1,' * (MAX_ITEMS + 1)}]")


def test_lists_that_hold_themselves_are_never_walked(simap) -> None:
    doubling = "x = [1]\nfor a in robot.get_contour('couch'):\n    x = [x, x]\n"
    for use in ("y = [x, x]\nif y == x:\n    robot.turn(90)", "robot.move_to(x)", "robot.turn(x[0])"):
        assert answer(simap, "", TOY_POSE, program=doubling + use).status == "refused"


AUDIT = f"""
import json, os, sys
sys.path.insert(0, {str(HERE)!r})
from hostile_programs import HARMLESS, REFUSED, STOPPED
from toy_maps import TOY_POSE, toy_map
from simaps_viz.errors import SIMapsError
from simaps_viz.language.program import parse_program
from simaps_viz.navigation.agent import answer

stopped = list(STOPPED.values())[::8]  # they take as long as a budget allows, and are made of the same calls
programs = [text for text, _ in [*REFUSED.values(), *stopped]] + list(HARMLESS.values())
simap = toy_map()

def run_all():
    for text in programs:
        answer(simap, "", TOY_POSE, program=text)
        try:
            parse_program(text)
        except SIMapsError:
            pass

run_all()  # kernels and modules that load late are loaded now
seen = set()

def watch(event, arguments):
    file = {{"compile": 1, "open": 0}}.get(event)
    seen.add(event if file is None else f"{{event}} {{arguments[file]}}")

sys.addaudithook(watch)
run_all()
by_us = sorted(seen)
seen.clear()
exec("open({SENTINEL!r}, 'w').close()")
print(json.dumps({{"by us": by_us, "by Python": sorted(seen), "programs": len(programs)}}))
"""


def test_nothing_is_executed(tmp_path: Path) -> None:
    """Python itself tells of every import, file, process and piece of code it runs: there is only the parser."""
    work = tmp_path / "work"
    work.mkdir()
    script = AUDIT.replace(repr(SENTINEL), repr(str(tmp_path / SENTINEL)))
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=work, check=True)
    report = json.loads(out.stdout)
    assert report["programs"] >= 200
    # ast.parse is the compiler told to stop at the syntax tree; after a syntax error it looks for the line in a file of
    # the name it was given, which is none
    assert report["by us"] == ["compile <program>", "open <program>"]
    assert out.stderr == ""
    assert not list(work.iterdir()) and not Path(SENTINEL).exists()
    # the same watch around a program that Python runs: otherwise its silence would prove nothing
    assert {"exec", "compile <string>", f"open {tmp_path / SENTINEL}"} <= set(report["by Python"])
    assert (tmp_path / SENTINEL).exists()
