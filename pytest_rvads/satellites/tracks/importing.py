"""Makes recordings at junctions from a log of traffic: `read_tracks` and its steps.

`Intake` holds settings that a log does not state: the point of a vehicle to which its positions refer, sizes of vehicles, the
offset from the coordinates of the map, and accuracies.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.crosswalks import PERSON
from pytest_rvads.geometry.finder import find, load, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.bodies import contacts
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.run import Facts
from pytest_rvads.runs.smoothing import DERIVED
from pytest_rvads.runs.states import AXLE, Agent, Kind
from pytest_rvads.satellites.lanelet2.lanelet_map import plane_of_utm, read_osm
from pytest_rvads.satellites.tracks.correcting import faced, on_plane, with_headings
from pytest_rvads.satellites.tracks.lightlog import lights_at, read_lights, signals_at, with_lights
from pytest_rvads.satellites.tracks.logformats import Point, read_log
from pytest_rvads.satellites.tracks.matching import (
    NEVER,
    ONCE,
    STEP,
    CrossingMatcher,
    Matched,
    Matcher,
    accuracy_of,
    delay_of,
    directions,
    linkage_of,
    noise_of,
    track_of,
    track_on_foot,
)
from pytest_rvads.satellites.tracks.samples import Log, Samples
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.support.errors import MapError, RunError, suggest
from pytest_rvads.support.wording import one_line

_Values = NDArray[np.float64]
_Pass = tuple[Samples, Matched]
_Match = tuple[str, Samples, Matched]
"""Name of an agent, its samples, and its way."""
_AHEAD = {"front": 0.0, "center": 0.5, "rear_axle": AXLE}
"""By the point of a vehicle to which its positions refer, the distance from this point to the front, as a share of the length."""


def read_tracks(  # noqa: PLR0913 - the options of a command
    source: Any,
    junction: Junction | str | None = None,
    *,
    map: str | os.PathLike[str] | None = None,
    format: str | None = None,
    columns: Mapping[str, str] | None = None,
    classes: Mapping[str, str] | None = None,
    point: Point | None = None,
    size: tuple[float, float] | None = None,
    offset: tuple[float, float] = (0.0, 0.0),
    lights: str | os.PathLike[str] | None = None,
    position_accuracy: float | None = None,
    speed_accuracy: float | None = None,
    speed_limit: float | None = None,
    strict: bool = False,
    label: str | None = None,
) -> Recording:
    """Return recorded traffic at a junction; ``left_out`` of the recording lists the omitted vehicles with reasons.

    Every vehicle is matched to the way (path through the junction) that is nearest to its whole track, from 150 m before the
    stopping line to the end of the exit road. In the recording, the vehicle is present from its first to its last sample on this
    way. A vehicle whose way is not decided is in the recording only if it crashes, see `Agent.other_exits`. A pedestrian is
    present while it is on a crosswalk of the junction, or on the sidewalk before or behind the crosswalk.

    Args:
        source: path of a file, or a table: of pandas, polars or pyarrow, or a dictionary of columns.
        junction: a junction, or an argument of `find`; None for the single junction that vehicles pass on the map of the log.
        map: map file of a junction given by id; None for the map that the log names, as OpenSCENARIO and CommonRoad do.
        format: ``csv``, ``ind``, ``interaction``, ``fcd``, ``commonroad``, ``carla``, ``osi``, ``rosbag`` or ``xosc``; None to
            choose the format by the suffix of the file.
        columns: column of a table per field (time, id, x, y, heading, speed, vx, vy, length, width, class), with a unit after a
            colon unless the unit is s, rad, m or m/s: ``{"time": "t:ms", "heading": "yaw:deg"}``; None to look for usual names.
        classes: kind of road user (car, truck, cyclist, pedestrian) per class of the log, for classes of other names.
        point: the point of a vehicle to which positions in the log refer: ``"front"`` is the middle of the front bumper,
            ``"center"`` the center of the box, and ``"rear_axle"`` the middle of the rear axle; None for the point of the
            format, which is the center for tables.
        size: length and width of vehicles whose size the log does not state [m].
        offset: numbers added to every x and y, for a log with another origin than the map [m]. Tracks of inD and its relatives
            are brought to the coordinates of a Lanelet2 map by themselves if the meta file of the recording lies beside them.
        lights: file of lights: CSV with the columns time, signal or entrance, colour; or ``<tlsState>`` of SUMO.
        position_accuracy: standard deviation of a coordinate [m]. A verdict is UNSURE if positions within the accuracy would give
            another verdict. None to estimate the accuracy from the noise of the tracks; the estimate misses errors that all
            samples share, and noise that was smoothed away before.
        speed_accuracy: standard deviation of a speed [m/s]; None to estimate the accuracy from the noise of the speeds. The
            accuracy of a speed that is derived from positions follows from the smoothing.
        speed_limit: speed limit at the junction [m/s]; by default the limits of the map.
        strict: whether a bad row is an error; without `strict`, a vehicle with a bad row is left out.
        label: prefix of the labels of the runs; None for the name of the file.

    Raises:
        RunError: the log can't be read, or no vehicle passes the junction.
        MapError: the junction does not exist.
    """
    log, usual_point = read_log(source, format=format, columns=columns, classes=classes, strict=strict)
    intake = Intake(point or usual_point, size, offset, position_accuracy, speed_accuracy, speed_limit)
    recorded_lights = log.lights if lights is None else read_lights(Path(lights))
    log = on_map(log, map)
    places = [junction] if isinstance(junction, Junction) else junctions_of(log, junction, map)
    recordings = recordings_at(log, places, intake, recorded_lights, label_of(log, label))
    check_single_junction(log, recordings)
    if recorded_lights and not recordings[0].lights:
        raise RunError(lights_elsewhere(recorded_lights, recordings[0].junction))
    return recordings[0]


def check_single_junction(log: Log, recordings: Sequence[Recording]) -> None:
    """Check that all vehicles of a log pass the same junction."""
    if len(recordings) > 1:
        ids = one_line(", ".join(recording.junction.id for recording in recordings), 200)
        raise RunError(
            f"{log.where}: vehicles pass {len(recordings)} junctions of the map ({ids}): name a junction (--junction, junction=)"
        )


def recordings_in(log: Log, point: Point) -> list[Recording]:
    """Return the recorded traffic of a log at every junction of its map that a vehicle passes."""
    places = junctions_of(log, None, None)
    return recordings_at(log, places, Intake(point), log.lights, label_of(log), by_junction=len(places) > 1)


def junctions_of(log: Log, junction: str | None, map: str | os.PathLike[str] | None) -> list[Junction]:
    """Return the named junction, or for ``all`` and None all usable junctions of the map; the log may name the map."""
    if map is None and junction not in names():
        map = log.map
    if junction is not None and junction != "all":
        return [find(junction, map)]
    if map is None:
        raise RunError(f"{log.where}: the log names no map: name the junction of its tracks (--junction, junction=)")
    reports = load(map).junctions
    usable = [find(report.id, map) for report in reports if report.usable]
    if not usable:
        why = "; ".join(f"{report.id}: {report.reason}" for report in reports)
        raise MapError(f"map file {map} has no usable junction ({one_line(why, 600)}): give the map of the place of the log")
    return usable


def on_map(log: Log, map: str | os.PathLike[str] | None) -> Log:
    """Return a log in the coordinates of its map.

    The positions of a log with UTM coordinates, or in degrees, are projected as the nodes of a Lanelet2 file are, or as the
    ``<geoReference>`` of an OpenDRIVE file says; other logs and maps have the same coordinates.
    """
    if log.degrees:
        return with_headings(on_plane(log, map))
    if log.utm is None or map is None or Path(map).suffix.lower() != ".osm":
        return log
    origin = read_osm(map).origin
    if origin is None:
        return log
    turn, utm = plane_of_utm(origin)
    return log.moved(turn, turn * (log.utm - utm))


def recordings_at(
    log: Log,
    junctions: Sequence[Junction],
    intake: Intake,
    recorded_lights: Mapping[str, Changes],
    label: str,
    *,
    by_junction: bool = False,
    watch: Watch | None = None,
) -> list[Recording]:
    """Return a recording per junction that a vehicle of the log passes."""
    recordings: list[Recording] = []
    left_out: Sequence[tuple[str, str]] = ()
    for number, junction in enumerate(junctions, start=1):
        recording = recording_of(log, junction, intake, recorded_lights, f"{label} {junction.id}" if by_junction else label)
        left_out = recording.left_out
        recordings += [recording] if recording.tracks else []
        if watch is not None:
            watch(number, len(junctions))
    if recordings:
        return recordings
    place = f"junction {junctions[0].name!r}" if len(junctions) == 1 else f"any of the {len(junctions)} junctions"
    finding = f"no vehicle in {log.where} passes {place}"
    if not log.vehicles:
        raise RunError(f"{finding}: {left_out[0][1]}" if left_out else f"{finding}: the log has no vehicles")
    points = np.vstack([vehicle.points for vehicle in log.vehicles]) + np.asarray(intake.offset)
    centres = [Matcher(junction).centre for junction in junctions]
    nearest = min(float(np.hypot(*(points - centre).T).min()) for centre in centres)
    if nearest > _FARTHEST_TRACK:
        (x, y), (far_x, far_y) = centres[0], np.median(points, axis=0)
        apart = math.dist((x, y), (far_x, far_y))
        raise RunError(
            f"{finding}: the tracks are around ({far_x:.0f}, {far_y:.0f}), {apart:,.0f} m from the junction at "
            f"({x:.0f}, {y:.0f}): --offset=X,Y (offset=) moves the tracks to the origin of the map"
        )
    why, count = Counter(reason for _, reason in left_out).most_common(1)[0]
    raise RunError(f"{finding}: {count} of {len(left_out)} vehicles are left out because {why}")


def label_of(log: Log, label: str | None = None) -> str:
    """Return the prefix of the labels of runs: `label`, or without a label the name of the log's file up to its first dot."""
    return one_line(label or log.where.partition(".")[0], 200) or "tracks"


