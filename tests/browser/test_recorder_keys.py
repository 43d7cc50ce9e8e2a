"""Which keys the recorded build keeps while it has them, and which go on to the workbench."""

import re
from importlib import resources

import pytest

SCRIPT = resources.files("simaps_viz.recorder").joinpath("rerun_page.js").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def of_rerun(browser):
    """Return a function that filters the keys that rerun handles itself."""
    found = re.search(r"^const OF_RERUN = .*?^}\n", SCRIPT, re.DOTALL | re.MULTILINE)
    assert found is not None
    page = browser.new_page()
    yield lambda *keys, **held: page.evaluate(
        "([script, keys, held]) => keys.filter(key => new Function(script + '; return isOfRerun')()({key, ...held}))",
        [found[0], list(keys), held],
    )
    page.close()


def test_keys_that_move_rerun_stay_there_with_and_without_shift(of_rerun):
    keys = (" ", "Enter", "Home", "End", "PageUp", "PageDown", "ArrowLeft", "w", "A", "S", "d", "Q", "e")
    assert of_rerun(*keys) == list(keys)


def test_other_keys_are_the_workbenchs_but_with_alt_or_control(of_rerun):
    keys = ("j", "X", "Escape", "Delete", "3", "[", "?", "F5")
    assert of_rerun(*keys) == []
    assert of_rerun(*keys, ctrlKey=True) == list(keys) == of_rerun(*keys, altKey=True)
    assert of_rerun("k", metaKey=True) == []
