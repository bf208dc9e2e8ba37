"""Keeps its distance, stops at stop signs and red lights, gives way, goes when nobody is in its way."""

import rvads_client

for seen in rvads_client.connect("example", rate=20):
    me, scenario = seen.me, seen.scenario
    if seen.fresh:
        since, stood, first = None, None, set()
    near = [o for o in seen.others if o["zone"] in ("approach", "entrance") and o["entrance"] != me["entrance"]]
    standing = {other["id"]: other["entrance"] for other in near if other["zone"] == "entrance"}
    if me["zone"] == "approach":
        first = set(standing)
    elif since is None:
        since = seen.time
    if since is not None and seen.time - since <= 0.5:  # at about the same time
        first |= {k for k, entrance in standing.items() if [entrance, me["entrance"]] in scenario["map"]["right_of"]}
    first &= set(standing)
    if me["zone"] == "entrance" and me["speed"] < 0.05 and stood is None:
        stood = seen.time
    sign, stops = scenario["map"]["entrances"][me["entrance"]]["sign"], scenario["map"]["control"] == "stop"
    patient = sign != "lights" and stood is not None and seen.time - stood > 5  # all stand and wait for each other
    free = [other for other in near if seen.lights[other["entrance"]] != "red" and not (patient and other["speed"] < 0.05)]
    come = [other for other in free if -other["station"] < 10 + 5 * other["speed"]]
    may = patient or not first if stops else not any(map(seen.gives_way_to, come))
    may = may and (sign != "stop" or (stood is not None and seen.time - stood > 0.5))
    may = may and (sign != "lights" or seen.lights[me["entrance"]] == "green")
    may = may and not any(other["zone"] == "junction" and seen.conflicts_with(other) for other in seen.others)
    waits = me["zone"] in ("approach", "entrance") and not may
    gap = min(seen.gap_ahead() - 2.0, scenario["itinerary"]["line"] - 0.5 - me["station"] if waits else float("inf"))
    seen.answer(target_speed=min(seen.limit_ahead(4.0), rvads_client.stopping_speed(gap)))
