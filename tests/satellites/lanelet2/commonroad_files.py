"""CommonRoad files written by the tests."""

from .lanelet_files import Point, curve, place


def bound(name: str, points: list[Point]) -> str:
    return f"<{name}>" + "".join(f"<point><x>{x!r}</x><y>{y!r}</y></point>" for x, y in points) + f"</{name}>"


def lanelet(id: int, left: list[Point], right: list[Point], more: str = "") -> str:
    return f'<lanelet id="{id}">{bound("leftBound", left)}{bound("rightBound", right)}{more}</lanelet>'


def commonroad(into: str = "", elements: str = "", version: str = "2020a") -> str:
    """Return a crossing of four roads: lanelets 10 to 13 lead in, 20 to 23 lead out, and 3ab leads from road a to road b.

    Args:
        into: content of the lanelet 10 beside its bounds and links.
        elements: elements beside the lanelets.
        version: version of the format.
    """
    lanelets = []
    for k in range(4):
        middle, kerbs = [place(k, 60.0, 0.0), place(k, 10.0, 0.0)], [[place(k, 60.0, a), place(k, 10.0, a)] for a in (3.5, -3.5)]
        ends = [end for end in range(4) if end != k]
        links = "".join(f'<successor ref="3{k}{end}"/>' for end in ends)
        lanelets.append(lanelet(10 + k, middle, kerbs[0], links + (into if k == 0 else "")))
        lanelets.append(lanelet(20 + k, middle[::-1], kerbs[1][::-1]))
        for end in ends:
            lines = curve(k, end, 0.0, 0.0), curve(k, end, 3.5, -3.5)
            lanelets.append(lanelet(int(f"3{k}{end}"), *lines, f'<predecessor ref="1{k}"/><successor ref="2{end}"/>'))
    return f'<commonRoad commonRoadVersion="{version}" timeStepSize="0.1">{"".join(lanelets)}{elements}</commonRoad>'


def light(id: int, duration: int, direction: str = "all") -> str:
    cycle = f"<cycle><cycleElement><duration>{duration}</duration><color>green</color></cycleElement></cycle>"
    return f'<trafficLight id="{id}">{cycle}<direction>{direction}</direction><active>true</active></trafficLight>'