def lights_elsewhere(recorded_lights: Mapping[str, Changes], junction: Junction) -> str:
    """Return the error message for the case that none of the recorded lights stands at the junction."""
    recorded_names, junction_names = (
        one_line(", ".join(sorted(names)), 300) for names in (recorded_lights, signals_at(junction))
    )
    return f"none of the lights ({recorded_names}) is at junction {junction.name!r}, which has the lights {junction_names}"


def unknown_lights(recording: Recording) -> dict[str, float | None]:
    """Return the entrances, by name, at which a recording lacks the colour of a light of the map while a vehicle comes.

    The value is the time from which the colour is recorded [s]; None if it is never recorded, whether a vehicle comes or not.
    """
    junction, since = recording.junction, dict[str, float | None]()
    for start, lane in enumerate(junction.entrances):
        first = float(recording.lights[start].times[0]) if start in recording.lights else math.inf
        comes = (track for track in recording.vehicles if track.agent.entrance == start and track.times[0] < first)
        if lane.sign is Sign.LIGHTS and (first == math.inf or any(comes)):
            since[junction.vehicle_at(start).removeprefix("a")] = None if first == math.inf else first
    return since


def recording_of(log: Log, junction: Junction, intake: Intake, recorded_lights: Mapping[str, Changes], label: str) -> Recording:
    """Return the recording of a log at a junction; the recording has no tracks if no vehicle passes the junction."""
    if not junction.drivable:
        raise RunError(f"junction {junction.name!r} has no geometry, and tracks are matched to the geometry: give its map")
    if intake.speed_limit is not None:
        junction = junction.limited(None)
    junction = with_lights(junction, recorded_lights)
    matcher = Matcher(junction)
    left_out = [*log.refused]
    found: list[tuple[Samples, list[Matched | str]]] = []
    for vehicle in (vehicle for vehicle in log.vehicles if vehicle.kind is not Kind.PEDESTRIAN):
        if _front_distance(vehicle, intake) is None:
            why = "its length is not known, and the place of its front depends on the length: give a length by --size (size=)"
            left_out.append((vehicle.name, why))
        else:
            facing = faced(vehicle, matcher.lines, intake.offset)
            found.append((facing, list(matcher.match(facing, *front_positions(facing, intake)))))
    all_passes = [(vehicle, match) for vehicle, matches in found for match in matches if isinstance(match, Matched)]
    walkers = [walker for walker in log.vehicles if walker.kind is Kind.PEDESTRIAN]
    walks: list[_Pass] = []
    if junction.crossings and all_passes:
        crossing_matcher = CrossingMatcher(junction.walked)
        for walker in walkers:
            walks += [(walker, walk) for walk in crossing_matcher.match(walker, *_placed_on_foot(walker, intake))]
    crashed = _crashed(all_passes, walks, junction, intake) if any(match.doubt for _, match in all_passes) else set()
    matched: list[_Pass] = []
    for vehicle, matches in found:
        passes = [match for match in matches if isinstance(match, Matched) and (not match.doubt or match in crashed)]
        matched += [(vehicle, match) for match in passes]
        reasons = [match.doubt if isinstance(match, Matched) else match for match in matches]
        if reasons and not passes:
            left_out.append((vehicle.name, next((why for why in reasons if why not in (NEVER, ONCE)), reasons[0])))
    walks = walks if matched else []
    on_foot = {walker.name for walker, _ in walks}
    reason = "it is a pedestrian" + (" who walks over no crosswalk" if junction.crossings and matched else "")
    left_out += [(walker.name, reason) for walker in walkers if walker.name not in on_foot]
    junction = junction.walked if walks else junction
    accuracy = accuracy_on_foot = intake.position_accuracy
    linked = linkage_of(matched)
    if accuracy is None:  # some logs repeat the position of a vehicle that stands, without noise
        accuracy = accuracy_of([pair for pair in matched if np.ptp(pair[1].station) >= STEP] or matched) * linked
    if accuracy_on_foot is None:
        accuracy_on_foot = max(accuracy, accuracy_of(walks))
    noise = intake.speed_accuracy
    if noise is None:
        noise = noise_of(matched, linked) if accuracy > 0.0 else 0.0
    derived = any(vehicle.speed is None for vehicle, _ in matched)
    named = _named([*matched, *walks])
    return Recording(
        label,
        junction,
        tuple(_tracks(named, junction, intake, float(accuracy), float(accuracy_on_foot), float(noise))),
        lights_at(junction, recorded_lights) if recorded_lights else {},
        Facts(speed_limit=intake.speed_limit),
        float(accuracy),
        max(float(noise), DERIVED if derived and accuracy > 0.0 else 0.0),
        left_out=tuple(left_out),
    )


