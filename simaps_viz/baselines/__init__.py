"""Other people's maps, re-implemented for comparison: same frames in, same kind of map out."""

from typing import Final

BASELINES: Final = {"vlmaps": False, "vlmaps+components": True}
"""The methods of `vlmaps` by name, listed without their code: whether each tells the objects of a class apart."""
