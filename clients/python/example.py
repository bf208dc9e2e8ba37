"""Keeps its distance, stops at stop signs, red lights and for pedestrians, gives way, goes when nobody is in its way."""

import rvads_client

for seen in rvads_client.connect("example", rate=20, pedestrians=True):
    me, scenario = seen.me, seen.scenario
    if seen.fresh:
        since, stood, moved, first = None, None, 0.0, set()
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
    moved = seen.time if any(other["zone"] == "junction" for other in seen.others) else moved
    sign, stops = scenario["map"]["entrances"][me["entrance"]]["sign"], scenario["map"]["control"] == "stop"
    patient = sign != "lights" and stood is not None and seen.time - max(stood, moved) > 5  # all wait for each other
    come = [o for o in near if seen.lights[o["entrance"]] != "red" and -o["station"] < 10 + 7 * o["speed"]]
    may = patient or not first if stops else not any(seen.gives_way_to(o) for o in come if o["speed"] > 0.05 or not patient)
    may = may and (sign != "stop" or (stood is not None and seen.time - stood > 0.5))
    may = may and (sign != "lights" or seen.lights[me["entrance"]] == "green")
    may = may and not any(other["zone"] == "junction" and seen.conflicts_with(other) for other in seen.others)
    line = float("inf") if may or me["zone"] not in ("approach", "entrance") else scenario["itinerary"]["line"]
    gap = min(seen.gap_ahead() - 2.0, seen.gap_to_pedestrians() - 0.5, line - 0.5 - me["station"])
    seen.answer(target_speed=min(seen.limit_ahead(4.0), rvads_client.stopping_speed(gap)))
