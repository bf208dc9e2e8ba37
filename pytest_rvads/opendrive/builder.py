"""The lanes of a map as a directed graph: one edge per lane and road, linked where traffic can go on."""

from __future__ import annotations

from collections import defaultdict

from pytest_rvads.errors import MapError
from pytest_rvads.maps.network import Draft, Network
from pytest_rvads.opendrive.chains import add_edges
from pytest_rvads.opendrive.lanes import sample_count
from pytest_rvads.opendrive.links import link_roads, link_table
from pytest_rvads.opendrive.records import Document
from pytest_rvads.opendrive.repairs import check_gaps, complete
from pytest_rvads.opendrive.sides import directions, kept_sides

__all__ = ["build"]

MAX_SAMPLES = 1_500_000
"""Most samples of lane centre lines in one map; a town has 70,000."""
MAX_ROAD = 200_000.0
"""Longest road [m]."""


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
    complete(draft)
    check_gaps(draft)
    inside: dict[str, list[str]] = defaultdict(list)
    for edge in draft.edges.values():
        if edge.junction is not None:
            inside[edge.junction].append(edge.id)
    table = {junction: tuple(ids) for junction, ids in inside.items()}
    sides = kept_sides(draft, leftward)
    return Network(
        draft.edges,
        draft.arriving,
        draft.departing,
        sides,
        dict(draft.direct),
        table,
        frozenset(draft.left_out),
        tuple(draft.warnings),
    )


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
