"""simple-autonomous-car's pure pursuit controller with its costmap (PyPI, MIT), unmodified, as an autopilot.

Needs the wheel `simple-autonomous-car`. The controller follows the centre line at the speed limit, slower in bends, and slows
down for what its costmap holds 5 m ahead. It knows no sign, no light and no priority.
"""

import math

import numpy as np
from simple_autonomous_car.car.car import CarState
from simple_autonomous_car.control.pure_pursuit_controller import PurePursuitController
from simple_autonomous_car.costmap.grid_costmap import GridCostmap
from simple_autonomous_car.footprint.rectangular_footprint import RectangularFootprint
from simple_autonomous_car.perception.perception import PerceptionPoints

import pytest_rvads as rvads

LATERAL = 2.0  # lateral acceleration in bends [m/s^2]
AHEAD = 50.0  # length of its plans [m], the default of its planner


def outline(other):
    """Points around a body, every 0.5 m, in the frame of the map."""
    along, across = np.meshgrid(np.arange(0.0, other.length, 0.5), np.arange(-other.width / 2, other.width / 2, 0.5))
    cos, sin = math.cos(other.heading), math.sin(other.heading)
    return np.column_stack([(other.x - along * cos - across * sin).ravel(), (other.y - along * sin + across * cos).ravel()])


class Pursuit(rvads.Autopilot):
    label = "simple-autonomous-car pure pursuit"
    period = 0.1  # its dt
    lookahead_gain = None  # of the controller: its default [s]

    def __init__(self):
        gains = {} if self.lookahead_gain is None else {"lookahead_gain": self.lookahead_gain}
        self.controller, self.costmap, self.steering = PurePursuitController(**gains), None, 0.0

    def control(self, seen):
        me, back = seen.me, seen.vehicle.rear_axle_offset
        if self.costmap is None:
            self.costmap = GridCostmap(footprint=RectangularFootprint(me.length, me.width))
        state = CarState(
            me.x - back * math.cos(me.heading), me.y - back * math.sin(me.heading), me.heading, me.speed, self.steering
        )
        points = [outline(other) for other in seen.others]
        seen_points = {"lidar": PerceptionPoints(np.concatenate(points), "global")} if points else {}
        self.costmap.update(seen_points, state)

        rear = me.station - back
        poses = [seen.itinerary.pose(min(station, seen.itinerary.end)) for station in np.arange(rear, rear + AHEAD, 2.0)]
        plan = np.array([(pose.x, pose.y) for pose in poses])
        headings = np.unwrap([pose.heading for pose in poses[:10]])
        bend = max(abs(np.diff(headings)).max() / 2.0, 1e-3)
        self.controller.target_velocity = min(seen.speed_limit, math.sqrt(LATERAL / bend))

        answer = self.controller.compute_control(state, seen_points, self.costmap, plan, dt=self.period)
        limit = seen.vehicle.steering_limit
        self.steering = float(np.clip(self.steering + answer["steering_rate"] * self.period, -limit, limit))
        return rvads.Acceleration(float(answer["acceleration"]), self.steering)


class Short(Pursuit):
    """With the gain of its looking ahead that a comment in its constants names as the former default."""

    label = "simple-autonomous-car pure pursuit, gain 0.5"
    lookahead_gain = 0.5
