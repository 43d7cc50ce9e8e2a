"""Every command of the pages is typed here, in its page's order, in a folder where what it names exists."""

import json
import re
import runpy
import shlex
import shutil
import sys
import webbrowser
from pathlib import Path

import pytest
import tyro
from chat_server import serving, writes
from docs_pages import PAGES, ROOT, blocks, indented_commands, inline_commands, links, shell_lines
from docs_world import SMALL, write_world

from simaps_viz import load_map
from simaps_viz.cli import COMMANDS, main
from simaps_viz.datasets.manifest import FORMAT
from simaps_viz.scenes import demo

NOT_RUN = {
    "simaps export-network": "needs torch and a trained checkpoint; tests/segmentation/test_export.py runs it",
}
"""How a command begins that only has to be understood, and why."""

SHORTER = (
    ("none,light,medium,heavy", "light"),
    ("--seeds 5", "--seeds 1"),
    ("--task navigation", "--task navigation --commands 4"),
    ("--task ablation", "--task ablation --errors light"),
)
"""What is the same, only more of it: (as printed, as typed here)."""

OTHER_PROGRAMS = ("make", "pip", "git", "python", "jupyter", "source", "curl", "tar", "unzip")
"""May stand in a block of commands; make's targets are looked up."""

WITH_A_PAGE = ("demo", "view", "judge")

SERVER = "http://127.0.0.1:11434/v1"


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("docs")
    write_world(folder / "world", folder / "cache")
    return folder


@pytest.fixture
def typed(world, tmp_path, monkeypatch):
    """Type a line at the prompt, in a copy of the world; returns the exit status."""
    shutil.copytree(world / "world", tmp_path / "world")
    monkeypatch.chdir(tmp_path / "world" / "here")
    monkeypatch.setenv("SIMAPS_CACHE", str(world / "cache"))
    monkeypatch.setenv("SIMAPS_RECORDINGS", str(tmp_path / "recordings"))
    monkeypatch.setattr(demo, "settings_of", lambda place: SMALL)
    monkeypatch.setattr(webbrowser, "open", lambda address: True)

    def run(line):
        text = line.text
        if line.words[1] in WITH_A_PAGE:  # serve it, and stop at once
            monkeypatch.setattr("simaps_viz.viewer.workbench.Workbench.wait", lambda page: None)
        for printed, here in SHORTER:
            text = text.replace(printed, here)
        with serving(writes('robot.move_to_object("couch")')) as server:
            return main.main(shlex.split(text.replace(SERVER, server.url))[1:])

    return run


def not_run(line):
    return next((reason for start, reason in NOT_RUN.items() if line.text.startswith(start)), None)


def parse(line):
    return main.parse(line.words[1:])


@pytest.mark.parametrize("page", [page for page in PAGES if shell_lines(page)])
def test_every_command_of_a_page_runs(page, typed):
    """And its Python, after them; docs/API.md has a test of its own."""
    for line in shell_lines(page):
        if line.words[0] != "simaps":
            continue
        if not_run(line):
            parse(line)
            continue
        try:
            status = typed(line)
        except SystemExit as stopped:
            status = stopped.code
        assert status == main.OK, f"{line}: exit status {status}"
    for number, block in blocks(page, ("python",)) if page != "docs/API.md" else ():
        exec(compile(block, f"{page}:{number}", "exec"), {})


@pytest.mark.parametrize("page", PAGES)
def test_commands_in_the_text_are_understood(page, capsys):
    for line in (*inline_commands(page), *indented_commands(page)):
        if line.words[0] == "python":
            continue  # below
        if len(line.words) == 2:  # the name of a command
            assert line.words[1] in {*COMMANDS, "--help", "--version"}, line
            continue
        try:
            parse(line)
        except SystemExit as stopped:
            assert stopped.code == 0, f"{line}\n{capsys.readouterr().err}"


class StoppedError(Exception):
    """An app has read its options, and goes no further."""


APPS = [line for page in PAGES for line in (*inline_commands(page), *indented_commands(page)) if "apps/" in line.text]


@pytest.mark.parametrize("line", APPS, ids=str)
def test_the_apps_understand_their_options(line, monkeypatch):
    """They measure for minutes or hours: each is started as typed, and stopped when it has read its words."""
    read = tyro.cli

    def parse(options):
        raise StoppedError(read(options, prog=line.words[1], args=line.words[2:]))

    monkeypatch.setattr(tyro, "cli", parse)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(StoppedError):
        runpy.run_path(str(ROOT / line.words[1]), run_name="__main__")


@pytest.mark.parametrize("page", PAGES)
def test_other_programs_are_few_and_make_has_its_targets(page):
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    for line in shell_lines(page):
        program, *words = line.words
        assert program == "simaps" or Path(program).name in OTHER_PROGRAMS, line
        if program == "make":
            assert {word for word in words if "=" not in word} <= targets, line
    for target in re.findall(r"`make ([a-z-]+)`", (ROOT / page).read_text()):
        assert target in targets, f"{page}: make {target}"


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for target in links(page):
        assert ((ROOT / page).parent / target).exists(), f"{page}: {target}"


def test_every_subcommand_is_in_the_table():
    table = set(re.findall(r"^\| `simaps ([a-z-]+)", (ROOT / "docs" / "COMMANDS.md").read_text(), re.M))
    assert table == set(COMMANDS)


def test_the_figures_of_the_method_can_be_drawn(world):
    app = runpy.run_path(str(ROOT / "apps" / "method_figures.py"))
    simap = load_map(world / "world" / "here" / "cafe.npz")
    picture = app["with_evidence"](simap, "chair")
    assert picture.shape == app["by_class"](simap, simap).shape == (28 * 12, 48 * 12, 3)
    assert all((picture == app[color]).all(axis=2).any() for color in ("SAME", "DIFFERENT"))
    names = re.findall(r"\((\.\./assets/method-[a-z]+\.png)\)", (ROOT / "docs" / "METHOD.md").read_text())
    assert len(names) == 3  # that they are there, the links' test says


def test_what_is_not_run_is_there():
    every = [line for page in PAGES for line in shell_lines(page)]
    assert all(any(line.text.startswith(start) for line in every) for start in NOT_RUN)
    assert len([line for line in every if line.words[0] == "simaps" and not not_run(line)]) >= 20
    assert len({line.words[1] for line in APPS}) >= 8


def test_the_manifests_shown_are_of_the_format():
    shown = [json.loads(text) for page in PAGES for _, text in blocks(page, ("json",))]
    assert any(one.get("format") == FORMAT and {"color", "depth", "poses", "intrinsics"} <= set(one) for one in shown)
