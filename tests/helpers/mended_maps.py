"""What must hold on every map, mended or not; and random edits on it."""

from dataclasses import asdict, fields

import numpy as np
from hypothesis import strategies as st

from simaps_viz.errors import InputError
from simaps_viz.mapping import edits
from simaps_viz.mapping.edits import Edit
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.partition import applied_steps, instance_of_community
from simaps_viz.mapping.simap import joining_threshold
from simaps_viz.structures import SIMap


def check_map(simap: SIMap) -> None:
    """Every instance follows from the arrays, every array from the others."""
    grid, spec = simap.grid, simap.spec
    ids = [one.id for one in simap.instances]
    assert sorted(ids) == np.unique(simap.instance[simap.instance > 0]).tolist() and len(set(ids)) == len(ids)
    assert len(grid.labels) == len(grid.is_thing) == len(set(grid.labels)) and grid.labels[0] == "none"
    for one in simap.instances:
        row, col = np.nonzero(simap.instance == one.id)
        assert one.cells == len(row)
        assert {grid.labels[i] for i in np.unique(grid.label[row, col])} == {one.label}
        assert grid.is_thing[grid.labels.index(one.label)]
        x, y, z = spec.x0_m + (col + 0.5) * 0.05, spec.y0_m + (row + 0.5) * 0.05, grid.height_m[row, col]
        np.testing.assert_allclose(one.centroid_m, (x.mean(), y.mean(), z.astype(float).mean()), atol=1e-4)
        low, high = (x.min() - 0.025, y.min() - 0.025, z.min()), (x.max() + 0.025, y.max() + 0.025, z.max())
        np.testing.assert_allclose(one.aabb_m, (low, high), atol=1e-4)
        mine = np.isin(simap.views.community, np.unique(simap.community[row, col]))
        assert one.frames == len(np.unique(simap.views.frame[mine]))
    for number in np.unique(simap.community[simap.community > 0]):
        assert len(np.unique(simap.instance[simap.community == number])) == 1, "a community lies in two instances"
    assert not simap.community[grid.label == 0].any()
    _check_parts(simap)


def _check_parts(simap: SIMap) -> None:
    living = set(np.unique(simap.community[simap.community > 0]).tolist())
    assert {*simap.merges.source.tolist(), *simap.merges.target.tolist()} <= living
    assert set(simap.views.community.tolist()) <= living
    assert (simap.views.cells > 0).all()
    applied = applied_steps(simap.merges, joining_threshold(simap.method, simap.parameters))
    follows = instance_of_community(simap.merges, applied, max(living, default=0))[simap.community]
    follows[np.bincount(follows.reshape(-1))[follows] < simap.parameters.get("min_cells", 1)] = 0
    assert np.array_equal(follows, simap.instance)
    for graph in simap.graphs:
        assert np.array_equal(graph.cells, np.flatnonzero(simap.grid.label == graph.label))
        first, second = graph.edges.T
        assert (first < second).all() and np.array_equal(np.lexsort((second, first)), np.arange(len(first)))
    things = {i for i in np.unique(simap.grid.label).tolist() if i and simap.grid.is_thing[i]}
    assert not simap.graphs or [graph.label for graph in simap.graphs] == sorted(things)


def assert_same(one: SIMap, other: SIMap) -> None:
    """Two maps agree in everything."""
    assert one.instances == other.instances and one.grid.labels == other.grid.labels
    assert dict(one.parameters) == dict(other.parameters) and dict(one.provenance) == dict(other.provenance)
    for name in ("instance", "community"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert np.array_equal(one.grid.label, other.grid.label)
    for a, b in zip((one.merges, one.views, *one.graphs), (other.merges, other.views, *other.graphs), strict=True):
        for key in (field.name for field in fields(a)):
            assert np.array_equal(getattr(a, key), getattr(b, key)), key


def survives_a_file(simap: SIMap, path) -> SIMap:
    save_map(simap, path)
    read = load_map(path)
    assert np.array_equal(read.instance, simap.instance)
    assert [asdict(one) for one in read.instances] == [asdict(one) for one in simap.instances]
    return read


@st.composite
def random_edit(draw, simap: SIMap) -> Edit | None:
    """Any edit of the map, or None where it is refused."""
    ids = [one.id for one in simap.instances]
    if not ids:
        return None
    number = st.sampled_from(ids)
    kind = draw(st.sampled_from(["merge", "split", "relabel", "delete"]))
    one = simap.by_id(draw(number))
    try:
        if kind == "merge":
            return edits.merge(simap, one.id, draw(number))
        if kind == "delete":
            return edits.delete(simap, one.id)
        if kind == "relabel":
            return edits.relabel(
                simap, one.id, draw(st.sampled_from(["chair", "couch", "stool", "wall", "Big  Table"]))
            )
        (x, y, _), angle = one.centroid_m, draw(st.floats(0.0, 6.2))
        off = draw(st.floats(-0.3, 0.3))
        a = (x - off * np.sin(angle), y + off * np.cos(angle))
        return edits.split(simap, one.id, a, (a[0] + np.cos(angle), a[1] + np.sin(angle)))
    except InputError:
        return None
