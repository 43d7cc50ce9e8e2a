"""Recognise what kind of network a file holds by its inputs and outputs, and open it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.errors import InputError
from simaps_viz.io.limits import check_picture
from simaps_viz.segmentation.class_names import ClassNames, names_beside, read_class_names
from simaps_viz.segmentation.mask_classification import (
    MASK2FORMER_GRID,
    MaskClassifier,
    MaskPorts,
    PanopticSettings,
    Picture,
    Rule,
    picture_beside,
    picture_in,
)
from simaps_viz.segmentation.protocol import Adjustable, Network
from simaps_viz.segmentation.session import Port, Session
from simaps_viz.segmentation.yolo_seg import YoloPorts, YoloSeg, YoloSettings

_DEFAULT_SIDE = 640
_FAMILY, _PICTURE = "simaps.family", "simaps.picture"
"""Metadata that `simaps export-network` writes."""
_STRICT = {"eomt": 0.8}
"""Families whose published threshold differs from transformers' usual 0.5; they follow the original rule."""
_SUPPRESSED_ROWS = 1000
"""Exports that suppress by themselves have at most a few hundred rows; the others have thousands of anchors."""
KNOWN = "a YOLO-seg export (boxes with mask coefficients, and prototypes) or a mask classifier (class and mask queries)"


@dataclass(frozen=True)
class NetworkSettings:
    """How a network is opened and its output read; None: as its family does."""

    labels: Path | None = None
    """Side file with class names; None: the file's metadata, or a file beside it."""
    providers: tuple[str, ...] = ()
    """What to run it on, in order of preference; empty: the fastest there is."""
    threads: int = 0
    """For one run on the CPU; 0 = one for each core."""
    input_size: tuple[int, int] | None = None
    """Height and width, for networks that leave them open."""
    score: float | None = None
    mask: float = 0.5
    overlap: float = 0.8
    """Mask classifiers: a query counts when it keeps more than this share of its mask."""
    iou: float = 0.5
    """YOLO: of two boxes that overlap more than this the less confident one goes."""
    rule: Rule | None = None
    """Mask classifiers: whose."""

    def to_json(self) -> dict[str, Any]:
        """Return them JSON-able."""
        return {**asdict(self), "labels": None if self.labels is None else str(self.labels.resolve())}

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> "NetworkSettings":
        """Take them back.

        Raises:
            InputError: the table is none of `to_json`.
        """
        try:
            size, labels = table["input_size"], table["labels"]
            return cls(**{**table, "labels": None if labels is None else Path(labels),
                          "providers": tuple(table["providers"]), "input_size": size and tuple(size)})  # fmt: skip
        except (KeyError, TypeError):
            raise InputError(f"network settings: expected those of a network, found {dict(table)}") from None


def open_network(path: Path, settings: NetworkSettings | None = None) -> tuple[Network, str]:
    """Open a network file; returns it and what it runs on.

    Raises:
        InputError: the file cannot be opened, is of no known kind, or its class names are missing or too many.
    """
    settings = settings or NetworkSettings()
    for name, value in (("score", settings.score), ("mask", settings.mask), ("overlap", settings.overlap)):
        if value is not None and not 0.0 < value < 1.0:
            raise InputError(f"{name} threshold: expected more than 0 and less than 1, found {value:g}")
    session = Session(Path(path), providers=settings.providers, threads=settings.threads)
    image, size = _image_input(session, settings.input_size)
    outputs = _resolved(session, image, size)
    yolo = _yolo_ports(outputs, image, size)
    if yolo is not None:
        names = _names(session, settings.labels)
        if yolo.classes is not None:
            names.check_count(yolo.classes, session.path)
        score = YoloSettings.score if settings.score is None else settings.score
        return YoloSeg(session, yolo, names, YoloSettings(score, settings.iou, settings.mask)), session.device
    masks = _mask_ports(outputs, image, size)
    if masks is not None:
        return _mask_classifier(session, masks, settings), session.device
    found = ", ".join(str(port) for port in outputs[:4])
    raise InputError(f"{path}: expected {KNOWN}, found the outputs {found}{', ...' if len(outputs) > 4 else ''}")


def origin(network: Network, path: Path, settings: NetworkSettings) -> dict[str, Any]:
    """Describe where an open network's file is and how it was opened, JSON-able; see `mask_store.About`."""
    thresholds = network.thresholds if isinstance(network, Adjustable) else ()
    return {
        "network": str(Path(path).resolve()),
        "settings": settings.to_json(),
        "thresholds": [asdict(threshold) for threshold in thresholds],
    }


