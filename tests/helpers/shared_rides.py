"""Shared by the tests of viewer and others."""

from dataclasses import replace

from toy_maps import TOY_POSE, toy_map

from simaps_viz.colors.instances import instance_colors
from simaps_viz.navigation.agent import answer
from simaps_viz.viewer.page.share import drive_of

COMMAND = "go to the couch"


def late_map():
    """The toy map, of which the couch (community 5) is named from frame 3 on only."""
    simap = toy_map()
    views = simap.views
    keep = (views.community != 5) | (views.frame >= 3)
    return replace(simap, views=replace(views, **{
        name: getattr(views, name)[keep] for name in ("community", "frame", "segment", "cells", "score")
    }))  # fmt: skip


def toy_drive(simap, command=COMMAND):
    return drive_of(simap, command, TOY_POSE, ask=answer)


def couch_of(simap):
    couch = simap.of_class("couch")[0]
    return couch, tuple(instance_colors(simap)[couch.id].tolist())
