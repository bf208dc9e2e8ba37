"""highway-env's IDMVehicle under its RegulatedRoad, for one vehicle or for all: the code of highway-env unmodified.

Needs the wheel `highway-env`. Its road gets a lane per approach, movement and exit road. It knows neither signs nor lights: the
priority of a lane tells who gives way, here the number of movements that give way to it, less those that it gives way to. The
steering is ours: that of highway-env counts on wheels that turn at once, and swings out of the lane where they do not.
"""

from itertools import pairwise

import numpy as np
from highway_env.road.lane import PolyLaneFixedWidth
from highway_env.road.regulation import RegulatedRoad
from highway_env.road.road import RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

import pytest_rvads as rvads

LATERAL = 2.0  # lateral acceleration in bends [m/s^2]; the cars of highway-env never slip, and take bends at any speed


class Idm(rvads.TrafficSystem):
    label = "highway-env IDM"

    def prepare(self, junction):
        self.junction, self.vehicles, self.asked = junction, {}, -1.0
        network, rank = RoadNetwork(), dict.fromkeys(junction.movements, 0)
        for lower, higher in junction.yields or ():
            rank[lower], rank[higher] = rank[lower] - 1, rank[higher] + 1
        best = [max(rank[key] for key in rank if key[0] == k) for k in range(len(junction.entrances))]
        lines = [(f"start {k}", f"in {k}", lane.approach, best[k]) for k, lane in enumerate(junction.entrances)]
        lines += [(f"in {start}", f"out {end}", way.path, rank[start, end]) for (start, end), way in junction.movements.items()]
        lines += [(f"out {k}", f"end {k}", lane.road, 0) for k, lane in enumerate(junction.exits)]
        for start, end, line, priority in lines:
            points = [tuple(point) for point in line.points]
            network.add_lane(start, end, PolyLaneFixedWidth(points, junction.lane_width, priority=priority))
        self.road = RegulatedRoad(network, np_random=np.random.RandomState(0))

    def autopilots(self, agents):
        self.exits = {agent.name: agent.exit for agent in agents}
        return [Pilot(self) for _ in agents]

    def place(self, state, limit):
        """Put a vehicle where it is on the road; the exit of a vehicle of others is told by its indicator."""
        exit = self.exits.get(state.name, self.junction.exits_of(state.entrance, state.turn)[0])
        nodes = f"start {state.entrance}", f"in {state.entrance}", f"out {exit}", f"end {exit}"
        centre = state.station - state.length / 2
        behind = (centre >= 0) + (centre >= self.junction.movements[state.entrance, exit].length)
        route = [(*ends, 0) for ends in pairwise(nodes)][behind:]
        place = np.array((state.x - state.length / 2 * np.cos(state.heading), state.y - state.length / 2 * np.sin(state.heading)))
        vehicle = self.vehicles.get(state.name) or IDMVehicle(self.road, place, state.heading, state.speed, route[0], limit)
        self.vehicles[state.name], vehicle.position, vehicle.heading, vehicle.speed = vehicle, place, state.heading, state.speed
        vehicle.LENGTH, vehicle.WIDTH, vehicle.route, vehicle.lane_index = state.length, state.width, route, route[0]
        vehicle.lane = self.road.network.get_lane(route[0])
        return vehicle

    def update(self, seen):
        """Move the road on to the time of an observation: vehicles of the road do not step, they are placed."""
        if seen.time > self.asked:
            self.asked = seen.time
            self.road.vehicles = [self.place(state, seen.limit_of(state)) for state in seen.everybody()]
            if round(seen.time / Pilot.period) % round(1 / Pilot.period / self.road.REGULATION_FREQUENCY) == 0:
                self.road.enforce_road_rules()


class Pilot(rvads.Autopilot):
    period = 0.1  # a whole part of the half second between two decisions of RegulatedRoad

    def __init__(self, world):
        self.world = world

    def control(self, seen):
        self.world.update(seen)
        vehicle, ahead = self.world.vehicles[seen.me.name], seen.me.station + np.arange(0.0, 16.0, 2.0)
        headings = np.unwrap([seen.itinerary.pose(station).heading for station in ahead])
        bend = max(abs(headings[2:] - headings[:-2]).max() / 4.0, 1e-3)
        vehicle.lane.speed_limit = min(seen.speed_limit, (LATERAL / bend) ** 0.5)
        if not getattr(vehicle, "is_yielding", False):
            vehicle.target_speed = seen.speed_limit
        vehicle.act()
        return rvads.Acceleration(float(vehicle.action["acceleration"]))
