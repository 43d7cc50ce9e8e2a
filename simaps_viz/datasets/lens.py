"""Shows pictures of one camera as another at the same place would have taken them: other size, lens or focal length."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import FIELD_OF_VIEW_DEG
from simaps_viz.errors import InputError
from simaps_viz.io.limits import check_picture
from simaps_viz.structures import Intrinsics


@dataclass(frozen=True)
class Lens:
    """A camera with radial and tangential distortion (Brown-Conrady, as OpenCV writes it)."""

    intrinsics: Intrinsics
    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2, k3; empty = none."""

    def scaled(self, width: int, height: int) -> "Lens":
        """Return the camera whose pictures are those of this one, resized to width x height pixels."""
        k = self.intrinsics
        if (k.width, k.height) == (width, height):
            return self
        sx, sy = width / k.width, height / k.height
        return Lens(
            Intrinsics(width, height, k.fx * sx, k.fy * sy, (k.cx + 0.5) * sx - 0.5, (k.cy + 0.5) * sy - 0.5),
            self.distortion,
        )


def pinhole(where: str, width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> Intrinsics:
    """Check a camera (pixels, pixel centres at whole numbers) and give it.

    Raises:
        InputError: It is not finite, its principal point is outside the picture or its field of view not a camera's.
    """
    if not np.isfinite([fx, fy, cx, cy]).all() or min(fx, fy, width, height) <= 0:
        raise InputError(f"{where}: expected a size and focal lengths over 0, found {width}x{height}, {fx:g}, {fy:g}")
    check_picture(where, width, height)
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        found = f"({cx:g}, {cy:g})"
        raise InputError(f"{where}: expected the principal point inside the {width}x{height} image, found {found}")
    low, high = FIELD_OF_VIEW_DEG
    for focal, size in ((fx, width), (fy, height)):
        degrees = float(np.rad2deg(2 * np.arctan(size / 2 / focal)))
        if not low <= degrees <= high:
            raise InputError(
                f"{where}: expected a field of view of {low:g} to {high:g} degrees, found {degrees:.3g} "
                f"(focal length {focal:g} for {size} pixels)"
            )
    return Intrinsics(int(width), int(height), float(fx), float(fy), float(cx), float(cy))


def see_through(image: NDArray, source: Lens, target: Intrinsics, *, exact: bool) -> NDArray:
    """Show a picture of one camera as the other would have taken it; outside of what was seen is 0.

    Both stand at the same place and look the same way, so depth along the optical axis stays what it is.

    Args:
        image: [H, W] or [H, W, 3] of ``source``.
        source: the camera that took it.
        target: the camera wanted, a pinhole.
        exact: take the nearest pixel (depth, ids) rather than mix neighbours (colour).
    """
    if _same(source, target):
        return image
    u, v = _pixels(source, target)
    if exact and image.dtype == np.int32:  # which OpenCV does not remap
        image = image.astype(np.float32)  # ids stay whole: they are under 2^24
        return np.rint(_remap(image, u, v, cv2.INTER_NEAREST)).astype(np.int32)
    return _remap(image, u, v, cv2.INTER_NEAREST if exact else cv2.INTER_LINEAR)


def _remap(image: NDArray, u: NDArray, v: NDArray, how: int) -> NDArray:
    return cv2.remap(image, u, v, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)


def _same(source: Lens, target: Intrinsics) -> bool:
    k = source.intrinsics
    if any(source.distortion) or (k.width, k.height) != (target.width, target.height):
        return False
    return bool(np.allclose(k.matrix(), target.matrix(), rtol=0, atol=1e-3))


@lru_cache(maxsize=8)
def _pixels(source: Lens, target: Intrinsics) -> tuple[NDArray, NDArray]:
    """Return float32 [H, W] twice: where each pixel of the target lies in the source's picture."""
    row, column = np.mgrid[: target.height, : target.width].astype(np.float64)
    x, y = (column - target.cx) / target.fx, (row - target.cy) / target.fy
    k1, k2, p1, p2, k3 = (*source.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    x, y = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    k = source.intrinsics
    return (x * k.fx + k.cx).astype(np.float32), (y * k.fy + k.cy).astype(np.float32)
