"""The embedded places by name; a new one is a file here and a line below."""

from simaps_viz.errors import InputError
from simaps_viz.scenes import cafe, canteen, home, office, shop
from simaps_viz.scenes.place import Place

PLACES: dict[str, Place] = {one.PLACE.name: one.PLACE for one in (cafe, home, office, canteen, shop)}


def place_of(name: str) -> Place:
    """Return the place of a name; raises InputError when there is none."""
    if name not in PLACES:
        raise InputError(f"place: expected one of {', '.join(PLACES)}, found {name!r}")
    return PLACES[name]
