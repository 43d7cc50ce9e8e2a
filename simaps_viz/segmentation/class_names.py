"""What a network's classes are called, and which of them can be counted."""

import ast
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simaps_viz.colors.classes import ADE20K_STUFF, COCO_THINGS, is_thing
from simaps_viz.datasets.manifest import read_json, shown
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_TEXT_BYTES, read_bytes

_ADE20K_CLASSES = 150
_COCO_PANOPTIC_CLASSES = 133


@dataclass(frozen=True)
class ClassNames:
    """The classes of a network, in its order."""

    labels: tuple[str, ...]
    is_thing: tuple[bool, ...]
    source: str
    """Where they were found."""

    def check_count(self, expected: int, network: Path) -> None:
        """Raise InputError unless there is one name for each class that the network tells apart."""
        if len(self.labels) != expected:
            raise InputError(
                f"{self.source}: expected {expected} class names, as many as {network.name} tells apart, found "
                f"{len(self.labels)}"
            )


def read_class_names(path: Path) -> ClassNames:
    """Read a side file.

    It is text with a name in each line; or JSON: a list of names, ``{"0": name}``, a ``config.json`` with
    ``id2label``, or a list of ``{"name", "isthing"}`` as in COCO panoptic's ``categories``.

    Raises:
        InputError: it is missing or holds something else.
    """
    if path.suffix.lower() != ".json":
        expected = "class names, one a line"
        try:
            lines = read_bytes(path, MAX_TEXT_BYTES, expected).decode().splitlines()
        except UnicodeDecodeError:
            raise InputError(f"{path}: expected {expected}, found bytes that are not UTF-8 text") from None
        while lines and not lines[-1].strip():
            lines.pop()
        return _named(str(path), [line.strip() for line in lines])
    table = read_json(path)
    if isinstance(table, dict):
        table = table.get("categories", table.get("id2label", table))
    return names_in(str(path), table)


def names_in(source: str, table: Any) -> ClassNames:
    """Take class names from what JSON or a network's metadata hold: a list, or a table by number.

    Raises:
        InputError: it is neither.
    """
    if isinstance(table, dict):
        try:
            numbered = {int(key): value for key, value in table.items()}
        except (TypeError, ValueError):
            numbered = {}
        if sorted(numbered) != list(range(len(table))) or not table:
            raise InputError(f"{source}: expected class names numbered from 0 on, found {shown(table)}")
        table = [numbered[i] for i in range(len(numbered))]
    if not isinstance(table, list):
        raise InputError(f"{source}: expected a list of class names, found {shown(table)}")
    if all(isinstance(row, dict) and "name" in row for row in table) and table:
        things = [row.get("isthing") for row in table]
        return _named(source, [row["name"] for row in table], things)
    return _named(source, table)


def names_beside(network: Path, metadata: dict[str, str]) -> ClassNames | None:
    """Look for class names in a network's metadata, then in files beside it; None when there are none."""
    for key in ("names", "id2label"):
        if key in metadata:
            return names_in(f"{network}: metadata {key}", _literal(metadata[key]))
    for name in (f"{network.stem}.labels.txt", f"{network.stem}.labels.json", "labels.txt", "config.json"):
        path = network.with_name(name)
        if path.is_file():
            return read_class_names(path)
    return None


def things_among(labels: Sequence[str]) -> tuple[bool, ...]:
    """Return which classes can be counted: by the lists of COCO panoptic and ADE20K where these are the ones."""
    first = [label.split(",")[0].strip() for label in labels]
    if len(labels) == _COCO_PANOPTIC_CLASSES and set(COCO_THINGS) <= set(first):
        return tuple(label in COCO_THINGS for label in first)
    if len(labels) == _ADE20K_CLASSES and {"wall", "building", "sky", "floor", "bed"} <= set(first):
        return tuple(label not in ADE20K_STUFF for label in first)
    return tuple(is_thing(label) for label in first)


def _named(source: str, names: Sequence[Any], things: Sequence[Any] | None = None) -> ClassNames:
    for number, name in enumerate(names):
        if not isinstance(name, str) or not name.strip() or name == "none":
            raise InputError(f'{source}: class {number}: expected a name (not "none"), found {shown(name)}')
    guessed = things_among(names)
    told = [None] * len(names) if things is None else things
    decided = tuple(bool(t) if t in (0, 1, True, False) else g for t, g in zip(told, guessed, strict=True))
    return ClassNames(tuple(names), decided, source)


def _literal(text: str) -> Any:
    """Read JSON, or a Python literal, as Ultralytics writes them; other text stays text."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        try:
            return ast.literal_eval(text)
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            return text
