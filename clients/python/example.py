"""Keeps its distance, stops at stop signs and red lights, gives way, goes when nobody is in its way."""

import rvads_client

for seen in rvads_client.connect("example", rate=20):
    me, scenario = seen.me, seen.scenario
    if seen.fresh:
        since, stood, first = None, None, set()
    near = [other for other in seen.others if other["zone"] in ("approach", "entrance") and seen.conflicts_with(other)]
    standing = {other["id"] for other in near if other["zone"] == "entrance"}
    if me["zone"] == "approach":
        first = set(standing)
    elif since is None:
        since = seen.time
    if since is not None and seen.time - since <= 0.5:  # at about the same time
        first |= {other["id"] for other in near if other["id"] in standing and seen.gives_way_to(other)}
    first &= standing
    if me["zone"] == "entrance" and me["speed"] < 0.05 and stood is None:
        stood = seen.time
    sign, stops = scenario["map"]["entrances"][me["entrance"]]["sign"], scenario["map"]["control"] == "stop"
    come = [other for other in near if -other["station"] < 10 + 5 * other["speed"] and seen.lights[other["entrance"]] != "red"]
    may = not (first if stops else any(map(seen.gives_way_to, come)))
    may = may and (sign != "stop" or (stood is not None and seen.time - stood > 0.5))
    may = may and (sign != "lights" or seen.lights[me["entrance"]] == "green")
    may = may and not any(other["zone"] == "junction" and seen.conflicts_with(other) for other in seen.others)
    waits = me["zone"] in ("approach", "entrance") and not may
    line = scenario["itinerary"]["line"] - 0.5 - me["station"]
    free = min(seen.gap_ahead() - 2.0, line if waits else float("inf"))
    seen.answer(target_speed=min(scenario["speed_limit"], rvads_client.stopping_speed(free)))
