"""A whole build of a sequence whose every cell is known."""

import numpy as np
import pytest
from sequences import SEATS_M, frame_name, write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.events import BuildFinished, BuildStarted, CommunitiesFound, FrameProjected, MergesFound
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.evidence import EvidenceSettings
from simaps_viz.mapping.votes import VoteSettings


class Listener:
    """Keeps every event, and the map as it was at each frame."""

    wants_color = True

    def __init__(self):
        self.events, self.grids = [], []

    def on_event(self, event):
        self.events.append(event)
        if isinstance(event, FrameProjected):
            self.grids.append(event.snapshot())


@pytest.fixture
def tiny(tmp_path):
    return open_sequence(write_tiny_sequence(tmp_path, frames=4))


def test_the_two_seats_are_found_exactly(tiny):
    simap = build_map(tiny)
    assert simap.counts() == {"chair": 2}
    for instance, (xmin, ymin, xmax, ymax) in zip(
        sorted(simap.instances, key=lambda i: i.centroid_m[0]), SEATS_M.values(), strict=True
    ):
        assert instance.cells == 16
        assert instance.centroid_m == pytest.approx(((xmin + xmax) / 2, (ymin + ymax) / 2, 1.0), abs=1e-3)
        assert np.array(instance.aabb_m) == pytest.approx(np.array([(xmin, ymin, 1.0), (xmax, ymax, 1.0)]), abs=1e-3)
        assert instance.frames == 4 and instance.score == pytest.approx(0.9)
        assert simap.at((xmin + xmax) / 2, (ymin + ymax) / 2) == instance
    assert simap.at(0.0, 0.0) is None and simap.at(99.0, 0.0) is None
    assert (simap.instance > 0).sum() == 32 and ((simap.community > 0) == (simap.instance > 0)).all()


def test_exact_ids_and_ids_per_frame_give_the_same_map(tmp_path):
    maps = [
        build_map(open_sequence(write_tiny_sequence(tmp_path / truth, truth=truth)))
        for truth in ("segments", "instances")
    ]
    assert np.array_equal(maps[0].instance, maps[1].instance)
    assert np.array_equal(maps[0].grid.label, maps[1].grid.label)


def test_events_come_in_order_and_say_what_happened(tiny):
    listener = Listener()
    simap = build_map(tiny, BuildConfig(method="paper"), observers=[listener], communities_every=2)
    kinds = [type(e) for e in listener.events]
    projected = FrameProjected
    assert kinds == [
        BuildStarted, projected, projected, CommunitiesFound, projected, projected, CommunitiesFound,
        CommunitiesFound, MergesFound, BuildFinished,
    ]  # fmt: skip
    frames = [e for e in listener.events if isinstance(e, FrameProjected)]
    assert [e.frame.name for e in frames] == [frame_name(i) for i in range(4)]
    assert all(e.frame.color is not None for e in frames)
    for event, grid in zip(frames, listener.grids, strict=True):
        assert (grid.observations[tuple(event.cells.T)] > 0).all()
        names = {grid.labels[i] for i in grid.label[tuple(event.new_edges[:, :2].T)]}
        assert names <= {"chair"}
    assert sum(len(e.new_edges) for e in frames) == len(simap.graphs[0].edges) > 0
    assert np.array_equal(listener.grids[-1].label, simap.grid.label)
    assert listener.events[-1].simap is simap


def test_communities_on_the_way_come_with_the_objects_they_make(tiny):
    listener = Listener()
    simap = build_map(tiny, BuildConfig(min_cells=1, resolution=5.0), observers=[listener], communities_every=2)
    halfway, whole = (e for e in listener.events if isinstance(e, CommunitiesFound) and not e.final)
    assert halfway.frame_index == 1 and halfway.instance is not None and whole.instance is not None
    assert np.array_equal(whole.instance, simap.instance) and np.array_equal(whole.community, simap.community)
    assert len(np.unique(whole.community)) > len(np.unique(whole.instance))


def test_observers_change_nothing_and_no_colour_is_read_without_them(tiny):
    with_observer = build_map(tiny, observers=[Listener()], communities_every=1)
    without = build_map(tiny)
    assert np.array_equal(with_observer.instance, without.instance)
    reads = []

    class Spy:
        def __getattr__(self, name):
            return getattr(tiny, name)

        def __len__(self):
            return len(tiny)

        def read(self, index, *, color=False):
            reads.append(color)
            return tiny.read(index, color=color)

    build_map(Spy())  # pyright: ignore[reportArgumentType]
    assert reads == [False] * 4


def test_the_same_build_twice_is_the_same_bit_for_bit(tiny):
    one, two = build_map(tiny), build_map(tiny)
    assert one.instances == two.instances
    for a, b in ((one.instance, two.instance), (one.community, two.community), (one.merges.score, two.merges.score)):
        assert np.array_equal(a, b)
    assert np.array_equal(one.grid.height_m, two.grid.height_m, equal_nan=True)


def test_what_covers_too_few_cells_is_no_instance_but_keeps_its_class(tiny):
    simap = build_map(tiny, BuildConfig(min_cells=17))
    assert simap.instances == () and not simap.instance.any()
    assert (simap.grid.label == simap.grid.labels.index("chair")).sum() == 32
    assert len(build_map(tiny, BuildConfig(min_cells=16)).instances) == 2


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (lambda: BuildConfig(k_percent=-1), "K: expected a percentage"),
        (lambda: BuildConfig(affinity=1.5), "affinity: expected a share from 0 to 1, found 1.5"),
        (lambda: BuildConfig(resolution=float("inf")), "resolution: expected a number above 0, found inf"),
        (lambda: BuildConfig(evidence=EvidenceSettings(ranges=(1, 1))), "ranges of evidence: expected different"),
        (lambda: BuildConfig(evidence=EvidenceSettings(ranges=(0, 2))), "ranges of evidence: expected different"),
        (lambda: BuildConfig(resolution=0), "resolution: expected"),
        (lambda: BuildConfig(votes=VoteSettings(rounds=-1)), "rounds of learning: expected"),
        (lambda: BuildConfig(projection=ProjectionSettings(cell_size_m=0)), "cell size: expected"),
    ],
)
def test_a_senseless_configuration_is_refused(config, message):
    with pytest.raises(InputError, match=message):
        config()
