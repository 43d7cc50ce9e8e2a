"""`make paper`: one reading of the frames makes the maps that a build makes, and the page holds what was measured."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks import paper, paper_text
from benchmarks.paper import DriveRow, MapRow, OnePass, PaperSettings, Results, at_most

from simaps_viz.build.methods import build
from simaps_viz.datasets.open import open_sequence
from simaps_viz.evaluation.evaluate import masks_source
from simaps_viz.evaluation.navigation import TRUE_MAP
from simaps_viz.scenes.demo import DemoSettings, ensure_demo

ROOT = Path(__file__).parents[2]
RESULTS = Results(
    PaperSettings(places=("cafe", "home"), seeds=2, most=100),
    {"cafe": 200, "home": 100},
    tuple(
        MapRow(place, level, seed, method, pq, 40, 44, 30, (10, 12, 9), 2_000_000)
        for place in ("cafe", "home")
        for level in ("light", "medium", "heavy")
        for seed in (0, 1)
        for method, pq in (("evidence", 0.9 if place == "cafe" else 0.5), *((m, 0.7) for m in paper.METHODS[:-1]))
        if level == "light" or method in paper.WITHOUT_EMBEDDINGS
    ),
    tuple(
        DriveRow(place, seed, method, 10, 0.9 + 0.1 * seed, 0.8, 0)
        for place in ("cafe", "home")
        for seed in (0, 1)
        for method in (*paper.METHODS, TRUE_MAP)
    ),
    {(r, k): r + k / 100 for r in (0.5, 1.0) for k in (0.0, 5.0)},
    (0.5, 5.0),
    {"rendering": 3.2},
)


@pytest.fixture(scope="module")
def manifest(tmp_path_factory) -> Path:
    return ensure_demo(
        level="none",
        cache_dir=tmp_path_factory.mktemp("cache"),
        settings=DemoSettings(frames=12, width=160, height=120),
    )


@pytest.mark.slow
def test_one_reading_makes_the_same_maps_as_builds_do(manifest):
    sequence, one_pass = open_sequence(manifest), OnePass()
    for seed, methods in ((0, ("paper", "paper-k9", "components", "evidence")), (1, ("evidence",))):
        source = masks_source(sequence, sequence, "medium", seed, None)
        for method in methods:
            mine, theirs = one_pass(source, method), build(source, method)
            np.testing.assert_array_equal(mine.instance, theirs.instance)
            np.testing.assert_array_equal(mine.grid.label, theirs.grid.label)
            assert mine.instances == theirs.instances and mine.parameters == theirs.parameters


@pytest.mark.slow
def test_the_sweep_holds_the_published_setting(manifest):
    sequence = open_sequence(manifest)
    simap = OnePass()(masks_source(sequence, sequence, "light", 0, None), "paper")
    published = paper.score(simap, paper.Truths(sequence).of(simap)).overall.pq
    assert paper._sweep(manifest)[1.0, 5.0] == pytest.approx(published)


def test_at_most_so_many_frames_are_taken_evenly(tmp_path):
    (tmp_path / "poses.txt").write_text("".join(f"{i:06d} 1\n" for i in range(10)))
    (tmp_path / "sequence.json").write_text('{"name": "x", "poses": "poses.txt"}')
    manifest = tmp_path / "sequence.json"
    assert at_most(manifest, 0) == at_most(manifest, 10) == manifest
    fewer = at_most(manifest, 4)
    assert fewer.read_text() == '{"name": "x", "poses": "sequence-every-3.txt"}'
    assert [line[:6] for line in (tmp_path / "sequence-every-3.txt").read_text().splitlines()] == [
        "000000", "000003", "000006", "000009"
    ]  # fmt: skip


def test_the_page_holds_what_was_measured():
    page = paper_text.paper_page(RESULTS)
    assert "| `evidence` | 0.95 ± 0.06 | 0.80 |  |  |" in page
    assert "| `paper`, K = 5 | 0.95 ± 0.06 | 0.80 | 0.88 | 0.80 |" in page
    assert "| `evidence` | 0.700 ± 0.231 | 0.700 ± 0.231 | 0.700 ± 0.231 |" in page
    assert "| `vlmaps` | 0.700 |  |  |" in page
    assert "| `components` | 80 | 88 | 60 | 28 | 20 | 24 | 18 | 6 |" in page
    assert "| 0.5 | 0.500 | 0.550 |" in page
    assert "| success, automatic | 0.950 | 0.97 | no |" in page and "| success, strict | 0.800 | 0.95 | no |" in page
    assert "home, light: `paper`, K = 5" in page and "cafe, light" not in page
    assert "Of 8 commands that `evidence` failed strictly, 0 ended in a collision" in page
    assert "--write --measured.most 100`" in page and "VLMaps' programs allocate: 2,048 MB" in page


def test_the_readme_shows_the_page_s_table():
    page = (ROOT / "docs" / "PAPER.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = readme.split("<!-- begins: make paper -->\n")[1].split("<!-- ends: make paper -->")[0]
    rows = [line for line in shown.splitlines() if line.startswith("|")]
    assert len(rows) == len(paper.METHODS) + 3 and all(row in page for row in rows)
