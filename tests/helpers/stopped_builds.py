"""Shared by the tests of build and others."""

from simaps_viz import save_map
from simaps_viz.events import BuildFinished, FrameProjected


def saved(simap, folder):
    save_map(simap, folder / "one.npz")
    return (folder / "one.npz").read_bytes()


def same(one, two):
    """Two accumulators make the same map and continue the same way."""
    for name in ("label", "height_m", "lowest_m", "observations"):
        a, b = getattr(one.snapshot(), name), getattr(two.snapshot(), name)
        assert a.dtype == b.dtype and a.tobytes() == b.tobytes(), name
    assert one.snapshot().spec == two.snapshot().spec and one.origin_cell == two.origin_cell
    for a, b in zip(one.frames, two.frames, strict=True):
        assert (a.index, a.name, a.segments, a.skipped) == (b.index, b.name, b.segments, b.skipped)
        assert a.T_map_camera.tobytes() == b.T_map_camera.tobytes()
        for name in ("rows", "cols", "segments", "height_m"):
            ours, theirs = getattr(a.readings, name), getattr(b.readings, name)
            assert ours.dtype == theirs.dtype and ours.tobytes() == theirs.tobytes(), name
    assert sorted_links(one) == sorted_links(two)


def sorted_links(one):
    cells, labels, counts = one.links.entries()
    return sorted(zip(labels.tolist(), cells.tolist(), counts.tolist(), strict=True))


class Stop:
    wants_color = False

    def __init__(self, after=None, cancel=None):
        self.after, self.cancel, self.frames, self.maps, self.finished = after, cancel, [], [], None

    def on_event(self, event):
        if isinstance(event, FrameProjected):
            self.frames.append(event.frame.index)
            self.maps.append(event.map_so_far)
            if len(self.frames) == self.after:
                if self.cancel is None:
                    raise KeyboardInterrupt
                self.cancel.set()
        elif isinstance(event, BuildFinished):
            self.finished = event.simap
