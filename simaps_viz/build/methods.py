"""All methods by name: ours, the paper's and the baselines. Every one gives a SIMap."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypedDict, Unpack, get_args

from simaps_viz.baselines.vlmaps import BASELINE_OF, Baseline, Instances, VLMapsConfig, build_vlmaps
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Event, FrameProjected, Observer
from simaps_viz.build.build_log import BuildLog
from simaps_viz.mapping.votes import VoteSettings
from simaps_viz.build.pipeline import BuildCancelled, BuildConfig, Elsewhere, Method, build_map
from simaps_viz.structures import SIMap

MethodName = Literal[Method, Baseline]
"""What ``--method`` takes."""
METHODS: tuple[MethodName, ...] = get_args(MethodName)
"""Its names, the default first."""

VARIANTS: Mapping[str, Callable[[BuildConfig], BuildConfig]] = {
    "evidence": lambda config: replace(config, method="evidence"),
    "components": lambda config: replace(config, method="components"),
    "components-highest": lambda config: replace(config, method="components", votes=VoteSettings(enabled=False)),
    "paper": lambda config: replace(config, method="paper"),
    "paper-k9": lambda config: replace(config, method="paper", k_percent=9.0),
    "paper-literal": lambda config: replace(config, method="paper", literal=True),
}
"""What `build_map` makes, by name: its methods, and settings of them worth comparing. An evaluation takes them all."""
BASELINES: Mapping[str, Instances] = {name: instances for instances, name in BASELINE_OF.items()}
"""What `build_vlmaps` makes, by name."""


def check_method(method: str) -> None:
    """Raise InputError unless there is a method of that name."""
    known = dict.fromkeys((*METHODS, *VARIANTS))
    if method not in known:
        raise InputError(f"method: expected one of {', '.join(known)}, found {method!r}")


def keeps_log(method: str) -> bool:
    """Return whether a build by this method can be logged, gone on with, and done by several processes."""
    return method in VARIANTS


def config_of(method: str, config: BuildConfig) -> BuildConfig:
    """Return the settings of a method of a name; a baseline has none of its own."""
    return VARIANTS[method](config) if method in VARIANTS else config


class Careful(TypedDict, total=False):
    """What `build_map` takes besides: how it deals with faults."""

    strict: bool
    log: Path | BuildLog | None
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
        method: one of ``METHODS`` or ``VARIANTS``, see `check_method`.
        config: everything but the method.
        observers: told everything, in order.
        communities_every: see `build_map`.
        how: ``strict``, ``log``, ``resume``, ``cancel`` and ``elsewhere``, see `build_map`; the baselines are always
            strict, keep no log, read their frames themselves and look at ``cancel`` too.

    Raises:
        InputError: there is no such method, or as for `build_map`.
    """
    config = config or BuildConfig()
    check_method(method)
    if method in BASELINES:
        settings = VLMapsConfig(projection=config.projection, min_cells=config.min_cells, seed=config.seed)
        watching = [*observers, _Stop(how.get("cancel"), sequence.name)]
        return build_vlmaps(sequence, settings, instances=BASELINES[method], observers=watching)
    return build_map(sequence, config_of(method, config), observers, communities_every=communities_every, **how)


class _Stop:
    """Ends a build that looks at no ``cancel`` itself."""

    wants_color = False

    def __init__(self, cancel: threading.Event | None, name: str) -> None:
        self._cancel, self._name = cancel, name

    def on_event(self, event: Event) -> None:
        """Raise BuildCancelled when it is time."""
        if self._cancel is not None and self._cancel.is_set() and isinstance(event, FrameProjected):
            raise BuildCancelled(f"{self._name}: cancelled after {event.frame.index} frames")
