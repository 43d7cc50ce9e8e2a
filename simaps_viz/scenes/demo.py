"""An embedded place as a sequence on disk: rendered on first use, cached, written whole or not at all."""

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import platformdirs
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.io.files import write_whole
from simaps_viz.scenes.places import Place, place_of
from simaps_viz.scenes.render import DepthSensor, Renderer, sense
from simaps_viz.scenes.simulated_errors import check_level, known_instances, simulate_errors
from simaps_viz.structures import Intrinsics

VERSION = 1
"""Raise it when the files' meaning changes; a change of the scene's program is noticed by itself."""
CACHE_VARIABLE = "SIMAPS_CACHE"
WORKERS = min(os.cpu_count() or 1, 6)
STALE_AFTER_S = 24 * 3600.0
"""Unfinished folders older than this were left by a crash and are removed."""
_PARTIAL = ".partial-"


@dataclass(frozen=True)
class DemoSettings:
    """What is rendered; every value is part of the cache's key."""

    frames: int = 200
    width: int = 640
    height: int = 480
    focal_share: float = 0.6875
    """Focal length as a share of the width: 440 pixels at 640, a view of 72 degrees."""
    sensor: DepthSensor = field(default_factory=DepthSensor)
    sensor_seed: int = 0

    def intrinsics(self) -> Intrinsics:
        """Return the camera: square pixels, principal point in the middle."""
        focal = self.focal_share * self.width
        return Intrinsics(self.width, self.height, focal, focal, (self.width - 1) / 2, (self.height - 1) / 2)

    def key(self, place: Place) -> str:
        """Hash these values, the version and the program that makes the place: 16 hex digits."""
        digest = hashlib.sha256(json.dumps([VERSION, asdict(self)], sort_keys=True).encode())
        for source in place.sources():
            digest.update(source.name.encode() + source.read_bytes())
        return digest.hexdigest()[:16]


