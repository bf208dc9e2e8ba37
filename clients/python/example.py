"""Stops at the line, lets those go first who came first or from the right, waits until the junction is free, and goes."""

import rvads_client

for seen in rvads_client.connect("example", rate=20):
    me, scenario = seen.me, seen.scenario
    if seen.fresh:
        since, stood, first = None, None, set()
    near = [other for other in seen.others if other["zone"] in ("approach", "entrance")]
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
    if scenario["map"]["control"] == "lights":
        oncoming = [other for other in near if [other["entrance"], me["entrance"]] in scenario["map"]["opposite"]]
        due = any(other["turn"] != "left" and -other["station"] < 10 + 5 * other["speed"] for other in oncoming)
        may = seen.lights[me["entrance"]] == "green" and not (me["turn"] == "left" and due)
    else:
        may = stood is not None and seen.time - stood > 0.5 and not first
    may = may and all(other["zone"] != "junction" for other in seen.others)
    line = scenario["itinerary"]["line"] - 0.5 - me["station"]
    waits = me["zone"] in ("approach", "entrance") and not may
    seen.answer(target_speed=rvads_client.stopping_speed(line) if waits else scenario["speed_limit"])
