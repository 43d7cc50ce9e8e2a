"""The readings of one clause, the likeliest first: English does not say what "near the desk" belongs to."""

from typing import Any, Final

from lark import Tree
from lark.visitors import CollapseAmbiguities

MAX_READINGS: Final = 24
_COST: Final = {"compound": 1.0, "group": 0.2, "go_beside": -0.5, "beside_at": -0.5, "go_front": -0.5}
_COST_OF_PART: Final = 0.3
_COST_OF_ONE_OF_MANY: Final = 0.6
_PARTS: Final = frozenset(
    [
        "away_from",
        "behind",
        "between",
        "farthest",
        "farthest_side",
        "from_here",
        "from_side",
        "from_side_of",
        "in_front",
        "near",
        "nearest",
        "numbered",
        "on_side",
        "outermost",
        "side_of",
        "swept",
        "view",
    ]
)
_THINGS: Final = ("described", "another_one", "compound", "group")


def readings_of(tree: Tree[Any]) -> list[Tree[Any]]:
    """Give the single trees of an ambiguous one, the likeliest first; of equally likely ones, the parser's first."""
    trees = CollapseAmbiguities().transform(tree) if any(tree.find_data("_ambig")) else [tree]
    unique = sorted(dict.fromkeys(trees), key=lambda t: round(_cost(t, 0), 6))
    # "second from the left of the table" may also mean: of those to its left, the second
    of_side = [_renamed(t, "from_side_of", "side_of") for t in unique if any(t.find_data("from_side_of"))]
    return [*unique, *of_side][:MAX_READINGS]


def _renamed(tree: Tree[Any], name: str, other: str) -> Tree[Any]:
    children = [_renamed(child, name, other) if isinstance(child, Tree) else child for child in tree.children]
    return Tree(other if tree.data == name else tree.data, children)


def _cost(tree: Tree[Any], depth: int) -> float:
    """Give how unlikely a reading is: a phrase belongs to the nearest thing before it, what is seen to the first."""
    cost = _COST.get(str(tree.data), 0.0)
    deeper = depth + (str(tree.data) in _THINGS)
    for child in tree.children:
        if isinstance(child, Tree):
            cost += _cost(child, deeper)
    if tree.data == "described" and any(_is_plural(child) for child in tree.children):
        cost += _COST_OF_ONE_OF_MANY
    if str(tree.data) in _PARTS:
        cost += _COST_OF_PART
    if str(tree.data) == "view":
        cost += 0.1 * depth
    elif depth and str(tree.data) not in _THINGS and str(tree.data) not in ("noun", "nouns", "amount", "side", "pair"):
        cost -= 0.1 * depth
    return cost


def _is_plural(noun: object) -> bool:
    return isinstance(noun, Tree) and noun.data == "noun" and getattr(noun.children[0], "type", "") == "NOUNS"
