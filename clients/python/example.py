"""Stops at the line, waits until nobody is in the junction, and goes."""

import rvads_client

stood = None
for seen in rvads_client.connect("example", rate=20):
    stood = None if seen.fresh else stood
    me, scenario = seen.me, seen.scenario
    waiting = me["zone"] in ("approach", "entrance")
    if me["zone"] == "entrance" and me["speed"] < 0.05 and stood is None:
        stood = seen.time
    lights = scenario["map"]["control"] == "lights"
    may = seen.lights[me["entrance"]] == "green" if lights else stood is not None and seen.time - stood > 0.5
    for other in seen.others:
        if other["zone"] == "entrance" and (
            other["turn"] != "left" and me["turn"] == "left" if lights else other["entrance"] < me["entrance"]
        ):
            may = False
        may = may and other["zone"] != "junction"
    line = scenario["itinerary"]["line"] - 0.5 - me["station"]
    speed = rvads_client.stopping_speed(line) if waiting and not may else scenario["speed_limit"]
    seen.answer(target_speed=speed)
