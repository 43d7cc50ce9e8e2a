"""What the pages state of names, files, keys and licences is what there is."""

import re
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution, requires

import numpy as np
import pytest
from docs_pages import PAGES, ROOT
from packaging.requirements import Requirement

from simaps_viz.datasets import manifest
from simaps_viz.mapping import file

COPYLEFT = re.compile(r"\bMPL\b|Mozilla|GPL|GNU|EUPL|CeCILL")


@pytest.mark.parametrize("page", PAGES)
def test_files_named_are_there(page):
    for name in re.findall(r"`(?:python )?((?:tests|apps|simaps_viz|docs)/[\w/.-]+)", (ROOT / page).read_text()):
        assert (ROOT / name).exists(), f"{page}: {name}"


def test_what_the_architecture_names_is_in_the_package():
    page = (ROOT / "ARCHITECTURE.md").read_text()
    named = {*re.findall(r"`([a-z_]+(?:/[a-z_]+)*(?:/|\.py))`", page)} - {"apps/", "tests/", "docs/", "simaps_viz/"}
    assert len(named) >= 30 and [name for name in sorted(named) if not (ROOT / "simaps_viz" / name).exists()] == []


def test_what_security_says_is_tested_is_a_test():
    """The last column names attacks of `apps/attack.py`, tests, or files."""
    rows = re.findall(r"^\|[^|]*\|[^|]*\|([^|]*)\|$", (ROOT / "SECURITY.md").read_text(), re.M)
    sources = [*(ROOT / "apps" / "attacks").glob("*.py"), *(ROOT / "tests").rglob("*.py")]
    defined = set(re.findall(r"^def (\w+)\(", "\n".join(path.read_text() for path in sources), re.M))
    named = [name for row in rows for name in re.findall(r"`([a-z_]+)`", row)]
    assert len(named) >= 20 and set(named) <= defined


def test_every_key_of_a_manifest_is_on_its_page():
    page = (ROOT / "docs" / "CONVENTIONS.md").read_text()
    inner = {f"segmentation.{key}" for key in manifest._SEGMENTATION_KEYS}
    keys = {*manifest._REQUIRED, *manifest._OPTIONAL, "isthing"} | inner
    rows = re.findall(r"^\| (`.*?`) \|", page, re.M)
    assert {key for row in rows for key in re.findall(r"`([\w.]+)`", row)} >= keys - {"segmentation"}


def test_every_array_of_a_map_file_is_on_its_page():
    page = (ROOT / "docs" / "CONVENTIONS.md").read_text().partition("## A map file")[2]
    rows = re.findall(r"^\| `(\w+)` \| (\w+) \[(.*?)\] \|", page, re.M)
    stated = {name: (dtype, len(shape.split(",")) if shape else 0) for name, dtype, shape in rows}
    arrays = {
        name: (np.dtype(dtype).name, axes)
        for name, (dtype, axes) in {**file._ARRAYS, **file._SEEN, **file._SURFACE}.items()
    }
    assert stated == {"metadata": ("str", 0), **arrays}


def needed(*wanted: str) -> Iterator[Distribution]:
    """Return what is installed of some requirements, and of what these require."""
    waiting, seen = [Requirement(one) for one in wanted], set()
    while waiting:
        one = waiting.pop()
        key = (one.name.lower(), *sorted(one.extras))
        if key in seen:
            continue
        seen.add(key)
        try:
            found = distribution(one.name)
        except PackageNotFoundError:
            continue  # of another system, or of an extra nobody asked for
        yield found
        for text in found.requires or ():
            other = Requirement(text)
            if other.marker is None or any(other.marker.evaluate({"extra": e}) for e in {*one.extras, ""}):
                waiting.append(other)


def licence(found: Distribution) -> str:
    meta = found.metadata
    stated = [one[:60] for key in ("License-Expression", "License") for one in meta.get_all(key) or ()]  # or all of it
    return " ".join([*stated, *(one for one in meta.get_all("Classifier") or () if one.startswith("License"))])


def test_packages_under_other_than_permissive_licences_are_named():
    """All requirements are checked, extras too; metadata does not cover what wheels bundle."""
    text = (ROOT / "README.md").read_text()
    told = text[text.index("MIT licence.") :]
    names = {one.name for one in needed(*(requires("simaps-viz") or ())) if COPYLEFT.search(licence(one))}
    assert "tqdm" in names and {name for name in names if f"{name}" not in told} == set()
