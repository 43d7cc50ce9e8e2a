"""The doctor: each check tells a sound installation from a broken one, and never raises."""

import json
import os
import socket
import stat
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from packaging.specifiers import SpecifierSet

from simaps_viz.cli import doctor
from simaps_viz.cli.main import main


@pytest.mark.parametrize(
    ("version", "bounds", "good"),
    [
        ("2.4.6", "<3,>=2.0", True), ("3.0", "<3,>=2.0", False), ("2", ">=2.0", True), ("1.9.9", ">=2.0", False),
        ("0.41.0", "==0.41.0", True), ("0.41.1", "==0.41.0", False), ("0.41", "==0.41.0", True),
        ("2.17.7.post6", ">=2.17.7.post6", True), ("2.17.7", ">=2.17.7.post6", False),
        ("2.17.8", ">=2.17.7.post6", True),
        ("0.9", "<0.70", True), ("0.70", "<0.70", False), ("3.14.0", ">=3.11,<3.14", False), ("3.0rc1", ">=2", True),
        ("1.0", "", True), ("1.0", "!=1.0", False), ("2.0", "<=2", True), ("2.0.1", ">2.0", True),
    ],
)  # fmt: skip
def test_bounds(version, bounds, good):
    assert doctor.within(version, SpecifierSet(bounds)) is good


ASKED = [
    "numpy<3,>=2.0",
    "rerun-sdk[catalog]==0.41.0; extra == 'dev'",
    'pandas (<4,>=2.2) ; extra == "pandas"',
    "tyro",
    "winsomething; sys_platform == 'win32'",
]


@pytest.mark.parametrize(
    ("extra", "wanted"),
    [
        ("", [("numpy", "<3,>=2.0"), ("tyro", "")]),
        ("dev", [("rerun-sdk", "==0.41.0")]),
        ("pandas", [("pandas", "<4,>=2.2")]),
        ("none", []),
    ],
)
def test_requirements_are_read(extra, wanted, monkeypatch):
    monkeypatch.setattr(doctor, "requires", lambda name: ASKED)
    assert [(one.name, str(one.specifier)) for one in doctor.requirements(extra)] == wanted


def test_a_version_that_is_none_keeps_no_bounds():
    assert not doctor.within("unknown", SpecifierSet(">=1"))


def test_this_installation_keeps_its_bounds():
    asked = {one.name for one in doctor.requirements()}
    assert {"numpy", "numba", "viser", "rerun-sdk"} <= asked
    assert doctor.check_python().status == "ok"
    (packed,) = doctor.check_dependencies()
    assert packed.status == "ok" and all(name in packed.found for name in asked)
    assert doctor.check_kernels().status == doctor.check_networks().status == "ok"
    assert doctor.check_extras().status == "ok"


def test_a_missing_and_an_old_package_fail_and_say_what_to_do(monkeypatch):
    monkeypatch.setattr(doctor, "requires", lambda name: ["numpy<2", "nosuchthing<9,>=8", "viser==1.1.1"])
    old, missing, rest = doctor.check_dependencies()
    assert (old.name, old.status, missing.name, missing.status) == ("numpy", "fail", "nosuchthing", "fail")
    assert "expected <2" in old.found and missing.advice == "pip install 'nosuchthing<9,>=8'"
    assert rest.found == "1 within their bounds: viser 1.1.1"
    monkeypatch.setattr(doctor, "metadata", lambda name: {"Requires-Python": ">=3.99"})
    assert doctor.check_python().status == "fail" and "3.99" in doctor.check_python().advice


def test_extras_are_told_apart(monkeypatch):
    asked = ["viser>=1; extra == 'here'", "nosuch; extra == 'away'", "numpy<1; extra == 'old'", "x; extra == 'dev'"]
    extras = ["here", "away", "old", "dev"]
    monkeypatch.setattr(doctor, "metadata", lambda name: SimpleNamespace(get_all=lambda field: extras))
    monkeypatch.setattr(doctor, "requires", lambda name: asked)
    found = doctor.check_extras()
    assert found.status == "warn" and "numpy" in found.found and "(expected <1)" in found.found
    assert "installed: here, old; not installed: away" in found.found
    monkeypatch.setattr(doctor, "requires", lambda name: asked[:2])
    extras[:] = ["here", "away"]
    assert doctor.check_extras().advice == "if you need one: pip install 'simaps-viz[away]'"


def test_where_kernels_are_kept(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert doctor.kernel_folder(tmp_path) == tmp_path / "__pycache__"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "deep" / "er"))
    assert doctor.kernel_folder(Path("/nowhere")) == tmp_path / "deep" / "er"
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert doctor.kernel_folder(tmp_path) is None
    found = doctor.check_kernels()
    assert found.status == "warn" and "NUMBA_CACHE_DIR" in found.advice


