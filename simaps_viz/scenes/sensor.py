"""A simulated depth camera: what a real one adds to, and loses from, exact depth."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class DepthSensor:
    """How depth is spoiled.

    The axial noise is the fit of Nguyen, Izadi and Lovell (3DIMPVT 2012) for a Kinect, for surfaces that are not
    seen at a grazing angle: ``sigma(z) = 0.0012 + 0.0019 (z - 0.4)^2``, metres.
    """

    enabled: bool = True
    """False gives exact depth, cut to the range."""
    near_m: float = 0.3
    far_m: float = 6.0
    """Nothing is measured beyond."""
    sigma_floor_m: float = 0.0012
    sigma_growth_per_m: float = 0.0019
    lateral_sigma_px: float = 0.6
    """The picture wanders smoothly by this much (standard deviation, at 640 pixels width), so that edges are ragged."""
    lateral_spacing_px: float = 10.0
    """Distance over which it wanders, at 640 pixels width."""
    edge_dropout: float = 0.4
    """Share of pixels lost at depth jumps of more than 5 %."""
    grazing_cosine: float = 0.22
    """Surfaces seen at a flatter angle (cosine to the normal below this) lose pixels, up to ``grazing_dropout``."""
    grazing_dropout: float = 0.85

    def sigma_m(self, z_m: NDArray) -> NDArray:
        """Return the axial standard deviation at depth z, metres."""
        return self.sigma_floor_m + self.sigma_growth_per_m * (z_m - 0.4) ** 2


def sense(
    depth_m: NDArray, incidence: NDArray, instance: NDArray, sensor: DepthSensor, rng: np.random.Generator
) -> tuple[NDArray, NDArray]:
    """Turn exact depth into a measurement, and tell which object each pixel of it was measured on.

    Args:
        depth_m: float32 [H, W], metres along the optical axis, 0 = nothing hit.
        incidence: float32 [H, W], cosine between the ray and the surface normal, 0-1.
        instance: uint8 [H, W], exact instance ids, 0 = nothing hit.
        sensor: How to spoil it.
        rng: Source of all randomness.

    Returns:
        Depth uint16 [H, W], millimetres, 0 = not measured; and instance ids uint8 [H, W] of what was measured: where
        the depth wanders over an edge, the id wanders with it, so that the highest point of a cell has its own id.
    """
    measured = depth_m
    if sensor.enabled:
        height, width = depth_m.shape
        u, v = _wandering(height, width, sensor, rng)
        seen = cv2.remap(depth_m, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        instance = cv2.remap(instance, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        measured = seen + sensor.sigma_m(seen) * rng.standard_normal(depth_m.shape, dtype=np.float32)
        square = np.ones((3, 3), dtype=np.uint8)
        jump = cv2.dilate(depth_m, square) - cv2.erode(depth_m, square) > 0.05 * depth_m
        grazing = np.clip(1.0 - incidence / sensor.grazing_cosine, 0.0, 1.0) * sensor.grazing_dropout
        chance = np.where(jump, np.maximum(grazing, sensor.edge_dropout), grazing)
        lost = (rng.random(depth_m.shape, dtype=np.float32) < chance) | (seen <= 0)
        measured = np.where(lost, 0.0, measured)
    measured = np.where((measured >= sensor.near_m) & (measured <= sensor.far_m), measured, 0.0)
    return np.round(measured * 1000.0).astype(np.uint16), instance


def _wandering(height: int, width: int, sensor: DepthSensor, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Give, for every pixel, the (u, v) it really shows; float32 [H, W] each."""
    scale = width / 640.0
    spacing = max(2.0, sensor.lateral_spacing_px * scale)
    control = (2, int(height / spacing) + 2, int(width / spacing) + 2)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    draws = rng.standard_normal(control, dtype=np.float32) * np.float32(sensor.lateral_sigma_px * scale)
    du, dv = (cv2.resize(draw, (width, height), interpolation=cv2.INTER_CUBIC) for draw in draws)
    return u + du, v + dv
