"""All methods by name: ours, the paper's and the baselines. Every one gives a SIMap."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from simaps_viz.baselines.vlmaps import VLMapsConfig, build_vlmaps
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Observer
from simaps_viz.mapping.votes import VoteSettings
from simaps_viz.pipeline import BuildConfig, build_map
from simaps_viz.structures import SIMap

METHODS = ("evidence", "components", "paper", "vlmaps", "vlmaps+components")
"""What ``--method`` takes."""

VARIANTS: Mapping[str, Callable[[BuildConfig], BuildConfig]] = {
    "evidence": lambda config: replace(config, method="evidence"),
    "components": lambda config: replace(config, method="components"),
    "components-highest": lambda config: replace(config, method="components", votes=VoteSettings(enabled=False)),
    "paper": lambda config: replace(config, method="paper"),
    "paper-k9": lambda config: replace(config, method="paper", k_percent=9.0),
    "paper-literal": lambda config: replace(config, method="paper", literal=True),
}
"""What an evaluation takes besides the two VLMaps: names for settings worth comparing."""


def build(
    sequence: FrameSource,
    method: str,
    config: BuildConfig | None = None,
    observers: Sequence[Observer] = (),
    *,
    communities_every: int = 0,
) -> SIMap:
    """Build a map by the method of a name.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        method: one of ``METHODS`` or ``VARIANTS``.
        config: everything but the method.
        observers: told everything, in order.
        communities_every: see `build_map`.

    Raises:
        InputError: there is no such method, or as for `build_map`.
    """
    config = config or BuildConfig()
    if method in ("vlmaps", "vlmaps+components"):
        settings = VLMapsConfig(projection=config.projection, min_cells=config.min_cells, seed=config.seed)
        instances = "components" if method == "vlmaps+components" else "none"
        return build_vlmaps(sequence, settings, instances=instances, observers=observers)
    if method not in VARIANTS:
        known = ", ".join(dict.fromkeys((*METHODS, *VARIANTS)))
        raise InputError(f"method: expected one of {known}, found {method!r}")
    return build_map(sequence, VARIANTS[method](config), observers, communities_every=communities_every)
