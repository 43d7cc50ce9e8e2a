"""A format is added by one object and one registry line; a reader's module is imported when its turn comes."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scans_folders import replica
from sequences import write_tiny_sequence

import simaps_viz
from simaps_viz.datasets import open as opening
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording
from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics

ARCHIVE = FormatFacts(
    title="NumPy archive",
    recognised_by="`frames.npz`",
    depth="float32 array",
    depth_unit_m=1.0,
    pose="camera to world: 4x4",
    up=(0.0, 0.0, 1.0),
)
"""Colour, depth and poses in one NumPy file."""


def open_archive(path: Path) -> Recording:
    with np.load(path / "frames.npz") as file:
        color, depth_m, poses = file["color"], file["depth_m"], file["poses"]
    return Recording(
        facts=ARCHIVE,
        path=path,
        name=path.name,
        frame_names=tuple(f"{i:03d}" for i in range(len(poses))),
        poses=poses,
        intrinsics=Intrinsics(16, 12, 14.0, 14.0, 7.5, 5.5),
        depth=lambda i: depth_m[i],
        color=lambda i: color[i],
        floor_height_m=0.0,
    )


def test_a_reader_is_one_object_and_one_registry_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    r = np.random.default_rng(15)
    color, depth_m = r.integers(0, 256, (3, 12, 16, 3), np.uint8), r.uniform(1, 3, (3, 12, 16)).astype(np.float32)
    np.savez(tmp_path / "frames.npz", color=color, depth_m=depth_m, poses=np.repeat(np.eye(4)[None], 3, axis=0))
    reader = Reader(ARCHIVE, lambda path: (path / "frames.npz").is_file(), open_archive)
    monkeypatch.setattr(opening, "READERS", [*opening.READERS, reader])

    sequence = simaps_viz.open_sequence(tmp_path)

    assert sequence.frame_names == ("000", "001", "002")
    np.testing.assert_array_equal(sequence.read(1).depth_m, depth_m[1])
    np.testing.assert_array_equal(sequence.color(2), color[2])
    assert opening.is_sequence(tmp_path)
    assert "| NumPy archive | `frames.npz` |" in opening.format_table()


@pytest.mark.slow
def test_readers_that_are_not_asked_are_not_imported(tmp_path: Path) -> None:
    path = write_tiny_sequence(tmp_path)
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        (tmp_path / "tum" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "tum" / name).write_text("")
    program = f"""
import sys
from pathlib import Path
from simaps_viz import open_sequence
from simaps_viz.datasets.open import recognise

def loaded():
    return sorted(name for name in ("tum", "rosbag", "rerun_rrd") if f"simaps_viz.datasets.{{name}}" in sys.modules)

