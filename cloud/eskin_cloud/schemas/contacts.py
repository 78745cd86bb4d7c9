"""Contacts of a skin at one instant."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypedDict

from eskin.contacts import Contacts
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.contacts import UNIT, ContactSkin, Pressures
from eskin_cloud.schemas.base import Instant

Bounds: TypeAlias = tuple[float | None, float | None]


class CoreDocument(TypedDict):
    """The contact of one core: the connected pressed taxels that hold its taxels.

    ``cells`` counts taxels, ``area`` is in m², ``force`` in N, ``centroid`` in m for each axis. A
    bound that is null is not known.
    """

    cells: tuple[int, int]
    area: Bounds
    force: Bounds
    centroid: list[Bounds]
    taxels: list[str]


class RegionDocument(TypedDict):
    """Connected taxels that are possibly pressed, and how many contacts are in them."""

    contacts: tuple[int, int]
    taxels: list[str]


class ContactsDocument(TypedDict):
    """The contacts of a node's skin at one instant.

    ``nodes`` sample the skin. Of one node, the true instants of its samples lie within
    ``time_error`` ns of the stated ones; of several, all that their samples may have been at ``t``
    is enclosed, and it is 0. ``threshold`` is the least of all taxels. Taxels of which nothing is
    known are possibly pressed.
    """

    node: str
    nodes: list[str]
    t: Instant
    time_error: int
    threshold: float
    unit: str
    cores: list[CoreDocument]
    regions: list[RegionDocument]


def describe_contacts(
    nodes: Sequence[str], skin: ContactSkin, pressures: Pressures, contacts: Contacts
) -> ContactsDocument:
    """The contacts of a skin at one instant; the first of its nodes is ``node``."""
    of_core = _names(skin, contacts.core_of, len(contacts))
    of_region = _names(skin, contacts.region_of, len(contacts.regions))
    return {
        "node": nodes[0],
        "nodes": list(nodes),
        "t": format_timestamp(pressures.t),
        "time_error": pressures.error,
        "threshold": skin.least,
        "unit": UNIT,
        "cores": [
            {
                "cells": each.cells,
                "area": each.area,
                "force": each.force,
                "centroid": list(each.centroid),
                "taxels": taxels,
            }
            for each, taxels in zip(contacts, of_core, strict=True)
        ],
        "regions": [
            {"contacts": each.count, "taxels": taxels}
            for each, taxels in zip(contacts.regions, of_region, strict=True)
        ],
    }


def _names(skin: ContactSkin, labels: NDArray[np.int64], count: int) -> list[list[str]]:
    """The taxels of each component."""
    found: list[list[str]] = [[] for _ in range(count)]
    for taxel in np.flatnonzero(labels >= 0).tolist():
        found[labels[taxel]].append(skin.taxels[taxel])
    return found
