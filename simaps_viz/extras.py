"""What does not come with the core is asked for in one line, which names the extra that brings it."""

from collections.abc import Iterator
from contextlib import contextmanager

from simaps_viz.errors import InputError


@contextmanager
def needs_extra(extra: str, what: str) -> Iterator[None]:
    """Import a library of an extra inside this block.

    Args:
        extra: its name in pyproject.toml.
        what: what needs it, as the user knows it.

    Raises:
        InputError: the library is not there, or cannot be loaded.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"{what}: expected the package {error.name}, found it not installed; pip install 'simaps-viz[{extra}]'"
        ) from None
    except ImportError as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{what}: expected the packages of the extra [{extra}], found {reason}") from error
