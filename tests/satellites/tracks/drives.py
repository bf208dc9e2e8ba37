"""Vehicles of logs for tests, sampled from positions that a formula gives."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary

__all__ = ["LENGTH", "WIDTH", "Drive", "drive", "write_csv"]

LENGTH, WIDTH = 4.6, 1.8


@dataclass(frozen=True, slots=True)
class Drive:
    """Samples of a vehicle; the points are the middle of its front bumper."""

    name: str
    times: np.ndarray
    points: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    crosses: float
    """Time at which the vehicle crosses the entrance vertex [s]."""

    def moved(self, back: float) -> np.ndarray:
        """Return the points `back` metres behind the front."""
        return self.points - back * np.column_stack((np.cos(self.heading), np.sin(self.heading)))


def drive(
    place: Junction,
    key: tuple[int, int],
    name: str = "v",
    *,
    start: float = 0.0,
    begin: float = -40.0,
    speed: float = 8.0,
    dt: float = 0.1,
) -> Drive:
    """Return a vehicle that drives a movement at constant speed, from station `begin` to shortly before its way ends."""
    way = Itinerary.through(place, *key)
    times = start + np.arange(0.0, (way.end - 1.0 - begin) / speed, dt)
    poses = np.array([way.pose(begin + speed * (time - start)) for time in times])
    return Drive(name, times, poses[:, :2], poses[:, 2], np.full(len(times), speed), start - begin / speed)


def write_csv(path: Path, drives: Sequence[Drive], *, back: float = LENGTH / 2, noise: float = 0.0, seed: int = 0) -> Path:
    """Write a CSV file with the usual columns; points are `back` metres behind the fronts."""
    rng = np.random.default_rng(seed)
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["time", "id", "x", "y", "heading", "speed", "length", "width", "class"])
        for vehicle in drives:
            points = vehicle.moved(back) + noise * rng.standard_normal((len(vehicle.times), 2))
            for k, time in enumerate(vehicle.times):
                x, y = points[k].tolist()
                out.writerow(
                    [
                        repr(float(time)),
                        vehicle.name,
                        x,
                        y,
                        float(vehicle.heading[k]),
                        float(vehicle.speed[k]),
                        LENGTH,
                        WIDTH,
                        "car",
                    ]
                )
    return path
