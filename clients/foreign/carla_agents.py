"""CARLA's BasicAgent and BehaviorAgent as autopilots: CARLA's code unmodified, in our simulation, without a CARLA server.

Needs the wheels `carla` and `shapely`, and CARLA's package `agents` in the folder that RVADS_CARLA names, CARLA/PythonAPI/carla.
CARLA's y axis and its angles are mirrored. The place of a CARLA vehicle is the middle of its body.
"""

import math
import os
import sys
from fnmatch import fnmatch
from functools import lru_cache, partial
from types import SimpleNamespace

import pytest_rvads as rvads

if "RVADS_CARLA" not in os.environ:
    raise ImportError("RVADS_CARLA is not set, expected the folder that holds CARLA's package agents: CARLA/PythonAPI/carla")
sys.path.insert(0, os.environ["RVADS_CARLA"])
import carla
from agents.navigation import basic_agent, behavior_agent, global_route_planner

THROTTLE, BRAKE, STEERING = 4.0, 8.0, math.radians(70.0)  # of CARLA's usual cars at full pedal [m/s^2] and at steer 1 [rad]
COLOURS = dict(zip(rvads.Colour, ("Unknown", "Green", "Yellow", "Red"), strict=True))


@lru_cache(maxsize=8)
def planned(junction):
    road_map = carla.Map(junction.name, junction.opendrive())
    return road_map, global_route_planner.GlobalRoutePlanner(road_map, 2.0)


def transform(x, y, heading):
    return carla.Transform(carla.Location(x, -y, 0.0), carla.Rotation(yaw=-math.degrees(heading)))


def light(line, colour):
    made = SimpleNamespace(id=str(line), type_id="traffic_light", get_transform=partial(transform, *line))
    made.trigger_volume = carla.BoundingBox(carla.Location(x=-1.0), carla.Vector3D(1.0, 1.0, 1.0))  # 1 m before the line
    made.state = getattr(carla.TrafficLightState, COLOURS[colour])
    return made


def car(state, world, limit):
    half, cos, sin = state.length / 2, math.cos(state.heading), math.sin(state.heading)
    place = partial(transform, state.x - half * cos, state.y - half * sin, state.heading)
    made = SimpleNamespace(id=state.name, type_id=f"vehicle.{state.kind}", get_transform=place, get_control=carla.VehicleControl)
    made.get_world, made.get_location, made.get_speed_limit = lambda: world, lambda: place().location, lambda: 3.6 * limit
    made.get_velocity = partial(carla.Vector3D, state.speed * cos, -state.speed * sin, 0.0)
    made.bounding_box = carla.BoundingBox(carla.Location(), carla.Vector3D(half, state.width / 2, 0.7))
    return made


class Driver(rvads.Autopilot):
    period, agent = 0.05, None  # the agents count on 20 Hz

    def control(self, seen):
        actors = [car(state, self, seen.speed_limit) for state in (seen.me, *seen.others)]
        actors += [light(lane.stop_line, seen.lights[k]) for k, lane in enumerate(seen.junction.entrances) if seen.lights[k]]
        known = self.actors if self.agent else {}
        for actor in actors:  # the agents keep the actors that they know
            vars(known.setdefault(actor.id, actor)).update(vars(actor))
        self.actors = {actor.id: known[actor.id] for actor in actors}
        if self.agent is None:
            road_map, planner = planned(seen.junction)
            self.agent = self.make(actors[0], map_inst=road_map, grp_inst=planner, opt_dict={})
            end = transform(*seen.itinerary.pose(seen.itinerary.end - 1.0)).location
            self.agent.set_global_plan(planner.trace_route(actors[0].get_location(), end))
        # Behind the last point of its plan a BehaviorAgent would raise.
        command = carla.VehicleControl() if self.agent.done() else self.agent.run_step()
        return rvads.Acceleration(THROTTLE * command.throttle - BRAKE * command.brake, -STEERING * float(command.steer))

    def get_actors(self):  # all that the agents ask of CARLA's world
        return SimpleNamespace(filter=lambda text: [actor for actor in self.actors.values() if fnmatch(actor.type_id, text)])


MAKES = {name: partial(behavior_agent.BehaviorAgent, behavior=name.lower()) for name in ("Cautious", "Normal", "Aggressive")}
MAKES["Basic"] = partial(basic_agent.BasicAgent, target_speed=30.0)
Cautious, Normal, Aggressive, Basic = (
    type(name, (Driver,), {"__module__": __name__, "label": f"CARLA {name}", "make": make}) for name, make in MAKES.items()
)
