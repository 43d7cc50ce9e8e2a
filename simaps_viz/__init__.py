"""Semantic Instance Maps from posed RGB-D: build, question and drive on them; the page and recordings come on top.

The public names are listed in ``__init__.pyi`` and loaded when they are first used.
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("simaps-viz")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
