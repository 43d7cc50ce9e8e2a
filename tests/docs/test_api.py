"""docs/API.md: its code runs, its table names the formats there are, and what it imports is public."""

import inspect
import re
from pathlib import Path

import pytest
from sequences import write_tiny_sequence
from toy_maps import toy_map

import simaps_viz
from simaps_viz.exports.formats import EXPORTERS

PAGE = (Path(__file__).parents[2] / "docs" / "API.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)


def test_the_code_on_the_page_runs(tmp_path, monkeypatch, capsys):
    write_tiny_sequence(tmp_path / "breakroom")
    simaps_viz.save_map(toy_map(), tmp_path / "cafe.npz")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for number, block in enumerate(BLOCKS):
        try:
            exec(compile(block, f"docs/API.md, block {number}", "exec"), names)
        except Exception as error:
            pytest.fail(f"docs/API.md, block {number}: {error!r}\n{block}")
    written = {path.name for path in tmp_path.iterdir()}
    assert {"breakroom.npz", "cafe.geojson", "cafe.tum", "cafe.yaml", "cafe-costmap.pgm"} <= written
    said = capsys.readouterr().out
    assert "refused There is no piano on this map" in said and "cancelled after" in said


INNER = {"BuildLog", "CellGraph", "FrameStep", "Grid", "MergeLog", "Reading", "Views"}
"""Parts of a map, which its class describes, and what only the package itself makes."""


def test_what_public_names_take_and_hold_is_public():
    public = [getattr(simaps_viz, name) for name in simaps_viz.__all__]
    hints = [str(inspect.signature(thing)) for thing in public if inspect.isfunction(thing)]
    hints += [str(hint) for thing in public if inspect.isclass(thing) and thing is not simaps_viz.PosedFrames
              for hint in inspect.get_annotations(thing).values()]  # fmt: skip
    named = set(re.findall(r"simaps_viz[\w.]*\.([A-Z]\w+)", "\n".join(hints)))
    assert {"Answer", "FrameSource", "Intrinsics", "Observer", "Path", "Segment", "VoteSettings"} <= named
    assert named - INNER <= set(simaps_viz.__all__)


def test_the_page_names_every_format_and_only_those():
    rows = dict(re.findall(r"^\| `([a-z0-9-]+)` \| (`X.*?|the same.*?) \|", PAGE, re.M))
    assert set(rows) == set(EXPORTERS)
    for name, files in rows.items():
        assert files.startswith("the same") or f"X{EXPORTERS[name].endings[0]}" in files


def test_the_page_imports_public_names_only():
    imported = re.findall(r"^from simaps_viz import (.*)$", PAGE, re.M)
    assert len(BLOCKS) >= 6 and imported
    for line in imported:
        assert set(line.split(", ")) <= set(simaps_viz.__all__)
