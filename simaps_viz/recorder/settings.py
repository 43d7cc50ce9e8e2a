"""How much of a build goes into a recording."""

from dataclasses import dataclass

from simaps_viz.errors import InputError


@dataclass(frozen=True)
class RecorderSettings:
    """The parts of each frame that are kept. The defaults are meant for shipping: about 70 kB a frame of 640 x 480."""

    color_every: int = 2
    """Keep the colour picture of every so many frames."""
    color_divide: int = 2
    """Shrink it so many times."""
    jpeg_quality: int = 75
    depth_every: int = 4
    """Keep the depth picture of every so many frames."""
    depth_divide: int = 4
    """Keep one depth pixel of so many along each axis."""
    segmentation_divide: int = 2
    """Keep one segmentation pixel of so many along each axis."""
    points: int = 800
    """Greatest number of back-projected points of one frame."""
    edges: int = 400
    """Greatest number of new graph edges of one frame that are drawn; all are counted."""
    map_every: int = 1
    """Keep the map after every so many frames; the last is always kept."""
    merge_pictures: int = 60
    """Greatest number of merge steps shown as a map."""
    cut_height_m: float = 2.0
    """Points above are left out, as they are on the map."""

    def __post_init__(self) -> None:
        for name in ("color_every", "color_divide", "depth_every", "depth_divide", "segmentation_divide", "map_every"):
            if getattr(self, name) < 1:
                raise InputError(f"recorder, {name}: expected at least 1, found {getattr(self, name)}")
        for name in ("points", "edges", "merge_pictures"):
            if getattr(self, name) < 0:
                raise InputError(f"recorder, {name}: expected at least 0, found {getattr(self, name)}")
        if not 1 <= self.jpeg_quality <= 100:
            raise InputError(f"recorder, jpeg_quality: expected 1 to 100, found {self.jpeg_quality}")


SMALL = RecorderSettings()
"""For shipping and for the page."""
