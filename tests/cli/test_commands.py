"""The commands by name: one file and one line each, light to list, and as they always were on the command line."""

import subprocess
import sys
from dataclasses import dataclass, is_dataclass
from types import ModuleType
from typing import get_args

import pytest

from simaps_viz.baselines import BASELINES
from simaps_viz.build import METHOD_NAMES
from simaps_viz.cli import COMMANDS, NO
from simaps_viz.cli.demo import Level
from simaps_viz.cli.main import load, main
from simaps_viz.cli.options import MappingOptions, Networks
from simaps_viz.exports import FormatName
from simaps_viz.exports.formats import EXPORTERS
from simaps_viz.mapping import methods
from simaps_viz.mapping.config import BuildConfig
from simaps_viz.scenes.simulated_errors import LEVELS
from simaps_viz.segmentation.recognise import NetworkSettings

HEAVY = ("numba", "scipy", "viser", "rerun", "networkx", "onnxruntime", "cv2", "trimesh")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_is_a_dataclass_that_says_what_it_does(name):
    command = load(name)
    assert is_dataclass(command) and callable(command.run)
    assert command.__name__.lower() == name.replace("-", "") and "Example: " in (command.__doc__ or "")


def test_a_new_command_is_one_class_and_one_line(monkeypatch, capsys):
    @dataclass(frozen=True)
    class Greet:
        """Greet somebody.

        Example: simaps greet --name Ada
        """

        name: str = "world"
        """Whom to greet."""

        def run(self) -> int:
            sys.stdout.write(f"Hello, {self.name}\n")
            return NO

    module = ModuleType("greetings")
    module.__dict__["Greet"] = Greet
    monkeypatch.setitem(sys.modules, "greetings", module)
    monkeypatch.setitem(COMMANDS, "greet", "greetings:Greet")
    assert main(["greet", "--name", "Ada"]) == NO
    assert capsys.readouterr().out == "Hello, Ada\n"
    for words in (["--help"], ["greet", "--help"]):
        with pytest.raises(SystemExit):
            main(words)
        assert "Greet somebody." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "also"), [(["--version"], ["tyro", "numpy", "rich"]), (["--help"], ["numpy"]), (["build", "--help"], [])]
)
def test_help_and_version_load_only_what_they_print(words, also):
    """Neither heavy libraries nor what is named in ``also``."""
    code = (
        "import sys, atexit; from simaps_viz.cli.main import main\n"
        f"atexit.register(lambda: print(sorted(set({[*HEAVY, *also]!r}) & set(sys.modules)), file=sys.stderr))\n"
        f"main({words!r})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]" and done.stdout


def test_help_of_a_command_loads_no_other():
    code = (
        "import sys, atexit; from simaps_viz.cli.main import main\n"
        "commands = ('demo', 'build', 'evaluate', 'recordings', 'doctor')\n"
        "there = lambda: [one for one in commands if f'simaps_viz.cli.{one}' in sys.modules]\n"
        "atexit.register(lambda: print(there(), file=sys.stderr))\n"
        "main(['build', '--help'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "['build']"


def test_what_reads_no_sentence_loads_no_words():
    code = (
        "import sys, simaps_viz.build.methods, simaps_viz.drawing.legend, simaps_viz.exports.records\n"
        "print([name for name in sys.modules if name.startswith('simaps_viz.language')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_an_unknown_command_is_answered_with_those_there_are(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["bild"])
    err = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert stopped.value.code == 2 and "bild" in err and "demo, build, view, query" in err


def test_shells_complete_all_commands(capsys):
    with pytest.raises(SystemExit):
        main(["--tyro-print-completion", "bash"])
    script = capsys.readouterr().out
    assert all(name in script for name in COMMANDS) and "--cell-size" in script


def test_an_underscore_is_as_good_as_a_hyphen(capsys):
    with pytest.raises(SystemExit) as helped:
        main(["export_network", "--help"])
    assert helped.value.code == 0 and "usage: simaps export-network" in capsys.readouterr().out


def test_options_have_the_defaults_of_the_settings_that_they_make():
    assert MappingOptions().config() == BuildConfig() and Networks().settings() == NetworkSettings()


def test_the_names_that_options_offer_are_those_there_are():
    assert set(METHOD_NAMES) == {*methods.METHODS, *BASELINES}
    assert get_args(FormatName) == tuple(EXPORTERS) and get_args(Level) == tuple(LEVELS)
