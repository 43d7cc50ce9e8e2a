"""The first moment: the package loads nothing before it is asked for, and Ctrl-C is answered from then on."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

import simaps_viz
from simaps_viz.__main__ import main


def test_the_package_alone_loads_no_library():
    code = "import sys, simaps_viz.__main__; print(sorted({'numpy', 'numba', 'networkx', 'rich'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there():
    assert len(simaps_viz.__all__) > 30
    for name in simaps_viz.__all__:
        assert getattr(simaps_viz, name) is not None and name in dir(simaps_viz)
    with pytest.raises(AttributeError, match="No simaps_viz attribute nothing"):
        simaps_viz.nothing  # noqa: B018 # pyright: ignore[reportAttributeAccessIssue] - asking is the test


def test_ctrl_c_while_the_program_loads_is_one_line(monkeypatch, capsys):
    def stopped():
        raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "simaps_viz.cli.main", SimpleNamespace(main=stopped))
    assert main() == 130
    assert capsys.readouterr().err == "simaps: interrupted\n"
