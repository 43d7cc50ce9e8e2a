"""What import-linter (`make check`) does not see: no text is run as code, and the package loads without the page."""

import ast
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HEAVY = ("viser", "rerun", "onnxruntime", "trimesh", "embreex", "openai")


@pytest.mark.slow
def test_nothing_evaluates_text():
    files = list((ROOT / "simaps_viz").rglob("*.py"))
    assert len(files) > 100
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            assert called not in ("eval", "exec", "compile", "__import__"), path


@pytest.mark.slow
def test_importing_the_package_loads_neither_page_nor_recorder():
    code = f"import sys, simaps_viz; simaps_viz.load_map; print([m for m in {HEAVY!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert out.stdout.strip() == "[]"


def test_every_folder_of_tests_is_looked_into(pytestconfig):
    """Of pytest's own list a folder called build is none: tests in it were never run by ``make test``."""
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "tests").rglob("test_*.py")}
    names = {part for folder in folders for part in folder.parts}
    assert {"build", "docs"} <= names
    assert not [(name, out) for name in names for out in pytestconfig.getini("norecursedirs") if fnmatch(name, out)]
