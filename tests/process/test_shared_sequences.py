"""Real and rendered sequences from the folder beside the project; skipped, saying so, where that folder is absent."""

from pathlib import Path

import numpy as np
import pytest

from simaps_viz import build_map, open_sequence

SHARED = Path(__file__).parents[2].parent / "shared"
BREAKROOM = SHARED / "data" / "hololens-breakroom"

needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason=f"{SHARED} is not on this machine")


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
