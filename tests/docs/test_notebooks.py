"""The notebooks run, in a kernel of their own and on a small café, and say what they should."""

import ast
from pathlib import Path

import nbformat
import pytest
from docs_world import SMALL
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

SMALLER = f"""
import os
from simaps_viz.scenes import demo
os.environ["SIMAPS_CACHE"] = CACHE
small = demo.DemoSettings(frames={SMALL.frames}, width={SMALL.width}, height={SMALL.height})
demo.settings_of = lambda place: small
"""
"""Typed before the first cell: the scene as the notebooks have it takes half a minute to render."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


def run(path, cache):
    notebook = nbformat.read(path, as_version=4)
    before = nbformat.v4.new_code_cell(SMALLER.replace("CACHE", repr(str(cache))))
    notebook.cells.insert(0, before)
    NotebookClient(notebook, timeout=600, kernel_name="python3").execute(cwd=str(cache))
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output for output in outputs if output.get("name") == "stderr"]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    texts = [output.get("text", "") or output.get("data", {}).get("text/plain", "") for output in outputs]
    return "\n".join(texts), pictures


def test_they_are_there_and_hold_no_outputs():
    assert [path.name for path in NOTEBOOKS] == ["build-and-ask.ipynb", "compare-and-score.ipynb"]
    for path in NOTEBOOKS:
        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        assert not any(cell.get("outputs") for cell in notebook.cells)
        assert path.stat().st_size < 20_000


def test_build_and_ask(cache):
    text, pictures = run(FOLDER / "build-and-ask.ipynb", cache)
    assert f"{SMALL.frames} frames" in text and "'chair': 3" in text and "m to the chair next to" in text
    assert "ok" in text and 'nth(order(things("chair"), "left"), 3)' in text
    assert "piano" in text and len(pictures) == 2


def test_compare_and_score(cache):
    text, pictures = run(FOLDER / "compare-and-score.ipynb", cache)
    scores = next(ast.literal_eval(line) for line in text.splitlines() if line.startswith("{'evidence': 0."))
    assert scores["evidence"] > scores["paper"] + 0.2 and len(pictures) == 1