def _mask_classifier(session: Session, ports: MaskPorts, settings: NetworkSettings) -> MaskClassifier:
    names = _names(session, settings.labels)
    names.check_count(ports.class_count, session.path)
    family = session.metadata.get(_FAMILY, "").lower()
    told = session.metadata.get(_PICTURE)
    picture: Picture = picture_beside(session.path)
    if told is not None:
        try:
            picture = picture_in(f"{session.path}: metadata {_PICTURE}", json.loads(told))
        except (ValueError, RecursionError):
            raise InputError(f"{session.path}: metadata {_PICTURE}: expected JSON, found another text") from None
    rule = settings.rule or ("original" if family in _STRICT else "transformers")
    default = 0.8 if rule == "original" else PanopticSettings.score
    score = default if settings.score is None else settings.score
    if family == "mask2former" and rule == "transformers":
        ports = replace(ports, grid=MASK2FORMER_GRID)
    return MaskClassifier(
        session, ports, names, picture, PanopticSettings(rule, score, settings.mask, settings.overlap)
    )


def _names(session: Session, given: Path | None) -> ClassNames:
    if given is not None:
        return read_class_names(given)
    found = names_beside(session.path, dict(session.metadata))
    if found is None:
        raise InputError(
            f"{session.path}: expected class names in its metadata (names, id2label) or beside it "
            f"({session.path.stem}.labels.txt, config.json), found none; give a file with --labels"
        )
    return found


def _image_input(session: Session, wanted: tuple[int, int] | None) -> tuple[Port, tuple[int, int]]:
    """Find the input that takes the picture, and the size to give it."""
    port = session.inputs[0] if len(session.inputs) == 1 else None
    if port is None or port.dtype not in (np.float32, np.float16) or len(port.shape) != 4:
        found = ", ".join(f"{p} {p.dtype.__name__ if p.dtype else ''}".strip() for p in session.inputs)
        raise InputError(f"{session.path}: expected one input [1, 3, height, width] of floats, found {found or 'none'}")
    batch, channels, rows, cols = port.shape
    if channels not in (3, None) or batch not in (1, None):
        raise InputError(f"{session.path}: expected one input [1, 3, height, width], found {port}")
    size = _open_size(session) if wanted is None else wanted
    if wanted is not None and ((rows or wanted[0]), (cols or wanted[1])) != wanted:
        raise InputError(
            f"{session.path}: expected --input-size {rows or '?'} {cols or '?'}, the only one it takes, found "
            f"{wanted[0]} {wanted[1]}"
        )
    height, width = rows or size[0], cols or size[1]
    check_picture(f"{session.path}: {port}", width, height)
    return port, (height, width)


def _open_size(session: Session) -> tuple[int, int]:
    """Return the size that a file which leaves it open was made for: Ultralytics writes ``imgsz``."""
    try:
        rows, cols = json.loads(session.metadata.get("imgsz", ""))
        return int(rows), int(cols)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return _DEFAULT_SIDE, _DEFAULT_SIDE


def _resolved(session: Session, image: Port, size: tuple[int, int]) -> Sequence[Port]:
    """Return the outputs with their real shapes; where the file leaves some open, by running it once on grey."""
    if all(None not in port.shape and port.shape for port in session.outputs):
        return session.outputs
    grey = np.full((1, 3, *size), 0.5, dtype=image.dtype)
    values = session.run({image.name: grey}, [port.name for port in session.outputs])
    return [replace(port, shape=value.shape) for port, value in zip(session.outputs, values, strict=True)]


def _yolo_ports(outputs: Sequence[Port], image: Port, size: tuple[int, int]) -> YoloPorts | None:
    boxes = [p for p in outputs if len(p.shape) == 3]
    prototypes = [p for p in outputs if len(p.shape) == 4]
    if len(boxes) != 1 or len(prototypes) != 1:
        return None
    rows, cols = boxes[0].shape[1:]
    count = prototypes[0].shape[1]
    if rows is None or cols is None or count is None or count == rows:
        return None
    kept = YoloPorts(image.name, boxes[0].name, prototypes[0].name, None, size, image.dtype or np.float32)
    if cols == 6 + count and rows <= _SUPPRESSED_ROWS:
        return replace(kept, suppressed=True)
    if cols > rows > 4 + count:
        return replace(kept, classes=rows - 4 - count)
    return None


def _mask_ports(outputs: Sequence[Port], image: Port, size: tuple[int, int]) -> MaskPorts | None:
    def pick(rank: int, names: tuple[str, ...]) -> Port | None:
        fitting = [p for p in outputs if len(p.shape) == rank and None not in p.shape]
        named = [p for p in fitting if p.name in names]
        return (named or fitting)[0] if named or len(fitting) == 1 else None

    classes = pick(3, ("class_queries_logits", "logits"))
    masks = pick(4, ("masks_queries_logits", "pred_masks"))
    if classes is None or masks is None or classes.shape[1] != masks.shape[1] or (classes.shape[2] or 0) < 2:
        return None
    count = (classes.shape[2] or 0) - 1
    return MaskPorts(image.name, classes.name, masks.name, count, size, image.dtype or np.float32)
