"""Shared by the tests of viewer and others."""

from dataclasses import replace

from browser import toy_services
from services import real_services


def all_services(**others):
    return replace(
        real_services(**others), repartition=toy_services().repartition, recommunity=toy_services().recommunity
    )
