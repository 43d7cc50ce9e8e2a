"""When a part of a filmed page changed: pictures as Chromium sends them, made here."""

import base64

import cv2
import numpy as np
import pytest
from checks.film import Film, filmed, repaint
from playwright.sync_api import FloatRect

PART: FloatRect = {"x": 100.0, "y": 40.0, "width": 80.0, "height": 60.0}


def sent(*, inside=0, outside=0):
    picture = np.full((100, 160, 3), 90, np.uint8)  # half of a page of 320 x 200
    picture[:15] += np.uint8(outside)
    picture[30:40, 60:70] += np.uint8(inside)
    return {"data": base64.b64encode(cv2.imencode(".jpg", picture)[1].tobytes()).decode()}


def test_only_the_watched_part_counts_and_only_what_can_be_seen():
    film = Film(PART)
    with pytest.raises(RuntimeError, match="expected a picture"):
        film.begin()
    film.take(sent())
    film.begin()
    film.take(sent(outside=120))
    film.take(sent(inside=20))
    assert film.changed_at is None
    film.take(sent(inside=120))
    first = film.changed_at
    film.take(sent(inside=60))
    assert first is not None and film.changed_at == first
    film.begin()
    film.take(sent(inside=60))
    assert film.changed_at is None
    film.take(sent())
    assert film.changed_at is not None and film.changed_at > first


def test_a_page_of_a_real_browser_is_filmed(browser):
    page = browser.new_page(viewport={"width": 320, "height": 200})
    page.set_content("<body style='background:#ddd'><p id='it' style='position:absolute;left:110px;top:50px'>I</p>")
    with filmed(page, PART) as film:
        film.begin()
        page.evaluate("document.body.style.borderTop = '9px solid black'")
        repaint(page)
        assert film.changed_at is None
        page.evaluate("document.getElementById('it').style.background = 'black'")
        page.evaluate("document.getElementById('it').style.padding = '10px'")
        for _ in range(150):
            if film.changed_at is None:
                repaint(page)
        assert film.changed_at is not None
