"""All export formats by name, and the one function that writes them."""

from pathlib import Path
from pkgutil import resolve_name
from typing import Final

from simaps_viz.errors import InputError
from simaps_viz.exports import REGISTRY
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.io.files import write_all
from simaps_viz.structures import SIMap

EXPORTERS: Final[dict[str, Exporter]] = {name: resolve_name(where)() for name, where in REGISTRY.items()}
"""All formats by name, in the order in which they are listed."""


def choose_format(path: Path, format: str | None = None, *, command: str | None = None) -> str:
    """Return the format asked for, or the one a file's ending means (with a command, .txt means tum).

    Raises:
        InputError: there is no such format, or the ending means none or several; or the format has other endings.
    """
    name = _guess(path, command) if format is None else format
    if name not in EXPORTERS:
        raise InputError(f"format: expected one of {', '.join(EXPORTERS)}, found {format!r}")
    endings = EXPORTERS[name].endings
    if path.suffix and path.suffix not in endings:
        raise InputError(f"{path}: expected a name ending in {' or '.join(endings)} for {name}, found {path.suffix}")
    return name


def _guess(path: Path, command: str | None) -> str:
    for name, exporter in EXPORTERS.items():
        drives = command is not None and "command" in exporter.options and path.suffix in ("", *exporter.endings)
        if drives or path.suffix in exporter.own_endings:
            return name
    several = [name for name, exporter in EXPORTERS.items() if path.suffix in exporter.endings]
    found = f"{path.suffix}, which may be {' or '.join(several)}" if several else path.suffix or "no ending"
    raise InputError(
        f"{path}: expected an ending that tells the format, or --format {'|'.join(EXPORTERS)}; found {found}"
    )


def export_map(simap: SIMap, path: Path, format: str | None = None, options: ExportOptions | None = None) -> list[Path]:
    """Write a map in another program's format: all its files, or none.

    Args:
        simap: the map.
        path: where to; ros, nav2 and coco write several files of this name.
        format: one of ``EXPORTERS``; by default the one that the path's ending means.
        options: what some formats take beside the map.

    Returns:
        The files written, the main one first.

    Raises:
        InputError: no such format or ending, or a file cannot be written.
        CommandError: tum: the command is refused.
        PlanningError: tum: there is no path.
    """
    path, options = Path(path), options or ExportOptions()
    name = choose_format(path, format, command=options.command)
    exporter = EXPORTERS[name]
    _refuse_ignored_options(name, options)
    path = path if path.suffix else path.with_name(path.name + exporter.endings[0])
    if not path.parent.is_dir():
        raise InputError(f"{path}: expected a folder to write in, found none at {path.parent}")
    files = exporter.files(simap, path, options)
    write_all(files, f"the map as {name}")
    return list(files)


def _refuse_ignored_options(name: str, options: ExportOptions) -> None:
    given = {"class": options.label, "command": options.command, "points": options.points_of}
    for what, value in given.items():
        if value is not None and what not in EXPORTERS[name].options:
            takers = " and ".join(other for other, exporter in EXPORTERS.items() if what in exporter.options)
            raise InputError(f"{name}: expected no {what} (only {takers} take it), found one")
