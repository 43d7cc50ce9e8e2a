"""What a page can ask for: of the robot that is there, and of everything a toy map allows."""

from dataclasses import replace

from browser import toy_services, toy_view

from simaps_viz.language.grounding import Grounding
from simaps_viz.navigation.agent import answer
from simaps_viz.viewer.page.shared import Services


def real_services(**others) -> Services:
    return Services(
        ask=answer,
        candidates=lambda simap, label, pose: Grounding(simap, pose).candidates(label),
        view=toy_view,
        **others,
    )


def all_services(**others) -> Services:
    toy = toy_services()
    return replace(real_services(**others), repartition=toy.repartition, recommunity=toy.recommunity)
