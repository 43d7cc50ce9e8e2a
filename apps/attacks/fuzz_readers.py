"""Fuzzing targets: every reader of recordings, and the files of a posed-frames/1 folder one by one."""

from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
from attacks.fuzz_cases import Case, Target
from attacks.fuzz_mutators import mutator_of
from scans import Z_UP, Sample, camera, write_reference
from scans_clouds import cloud_of, lidar, pcd, ply
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.datasets.calibration import matrix16, pose_rows, read_intrinsics
from simaps_viz.datasets.clouds import read_pcd, read_ply
from simaps_viz.datasets.images import read_color, read_depth, read_ids
from simaps_viz.datasets.manifest import read_manifest
from simaps_viz.datasets.posed_frames import read_frame_segments, read_world_segments

Writer = Callable[[Path], Sample]
_SKIPPED = (".conf",)


def one_file(data: bytes, name: str, read: Callable[[Path], object]) -> Callable[[Path], Case]:
    """Damage one small file and read it."""

    def prepare(folder: Path) -> Case:
        path, mutate = folder / name, mutator_of(name)

        def case(r: Random) -> object:
            path.write_bytes(mutate(r, data))
            return read(path)

        return case

    return prepare


def tiny_file(name: str, read: Callable[[Path], object]) -> Callable[[Path], Case]:
    """Damage one file of the tiny folder and read it alone."""

    def prepare(folder: Path) -> Case:
        write_tiny_sequence(folder / "tiny", truth="instances" if name == "scene.json" else "segments")
        data = (folder / "tiny" / name).read_bytes()
        return one_file(data, Path(name).name, read)(folder)

    return prepare


def recording(
    writer: Writer | Callable[[Path], object], use: Callable[[Path], object] | None = None
) -> Callable[[Path], Case]:
    """Damage one file of a recording, use it (open it and read two frames), and put it right again."""
    use = use or use_sequence

    def prepare(folder: Path) -> Case:
        made = writer(folder / "sample")
        path = made.path if isinstance(made, Sample) else folder / "sample"
        files = sorted(p for p in ([path] if path.is_file() else path.rglob("*")) if _counts(p))
        beside = path.parent / "cam_params.json"
        files += [beside] * beside.is_file()
        whole = {file: file.read_bytes() for file in files}

        def case(r: Random) -> object:
            file = r.choice(files)
            try:
                if r.random() < 0.03:
                    file.unlink()
                else:
                    file.write_bytes(mutator_of(file.name)(r, whole[file]))
                return use(path)
            finally:
                file.write_bytes(whole[file])

        return case

    return prepare


def use_sequence(path: Path) -> object:
    """Open a sequence and read two of its frames."""
    sequence = open_sequence(path)
    for index in (0, len(sequence) - 1):
        sequence.read(index, color=True)
        if len(sequence.labels) > 1:
            sequence.segmentation(index)
    return sequence


def _checked(path: Path) -> object:
    """Look for what is wrong with a sequence, drawn too."""
    from simaps_viz.checking.run import check  # noqa: PLC0415 - compiled, and needed by few

    return check(path, fix=False, picture=path / "checked.png", progress=lambda *_: None)


def tiny(folder: Path) -> None:
    write_tiny_sequence(folder)


def tiny_world(folder: Path) -> None:
    write_tiny_sequence(folder, truth="instances")


def gravity(folder: Path) -> None:
    """A folder whose manifest says neither up nor where the floor is."""
    write_reference(folder, camera(), Z_UP)


def _counts(path: Path) -> bool:
    return path.is_file() and not path.is_symlink() and path.suffix not in _SKIPPED


def _named(module: str, name: str) -> Writer:
    """Writers whose libraries are slow to load are loaded by the process that needs them."""

    def write(folder: Path) -> Sample:
        folder.mkdir(parents=True, exist_ok=True)
        return getattr(__import__(module), name)(folder)

    return write


