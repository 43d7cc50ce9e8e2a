"""docs/FORMATS.md says what the readers do, and `simaps convert` and `view` know their files."""

import json
from pathlib import Path

import pytest
from scans_folders import replica, scannet

from simaps_viz import open_sequence
from simaps_viz.cli import main
from simaps_viz.datasets.open import format_table, is_sequence, readers

FORMATS = Path(__file__).parents[2] / "docs" / "FORMATS.md"


def test_the_table_is_the_readers_own():
    """To renew it: python -c "from simaps_viz.datasets.open import format_table; print(format_table())"."""
    assert format_table() in FORMATS.read_text()
    titles = [reader.facts.title for reader in readers()]
    assert len(titles) == len(set(titles)) > 10


def test_convert(tmp_path, capsys):
    sample = scannet(tmp_path)
    assert main.main(["convert", str(sample.path), "-o", str(tmp_path / "out"), "--every", "3", "--json"]) == main.OK
    said = json.loads(capsys.readouterr().out)
    assert said == {
        "event": "done",
        "manifest": str(tmp_path / "out" / "sequence.json"),
        "name": "scene0000_00",
        "frames": 2,
        "segmentation": "ScanNet annotation (instance-filt)",
        "notes": ["1 of 5 frames have no pose, tracking was lost: left out"],
    }
    assert open_sequence(tmp_path / "out").frame_names == ("0", "10")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(["--every", "0"], "--every: expected a whole number from 1, found 0"), ([], "expected a new or empty folder")],
)
def test_convert_refuses(tmp_path, capsys, arguments, says):
    sample, out = replica(tmp_path), tmp_path / "out"
    if not arguments:
        out.mkdir()
        (out / "mine.txt").write_text("keep")
    assert main.main(["convert", str(sample.path), "-o", str(out), *arguments]) == main.BAD_INPUT
    assert says in capsys.readouterr().err.replace("\n", "")
    assert [p.name for p in out.iterdir()] == ["mine.txt"] if not arguments else not out.exists()


def test_a_damaged_frame_leaves_nothing_behind(tmp_path, capsys):
    sample = replica(tmp_path)
    sequence = open_sequence(sample.path)
    file = sample.path / "results" / "frame000003.jpg"
    file.write_bytes(file.read_bytes()[:500])
    before = sorted(tmp_path.iterdir())
    assert main.main(["convert", str(sample.path), "-o", str(tmp_path / "out"), "--strict"]) == main.BAD_INPUT
    assert "frame000003.jpg: expected a whole image, found a truncated JPEG" in capsys.readouterr().err.replace(
        "\n", ""
    )
    assert sorted(tmp_path.iterdir()) == before and len(sequence) == 4


def test_what_is_a_sequence(tmp_path):
    for name in ("map.npz", "scan.sens", "scan.r3d"):
        (tmp_path / name).write_bytes(b"")
    assert [is_sequence(tmp_path / n) for n in ("", "x.json", "scan.sens", "scan.r3d", "map.npz", "scan.txt")] == [
        True, True, True, True, False, False,
    ]  # fmt: skip
