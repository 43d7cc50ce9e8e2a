"""Layers looked up and counted in blocks of rows: the same as at once."""

import numpy as np
import pytest

from simaps_viz.mapping import partition


@pytest.mark.parametrize("cells", [1 << 20, 7])
def test_looking_up_and_counting_in_bands_is_looking_up_and_counting(monkeypatch, cells):
    monkeypatch.setattr(partition, "BLOCK_CELLS", cells)
    ids = np.random.default_rng(2).integers(0, 9, (37, 23), dtype=np.int32)
    table = np.arange(9, dtype=np.int32)[::-1] * 5
    found = partition.look_up(table, ids)
    assert np.array_equal(found, table[ids]) and found.dtype == table.dtype
    assert partition.count_ids(ids, 12).tolist() == [0, *np.bincount(ids.reshape(-1), minlength=12)[1:].tolist()]
    assert partition.count_ids(ids * 0, 2).tolist() == [0, 0] and partition.look_up(table, ids[:0]).shape == (0, 23)
