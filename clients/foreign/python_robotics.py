"""Path trackers of PythonRobotics, Stanley and LQR, as autopilots: the code of PythonRobotics unmodified.

Needs `scipy` and `matplotlib`, and PythonRobotics in the folder that RVADS_PYTHONROBOTICS names. The trackers follow the centre
line at the speed limit, slower in bends. They know no other vehicle, no sign and no light.
"""

import math
import os
import sys

import numpy as np

import pytest_rvads as rvads

if "RVADS_PYTHONROBOTICS" not in os.environ:
    raise ImportError("RVADS_PYTHONROBOTICS is not set, expected the folder of PythonRobotics with PathTracking and PathPlanning")
sys.path.insert(0, os.environ["RVADS_PYTHONROBOTICS"])
from PathTracking.lqr_speed_steer_control import lqr_speed_steer_control as lqr
from PathTracking.stanley_control import stanley_control as stanley

LATERAL = 2.0  # lateral acceleration in bends [m/s^2]
AHEAD = 12.0  # distance over which a bend is looked for ahead [m]


class Tracker(rvads.Autopilot):
    period, course = 0.1, None  # the trackers count on 10 Hz

    def control(self, seen):
        stanley.L = lqr.L = seen.vehicle.wheelbase
        if self.course is None:
            stations = np.arange(seen.me.station - seen.vehicle.rear_axle_offset, seen.itinerary.end, 0.5)
            x, y, yaw = np.array([seen.itinerary.pose(station) for station in stations]).T
            curvature = np.gradient(np.unwrap(yaw), stations)
            self.course = list(x), list(y), list(yaw), list(np.convolve(curvature, np.full(5, 0.2), "same"))
            self.errors, self.target = (0.0, 0.0), 0
        me, back = seen.me, seen.vehicle.rear_axle_offset
        state = stanley.State(me.x - back * math.cos(me.heading), me.y - back * math.sin(me.heading), me.heading, me.speed)
        nearest, _ = lqr.calc_nearest_index(state, *self.course[:3])
        bend = max(map(abs, self.course[3][nearest : nearest + round(2 * AHEAD)]), default=0.0)
        speed = min(seen.speed_limit, math.sqrt(LATERAL / bend)) if bend else seen.speed_limit
        acceleration, steering = self.track(state, speed)
        limit = seen.vehicle.steering_limit
        return rvads.Acceleration(float(acceleration), float(np.clip(steering, -limit, limit)))


class Stanley(Tracker):
    label = "PythonRobotics Stanley"

    def track(self, state, speed):
        steering, self.target = stanley.stanley_control(state, *self.course[:3], self.target)
        return stanley.pid_control(speed, state.v), steering


class Lqr(Tracker):
    label = "PythonRobotics LQR"

    def track(self, state, speed):
        speeds = [speed] * len(self.course[0])
        steering, _, *self.errors, acceleration = lqr.lqr_speed_steering_control(
            state, *self.course, *self.errors, speeds, lqr.lqr_Q, lqr.lqr_R
        )
        return acceleration, steering
