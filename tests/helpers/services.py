"""Shared by the tests of viewer and others."""

from browser import toy_view

from simaps_viz.language.grounding import Grounding
from simaps_viz.navigation.agent import answer
from simaps_viz.viewer.page.services import Services


def real_services(**others) -> Services:
    return Services(
        ask=answer,
        candidates=lambda simap, label, pose: Grounding(simap, pose).candidates(label),
        view=toy_view,
        **others,
    )