open_sequence(Path({str(path)!r}))
open_sequence(Path({str(path.parent)!r}))
assert loaded() == []
assert recognise(Path({str(tmp_path / "tum")!r})).facts.title == "TUM RGB-D"
print(loaded(), "rosbags" in sys.modules, "rerun" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['tum'] False False"


def test_an_unknown_folder_gets_a_manifest_that_makes_it_readable(tmp_path: Path) -> None:
    """The error names the nearest format and what it lacks; the manifest it prints opens the very frames."""
    path = write_tiny_sequence(tmp_path / "tiny").parent
    expected = simaps_viz.open_sequence(path)
    (path / "sequence.json").unlink()
    with pytest.raises(InputError, match=r"found color/, depth/, ids/, intrinsics\.txt, .*; nearest is ") as caught:
        simaps_viz.open_sequence(path)
    notes = caught.value.__notes__
    assert all(any(note.startswith(f"  {r.facts.title}: ") for note in notes) for r in opening.readers())
    (manifest,) = (note for note in notes if note.startswith("{"))
    words = [sys.executable, "-m", "simaps_viz", "convert", str(path), "-o", str(tmp_path / "out")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert manifest.splitlines()[1] in done.stderr

    (path / "sequence.json").write_text(manifest)
    found = simaps_viz.open_sequence(path)
    np.testing.assert_array_equal(found.poses, expected.poses)
    np.testing.assert_allclose(found.read(1).depth_m, expected.read(1).depth_m, atol=1e-6)
    with pytest.raises(InputError, match=f"found tiny/; {path} is one"):
        simaps_viz.open_sequence(tmp_path)


@pytest.mark.parametrize(
    ("color", "depth"),
    [
        ("color_{}.png", "depth_{}.png"),  # FrankJIE09/tsdf-fusion-python, realsense_tsdf/captured_images
        ("frame_{}_rgb.png", "frame_{}_depth.png"),  # babaee984/RGBDMotion, Data
        ("image/rgb{}.png", "depth/depth{}.png"),  # sgffoen/stereo-3d-reconstruction, dataset
    ],
)
def test_the_manifest_of_an_unknown_folder_names_pictures_by_their_numbers(
    color: str, depth: str, tmp_path: Path
) -> None:
    """Colour and depth that lie in one folder, or begin with their own words, share a frame's number alone."""
    path = write_tiny_sequence(tmp_path / "tiny").parent
    expected = simaps_viz.open_sequence(path)
    depth_m = expected.read(1).depth_m
    (path / "sequence.json").unlink()
    numbers = {name: str(i) for i, name in enumerate(expected.frame_names)}
    for i, name in enumerate(expected.frame_names):
        for kind, called in (("color", color), ("depth", depth)):
            (file,) = (path / kind).glob(f"{name}.*")
            (path / called.format(i)).parent.mkdir(exist_ok=True)
            file.rename(path / called.format(i))
    for file in (path / "ids").iterdir():
        file.unlink()
    lines = [line.split(maxsplit=1) for line in (path / "poses.txt").read_text().splitlines()]
    (path / "poses.txt").write_text("\n".join(f"{numbers.get(name, name)} {rest}" for name, rest in lines))
    (path / "sequence.json").write_text(opening.manifest_for(path))
    found = simaps_viz.open_sequence(path)
    np.testing.assert_array_equal(found.poses, expected.poses)
    np.testing.assert_allclose(found.read(1).depth_m, depth_m, atol=1e-6)


def test_what_is_nearest_and_what_it_lacks(tmp_path: Path) -> None:
    path = replica(tmp_path).path
    (path / "traj.txt").unlink()
    with pytest.raises(InputError, match=r"nearest is Replica \(NICE-SLAM\), which also has traj\.txt"):
        simaps_viz.open_sequence(path)


@pytest.mark.parametrize(
    ("files", "named"),
    [
        (("data.jsonl", "calibration.json", "data.mp4", "metadata.json"), "a recording of Spectacular AI: "),
        (("train.json", "val.json", "images/depth_00001.png"), "an export of Spectacular AI for Taichi: "),
    ],
)
def test_what_another_program_makes_readable_is_named_with_it(tmp_path: Path, files: tuple, named: str) -> None:
    for file in files:
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text("{}")
    for path, says in ((tmp_path, "; it is "), (tmp_path / files[0], "found that its folder is ")):
        with pytest.raises(InputError, match=f"{says}{named}what `sai-cli process INPUT OUTPUT` makes .* is read"):
            simaps_viz.open_sequence(path)
    (tmp_path / files[1]).unlink()
    with pytest.raises(InputError, match=r"^(?!.*Spectacular)"):
        simaps_viz.open_sequence(tmp_path)


def test_formats_that_lack_as_little_are_all_named(tmp_path: Path) -> None:
    """Pictures of Open3D's recorder without a trajectory may get either's."""
    for folder in ("color", "depth"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "000000.png").touch()
    slam = r"nearest is RGB-D SLAM folder, which also has pose\.txt, or "
    with pytest.raises(InputError, match=slam + r"Redwood, Open3D, which also has trajectory\.log\n"):
        simaps_viz.open_sequence(tmp_path)
