"""Run ONNX files with onnxruntime: opened, pictures laid into their inputs, masks laid back over the pictures.

What is wrong with a file that cannot be opened is said in one line.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from simaps_viz.errors import InputError

_PREFERRED = ("CUDA", "ROCM", "MIGraphX", "CoreML", "Dml", "OpenVINO")
"""Tried in this order when nobody chose; TensorRT is left out, as it compiles for minutes."""
_ELEMENTS = {
    "tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8, "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
}  # fmt: skip
_QUIET = 3
"""Only errors: onnxruntime writes its warnings to the terminal by itself."""


@dataclass(frozen=True)
class Port:
    """An input or output of a network."""

    name: str
    shape: tuple[int | None, ...]
    """None where the file leaves the size open."""
    dtype: type | None
    """None for kinds of elements that neither images nor words have."""

    def __str__(self) -> str:
        return f"{self.name} [{', '.join('?' if n is None else str(n) for n in self.shape)}]"


class Session:
    """A network file, opened."""

    def __init__(self, path: Path, *, providers: Sequence[str] = (), threads: int = 0, optimize: bool = True) -> None:
        """Open a network.

        Args:
            path: the file (.onnx).
            providers: what to run it on, such as ("cuda", "cpu"), in order of preference; empty: the fastest there is.
            threads: for one run on the CPU; 0 = one for each core.
            optimize: let onnxruntime fuse operations, which it cannot do with every file.

        Raises:
            InputError: the file is missing, damaged or needs what this onnxruntime lacks, or a provider is not there.
        """
        self.path = Path(path)
        if not self.path.is_file():
            raise InputError(f"{path}: expected a network (.onnx), found {'a folder' if path.is_dir() else 'nothing'}")
        wanted = choose_providers(providers, onnxruntime.get_available_providers())
        options = onnxruntime.SessionOptions()
        if threads < 0:
            raise InputError(f"threads: expected 0 (one for each core) or more, found {threads}")
        options.intra_op_num_threads = threads
        if not optimize:
            options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.log_severity_level = _QUIET
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # its threads would keep ours waiting
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=wanted)
        except Exception as error:  # onnxruntime's errors share no base of their own
            raise InputError(f"{path}: expected an ONNX network, found a file that is none: {_why(error)}") from None
        running = self._session.get_providers()
        if providers and running[0] != wanted[0]:
            raise InputError(
                f"--providers {','.join(providers)}: expected to run on {_short(wanted[0])}, found that it cannot "
                f"start here; {_short(running[0])} can"
            )
        self.device = _short(running[0])
        """What it runs on, as ``--providers`` spells it."""
        try:
            self.inputs = tuple(map(_port, self._session.get_inputs()))
            self.outputs = tuple(map(_port, self._session.get_outputs()))
            self.metadata: Mapping[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        except UnicodeDecodeError:
            raise InputError(f"{path}: expected an ONNX network, found names in it that are not UTF-8") from None

    def run(self, tensors: Mapping[str, NDArray], outputs: Sequence[str]) -> list[NDArray]:
        """Run the network; raises InputError when it does not take the tensors."""
        try:
            return [np.asarray(value) for value in self._session.run(list(outputs), dict(tensors))]
        except Exception as error:  # as above
            given = ", ".join(f"{name} {list(t.shape)}" for name, t in tensors.items())
            raise InputError(f"{self.path}: expected to run on {given}, found: {_why(error)}") from None

    @cached_property
    def digest(self) -> str:
        """Hash of the file, and of the weights kept beside it: 64 hex digits."""
        sha = hashlib.sha256()
        for path in (self.path, *(self.path.with_name(self.path.name + end) for end in (".data", "_data"))):
            if path.is_file():
                with path.open("rb") as file:
                    while block := file.read(1 << 20):
                        sha.update(block)
        return sha.hexdigest()


def available_providers() -> list[str]:
    """Return short names of what networks can run on here, the fastest first ("cuda", "cpu")."""
    return [_short(name) for name in choose_providers((), onnxruntime.get_available_providers())]


def choose_providers(wanted: Sequence[str], available: Sequence[str]) -> list[str]:
    """Return onnxruntime's names of what to run on, the CPU always last.

    Raises:
        InputError: one of those wanted is not there.
    """
    if not wanted:
        found = [f"{name}ExecutionProvider" for name in _PREFERRED if f"{name}ExecutionProvider" in available]
        return [*found, "CPUExecutionProvider"]
    by_short = {_short(name): name for name in available}
    called = {"directml": "dml", "trt": "tensorrt"}
    chosen = []
    for name in wanted:
        short = _short(name.strip())
        short = called.get(short, short)
        if short not in by_short:
            raise InputError(
                f"--providers {','.join(wanted)}: expected some of {', '.join(by_short)}, the ones this onnxruntime "
                f"has, found {name.strip()!r}; others come with other packages, such as onnxruntime-gpu"
            )
        chosen.append(by_short[short])
    return list(dict.fromkeys([*chosen, "CPUExecutionProvider"]))


def _short(provider: str) -> str:
    return provider.lower().removesuffix("executionprovider")


def _port(value: Any) -> Port:
    shape = tuple(n if isinstance(n, int) and n > 0 else None for n in value.shape)
    return Port(value.name, shape, _ELEMENTS.get(value.type))


def _why(error: Exception) -> str:
    """Return the end of onnxruntime's message, which says why, on one line and without the file's name again."""
    text = " ".join(str(error).split())
    for mark in ("] : ", " : ", " failed:"):
        text = text.partition(mark)[2] or text
    return text.rstrip(" .")[:200] or type(error).__name__


@dataclass(frozen=True)
class Placement:
    """Where the resized picture lies in the input; pixel corners count, so ``input = picture * scale + offset``."""

    width: int
    """Width of the resized picture, pixels of the input."""
    height: int
    left: int
    top: int
    scale_x: float
    scale_y: float

    def to_picture(self, boxes: NDArray) -> NDArray:
        """Move boxes [n, 4] (xmin, ymin, xmax, ymax) from the input to the picture."""
        offset = np.array([self.left, self.top] * 2, dtype=np.float32)
        return (boxes - offset) / np.array([self.scale_x, self.scale_y] * 2, dtype=np.float32)


def letterbox(height: int, width: int, *, into: tuple[int, int]) -> Placement:
    """Keep the picture's shape and put it into the middle of an input (height, width), as Ultralytics does."""
    rows, cols = into
    scale = min(rows / height, cols / width)
    new_h, new_w = round(height * scale), round(width * scale)
    left, top = round((cols - new_w) / 2 - 0.1), round((rows - new_h) / 2 - 0.1)
    return Placement(new_w, new_h, left, top, new_w / width, new_h / height)


