"""Real and rendered sequences from the folder beside the project; skipped, saying so, where that folder is absent."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simaps_viz import BuildConfig, build_map, open_sequence, save_map

SHARED = Path(__file__).parents[2].parent / "shared"
HOUSE = SHARED / "data" / "aws-small-house" / "rgbd"
BREAKROOM = SHARED / "data" / "hololens-breakroom"

needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason=f"{SHARED} is not on this machine")
TABLES = ("dining table", "table", "coffee table", "desk")


@needs_shared
def test_exact_ids_give_all_chairs_and_tables_of_the_house(tmp_path):
    """Scored by a program that shares no code with ours."""
    simap = build_map(open_sequence(HOUSE), BuildConfig(method="paper"))
    assert simap.parameters["k_percent"] == 5.0 and simap.method == "paper"
    save_map(simap, tmp_path / "house.npz")
    command = [sys.executable, SHARED / "tools" / "score_map.py", tmp_path / "house.npz", HOUSE, "chair", *TABLES]
    scores = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert scores["true"] == scores["matched"] == 12
    assert scores["by_label"]["chair"]["matched"] == 8
    assert scores["pq"] >= 0.95
    assert (tmp_path / "house.npz").stat().st_size <= 2 * 2**20


@needs_shared
def test_the_break_room_has_its_floor_at_zero_and_its_long_table():
    simap = build_map(open_sequence(BREAKROOM))
    heights = simap.grid.height_m[simap.grid.observations > 20]
    floor = heights[np.abs(heights) < 0.1]
    # A cell keeps its highest pixel, so sensor noise lifts the floor a little: hence not centred on 0.
    assert len(floor) > 2000 and -0.01 < float(np.median(floor)) < 0.05
    tables = [i for i in simap.of_class("dining table") if i.cells > 100]
    longest = max(tables, key=lambda i: i.cells)
    assert 0.70 < float(np.median(simap.grid.height_m[simap.instance == longest.id])) < 0.80
    size = np.ptp(np.array(longest.aabb_m), axis=0)
    assert max(size[:2]) > 2.0
    assert simap.spec.x0_m <= simap.T_map_camera[:, 0, 3].min() <= simap.spec.extent_m[2]
