"""The page that the tests of a file share; a file whose page is another one has its own ``opened``."""

import pytest
from browser import borrowed, open_workbench, toy_workbench, watched_page


@pytest.fixture(scope="module")
def opened(browser):
    with toy_workbench() as bench, watched_page(browser) as page:
        open_workbench(page, bench)
        yield bench, page


@pytest.fixture
def bench(opened):
    return opened[0]


@pytest.fixture
def page(opened):
    with borrowed(*opened) as found:
        yield found
