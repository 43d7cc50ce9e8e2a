"""From frames to a map file: the pipeline, its log, several processes, the cache.

Here are the names of all methods, without their code: the command line lists them before it loads one.
"""

from typing import TYPE_CHECKING, Literal

from simaps_viz.baselines import BASELINES
from simaps_viz.mapping.methods import METHODS

METHOD_NAMES: tuple[str, ...] = (*METHODS, *BASELINES)
"""What ``--method`` takes, the default first: the methods of `build_map`, and the baselines."""
if TYPE_CHECKING:
    MethodName = str
else:
    MethodName = Literal[METHOD_NAMES]
"""One of `METHOD_NAMES`; the command line shows them as choices."""