def _crashed(passes: Sequence[_Pass], walks: Sequence[_Pass], junction: Junction, intake: Intake) -> set[Matched]:
    """Return the passes in which a vehicle runs into another body, of all passes near one whose way is not decided.

    A contact also counts if the speeds in a sample lead to it after `_UNSEEN`. Bodies that overlap from the beginning are an
    error of the log.
    """
    numbered = [(f"{k}", vehicle, match) for k, (vehicle, match) in enumerate((*passes, *walks))]
    tracks = [track for track in _tracks(numbered, junction.walked, intake, 0.0, 0.0, 0.0) if track.agent.size is not None]
    touched = set[str]()
    for seconds in (0.0, _UNSEEN):
        later_tracks = []
        for track in tracks:
            heading = track.pose[:, 2]
            ahead = np.column_stack((np.cos(heading), np.sin(heading), np.zeros_like(heading)))
            later_tracks.append(replace(track, pose=track.pose + seconds * track.speed[:, None] * ahead))
        recording = Recording("", junction.walked, tuple(later_tracks))
        for k, period in enumerate(recording.periods):
            if any(recording.tracks[number].agent.other_exits for number in period.present):
                run = recording[k]
                since = dict(zip((agent.name for agent in run.agents), run.spans[:, 0] * run.dt, strict=True))
                touched.update(*(c.agents for c in contacts(run) if c.time > max(since[name] for name in c.agents)))
    return {match for name, _, match in numbered[: len(passes)] if name in touched}


