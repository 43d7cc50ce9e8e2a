"""The evidence as one picture: bars of the hypotheses' agreement, and two frames laid over one another."""

import io
from functools import cache
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from simaps_viz.checking.diagnose import Diagnosis
from simaps_viz.checking.findings import Bar
from simaps_viz.checking.overlay import overlay, telling_pair
from simaps_viz.checking.reading import Reading
from simaps_viz.files import check_output, write_whole
from simaps_viz.palette import Color

WIDTH, MARGIN = 1500, 36
INK, PALE_INK, RULE = (33, 37, 44), (98, 104, 115), (214, 218, 226)
STATED, CHOSEN, OTHER = (196, 70, 52), (38, 132, 90), (176, 184, 196)
ROW, LABEL = 34, 560
"""Height of a bar's row and width of its label, pixels."""
MOST_BARS = 12


def save_picture(diagnosis: Diagnosis, path: Path) -> None:
    """Write the picture as PNG, replacing an earlier file only once the new one is complete.

    Raises:
        InputError: The file cannot be written, or is not called .png.
    """
    path = Path(path)
    check_output(path, ".png")
    buffer = io.BytesIO()
    draw(diagnosis).save(buffer, format="PNG", optimize=True)
    write_whole(path, buffer.getbuffer(), "the picture")


def draw(diagnosis: Diagnosis) -> Image.Image:
    """Lay out the picture."""
    lines = _finding_lines(diagnosis)
    bars = _shown(diagnosis.bars)
    frames = _frames(diagnosis)
    bars_top = MARGIN + 56 + 26 * len(lines) + 34
    frames_top = bars_top + 40 + ROW * len(bars) + 34
    frames_high = max((image.height for _, image in frames), default=-90) + 90
    page = Image.new("RGB", (WIDTH, frames_top + frames_high + MARGIN), (255, 255, 255))
    pen = ImageDraw.Draw(page)
    verdict = "usable" if diagnosis.ok else "not usable as it is"
    pen.text((MARGIN, MARGIN), f"{diagnosis.recording.manifest.name}: {verdict}", fill=INK, font=_font(30))
    for number, (text, color) in enumerate(lines):
        pen.text((MARGIN, MARGIN + 52 + 26 * number), text, fill=color, font=_font(18))
    _draw_bars(pen, bars, bars_top)
    _draw_frames(page, pen, frames, frames_top)
    return page


def _finding_lines(diagnosis: Diagnosis) -> list[tuple[str, Color]]:
    font, lines = _font(18), []
    for finding in diagnosis.findings:
        color = STATED if finding.severity == "error" else PALE_INK
        line = ""
        for word in finding.message.split():
            if line and font.getlength(f"{line} {word}") > WIDTH - 2 * MARGIN:
                lines.append((line, color))
                line = "   "
            line = f"{line} {word}".lstrip() if line.strip() or not line else f"{line}{word}"
        lines.append((line, color))
    return lines or [("Neighbouring frames see the same surfaces in the same places.", CHOSEN)]


def _shown(bars: tuple[Bar, ...]) -> list[Bar]:
    """Give what the files say and what is believed first, then the best of the others."""
    special = [bar for bar in bars if bar.stated or bar.chosen]
    others = sorted((bar for bar in bars if not (bar.stated or bar.chosen)), key=lambda bar: -bar.share)
    return (special + others)[:MOST_BARS]


def _draw_bars(pen: ImageDraw.ImageDraw, bars: list[Bar], top: int) -> None:
    pen.text((MARGIN, top), "How much of what two neighbouring frames see agrees, if ...", fill=INK, font=_font(20))
    left, room = MARGIN + LABEL, WIDTH - 2 * MARGIN - LABEL - 90
    top += 40
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x = left + share * room
        pen.line((x, top - 4, x, top + ROW * len(bars)), fill=RULE)
    for number, bar in enumerate(bars):
        y = top + ROW * number
        color = CHOSEN if bar.chosen else STATED if bar.stated else OTHER
        ink = INK if bar.chosen or bar.stated else PALE_INK
        pen.text((left - 14, y + ROW / 2 - 4), _fitted(bar.label, LABEL - 20), fill=ink, font=_font(17), anchor="rm")
        pen.rectangle((left, y + 3, left + max(2, bar.share * room), y + ROW - 11), fill=color)
        words = f"{100 * bar.share:.0f} %"
        pen.text((left + bar.share * room + 10, y + ROW / 2 - 4), words, fill=ink, font=_font(17), anchor="lm")


def _fitted(text: str, width: float) -> str:
    font = _font(17)
    while font.getlength(text) > width and len(text) > 8:
        text = text[:-2].rstrip() + "…" if not text.endswith("…") else text[:-3].rstrip() + "…"
    return text


def _frames(diagnosis: Diagnosis) -> list[tuple[str, Image.Image]]:
    """Give titled overlays: as the files are, and as corrected where that differs."""
    pair = telling_pair(diagnosis)
    if pair is None or diagnosis.views is None:
        return []
    names = [diagnosis.recording.names[diagnosis.views.frames[i]] for i in pair]
    wanted = [(f"as the files are: frame {names[0]} over {names[1]}", Reading())]
    if any(bar.chosen and not bar.stated for bar in diagnosis.bars):
        wanted.append(("corrected", diagnosis.reading))
    wide = (WIDTH - 3 * MARGIN) // 2
    images = []
    for title, reading in wanted:
        image = Image.fromarray(overlay(diagnosis, pair, reading))
        images.append((title, image.resize((wide, round(image.height * wide / image.width)))))
    return images


def _draw_frames(page: Image.Image, pen: ImageDraw.ImageDraw, frames: list[tuple[str, Image.Image]], top: int) -> None:
    for number, (title, image) in enumerate(frames):
        x = MARGIN + number * (image.width + MARGIN)
        pen.text((x, top), title, fill=INK, font=_font(20))
        page.paste(image, (x, top + 36))
    if frames:
        words = "grey where both agree; red and cyan fringes where they do not; pale where only one of them sees"
        pen.text((MARGIN, top + 36 + frames[0][1].height + 10), words, fill=PALE_INK, font=_font(17))


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font
