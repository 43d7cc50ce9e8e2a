"""Shared by the tests of datasets and others."""

import numpy as np

from simaps_viz.structures import SIMap


def same_maps(found: SIMap, expected: SIMap) -> None:
    assert found.spec.shape == expected.spec.shape
    np.testing.assert_allclose(found.spec.extent_m, expected.spec.extent_m, atol=1e-9)
    for name in ("label", "observations"):
        names = np.array(found.grid.labels), np.array(expected.grid.labels)
        a, b = getattr(found.grid, name), getattr(expected.grid, name)
        np.testing.assert_array_equal(*((names[0][a], names[1][b]) if name == "label" else (a, b)))
    np.testing.assert_array_equal(found.instance, expected.instance)
    np.testing.assert_allclose(found.grid.height_m, expected.grid.height_m, atol=2e-6)
    assert found.counts() == expected.counts() == {"chair": 2}
