"""The map from above in the COCO panoptic format: one picture, a pixel a cell, north up."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.instances import instance_colors
from simaps_viz.exports.exporter import Exporter, ExportOptions
from simaps_viz.exports.records import label_colors, node_name, origin
from simaps_viz.structures import SIMap

UNSEEN = (24, 24, 28)


class COCOPanoptic(Exporter):
    """The map from above, with a table of its segments."""

    endings = (".json", ".png")

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        """Return STEM.json, STEM.png (segment ids as R + 256 G + 256² B) and STEM-top.png (the coloured map).

        Instances keep their ids; the segment of a stuff class has the largest instance id plus the class's index.
        Cells without a class, and those of things too small to be an instance, are void (0). ``category_id`` is the
        index into the map's ``labels``.
        """
        ids = segment_ids(simap)[::-1]
        names = [path.with_name(path.stem + ending) for ending in (".json", ".png", "-top.png")]
        about = _about(simap, ids, ids_name=names[1].name, top_name=names[2].name)
        rgb = np.stack([ids & 255, ids >> 8 & 255, ids >> 16 & 255], axis=-1).astype(np.uint8)
        contents = (json.dumps(about, ensure_ascii=False, indent=1).encode(), _png(rgb), _png(top_view(simap)))
        return dict(zip(names, contents, strict=True))


def segment_ids(simap: SIMap) -> NDArray:
    """Return int64 [rows, cols], row 0 in the south: the segment of each cell, 0 = void."""
    label = simap.grid.label.astype(np.int64)
    is_stuff = ~np.array(simap.grid.is_thing) & (np.arange(len(simap.grid.labels)) > 0)
    stuff = np.where(is_stuff[label], _stuff_base(simap) + label, 0)
    return np.where(simap.instance > 0, simap.instance.astype(np.int64), stuff)


def top_view(simap: SIMap) -> NDArray:
    """Return uint8 [rows, cols, 3], RGB, north up: instances in their colours, other classes in theirs."""
    classes = np.array(label_colors(simap), np.uint8)
    picture = classes[simap.grid.label]
    picture[np.isnan(simap.grid.height_m)] = UNSEEN
    things = simap.instance > 0
    picture[things] = instance_colors(simap)[simap.instance[things]]
    return picture[::-1]


def _stuff_base(simap: SIMap) -> int:
    return int(simap.instance.max(initial=0))


def _about(simap: SIMap, ids: NDArray, *, ids_name: str, top_name: str) -> dict[str, Any]:
    height, width = ids.shape
    labels, base = simap.grid.labels, _stuff_base(simap)
    known = {one.id: (labels.index(one.label), node_name(one)) for one in simap.instances}
    segments = []
    for number in np.unique(ids[ids > 0]).tolist():
        category, name = known.get(number, (number - base, labels[number - base] if number > base else ""))
        row, col = np.nonzero(ids == number)
        x, y = int(col.min()), int(row.min())
        segments.append(
            {
                "id": number,
                "category_id": category,
                "name": name,
                "area": len(row),
                "bbox": [x, y, int(col.max()) - x + 1, int(row.max()) - y + 1],
                "iscrowd": 0,
            }
        )
    colors = label_colors(simap)
    categories = [
        {
            "id": index,
            "name": name,
            "supercategory": "thing" if is_thing else "stuff",
            "isthing": int(is_thing),
            "color": list(colors[index]),
        }
        for index, (name, is_thing) in enumerate(zip(labels, simap.grid.is_thing, strict=True))
        if index > 0
    ]
    x0, _, _, y1 = simap.spec.extent_m
    return {
        "info": {
            "description": "Semantic Instance Map from above: one pixel a cell, north up",
            **origin(simap),
            "cell_size_m": simap.spec.cell_size_m,
            "top_left_m": [x0, y1],
        },
        "licenses": [],
        "images": [{"id": 1, "file_name": top_name, "width": width, "height": height}],
        "annotations": [{"image_id": 1, "file_name": ids_name, "segments_info": segments}],
        "categories": categories,
    }


def _png(rgb: NDArray) -> bytes:
    return cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))[1].tobytes()
