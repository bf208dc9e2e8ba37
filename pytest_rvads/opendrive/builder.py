"""From the records of an OpenDRIVE file to a network: one edge per lane and road, linked where traffic can go on."""

from __future__ import annotations

import os

from pytest_rvads.errors import MapError
from pytest_rvads.maps.network import DeclaredJunction, Network
from pytest_rvads.opendrive.chains import add_edges
from pytest_rvads.opendrive.draft import Draft
from pytest_rvads.opendrive.lanes import sample_count
from pytest_rvads.opendrive.links import link_roads, link_table
from pytest_rvads.opendrive.reader import read
from pytest_rvads.opendrive.records import Document, JunctionRecord
from pytest_rvads.opendrive.repairs import complete, mend_joints, turn_links
from pytest_rvads.opendrive.sides import directions, kept_sides
from pytest_rvads.opendrive.signals import attach

__all__ = ["build", "read_network"]

MAX_SAMPLES = 1_500_000
"""Most samples of lane centre lines in one map; a town has 70,000."""
MAX_ROAD = 200_000.0
"""Longest road [m]."""


def read_network(path: str | os.PathLike[str]) -> Network:
    """Return the network of an OpenDRIVE file.

    Raises:
        MapError: the file cannot be used at all; the message is one sentence.
    """
    document = read(path)
    try:
        return build(document)
    except MapError as error:
        raise MapError(f"map file {path}: {error}") from None


def build(document: Document) -> Network:
    """Build the network of a document.

    Raises:
        MapError: a map too large to sample, or coordinates that are not finite.
    """
    _bound(document)
    draft = Draft(document)
    leftward = directions(document, draft.warnings)
    for road in document.roads.values():
        add_edges(draft, road, left_hand=leftward[road.id])
    for road in document.roads.values():
        link_roads(draft, road)
    for junction in document.junctions:
        link_table(draft, junction)
    turn_links(draft)
    complete(draft)
    mend_joints(draft)
    sides = kept_sides(draft, leftward)
    objects = attach(draft)
    return Network(
        draft.edges,
        draft.links,
        {
            id: DeclaredJunction(junction.type, tuple(draft.direct[id]), _lost(draft, junction), junction.priorities)
            for id, junction in document.junctions.items()
        },
        frozenset(road for road, left in sides.items() if left),
        tuple(objects),
        tuple(document.controllers.values()),
        tuple(draft.warnings),
        motorways=frozenset(road.id for road in document.roads.values() if road.motorway),
    )


def _lost(draft: Draft, junction: JunctionRecord) -> str | None:
    """Return a road of a junction, or one that it connects, whose lanes have no place."""
    for row in junction.connections if draft.left_out else ():
        road = draft.document.roads.get(row.connecting)
        links = () if road is None else (road.predecessor, road.successor)
        for name in (row.incoming, row.connecting, *(link.element for link in links if link is not None and not link.junction)):
            if name in draft.left_out:
                return name
    return None


def _bound(document: Document) -> None:
    """Refuse a map that would take too long, before any work is done."""
    for road in document.roads.values():
        if road.length > MAX_ROAD:
            raise MapError(
                f"road {road.id!r} says it is {road.length / 1000:,.0f} km long, expected at most {MAX_ROAD / 1000:.0f} km"
            )
    samples = sum(map(sample_count, document.roads.values()))
    if samples > MAX_SAMPLES:
        raise MapError(
            f"its lane centre lines would take {samples:,} samples, more than {MAX_SAMPLES:,}; "
            "check the lengths of its roads, or cut the map into pieces"
        )
