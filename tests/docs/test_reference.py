"""docs/REFERENCE.md is what `make docs` writes from the docstrings of today, and those are complete."""

import inspect
import runpy
import sys
from pathlib import Path

import pytest

import simaps_viz

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "REFERENCE.md"


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="signatures are printed a little differently elsewhere")
def test_the_page_is_up_to_date():
    app = runpy.run_path(str(ROOT / "apps" / "reference.py"))
    assert app["page"]() == PAGE.read_text(), "docs/REFERENCE.md is out of date: make docs"


def test_every_public_name_has_an_entry_and_a_docstring():
    text = PAGE.read_text()
    for name in simaps_viz.__all__:
        assert f"\n## `{name}`\n" in text
        assert inspect.getdoc(getattr(simaps_viz, name)), name
    assert "\n- `_" not in text  # what begins so is nobody else's business
    assert "### `SIMap.find`" in text and "### `SIMap.plan`" in text


def test_public_methods_have_docstrings():
    for name in simaps_viz.__all__:
        thing = getattr(simaps_viz, name)
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for member, value in vars(thing).items():
                if not member.startswith("_") and (callable(value) or isinstance(value, (property, classmethod))):
                    assert inspect.getdoc(value), f"{name}.{member}"
