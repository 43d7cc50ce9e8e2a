"""The embedded scene on disk: format, determinism, and that nothing half-made ever looks complete."""

import hashlib
import json
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.scenes import demo
from simaps_viz.scenes.demo import DemoSettings, ensure_demo
from simaps_viz.scenes.places import PLACES
from simaps_viz.scenes.render import DepthSensor

pytestmark = pytest.mark.slow

CAFE = PLACES["cafe"]
TINY = DemoSettings(frames=8, width=160, height=120)


def fingerprint(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def rendered(tmp_path_factory) -> Path:
    """The tiny scene with masks of level light."""
    return ensure_demo(cache_dir=tmp_path_factory.mktemp("cache"), settings=TINY)


def test_it_opens_as_a_sequence(rendered):
    sequence = open_sequence(rendered)
    assert len(sequence) == 8
    assert sequence.simulated and not sequence.ground_truth
    assert sequence.segmentation_source == "simulated network errors, light, seed 0"
    np.testing.assert_allclose(sequence.T_map_world, np.eye(4))
    frame = sequence.read(3, color=True)
    assert frame.color is not None and frame.color.shape == (120, 160, 3)
    assert 0.3 <= np.median(frame.depth_m[frame.depth_m > 0]) < 6.0
    segmentation = sequence.segmentation(3)
    assert set(np.unique(segmentation.ids)) - {0} <= {s.id for s in segmentation.segments}
    thing = {s.label: s.is_thing for s in segmentation.segments}
    assert not thing["floor"] and not thing["wall"] and any(thing.values())


def test_exact_masks_are_the_truth(rendered):
    manifest = ensure_demo(level="none", cache_dir=rendered.parents[2], settings=TINY)
    assert manifest == rendered.parent / "sequence.json"
    sequence = open_sequence(manifest)
    assert sequence.ground_truth and sequence.simulated and sequence.segmentation_source == "renderer"
    table = json.loads((rendered.parent / "scene.json").read_text(encoding="utf-8"))
    names = {row["id"]: row["label"] for row in table["instances"]}
    assert table["up"] == "+z" and table["units"] == "metre"
    for index in range(8):
        exact = cv2.imread(str(rendered.parent / "instance" / f"{index:06d}.png"), cv2.IMREAD_UNCHANGED)
        segmentation = sequence.segmentation(index)
        assert (segmentation.ids == exact).all()
        assert all(names[s.id] == s.label for s in segmentation.segments)


def test_measured_points_lie_near_their_instance_s_box(rendered):
    """Noise and lost edges included: nearly all pixels away from edges, within three standard deviations."""
    sequence = open_sequence(rendered.parent / "sequence.json")
    table = json.loads((rendered.parent / "scene.json").read_text(encoding="utf-8"))["instances"]
    boxes = np.array([[[0, 0, 0]] * 2, *[[row["aabb_min"], row["aabb_max"]] for row in table]])
    K = sequence.intrinsics
    for index in range(8):
        depth, ids = sequence.read(index).depth_m, sequence.segmentation(index).ids.astype(np.uint8)
        inner = cv2.erode(ids, np.ones((5, 5))) == cv2.dilate(ids, np.ones((5, 5)))
        v, u = np.nonzero(inner & (depth > 0))
        z = depth[v, u].astype(np.float64)
        camera = np.stack([(u - K.cx) / K.fx * z, (v - K.cy) / K.fy * z, z], -1)
        T = sequence.poses[index]
        world = camera @ T[:3, :3].T + T[:3, 3]
        low, high = boxes[ids[v, u]].swapaxes(0, 1)
        slack = 3 * DepthSensor().sigma_m(z)[:, None] * 1.3 + 0.03
        assert ((world > low - slack) & (world < high + slack)).all(axis=1).mean() > 0.97


def test_same_settings_same_bytes_and_other_seeds_other_bytes(rendered, tmp_path):
    again = ensure_demo(cache_dir=tmp_path / "a", settings=TINY)
    first = fingerprint(rendered.parent)
    assert fingerprint(again.parent) == {k: first[k] for k in fingerprint(again.parent)}
    noisy = ensure_demo(cache_dir=tmp_path / "b", settings=DemoSettings(8, 160, 120, sensor_seed=1))
    second = fingerprint(noisy.parent)
    assert second["depth/000000.png"] != first["depth/000000.png"]
    assert second["color/000000.jpg"] == first["color/000000.jpg"]
    assert noisy.parent.name != rendered.parent.name
    other = ensure_demo(seed=1, cache_dir=tmp_path / "a", settings=TINY)
    assert other.name == "sequence-light-seed1.json"
    third = fingerprint(other.parent)
    assert third["errors-light-seed1/segments.json"] != third["errors-light-seed0/segments.json"]


def test_the_second_call_renders_nothing(rendered, monkeypatch):
    monkeypatch.setattr(demo, "Renderer", None)
    before = fingerprint(rendered.parent)
    assert ensure_demo(cache_dir=rendered.parents[2], settings=TINY) == rendered
    assert fingerprint(rendered.parent) == before


def test_what_a_killed_process_left_is_rendered_anew_and_progress_counts_up_stage_by_stage(tmp_path):
    """No manifest, no sequence."""
    folder = tmp_path / "scenes" / f"cafe-{TINY.key(CAFE)}"
    (folder / "errors-light-seed0").mkdir(parents=True)
    (folder / "color").mkdir()
    (folder / ".partial-x").mkdir()
    told: list[tuple[str, int, int]] = []
    manifest = ensure_demo(cache_dir=tmp_path, settings=TINY, progress=lambda *step: told.append(step))
    assert len(open_sequence(manifest)) == 8
    stages = list(dict.fromkeys(stage for stage, _, _ in told))
    assert stages == ["building the scene", "rendering frames", "simulating network errors"]
    for stage in stages:
        done = [d for s, d, _ in told if s == stage]
        total = {n for s, _, n in told if s == stage}
        assert done == list(range(done[-1] + 1)) and total == {done[-1]}


@pytest.mark.parametrize(
    ("stage", "failure"), [("rendering frames", KeyboardInterrupt), ("simulating network errors", RuntimeError)]
)
def test_an_interrupted_run_leaves_nothing_that_looks_complete(tmp_path, stage, failure):
    def stop(now: str, done: int, _total: int) -> None:
        if now == stage and done == 3:
            raise failure

    with pytest.raises(failure):
        ensure_demo(cache_dir=tmp_path, settings=TINY, progress=stop)
    assert not list(tmp_path.rglob("sequence-light.json"))
    assert not list(tmp_path.rglob(".partial-*"))
    if stage == "rendering frames":
        assert not list(tmp_path.rglob("sequence*.json"))
        assert not list((tmp_path / "scenes").iterdir())
    assert len(open_sequence(ensure_demo(cache_dir=tmp_path, settings=TINY))) == 8


def test_two_at_once_do_no_harm(tmp_path):
    found: list[Path] = []
    threads = [
        threading.Thread(target=lambda: found.append(ensure_demo(cache_dir=tmp_path, settings=TINY))) for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 2 and len(set(found)) == 1
    assert len(open_sequence(found[0])) == 8
    assert not list(tmp_path.rglob(".partial-*"))


def test_the_cache_is_where_the_variable_says(rendered, monkeypatch):
    monkeypatch.setenv("SIMAPS_CACHE", str(rendered.parents[2]))
    assert ensure_demo(settings=TINY) == rendered


def test_other_settings_have_another_key():
    keys = {s.key(CAFE) for s in (TINY, DemoSettings(), DemoSettings(9, 160, 120), DemoSettings(8, 160, 120, 0.7))}
    assert len(keys) == 4
    assert DemoSettings(8, 160, 120, sensor=DepthSensor(far_m=5.0)).key(CAFE) not in keys


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"level": "hard"}, "error level: expected one of none, light, medium, heavy, detector, found 'hard'"),
        ({"seed": -1}, "seed: expected 0 or more, found -1"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, arguments, message):
    with pytest.raises(InputError, match=message):
        ensure_demo(cache_dir=tmp_path, settings=TINY, **arguments)
    assert not list(tmp_path.iterdir())


def test_a_cache_that_cannot_be_written_is_named(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(InputError, match=r"file.*expected to keep the rendered scene there"):
        ensure_demo(cache_dir=blocked, settings=TINY)
