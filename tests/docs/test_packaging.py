"""The wheel and the source archive: complete, small, and at work in an environment that has never seen the repository.

The wheel is built from the source archive. The fresh environment borrows this one's libraries through a .pth file, as
downloading them takes minutes, and what was compiled before, kernels' machine code too; the package itself comes from
the wheel alone.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from dataclasses import dataclass
from email.parser import Parser
from pathlib import Path

import pytest
from docs_pages import PAGES, links
from sequences import write_tiny_sequence

ROOT = Path(__file__).parents[2]
MAX_SDIST_BYTES = 10_000_000


@dataclass(frozen=True)
class Built:
    sdist: Path
    wheel: Path


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return Built(sdist, wheel)


@pytest.fixture(scope="module")
def fresh(built, tmp_path_factory):
    """The bin folder of a new environment with the wheel installed, far from the repository."""
    home = tmp_path_factory.mktemp("fresh") / "env"
    venv.create(home, with_pip=False, symlinks=True)
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check", "install", "--quiet"]
    subprocess.run([*pip, "--no-deps", "--no-index", "--no-compile", str(built.wheel)], check=True)
    purelib = Path(sysconfig.get_path("purelib", vars={"base": str(home)}))
    (purelib / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    lend_compiled(purelib)
    return home / "bin"


def lend_compiled(purelib):
    """Lend what Python and numba have compiled in the repository to the files that are the same, as old as theirs."""
    for source in (ROOT / "simaps_viz").rglob("*.py"):
        installed = purelib / source.relative_to(ROOT)
        if installed.is_file() and installed.read_bytes() == source.read_bytes():
            shutil.copystat(source, installed)
            installed.with_name("__pycache__").mkdir(exist_ok=True)
            folder = source.with_name("__pycache__")
            for kept in (*folder.glob(f"{source.stem}.*.nb[ci]"), *folder.glob(f"{source.stem}.*.pyc")):
                shutil.copy(kept, installed.with_name("__pycache__"))


@pytest.fixture(scope="module")
def tiny(fresh, tmp_path_factory):
    """A folder with a tiny sequence, and a map that the installed command built of it."""
    folder = tmp_path_factory.mktemp("tiny")
    write_tiny_sequence(folder / "tiny")
    run_there(fresh, folder, "simaps", "build", "tiny", "-o", "tiny.npz")
    return folder


def run_there(fresh, cwd, *command, **environment):
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [str(fresh / command[0]), *command[1:]],
        cwd=cwd,
        capture_output=True,
        text=True,
        env=clean | environment,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def tracked(*patterns):
    command = ["git", "ls-files", "-co", "--exclude-standard", *patterns]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
    if listed.returncode:
        pytest.skip("needs the repository: git does not know this folder")
    return {name for name in listed.stdout.decode().split() if (ROOT / name).is_file()}


def test_the_wheel_is_the_package_and_nothing_else(built):
    with zipfile.ZipFile(built.wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        meta = Parser().parsestr(archive.read(next(n for n in archive.namelist() if n.endswith("METADATA"))).decode())
        licences = [n for n in archive.namelist() if n.endswith("licenses/LICENSE")]
    assert names == tracked("simaps_viz") and "simaps_viz/py.typed" in names
    assert meta["License-Expression"] == "MIT" and len(licences) == 1
    assert {"pandas", "cluster", "export", "record3d"} <= set(meta.get_all("Provides-Extra") or [])


def test_the_source_archive_has_sources_and_no_recordings(built):
    with tarfile.open(built.sdist) as archive:
        names = {member.name.partition("/")[2] for member in archive.getmembers() if member.isfile()}
    pages = ("README.md", "CHANGELOG.md", "SECURITY.md", "ARCHITECTURE.md", "CONTRIBUTING.md")
    wanted = tracked("simaps_viz", "apps", "tests", "docs", "assets", *pages, "LICENSE", "Makefile")
    assert names - {"PKG-INFO", ".gitignore", "pyproject.toml"} == wanted and "pyproject.toml" in names
    assert built.sdist.stat().st_size < MAX_SDIST_BYTES


def test_what_the_pages_link_to_is_in_the_source_archive(built):
    with tarfile.open(built.sdist) as archive:
        names = {member.name.partition("/")[2] for member in archive.getmembers()}
    folders = {str(folder) for name in names for folder in Path(name).parents}
    for page, target in [(one, target) for one in PAGES for target in links(one)]:
        there = os.path.normpath(Path(page).parent / target)
        assert there in names | folders, f"{page}: {target}"


def test_every_module_is_imported_from_the_wheel(fresh, tmp_path):
    code = (
        "import importlib, pkgutil, simaps_viz;"
        "names = [m.name for m in pkgutil.walk_packages(simaps_viz.__path__, 'simaps_viz.')];"
        "[importlib.import_module(n) for n in names];"
        "print(len(names), simaps_viz.__file__, simaps_viz.__version__)"
    )
    count, file, version = run_there(fresh, tmp_path, "python", "-c", code).split()
    modules = {name for name in tracked("simaps_viz/*.py") if name != "simaps_viz/__init__.py"}
    assert int(count) == len(modules) and version == "0.1.0"
    assert Path(file).is_relative_to(fresh.parent)


def test_the_installed_command_builds_and_answers(fresh, tiny):
    assert "simaps" in run_there(fresh, tiny, "simaps", "--help")
    assert '"chair": 2' in run_there(fresh, tiny, "simaps", "info", "tiny.npz", "--json")


def test_the_rest_works_without_the_extras(fresh, tiny):
    code = (
        "import sys\nfor name in ('pandas', 'OpenEXR', 'liblzfse', 'tokenizers'):\n"
        "    sys.modules[name] = None\n"
        "from simaps_viz.cli.main import main\n"
        "assert main(['build', 'tiny', '-o', 't.npz', '--record', 't.rrd']) == 0\n"
        "assert main(['query', 't.npz', 'turn left']) == 0\n"
        "import simaps_viz.viewer.workbench, simaps_viz.evaluation.report, simaps_viz.checking.run\n"
    )
    run_there(fresh, tiny, "python", "-c", code)
