"""All methods by name: ours, the paper's and the baselines. Every one gives a SIMap."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypedDict, Unpack

from simaps_viz.baselines.vlmaps import VLMapsConfig, build_vlmaps
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Event, FrameProjected, Observer
from simaps_viz.mapping.votes import VoteSettings
from simaps_viz.pipeline import BuildCancelled, BuildConfig, Elsewhere, build_map
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


def check_method(method: str) -> None:
    """Raise InputError unless there is a method of that name."""
    known = dict.fromkeys((*METHODS, *VARIANTS))
    if method not in known:
        raise InputError(f"method: expected one of {', '.join(known)}, found {method!r}")


class Careful(TypedDict, total=False):
    """What `build_map` takes besides: how it deals with faults."""

    strict: bool
    log: Path | None
    resume: bool
    cancel: threading.Event | None
    elsewhere: Elsewhere | None


def build(
    sequence: FrameSource,
    method: str,
    config: BuildConfig | None = None,
    observers: Sequence[Observer] = (),
    *,
    communities_every: int = 0,
    **how: Unpack[Careful],
) -> SIMap:
    """Build a map by the method of a name.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        method: one of ``METHODS`` or ``VARIANTS``.
        config: everything but the method.
        observers: told everything, in order.
        communities_every: see `build_map`.
        how: ``strict``, ``log``, ``resume``, ``cancel`` and ``elsewhere``, see `build_map`; the baselines are always
            strict, keep no log, read their frames themselves and look at ``cancel`` too.

    Raises:
        InputError: there is no such method, or as for `build_map`.
    """
    config = config or BuildConfig()
    if method in ("vlmaps", "vlmaps+components"):
        settings = VLMapsConfig(projection=config.projection, min_cells=config.min_cells, seed=config.seed)
        instances = "components" if method == "vlmaps+components" else "none"
        watching = [*observers, _Stop(how.get("cancel"), sequence.name)]
        return build_vlmaps(sequence, settings, instances=instances, observers=watching)
    check_method(method)
    return build_map(sequence, VARIANTS[method](config), observers, communities_every=communities_every, **how)


class _Stop:
    """Ends a build that looks at no ``cancel`` itself."""

    wants_color = False

    def __init__(self, cancel: threading.Event | None, name: str) -> None:
        self._cancel, self._name = cancel, name

    def on_event(self, event: Event) -> None:
        """Raise BuildCancelled when it is time."""
        if self._cancel is not None and self._cancel.is_set() and isinstance(event, FrameProjected):
            raise BuildCancelled(f"{self._name}: cancelled after {event.frame.index} frames")
