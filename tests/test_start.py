"""The first moment: the package loads nothing before it is asked for, and Ctrl-C is answered from then on."""

import ast
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import simaps_viz
from simaps_viz.__main__ import main


def test_the_package_alone_loads_no_library():
    code = "import sys, simaps_viz.__main__; print(sorted({'numpy', 'numba', 'networkx', 'rich'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_name_is_there_and_type_checkers_are_told_the_same():
    tree = ast.parse(Path(simaps_viz.__file__).read_text())
    told = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("simaps_viz.")
        for alias in node.names
    }
    assert told == simaps_viz._MODULE_OF and sorted(told) == sorted(simaps_viz.__all__)
    for name in simaps_viz.__all__:
        assert getattr(simaps_viz, name) is not None and name in dir(simaps_viz)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        simaps_viz.nothing  # noqa: B018 - asking is the test


def test_ctrl_c_while_the_program_loads_is_one_line(monkeypatch, capsys):
    def stopped():
        raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "simaps_viz.cli", SimpleNamespace(main=stopped))
    assert main() == 130
    assert capsys.readouterr().err == "simaps: interrupted\n"
