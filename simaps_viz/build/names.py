"""The names of all methods, without their code: the command line lists them before it loads one."""

from typing import Literal, get_args

MethodName = Literal["evidence", "components", "paper", "vlmaps", "vlmaps+components"]
"""What ``--method`` takes."""
METHODS: tuple[MethodName, ...] = get_args(MethodName)
"""The same as a tuple, the default first."""