def test_ports():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert doctor.check_port(port).status == "warn" and str(port) in doctor.check_port(port).found
    assert doctor.check_port(port).status == "ok"
    assert doctor.check_port(70_000).status == "warn"


def test_memory(tmp_path):
    file = tmp_path / "meminfo"
    for text, status in (("MemAvailable: 900000 kB\n", "warn"), ("MemAvailable: 9000000 kB\n", "ok"), ("?", "ok")):
        file.write_text(text)
        assert doctor.check_memory(file).status == status
    assert "cores" in doctor.check_memory(tmp_path / "missing").found


def test_clock():
    assert doctor.check_clock().status == "ok"
    assert doctor.check_clock(0.0).status == "warn" and "1970" in doctor.check_clock(0.0).found


def test_folders(monkeypatch, tmp_path):
    (tmp_path / "cache" / "maps").mkdir(parents=True)
    (tmp_path / "cache" / "maps" / "a").write_bytes(bytes(3_000_000))
    found = doctor.check_cache(tmp_path / "cache")
    assert found.status == "ok" and "3 MB in 1 files" in found.found
    assert doctor.check_cache(tmp_path / "not" / "yet").status == "ok"
    (tmp_path / "file").write_text("")
    assert doctor.check_cache(tmp_path / "file" / "below").status == "fail"
    assert doctor.check_disk(tmp_path / "not" / "yet").found.endswith(f"at {tmp_path}")
    for free, status in ((10_000_000, "fail"), (1_000_000_000, "warn"), (10_000_000_000, "ok")):
        monkeypatch.setattr(doctor.shutil, "disk_usage", lambda _, free=free: type("U", (), {"free": free}))
        assert doctor.check_disk(tmp_path).status == status


def test_recordings(monkeypatch, tmp_path):
    monkeypatch.setenv("SIMAPS_RECORDINGS", str(tmp_path / "own"))
    assert doctor.check_recordings().status == "ok"
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "cut.rrd").write_bytes(b"RRF2")
    found = doctor.check_recordings()
    assert found.status == "warn" and "cut" in found.found and "simaps recordings delete cut --yes" in found.advice


def program(folder: Path, name: str, body: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!{sys.executable}\nimport sys, time\n{body}\n")
    (folder / name).chmod(stat.S_IRWXU)


BROWSERS = [
    ("print('<p id=\"out\">webgl2: ANGLE (Fast &amp; Good)</p>')", "ok", "Fast & Good"),
    ("print('<p id=\"out\">webgl2: SwiftShader</p>')", "warn", "in software"),
    ("print('<p id=\"out\">no webgl2</p>')", "warn", "no WebGL 2"),
    ("sys.exit(1)", "warn", "no WebGL 2"),
    ("time.sleep(600)", "warn", "did not answer (TimeoutExpired)"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("body", "status", "words"), BROWSERS)
def test_browsers(monkeypatch, tmp_path, body, status, words):
    program(tmp_path / "bin", "chromium", body)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setattr(doctor, "BROWSER_TIMEOUT_S", 1.0 if "sleep" in body else 60.0)
    found = doctor.check_browser()
    assert found.status == status and words in found.found


def test_no_browser_and_no_card(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert doctor.check_browser().status == doctor.check_gpu().status == "ok"
    program(tmp_path / "bin", "nvidia-smi", "print('GPU 0: RTX 9 (UUID: GPU-1)')")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert doctor.check_gpu().found == "GPU 0: RTX 9"
    program(tmp_path / "bin", "nvidia-smi", "sys.exit(9)")
    assert doctor.check_gpu().status == "warn"


@pytest.mark.browser
def test_the_browser_of_this_machine_answers():
    if os.environ.get("SIMAPS_NO_BROWSER") == "1":
        pytest.skip("SIMAPS_NO_BROWSER=1")
    found = doctor.check_browser()
    assert "WebGL 2" in found.found and "did not answer" not in found.found


@pytest.mark.slow
def test_the_command(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    assert main(["doctor", "--no-browser", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is True and all(set(one) == {"name", "status", "found", "advice"} for one in report["checks"])
    names = [one["name"] for one in report["checks"]]
    assert {"Python", "packages", "compiled kernels", "networks", "GPU", "port", "cache", "disk", "clock"} <= set(names)
    assert not (tmp_path / "cache").exists(), "looking changes nothing"
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "file" / "below"))
    assert main(["doctor", "--no-browser"]) == 1
    out = capsys.readouterr().out
    assert "fail  cache: " in out and "      -> set SIMAPS_CACHE" in out and out.splitlines()[-1].startswith("simaps ")
