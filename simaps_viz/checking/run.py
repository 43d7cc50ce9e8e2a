"""What `simaps check` does: diagnose, draw, repair; returns what a person reads, and the record."""

from pathlib import Path
from typing import Any

from simaps_viz.checking.diagnose import Diagnosis, diagnose
from simaps_viz.checking.fix import write_fixed
from simaps_viz.checking.picture import save_picture
from simaps_viz.checking.recording import open_recording
from simaps_viz.datasets.open import open_sequence, recognise
from simaps_viz.datasets.posed_frames import PosedFramesReader
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.io.files import check_output


def check(path: Path, *, fix: bool, picture: Path | None, progress: Progress) -> tuple[bool, str, dict[str, Any]]:
    """Check a sequence, and correct it when asked.

    Returns:
        Whether it is usable as it is, what a person reads, and the record.

    Raises:
        InputError: It cannot be read, or something cannot be written; then nothing was.
    """
    if picture is not None:
        check_output(picture, ".png")
    reader = recognise(path)
    if reader is not None and not isinstance(reader, PosedFramesReader):
        raise InputError(f"{path}: expected a posed-frames/1 sequence, found another format; run simaps convert first")
    diagnosis = diagnose(open_recording(path), progress)
    if picture is not None:
        save_picture(diagnosis, picture)
    record = diagnosis.to_json()
    written = None
    if fix and diagnosis.correction is not None:
        written = write_fixed(diagnosis)
        open_sequence(written)
        record["correction"]["written"] = str(written)
    text = _text(diagnosis, written, fix) + (f"\n{picture}: the evidence" if picture is not None else "")
    return diagnosis.ok, text, record


def _text(diagnosis: Diagnosis, written: Path | None, fix: bool) -> str:
    recording = diagnosis.recording
    lines = [f"{recording.manifest.path}: {len(recording)} frames, neighbours agree on {diagnosis.before.percent()} %"]
    lines += [f"{finding.severity}: {finding.message}" for finding in diagnosis.findings]
    if diagnosis.ok:
        lines.append("usable" + (", with the remarks above" if diagnosis.findings else ""))
    correction = diagnosis.correction
    if written is not None:
        lines.append(f"{written}: corrected ({'; '.join(correction.changes if correction else ())})")
    elif correction is not None:
        lines.append(f"A correction fits: {'; '.join(correction.changes)}. Write it with --fix.")
    elif not diagnosis.ok:
        lines.append("Nothing can be corrected automatically." if fix else "No correction is known.")
    return "\n".join(lines)
