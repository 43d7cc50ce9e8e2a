"""Over two hundred ways to say things: at least 97 of 100 must come to what a person would want."""

from pathlib import Path

import pytest
from commands_afresh import AFRESH
from commands_corpus import CORPUS
from toy_maps import TOY_POSE, toy_map
from world import World, problem

from simaps_viz import BuildConfig, build_map, open_sequence
from simaps_viz.navigation.agent import answer
from simaps_viz.structures import Pose2

HOUSE = Path(__file__).parents[2].parent / "shared" / "data" / "aws-small-house" / "rgbd"
POSES = {
    "house": Pose2.from_heading(1.0, 0.5, 180.0),
    "bedroom": Pose2.from_heading(-5.9, -0.3, 0.0),
    "dining": Pose2.from_heading(5.2, 1.0, 90.0),
}
SHARE = 0.97


@pytest.fixture(scope="session")
def house():
    if not HOUSE.is_dir():
        pytest.skip(f"{HOUSE} is not on this machine")
    return build_map(open_sequence(HOUSE), BuildConfig(method="paper", k_percent=5.0))


def failures(where: dict[str, World]) -> tuple[int, list[str]]:
    said = [
        (place, expected, text)
        for place, expected, texts in (*CORPUS, *AFRESH)
        for text in texts.split(" / ")
        if place in where
    ]
    wrong = []
    for place, expected, text in said:
        world = where[place]
        why = problem(world, expected(world), answer(world.simap, text, world.pose))
        wrong += [f"{place}: {text!r}: {why}"] if why else []
    return len(said), wrong


@pytest.mark.slow
def test_what_is_said_on_the_toy_map() -> None:
    total, wrong = failures({"toy": World(toy_map(), TOY_POSE)})
    assert total >= 160
    assert len(wrong) <= (1.0 - SHARE) * total, "\n".join(wrong)


@pytest.mark.slow
def test_what_is_said_in_the_house(house) -> None:
    total, wrong = failures({name: World(house, pose) for name, pose in POSES.items()})
    assert total >= 60
    assert len(wrong) <= (1.0 - SHARE) * total, "\n".join(wrong)


def test_the_corpus_is_large_and_says_nothing_twice() -> None:
    said = [(place, text.lower()) for place, _, texts in (*CORPUS, *AFRESH) for text in texts.split(" / ")]
    assert len(set(said)) == len(said) >= 220
