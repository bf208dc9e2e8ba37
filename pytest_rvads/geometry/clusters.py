"""Reads a cluster, junctions whose ways lead into each other without a road between, as one junction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import networkx as nx

from pytest_rvads.geometry.analysis import cut
from pytest_rvads.geometry.graph import MetricGraph
from pytest_rvads.geometry.network import DeclaredJunction, Doubt, MapWarning, Network
from pytest_rvads.geometry.usability import FEWEST, MOST

__all__ = ["clustered"]


def clustered(graph: MetricGraph) -> MetricGraph:
    """Return a metric graph in which each cluster of `FEWEST` to `MOST` arms is one junction.

    Raises:
        MapError: the lanes of a junction branch too often, see `pytest_rvads.geometry.paths.paths_of`.
    """
    names = _names(graph.network)
    if not names:
        return graph
    merged = MetricGraph(_merged(graph.network, names))
    fitting = {name for name in set(names.values()) if FEWEST <= len(cut(merged, name).arms) <= MOST}
    if fitting == set(names.values()):
        return merged
    return MetricGraph(_merged(graph.network, {id: name for id, name in names.items() if name in fitting}))


def _names(network: Network) -> dict[str, str]:
    """Return, per junction of a cluster, the name of the cluster: the ids of its junctions in file order."""
    beside = nx.Graph()
    for edge, next_edge in network.links.edges:
        junction, next_junction = network.edges[edge].junction, network.edges[next_edge].junction
        if junction is not None and next_junction is not None and junction != next_junction:
            beside.add_edge(junction, next_junction)
    order = {id: k for k, id in enumerate(network.junctions)}
    clusters = [sorted(group, key=order.__getitem__) for group in nx.connected_components(beside)]
    return {id: "+".join(group) for group in clusters for id in group}


def _merged(network: Network, names: Mapping[str, str]) -> Network:
    """Return a network in which the junctions of each cluster are one junction, with the name of the cluster."""
    junctions: dict[str, list[DeclaredJunction]] = {}
    for id, junction in network.junctions.items():
        junctions.setdefault(names.get(id, id), []).append(junction)
    warnings = [replace(warning, junction=names.get(warning.junction or "", warning.junction)) for warning in network.warnings]
    for name in dict.fromkeys(names.values()):
        ids = " and ".join(repr(id) for id, cluster in names.items() if cluster == name)
        message = f"the ways of junctions {ids} lead into each other without a road between; they were read as one, {name!r}"
        warnings.append(MapWarning(Doubt.TABLE, message, None, name))
    return replace(
        network,
        edges={id: replace(edge, junction=names.get(edge.junction or "", edge.junction)) for id, edge in network.edges.items()},
        junctions={
            name: replace(
                parts[0],
                lost=next((part.lost for part in parts if part.lost is not None), None),
                priorities=tuple(pair for part in parts for pair in part.priorities),
            )
            for name, parts in junctions.items()
        },
        objects=tuple(replace(item, junction=names.get(item.junction, item.junction)) for item in network.objects),
        warnings=tuple(warnings),
    )
