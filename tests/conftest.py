"""Settings and fixtures of all tests."""

import pytest
from hypothesis import settings

# How long an example takes says how busy the machine is, not whether the program is right.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


@pytest.fixture(scope="module")
def browser():
    """Debian's Chromium, for the tests of one file only: it keeps an event loop running in their thread."""
    from browser import chromium  # noqa: PLC0415 - tests without a page do not need it

    with chromium() as found:
        yield found