def _cloud(form: str) -> bytes:
    points = np.asarray(cloud_of(0)[:60])
    return (
        pcd(points, form)
        if form in ("ascii", "binary", "binary_compressed")
        else ply(points, form.removeprefix("ply "))
    )


def _pictures(folder: Path) -> Case:
    write_tiny_sequence(folder / "tiny")
    files = {
        p: p.read_bytes() for kind in ("color", "depth", "ids") for p in sorted((folder / "tiny" / kind).iterdir())
    }
    jpeg = folder / "tiny" / "color" / "a.jpg"
    import cv2  # noqa: PLC0415 - as `_named`

    cv2.imwrite(str(jpeg), np.arange(24 * 32 * 3, dtype=np.uint8).reshape(24, 32, 3))
    files[jpeg] = jpeg.read_bytes()

    def case(r: Random) -> object:
        path = r.choice(list(files))
        target = folder / path.name
        target.write_bytes(mutator_of(path.name)(r, files[path]))
        return r.choice((read_color, read_ids, lambda p: read_depth(p, 0.001)))(target)

    return case


FOLDERS = ("tum", "seven_scenes", "scannet", "replica", "nerfstudio", "habitat", "habitat_classes", "arkit", "polycam",
           "bundle_fusion", "sens", "amazon", "sun3d")  # fmt: skip
LARGE = ("tum", "seven_scenes")
"""Their pictures have 640 x 480 pixels."""
APPS = ("record3d_folder", "record3d_zip", "record3d_exr")
SLAM = ("colmap", "instant_ngp", "redwood", "rtabmap", "slam_folder", "stray_scanner", "pose_lines", "matrix_lines")
BAGS = ("ros1_bag", "ros2_sqlite", "ros2_mcap")

READER_TARGETS = (
    Target("manifest", tiny_file("sequence.json", read_manifest), weight=200, guided=True),
    Target("poses", tiny_file("poses.txt", lambda p: [matrix16(*row) for row in pose_rows(p).values()]), weight=120,
           guided=True),
    Target("intrinsics", tiny_file("intrinsics.txt", lambda p: read_intrinsics(p, width=32, height=24)), weight=120,
           guided=True),
    Target("segment table", tiny_file("segments.json", lambda p: read_frame_segments(p, ["0010", "0011"])), weight=100,
           guided=True),
    Target("instance table", tiny_file("scene.json", read_world_segments), weight=80, guided=True),
    Target("pictures", _pictures, weight=50),
    *(Target(f"cloud {form}", one_file(_cloud(form), f"a.{'ply' if 'ply' in form else 'pcd'}",
                                       read_ply if "ply" in form else read_pcd), weight=15, guided=True)
      for form in ("ply ascii", "ply binary_little_endian", "ply binary_big_endian", "ascii", "binary",
                   "binary_compressed")),
    Target("posed frames", recording(tiny), weight=10),
    Target("posed frames, scene", recording(tiny_world), weight=5),
    Target("posed frames, no up", recording(gravity), weight=3),
    Target("check", recording(tiny, _checked), weight=2),
    Target("check, no up", recording(gravity, _checked), weight=1),
    *(Target(name, recording(_named("scans_folders", name)), weight=1 if name in LARGE else 3) for name in FOLDERS),
    *(Target(name, recording(_named("scans_apps", name)), weight=3) for name in APPS),
    *(Target(name, recording(_named("scans_bags", name)), weight=2) for name in BAGS),
    *(Target(name, recording(_named("scans_slam", name)), weight=3) for name in SLAM),
    *(Target(name, recording(_named("scans_mcap", name)), weight=2) for name in ("ros1_mcap", "foxglove_mcap")),
    Target("ros clouds", recording(_named("scans_clouds", "cloud_bag")), weight=2),
    Target("lidar", recording(lidar), weight=3),
    Target("kitti360", recording(_named("scans_clouds", "kitti360")), weight=3),
    Target("rerun_rrd", recording(_named("scans_rerun", "rerun_rrd")), weight=2),
)  # fmt: skip