def top_left(height: int, width: int, *, into: tuple[int, int]) -> Placement:
    """Keep the picture's shape and put it into the upper left corner, as transformers' padding does."""
    rows, cols = into
    scale = min(rows / height, cols / width)
    new_h, new_w = max(1, int(height * scale + 0.5)), max(1, int(width * scale + 0.5))
    return Placement(min(new_w, cols), min(new_h, rows), 0, 0, new_w / width, new_h / height)


def stretch(height: int, width: int, *, into: tuple[int, int]) -> Placement:
    """Fill the whole input, whatever that does to the picture's shape."""
    rows, cols = into
    return Placement(cols, rows, 0, 0, cols / width, rows / height)


def lay(image: NDArray, place: Placement, *, into: tuple[int, int], fill: int, smooth: bool = False) -> NDArray:
    """Resize an image, uint8 [H, W, 3], and lay it into one of the input's size; the rest is ``fill``.

    Args:
        image: the picture.
        place: where to.
        into: the input's height and width.
        fill: value around the picture.
        smooth: average when shrinking, as transformers do; else sample, as Ultralytics do.
    """
    shrinks = smooth and (place.scale_x < 1.0 or place.scale_y < 1.0)
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    resized = image
    if image.shape[:2] != (place.height, place.width):
        resized = cv2.resize(image, (place.width, place.height), interpolation=how)
    if (place.height, place.width) == into:
        return resized
    canvas = np.full((*into, 3), fill, dtype=np.uint8)
    canvas[place.top : place.top + place.height, place.left : place.left + place.width] = resized
    return canvas


def channels_first(image: NDArray, *, scale: tuple[float, ...], offset: tuple[float, ...] = (0.0, 0.0, 0.0)) -> NDArray:
    """Return ``image * scale + offset`` by channel, float32 [1, 3, H, W], of uint8 [H, W, 3].

    Ten times as fast as OpenCV's ``blobFromImage``, whose memory is new each time.
    """
    tensor = np.empty((1, 3, *image.shape[:2]), dtype=np.float32)
    for plane, channel, factor, shift in zip(tensor[0], cv2.split(image), scale, offset, strict=True):
        np.multiply(channel, np.float32(factor), out=plane, dtype=np.float32)
        if shift:
            np.add(plane, np.float32(shift), out=plane)
    return tensor


def resize_masks(masks: NDArray, height: int, width: int) -> NDArray:
    """Resize float32 masks [n, h, w] bilinearly, corners not aligned, borders repeated: torch's ``interpolate``."""
    if masks.shape[1:] == (height, width):
        return masks
    return np.stack([cv2.resize(mask, (width, height), interpolation=cv2.INTER_LINEAR) for mask in masks])