def settings_of(place: Place) -> DemoSettings:
    """Return what is rendered of a place unless something else is asked for."""
    return DemoSettings(frames=place.frames, width=place.width, height=place.width * 3 // 4)


def ensure_demo(
    place: str = "cafe",
    *,
    level: str = "light",
    seed: int = 0,
    cache_dir: Path | None = None,
    progress: Progress | None = None,
    settings: DemoSettings | None = None,
) -> Path:
    """Render an embedded place if this has not been done yet, and return the manifest of the wanted masks.

    Args:
        place: One of ``places.PLACES``.
        level: Simulated network errors: none (the exact masks), light, medium, heavy or detector.
        seed: Of the errors; not negative.
        cache_dir: Where to keep it; else the variable SIMAPS_CACHE, else the user's cache folder.
        progress: Told how far it is.
        settings: What to render; the café's default takes about half a minute on two cores.

    Returns:
        Path of a ``posed-frames/1`` manifest.

    Raises:
        InputError: There is no such place or level, the seed is negative, or the cache cannot be written.
    """
    check_level(level)
    if seed < 0:
        raise InputError(f"seed: expected 0 or more, found {seed}")
    tell = progress or (lambda stage, done, total: None)
    manifest = demo_manifest(place, level=level, seed=seed, cache_dir=cache_dir, settings=settings)
    folder = manifest.parent
    try:
        if not (folder / "sequence.json").is_file():
            _render(folder, place_of(place), settings or settings_of(place_of(place)), tell)
        if not manifest.is_file():
            _spoil(folder, manifest, place_of(place), level, seed, tell)
        return manifest
    except OSError as error:
        raise InputError(
            f"{folder}: expected to keep the rendered scene there, found {error.strerror or error}"
        ) from error


def demo_manifest(
    place: str = "cafe",
    *,
    level: str = "light",
    seed: int = 0,
    cache_dir: Path | None = None,
    settings: DemoSettings | None = None,
) -> Path:
    """Return the path that `ensure_demo` returns for the same arguments, whether or not it is there yet."""
    known = place_of(place)
    folder = _cache_root(cache_dir) / "scenes" / f"{place}-{(settings or settings_of(known)).key(known)}"
    if level == "none":
        return folder / "sequence.json"
    return folder / f"sequence-{level if seed == 0 else f'{level}-seed{seed}'}.json"


def _cache_root(cache_dir: Path | None) -> Path:
    if cache_dir is not None:
        return Path(cache_dir)
    named = os.environ.get(CACHE_VARIABLE, "").strip()
    return Path(named) if named else platformdirs.user_cache_path("simaps", appauthor=False)


@contextmanager
def _whole_or_nothing(target: Path) -> Iterator[Path]:
    """Return a new folder beside ``target`` that becomes ``target`` at the end, or is removed on any failure.

    When another process was faster, its folder stays and this one is dropped.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    for old in target.parent.glob(f"{_PARTIAL}*"):
        with suppress(FileNotFoundError):  # its owner may have finished meanwhile
            if time.time() - old.stat().st_mtime > STALE_AFTER_S:
                shutil.rmtree(old, ignore_errors=True)
    partial = Path(tempfile.mkdtemp(prefix=_PARTIAL, dir=target.parent))
    try:
        yield partial
        partial.chmod(0o755)
        try:
            partial.rename(target)
        except OSError:
            if not target.is_dir():
                raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _write_image(path: Path, image: NDArray, options: list[int]) -> None:
    done, data = cv2.imencode(path.suffix, image, options)
    if not done:
        raise OSError(f"{path.name} could not be encoded")
    path.write_bytes(data.tobytes())


_FAST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 92]


def _in_parallel(work: Callable[[int], Any], count: int, stage: str, tell: Progress) -> list[Any]:
    """Do ``work(0) … work(count - 1)`` in threads (Embree, OpenCV and numpy release the lock); results in order."""
    tell(stage, 0, count)
    pool = ThreadPoolExecutor(WORKERS)
    try:
        futures: list[Future[Any]] = [pool.submit(work, i) for i in range(count)]
        for done, future in enumerate(as_completed(futures), start=1):
            future.result()
            tell(stage, done, count)
        return [future.result() for future in futures]
    finally:
        pool.shutdown(cancel_futures=True)


def _render(folder: Path, place: Place, settings: DemoSettings, tell: Progress) -> None:
    """Render all frames into ``folder``, with the manifest of the exact masks."""
    tell("building the scene", 0, 1)
    scene, intrinsics = place.scene(), settings.intrinsics()
    renderer, walk = Renderer(scene, intrinsics), place.walk(settings.frames)
    tell("building the scene", 1, 1)
    if folder.is_dir() and not (folder / "sequence.json").is_file():  # of no use; a whole one came from another process
        shutil.rmtree(folder)
    with _whole_or_nothing(folder) as partial:
        for name in ("color", "depth", "instance"):
            (partial / name).mkdir()

        def one(index: int) -> None:
            frame = renderer.render(walk.T_world_camera[index])
            rng = np.random.default_rng([settings.sensor_seed, index])
            name = f"{index:06d}"
            depth, instance = sense(frame.depth_m, frame.incidence, frame.instance, settings.sensor, rng)
            _write_image(partial / "color" / f"{name}.jpg", cv2.cvtColor(frame.color, cv2.COLOR_RGB2BGR), _JPEG)
            _write_image(partial / "depth" / f"{name}.png", depth, _FAST_PNG)
            _write_image(partial / "instance" / f"{name}.png", instance, _FAST_PNG)

        _in_parallel(one, settings.frames, "rendering frames", tell)
        np.savetxt(partial / "intrinsics.txt", intrinsics.matrix(), fmt="%.9g")
        poses = [f"{i:06d} " + " ".join(f"{n:.9g}" for n in T.ravel()) for i, T in enumerate(walk.T_world_camera)]
        (partial / "poses.txt").write_text("\n".join(poses) + "\n", encoding="utf-8")
        (partial / "scene.json").write_text(json.dumps(scene.table(), indent=1) + "\n", encoding="utf-8")
        exact = {"ids": "instance/{frame}.png", "instances": "scene.json", "source": "renderer", "ground_truth": True}
        _write_manifest(partial / "sequence.json", place, "", exact)


def _write_manifest(path: Path, place: Place, errors: str, segmentation: dict[str, Any]) -> None:
    """Write a manifest; it appears whole, and last, so that what it names is there."""
    manifest = {
        "name": place.name + errors,
        "description": f"{place.title}, ray cast, with simulated depth noise.",
        "format": "posed-frames/1",
        "simulated": True,
        "color": "color/{frame}.jpg",
        "depth": "depth/{frame}.png",
        "depth_unit_m": 0.001,
        "intrinsics": "intrinsics.txt",
        "poses": "poses.txt",
        "pose": "T_world_camera",
        "camera_axes": "x right, y down, z forward",
        "up": [0, 0, 1],
        "floor_height_m": 0.0,
        "segmentation": segmentation,
    }
    text = json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"
    write_whole(path, text.encode(), "the rendered scene", durable=False)


def _spoil(folder: Path, manifest: Path, place: Place, level: str, seed: int, tell: Progress) -> None:
    """Write the masks with simulated errors of one level and seed, then their manifest."""
    instances = known_instances(json.loads((folder / "scene.json").read_text(encoding="utf-8")))
    names = [line.split()[0] for line in (folder / "poses.txt").read_text(encoding="utf-8").splitlines()]
    target = folder / f"errors-{level}-seed{seed}"
    if target.is_dir() and not (target / "segments.json").is_file():
        shutil.rmtree(target)
    if not target.is_dir():
        with _whole_or_nothing(target) as partial:

            def one(index: int) -> list[dict[str, Any]]:
                exact = cv2.imread(str(folder / "instance" / f"{names[index]}.png"), cv2.IMREAD_UNCHANGED)
                if exact is None:
                    raise OSError(
                        f"instance/{names[index]}.png is missing or damaged: delete the folder to render anew"
                    )
                ids, rows = simulate_errors(exact, instances, level=level, seed=seed, frame=names[index])
                narrow = ids.astype(np.uint8) if ids.max() < 256 else ids
                _write_image(partial / f"{names[index]}.png", narrow, _FAST_PNG)
                return rows

            rows = _in_parallel(one, len(names), "simulating network errors", tell)
            table = json.dumps(dict(zip(names, rows, strict=True)), separators=(",", ":"))
            (partial / "segments.json").write_text(table + "\n", encoding="utf-8")
    spoiled = {
        "ids": f"{target.name}/{{frame}}.png",
        "segments": f"{target.name}/segments.json",
        "source": f"simulated network errors, {level}, seed {seed}",
        "ground_truth": False,
    }
    _write_manifest(manifest, place, f", {level} errors", spoiled)
