"""What ``--method`` takes, by name: the methods of `build_map`, variants of them, and the baselines."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from simaps_viz.baselines import BASELINES
from simaps_viz.baselines.vlmaps import VLMapsConfig, build_vlmaps
from simaps_viz.build import METHOD_NAMES
from simaps_viz.build.pipeline import BuildCancelled, BuildConfig, BuildControl, run_build
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Event, FrameProjected, Observer
from simaps_viz.mapping import methods
from simaps_viz.mapping.votes import VoteSettings
from simaps_viz.structures import SIMap

VARIANTS: Mapping[str, Callable[[BuildConfig], BuildConfig]] = {
    "components-highest": lambda config: replace(config, method="components", votes=VoteSettings(enabled=False)),
    "paper-k9": lambda config: replace(config, method="paper", k_percent=9.0),
    "paper-literal": lambda config: replace(config, method="paper", literal=True),
}
"""Other settings of methods worth comparing in an evaluation, by name."""


def check_method(method: str) -> None:
    """Raise InputError unless there is a method or variant of that name."""
    known = dict.fromkeys((*METHOD_NAMES, *methods.METHODS, *VARIANTS))
    if method not in known:
        raise InputError(f"method: expected one of {', '.join(known)}, found {method!r}")


def keeps_log(method: str) -> bool:
    """Return whether a build by this method can be logged, resumed, and done by several processes."""
    return method in methods.METHODS or method in VARIANTS


def config_of(method: str, config: BuildConfig) -> BuildConfig:
    """Return the settings of a method or variant; a baseline has none of its own."""
    if method in VARIANTS:
        return VARIANTS[method](config)
    return replace(config, method=method) if method in methods.METHODS else config


def build(
    sequence: FrameSource,
    method: str,
    config: BuildConfig | None = None,
    observers: Sequence[Observer] = (),
    control: BuildControl | None = None,
) -> SIMap:
    """Build a map by the method of a name.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        method: one of ``METHOD_NAMES`` or ``VARIANTS``, see `check_method`.
        config: everything but the method.
        observers: notified of every event, in order.
        control: how the build is run; a baseline is always strict, keeps no log, reads its frames itself, and only
            looks at ``cancel``.

    Raises:
        InputError: there is no such method, or as for `build_map`.
    """
    config, control = config or BuildConfig(), control or BuildControl()
    check_method(method)
    if method not in BASELINES:
        return run_build(sequence, config_of(method, config), observers, control)
    settings = VLMapsConfig(projection=config.projection, min_cells=config.min_cells, seed=config.seed)
    watching = [*observers, _Stop(control, sequence.name)]
    return build_vlmaps(sequence, settings, components=BASELINES[method], observers=watching)


class _Stop:
    """Ends a build that does not look at ``cancel`` itself."""

    wants_color = False

    def __init__(self, control: BuildControl, name: str) -> None:
        self._cancel, self._name = control.cancel, name

    def on_event(self, event: Event) -> None:
        """Raise BuildCancelled after a frame if ``cancel`` is set."""
        if self._cancel is not None and self._cancel.is_set() and isinstance(event, FrameProjected):
            raise BuildCancelled(f"{self._name}: cancelled after {event.frame.index} frames")
