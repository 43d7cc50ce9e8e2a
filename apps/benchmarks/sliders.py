"""What moving a slider costs the server: another K, another affinity, another resolution."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from benchmarks.timing import slowest

from simaps_viz.mapping.simap import recommunity, repartition, slider_of
from simaps_viz.structures import SIMap

JOINING_MS, RESOLUTION_MS = 30, 50
"""Required at most, milliseconds."""
RESOLUTIONS = (0.2, 0.5, 1.0, 2.0, 5.0)


def bench_sliders(simap: SIMap, *, paint: Callable[[SIMap], object], values: int = 51, runs: int = 3) -> Iterator[str]:
    """Time partitioning a built map anew.

    Args:
        simap: a map whose method has a merge log.
        paint: what the page does with a new partition: its picture, encoded.
        values: of K or the affinity, from one end of the slider to the other.
        runs: of each value.
    """
    name = slider_of(simap).parameter
    top, words = (100.0, "K") if name == "k_percent" else (1.0, "affinity")
    settings = [round(float(value), 6) for value in np.linspace(0.0, top, values)]

    def joined(value: float) -> SIMap:
        return repartition(simap, **{name: value})

    cells, source = sum(len(graph.cells) for graph in simap.graphs), simap.provenance.get("name", "a map")
    yield f"{source}, {simap.method}: {len(simap.graphs)} classes, {cells:,} cells of things; medians of {runs} runs"

    paint(joined(settings[0]))

    def line(words: str, works: Mapping[float, Callable[[], object]]) -> str:
        cost = slowest(works, runs=runs)
        return (
            f"  {1000 * cost.wall:6.1f} ms wall {1000 * cost.cpu:6.1f} ms CPU   {words}; slowest of {len(works)} values"
        )

    painted = {value: (lambda v=value: paint(joined(v))) for value in settings}
    yield line(f"any {words}, picture included (required: {JOINING_MS} ms)", painted)
    yield line(f"any {words}, without its picture", {value: (lambda v=value: joined(v)) for value in settings})
    anew = {value: (lambda v=value: recommunity(simap, resolution=v)) for value in RESOLUTIONS}
    yield line(f"any resolution, without its picture (required: {RESOLUTION_MS} ms)", anew)