_UNSEEN = 0.2
"""Time by which a log can end before the crash that ended it [s]: usual logs have a sample at least every 0.2 s."""


def _named(passes: Sequence[_Pass]) -> list[_Match]:
    """Return agents for the passes of vehicles, such as v17 and v17#2, whose names no other vehicle of the log has."""
    used_names, counts, named = {vehicle.name for vehicle, _ in passes}, Counter[Samples](), []
    for vehicle, match in passes:
        counts[vehicle] += 1
        name = vehicle.name if counts[vehicle] == 1 else f"{vehicle.name}#{counts[vehicle]}"
        while name != vehicle.name and name in used_names:  # the log itself has a vehicle with this name
            name += "'"
        used_names.add(name)
        named.append((name, vehicle, match))
    return named


def _tracks(
    named: Sequence[_Match], junction: Junction, intake: Intake, accuracy: float, accuracy_on_foot: float, noise: float
) -> Iterator[Track]:
    driven = [(vehicle, match) for _, vehicle, match in named if vehicle.kind is not Kind.PEDESTRIAN]
    late = delay_of(driven) if accuracy > 0.0 else 0.0
    for name, vehicle, match in named:
        way = junction.every_way[match.way.entrance, match.way.exit]
        if vehicle.kind is Kind.PEDESTRIAN:
            agent = Agent(name, way, vehicle.kind, (PERSON, PERSON))
            yield track_on_foot(agent, vehicle, match, *_placed_on_foot(vehicle, intake), accuracy_on_foot)
        else:
            agent = Agent(name, way, vehicle.kind, vehicle.size or intake.size, match.other_exits)
            points, _ = front_positions(vehicle, intake)
            yield track_of(agent, vehicle, match, points, vehicle.heading, accuracy, late, noise)


