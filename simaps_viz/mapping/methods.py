"""The methods that `build_map` knows. A new one is a file with an object and a line here; see `method.Method`.

The objects are imported when they are first asked for: the command line lists the names and loads no method's code.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simaps_viz.mapping.method import Method

METHODS: dict[str, str] = {
    "evidence": "simaps_viz.mapping.evidence:EVIDENCE",
    "components": "simaps_viz.mapping.components:COMPONENTS",
    "paper": "simaps_viz.mapping.paper:PAPER",
}
"""Where the object of each method is, by name, the default first."""
_OTHER = "simaps_viz.mapping.method:Method"


def method_of(name: str) -> "Method":
    """Return the method of a map; for one that is not built here, such as a baseline, one that joins nothing."""
    module, _, attribute = METHODS.get(name, _OTHER).partition(":")
    found = getattr(import_module(module), attribute)
    return found if name in METHODS else found(name)
