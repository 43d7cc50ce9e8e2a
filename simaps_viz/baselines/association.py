"""Objects in space by associating masks frame by frame, as ConceptGraphs does (Gu et al., ICRA 2024): a baseline.

A small re-implementation of the association only, to compare with: each mask becomes a cloud without its outliers and
joins the object of most similarity, geometric (share of its points near the object's) plus semantic, or begins a new
one. Their semantic similarity is that of CLIP vectors; here classes are known, so it is 1 for the same class, else 0.
Their clouds have voxels of 2.5 cm, these of 5 cm.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource, read_ahead
from simaps_viz.geometry import back_project, transform_points
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.in_space import among, majority, patches, voxel_centres, voxel_keys
from simaps_viz.structures import Points

NAME: Final = "ConceptGraphs' association (re-implemented)"
MIN_SIMILARITY: Final = 1.1
"""Geometric and semantic similarity together must exceed this, or a mask begins an object of its own."""
MERGE_OVERLAP: Final = 0.7
"""Objects of one class are joined in the end if the other holds more than this share of one."""
MIN_DETECTIONS: Final = 3
"""Objects seen in fewer frames are left out."""
MIN_VOXELS: Final = 3
"""Masks with fewer voxels are left out."""


@dataclass(eq=False)
class _Object:
    label: str
    keys: NDArray
    """int64 [n], sorted."""
    counts: NDArray
    """int64 [n], masks that had the voxel."""
    detections: int = 1

    def join(self, other: "_Object") -> None:
        """Take over the voxels of another object, or of one mask of it."""
        keys = np.concatenate([self.keys, other.keys])
        self.keys, inverse = np.unique(keys, return_inverse=True)
        weights = np.concatenate([self.counts, other.counts])
        self.counts = np.bincount(inverse, weights, len(self.keys)).astype(np.int64)
        self.detections += other.detections


def associated_points(
    masks: FrameSource, T_map_world: NDArray, origin_m: tuple[float, float], settings: ProjectionSettings
) -> Points:
    """Return the objects of a sequence as points; classes refer to ``masks.labels``, colours are grey.

    Args:
        masks: posed depth with masks of any kind.
        T_map_world: map frame.
        origin_m: a corner of the voxels' grid.
        settings: depth range and heights.
    """
    things = {name for name, thing in zip(masks.labels, masks.is_thing, strict=True) if thing}
    objects: list[_Object] = []
    for frame, segmentation in read_ahead(masks, color=False):
        K, depth = frame.intrinsics, frame.depth_m
        near = (depth > settings.near_m) & (depth < settings.far_m)
        camera = back_project(depth, K.fx, K.fy, K.cx, K.cy)[near]
        points = transform_points(np.asarray(T_map_world) @ frame.T_world_camera, camera)
        kept = (points[:, 2] < settings.cut_height_m) & (points[:, 2] > -settings.below_floor_m)
        keys, ids = voxel_keys(points[kept], origin_m), segmentation.ids[near][kept]
        before = len(objects)  # masks of one frame are not joined with one another
        for segment in segmentation.segments:
            if segment.label not in things:
                continue
            mine = _largest(np.unique(keys[ids == segment.id]))
            if len(mine) < MIN_VOXELS:
                continue
            found = _Object(segment.label, mine, np.ones(len(mine), np.int64))
            similar = [_similarity(found, one) for one in objects[:before]]
            if similar and max(similar) > MIN_SIMILARITY:
                objects[int(np.argmax(similar))].join(found)
            else:
                objects.append(found)
    return _points([one for one in _merged(objects) if one.detections >= MIN_DETECTIONS], masks, origin_m)


def _largest(keys: NDArray) -> NDArray:
    """Return the largest patch of voxels that touch; of equals, all."""
    if len(keys) == 0:
        return keys
    patch, sizes = patches(keys)
    return keys[sizes[patch] == sizes.max()]


def _similarity(found: _Object, one: _Object) -> float:
    """Return the share of a mask's voxels that an object has, plus 1 if their class is the same."""
    if found.label != one.label or found.keys[0] > one.keys[-1] or one.keys[0] > found.keys[-1]:
        return float(found.label == one.label)
    return 1.0 + float(among(found.keys, one.keys).mean())


def _merged(objects: list[_Object]) -> list[_Object]:
    """Join objects of one class that lie in one another, the largest first."""
    left: list[_Object] = []
    for one in sorted(objects, key=lambda one: -len(one.keys)):
        shares = [among(one.keys, other.keys).mean() if one.label == other.label else 0.0 for other in left]
        if shares and max(shares) > MERGE_OVERLAP:
            left[int(np.argmax(shares))].join(one)
        else:
            left.append(one)
    return left


def _points(objects: list[_Object], masks: FrameSource, origin_m: tuple[float, float]) -> Points:
    """Return each voxel as a point of the object that most masks gave it to."""
    numbers = np.repeat(np.arange(1, len(objects) + 1), [len(one.keys) for one in objects])
    keys, counts = (
        np.concatenate([np.zeros(0, np.int64), *parts])
        for parts in ([one.keys for one in objects], [one.counts for one in objects])
    )
    keys, owner, _ = majority(keys, numbers, counts)
    class_of = np.array([-1, *(masks.labels.index(one.label) for one in objects)], np.int16)
    colors = np.full((len(keys), 3), 150, np.uint8)
    return Points(voxel_centres(keys, origin_m).astype(np.float32), colors, class_of[owner], owner.astype(np.int32))
