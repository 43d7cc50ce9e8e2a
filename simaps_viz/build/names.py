"""The names of all methods, without their code: the command line lists them before it loads one."""

from typing import TYPE_CHECKING, Literal

from simaps_viz.mapping import methods

METHOD_NAMES: tuple[str, ...] = (*methods.METHODS, "vlmaps", "vlmaps+components")
"""What ``--method`` takes, the default first: the methods of `build_map` (`methods.METHODS`), and the baselines."""
if TYPE_CHECKING:
    MethodName = str
else:
    MethodName = Literal[METHOD_NAMES]
"""One of `METHOD_NAMES`; the command line shows them as choices."""
