"""The evidence as one picture: bars of the hypotheses' agreement, and two frames laid over one another."""

import io
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from simaps_viz.checking.agreement import relative_poses, residuals
from simaps_viz.checking.diagnose import Diagnosis
from simaps_viz.checking.findings import Bar
from simaps_viz.checking.recording import Reading
from simaps_viz.colors.palette import Color
from simaps_viz.io.files import check_output, write_whole


def telling_pair(diagnosis: Diagnosis) -> NDArray | None:
    """Choose the pair whose agreement the correction raises most (or, with none, a well agreeing one); view indices."""
    views, pairs, recording = diagnosis.views, diagnosis.pairs, diagnosis.recording
    if views is None or not len(pairs):
        return None
    scores = []
    for reading in (Reading(), diagnosis.reading):
        poses = reading.poses(recording)
        T = relative_poses(poses, views.frames, pairs)
        r = residuals(views, pairs, T, reading.camera_of(recording), reading.unit_m(recording))
        sampled = np.maximum((~np.isnan(r)).sum(axis=1), 1)
        scores.append((np.abs(r) < 0.02).sum(axis=1) / sampled)
    gain = 2 * scores[1] - scores[0]
    return pairs[int(gain.argmax())]


def overlay(diagnosis: Diagnosis, pair: NDArray, reading: Reading) -> NDArray:
    """Lay frame a, moved to the camera of frame b, over frame b.

    Frame b is drawn in the red, frame a in the green and blue channel: where they agree the picture is grey.

    Returns:
        uint8 [H, W, 3], RGB, size of the depth images in memory.
    """
    recording, views = diagnosis.recording, diagnosis.views
    assert views is not None
    source, target = (int(i) for i in pair)
    height, width = views.steps.shape[1:]
    gray_a, gray_b = (_gray(diagnosis, view, (width, height)) for view in (source, target))
    poses = reading.poses(recording)
    T = relative_poses(poses, views.frames, pair[None])[0]
    moved = np.full((height, width), np.nan, np.float32)
    if np.isfinite(T).all():
        fx, fy, cx, cy = views.camera(reading.camera_of(recording))
        v, u = np.nonzero(views.steps[source])
        z = views.steps[source][v, u] * reading.unit_m(recording)
        points = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=-1) @ T[:3, :3].T + T[:3, 3]
        ahead = points[:, 2] > 1e-9
        points, shade = points[ahead], gray_a[v, u][ahead]
        with np.errstate(over="ignore"):
            column = np.round(points[:, 0] / points[:, 2] * fx + cx)
            row = np.round(points[:, 1] / points[:, 2] * fy + cy)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        order = np.argsort(-points[inside, 2], kind="stable")  # near ones last, so that they hide the others
        moved[row[inside][order].astype(int), column[inside][order].astype(int)] = shade[inside][order]
    moved = _filled(moved)
    seen = np.isfinite(moved)
    out = np.repeat((96 + gray_b * 0.35)[..., None], 3, axis=2)
    out[seen] = np.stack([gray_b[seen], moved[seen], moved[seen]], axis=-1)
    return np.clip(out, 0, 255).astype(np.uint8)


def _gray(diagnosis: Diagnosis, view: int, size: tuple[int, int]) -> NDArray:
    assert diagnosis.views is not None
    rgb = diagnosis.recording.color(int(diagnosis.views.frames[view]))
    gray = cv2.cvtColor(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    return cv2.createCLAHE(2.0, (4, 4)).apply(gray).astype(np.float32)


def _filled(image: NDArray) -> NDArray:
    """Close the thin gaps between moved pixels with the brightest neighbour; float32 [H, W], NaN = none."""
    empty = ~np.isfinite(image)
    grown = cv2.dilate(np.where(empty, -1, image).astype(np.float32), np.ones((3, 3), np.uint8))
    return np.where(empty & (grown >= 0), grown, image)


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
    """Return what the files say and what is believed first, then the best of the others."""
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
    """Return titled overlays: as the files are, and as corrected where that differs."""
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
