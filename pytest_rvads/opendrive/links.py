"""Links between roads: by the links of the roads themselves and by the connection tables of junctions.

Both are read and united, because each alone lists only half of the movements in some writers' files. A link
whose lane drives out through the contact point is dropped.
"""

from __future__ import annotations

from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.opendrive.draft import Draft, LaneEnd
from pytest_rvads.opendrive.records import Connection, Road

__all__ = ["link_roads", "link_table"]


def link_roads(draft: Draft, road: Road) -> None:
    """Link the lanes of `road` to those of the roads it names as neighbours."""
    for contact, link in road.contacts:
        if link is None or link.junction or not road.sections:
            continue
        other = draft.document.roads.get(link.element)
        if other is None:
            draft.warn(Doubt.LINK, f"road {road.id!r} is linked to road {link.element!r}, which does not exist", road.id)
            continue
        if link.contact not in ("start", "end"):
            draft.warn(Doubt.LINK, f"the link from road {road.id!r} to road {other.id!r} has no contact point", road.id)
            continue
        for lane in road.lanes_at(contact).values():
            for target in lane.onward(contact):
                one, two = (road.id, contact, lane.id), (other.id, link.contact, target)
                pair = draft.pair(one, two)
                if pair is None:
                    draft.idle.append((one, two))
                    continue
                draft.links.add_edge(*pair)
                if road.junction is not None and draft.edges[pair[1]].road == road.id:
                    draft.linked[road.junction].add(pair)


def link_table(draft: Draft, id: str) -> None:
    """Add the links of the connection table of junction `id`."""
    junction = draft.document.junctions[id]
    for row in junction.connections:
        end = _end(draft, id, row)
        if end is None:
            continue
        for source, target in row.links:
            one, two = (row.incoming, end, source), (row.connecting, row.contact, target)
            pair = draft.pair(one, two)
            if pair is None:
                draft.idle.append((one, two))
                if one[:2] != two[:2]:
                    _check(draft, id, one, two)
            elif junction.type == "direct":
                draft.direct[id].append(pair)
            else:
                draft.links.add_edge(*pair)
                if draft.edges[pair[1]].road == row.connecting:
                    draft.listed[id].add(pair)
    only_listed, only_linked = len(draft.listed[id] - draft.linked[id]), len(draft.linked[id] - draft.listed[id])
    if only_listed or only_linked:
        message = (
            f"{only_listed} links into junction {id!r} are only in its table and {only_linked} only in its roads; all were taken"
        )
        draft.warn(Doubt.TABLE, message, None, id)


def _end(draft: Draft, id: str, row: Connection) -> str | None:
    """Return the end of the incoming road at which a row of the table holds; None, with a warning, where there is none."""
    roads = draft.document.roads
    for name in (row.incoming, row.connecting):
        if name not in roads:
            draft.warn(Doubt.LINK, f"junction {id!r} names road {name!r}, which does not exist", None, id)
            return None
    if row.contact not in ("start", "end"):
        what = f"has a connection from road {row.incoming!r} to road {row.connecting!r} without contact point"
        draft.warn(Doubt.LINK, f"junction {id!r} {what}", None, id)
        return None
    end = draft.document.touching(id, row)
    if end is None:
        what = f"junction {id!r} names road {row.incoming!r} as incoming, which does not touch it"
        draft.warn(Doubt.TABLE, what, row.incoming, id)
    return end


def _check(draft: Draft, id: str, *ends: LaneEnd) -> None:
    """Warn of a lane link that names a lane that does not exist."""
    for road, end, lane in ends:
        if lane not in draft.document.roads[road].lanes_at(end):
            what = f"a lane link of junction {id!r} names lane {lane} at the {end} of road {road!r}, which does not exist"
            draft.warn(Doubt.TABLE, what, road, id)
            return
