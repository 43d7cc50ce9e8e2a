"""Names of any length, narrow pages and slow ones: what the page does with them."""

from dataclasses import replace

import pytest
from toy_maps import toy_map

from simaps_viz.drawing.legend import counts_text, facts_html, legend_html
from simaps_viz.drawing.theme import MAX_NAME_LENGTH, short, short_html
from simaps_viz.errors import CommandError
from simaps_viz.language.commands import examples as spoken_examples
from simaps_viz.language.commands import read_command
from simaps_viz.viewer.panels.command import examples
from simaps_viz.viewer.panels.map import origin_html
from simaps_viz.viewer.server.viser_page import COVERED_S, OPENED, PAGE_SCRIPT, covered

LONG = "w" * 480 + " end of name"


def long_map():
    simap = toy_map()
    labels = tuple(LONG if label == "couch" else label for label in simap.grid.labels)
    instances = tuple(replace(i, label=LONG) if i.label == "couch" else i for i in simap.instances)
    return replace(simap, grid=replace(simap.grid, labels=labels), instances=instances)


def test_where_a_map_comes_from_is_said_in_plain_words_and_in_full_to_who_asks():
    simap = toy_map()
    source = "simulated network errors, light, seed 0"
    made = {"name": "cafe, light errors", "segmentation": source, "simulated": True}
    html = origin_html(replace(simap, provenance=made))
    assert "masks with simulated errors on" in html and f'title="method {simap.method}; segmentation: {source}"' in html
    assert ">cafe</div>" in html and ">simulated</span>" in html
    assert html.replace(f"segmentation: {source}", "").count("light") == 0
    real = origin_html(replace(simap, provenance={"name": "a room, with errors", "segmentation": "yolo11n-seg"}))
    assert ">a room, with errors</div>" in real and "masks of yolo11n-seg on" in real and "simulated" not in real


def test_a_long_name_is_shortened_and_told_in_full_to_who_asks():
    assert short("chair 7 of 31") == short_html("chair 7 of 31") == "chair 7 of 31"
    cut = short(LONG)
    assert len(cut) <= MAX_NAME_LENGTH and cut.startswith("www") and "…" in cut and cut.endswith("of name")
    assert short_html(LONG) == f'<span title="{LONG}">{cut}</span>'
    assert 'title="&lt;b&gt;' in short_html("<b>" + LONG)


def test_summary_legend_and_headings_keep_long_names_short():
    simap = long_map()
    couch = next(one for one in simap.instances if one.label == LONG)
    legends = [legend_html(simap, mode) for mode in ("class", "instance")]
    for html in (counts_text(simap), *legends, facts_html(simap, couch)):
        assert short(LONG)[:20] in html and LONG not in html.replace(f'title="{LONG}', "")
    for text in (*examples(simap, 5), *spoken_examples([LONG, "chair"])):
        assert "www" not in text
    assert "go to the chair" in spoken_examples([LONG])


def test_a_refusal_repeats_little_of_what_was_said():
    with pytest.raises(CommandError, match=r'^Not understood: "x{59}…"\. Try') as refused:
        read_command("x" * 300, toy_map().grid.labels[1:])
    assert "x" * 60 not in str(refused.value)
    with pytest.raises(CommandError, match="501 characters, and at most 500 can be read"):
        read_command("g" * 501, ["chair"])


def test_the_page_of_the_server_is_covered_until_ours_is_there():
    page = b"<html><head><title>Viser</title></head><body></body></html>"
    shown = covered(page).decode()
    assert "Opening the map" in shown and f".{OPENED}" in shown and f'class="{OPENED}"' in PAGE_SCRIPT
    assert shown.endswith("</style></head><body></body></html>") and "<title>Viser</title>" in shown
    assert f"0s {COVERED_S}s forwards" in shown and covered(b"no page") == b"no page"
