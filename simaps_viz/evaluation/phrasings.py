"""How the commands of each family are worded. ``{x}``, ``{y}`` and ``{z}`` are things, ``{nth}`` an ordinal word."""

from typing import Final

FAMILIES: Final = (
    "plain",
    "n-th closest",
    "from a side",
    "near another",
    "between",
    "compass",
    "in view",
    "multi-goal",
    "absent",
)

ORDINALS: Final = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
MOST: Final = {
    "left": "leftmost",
    "right": "rightmost",
    "north": "northernmost",
    "south": "southernmost",
    "east": "easternmost",
    "west": "westernmost",
}

ONLY: Final = (
    "go to the {x}",
    "please drive to the {x}",
    "take me to the {x}",
    "approach the {x}",
    "can you find the {x}?",
    "stop next to the {x}",
)
"""For the only one of its class."""
CLOSEST: Final = ("go to the nearest {x}", "navigate to the closest {x}", "walk over to the nearest {x}, please")
NTH: Final = (
    "go to the {nth} closest {x}",
    "drive to the {nth} nearest {x}",
    "could you go to the {nth} closest {x}?",
    "move to the {nth} closest {x} from here",
)
FROM_SIDE: Final = (
    "go to the {nth} {x} from the {side}",
    "drive to the {nth} {x} from the {side}",
    "please move to the {nth} {x} from the {side} side",
)
OUTERMOST: Final = ("go to the {most} {x}", "head to the {most} {x}", "go to the first {x} from the {side}")
NEAR: Final = (
    "go to the {x} nearest the {y}",
    "drive to the {x} closest to the {y}",
    "approach the {x} that is closest to the {y}",
)
NEXT_TO: Final = ("move to the {x} near the {y}", "take me to the {x} next to the {y}", "go to the {x} by the {y}")
"""Where the two are less than a metre apart."""
BETWEEN: Final = (
    "go between the {x} and the {y}",
    "stand between the {x} and the {y}",
    "please move in between the {x} and the {y}",
    "stop halfway between the {x} and the {y}",
)
COMPASS: Final = (
    "go to the {side} side of the {x}",
    "move to the {side} of the {x}",
    "stand on the {side} side of the {x}",
    "please drive to the {side} side of the {x}",
)
IN_VIEW: Final = (
    "go to the {nth} {x} in view",
    "drive to the {nth} {x} you can see",
    "move to the {nth} visible {x}",
)
FIRST_IN_VIEW: Final = ("go to the nearest {x} in view", "drive to the closest {x} in sight", "go to the {x} in view")
MULTI: Final = (
    "go to the {x}, then to the {y}",
    "first drive to the {x}, then go to the {y}",
    "visit the {x} and then go to the {y}",
    "go to the {x}, then to the {y} and finally to the {z}",
)
ABSENT: Final = (
    "go to the {absent}",
    "find the {absent}",
    "go to the {x} nearest the {absent}",
    "go between the {x} and the {absent}",
    "go to the {x}, then to the {absent}",
    "drive to the north side of the {absent}",
    "go to the {beyond} closest {x}",
)
"""``{beyond}`` is a rank that the class does not have."""
ABSENT_THINGS: Final = (
    "piano",
    "bathtub",
    "fireplace",
    "motorcycle",
    "surfboard",
    "aquarium",
    "giraffe",
    "harp",
    "kayak",
    "telescope",
)
"""Words for things that scenes seldom have; those a scene has are left out."""