def front_positions(vehicle: Samples, intake: Intake) -> tuple[_Values, _Values]:
    """Return the positions of a vehicle's front, shape ``(samples, 2)`` [m], and its headings, shape ``(samples,)`` [rad].

    The positions are given in the coordinates of the map. Headings that the log lacks are derived from the positions.
    """
    heading = directions(vehicle.points) if vehicle.heading is None else vehicle.heading
    points = vehicle.points + np.asarray(intake.offset, dtype=np.float64)
    ahead = _front_distance(vehicle, intake) or 0.0
    return points + ahead * np.column_stack((np.cos(heading), np.sin(heading))), heading


def _placed_on_foot(walker: Samples, intake: Intake) -> tuple[_Values, float]:
    """Return the recorded point of a pedestrian on the map, shape ``(samples, 2)``, and the distance from it to the front [m]."""
    points = walker.points + np.asarray(intake.offset, dtype=np.float64)
    usual = 0.0 if intake.point == "front" else PERSON / 2
    return points, usual if walker.ahead is None else walker.ahead


def _front_distance(vehicle: Samples, intake: Intake) -> float | None:
    """Return the distance from the recorded point of a vehicle to its front [m]; None if it depends on an unknown length."""
    share, size = _AHEAD[intake.point], vehicle.size or intake.size
    if vehicle.ahead is not None or not share:
        return vehicle.ahead or 0.0
    return None if size is None else share * size[0]


_FARTHEST_TRACK = 30.0
"""If every track is farther than this from every junction's centre, log and map are taken to have different origins [m]."""


@dataclass(frozen=True, slots=True)
class Intake:
    """Settings of an import that a log does not state. `read_tracks` explains the fields.

    Raises:
        RunError: a value is out of its range.
    """

    point: Point
    size: tuple[float, float] | None = None
    offset: tuple[float, float] = (0.0, 0.0)
    position_accuracy: float | None = None
    speed_accuracy: float | None = None
    speed_limit: float | None = None

    def __post_init__(self) -> None:
        points = get_args(Point)
        if self.point not in points:
            raise RunError(f"point must be {', '.join(points)}, got {self.point!r:.60}{suggest(str(self.point), points)}")
        for name in ("position_accuracy", "speed_accuracy"):
            value = getattr(self, name)
            if value is not None and not _are_within((value,), 1, 0.0, 10.0):
                raise RunError(f"{name} must be a standard deviation from 0 to 10, got {value!r:.60}")
        if self.size is not None and not _are_within(self.size, 2, 0.1, 100.0):
            raise RunError(f"size must be a length and a width from 0.1 to 100 m, got {self.size!r:.60}")
        if not _are_within(self.offset, 2, -1e9, 1e9):
            raise RunError(f"offset must be two numbers to add to x and y [m], got {self.offset!r:.60}")


def _are_within(values: object, count: int, low: float, high: float) -> bool:
    """Return whether the values are so many numbers in a range."""
    if not isinstance(values, tuple | list) or len(values) != count:
        return False
    return all(isinstance(value, int | float | np.number) and low <= float(value) <= high for value in values)
