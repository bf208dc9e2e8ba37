"""`read_tracks`: from a log of traffic to a recording at one junction."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import MapError, RunError
from pytest_rvads.junctions.finder import find, load, names
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.run import Facts
from pytest_rvads.runs.smoothing import DERIVED
from pytest_rvads.runs.states import AXLE, Agent, Kind
from pytest_rvads.satellites.tracks.cleaning import accuracy_of, delay_of, noise_of, track_of
from pytest_rvads.satellites.tracks.intake import Intake
from pytest_rvads.satellites.tracks.lightlog import lights_at, read_lights, signals_at
from pytest_rvads.satellites.tracks.logformats import Point, read_log
from pytest_rvads.satellites.tracks.matching import NEVER, STANDS, Matched, Matcher, directions
from pytest_rvads.satellites.tracks.samples import Log, Samples
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.wording import one_line

__all__ = [
    "check_one",
    "junctions_of",
    "label_of",
    "light_log",
    "passed",
    "read_tracks",
    "recording_of",
    "recordings_in",
    "unlit",
]

_Values = NDArray[np.float64]
_AHEAD = {"front": 0.0, "center": 0.5, "rear_axle": AXLE}
"""How far ahead of its point the front bumper of a vehicle is, as a share of its length."""
_WALKS = "it is a pedestrian"
_UNSIZED = "its length is not known, which is needed to tell where its front is: --size (size=) gives one"


def read_tracks(  # noqa: PLR0913 - the options of a command
    source: Any,
    junction: Junction | str | None = None,
    *,
    map: str | os.PathLike[str] | None = None,
    format: str | None = None,
    columns: Mapping[str, str] | None = None,
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
    """Return recorded traffic at a junction; the omitted vehicles and the reasons are in its ``left_out``.

    Every vehicle is matched to the way through the junction that is nearest to its whole track, from 150 m before the stopping
    line to the end of the exit road. The vehicle is absent before its first sample and after its last sample on this way.

    Args:
        source: a file, or a table: of pandas, polars, pyarrow, or a dictionary of columns.
        junction: a junction, or an argument of `find`; None for the single junction that vehicles pass on the map of the log.
        map: OpenDRIVE file of a junction given by id; None for the map that the log names, as OpenSCENARIO does.
        format: ``csv``, ``ind``, ``interaction``, ``fcd``, ``carla``, ``osi``, ``rosbag`` or ``xosc``; None: by the name of the
            file.
        columns: of a table, per field (time, id, x, y, heading, speed, vx, vy, length, width, class) its column, with a unit
            after a colon where it is not s, rad or m/s: ``{"time": "t:ms", "heading": "yaw:deg"}``; None: by the usual names.
        point: which point of a vehicle x and y are: ``"front"``, the middle of the front bumper, ``"center"`` of its box, or
            ``"rear_axle"``; None: what the format says, the center for tables.
        size: length and width of vehicles of which the log has none [m].
        offset: added to every x and y, where the log has another origin than the map [m].
        lights: file of lights, CSV with the columns time, signal or entrance, colour; or SUMO's ``<tlsState>``.
        position_accuracy: standard deviation of a coordinate [m]. A verdict is UNSURE if positions within the accuracy would give
            another verdict. None to estimate the accuracy from the roughness of the tracks; the estimate misses errors that all
            samples share, and errors that were smoothed away.
        speed_accuracy: standard deviation of a speed [m/s]; None to estimate it like the accuracy of positions. Speeds that are
            derived from positions have the accuracy that smoothing leaves.
        speed_limit: speed limit at the junction [m/s]; by default the limits of the map.
        strict: whether a bad row is an error; otherwise the vehicle of a bad row is left out.
        label: prefix of the labels of the runs; None for the name of the file.

    Raises:
        RunError: the log can't be read, or no vehicle passes the junction; the message says where, and what to do.
        MapError: the junction does not exist.
    """
    log, usual = read_log(source, format=format, columns=columns, strict=strict)
    intake = Intake(point or usual, size, offset, position_accuracy, speed_accuracy, speed_limit)
    shown = light_log(log, lights)
    places = [junction] if isinstance(junction, Junction) else junctions_of(log, junction, map)
    found = passed(log, places, intake, shown, label_of(log, label))
    check_one(log, found)
    if shown and not found[0].lights:
        raise RunError(unlit(shown, found[0].junction))
    return found[0]


def check_one(log: Log, found: Sequence[Recording]) -> None:
    """Raise a `RunError` where somebody passes several junctions and only one can be meant."""
    if len(found) > 1:
        named = one_line(", ".join(recording.junction.id for recording in found), 200)
        raise RunError(
            f"{log.where}: vehicles pass {len(found)} junctions of the map ({named}): name one (--junction, junction=)"
        )


def recordings_in(log: Log, point: Point) -> list[Recording]:
    """Return the recorded traffic of a log at every junction of its map that a vehicle passes.

    Raises:
        RunError: the log names no map, or no vehicle passes a junction of the map.
        MapError: the map can't be read.
    """
    places = junctions_of(log, None, None)
    return passed(log, places, Intake(point), log.lights, label_of(log, None), by_junction=len(places) > 1)


def junctions_of(log: Log, junction: str | None, map: str | os.PathLike[str] | None) -> list[Junction]:
    """Return the junctions that a log may be about; without a name all usable ones of its map.

    Args:
        log: the log.
        junction: what `find` takes, ``all``, or None.
        map: OpenDRIVE file; None: the one that the log names, unless `junction` is a built-in one.

    Raises:
        RunError: neither a junction is named nor a map.
        MapError: no such junction, or the map has no usable one; the message says why each is not.
    """
    if map is None and junction not in names():
        map = log.map
    if junction is not None and junction != "all":
        return [find(junction, map)]
    if map is None:
        raise RunError(f"{log.where}: name the junction that it is about (--junction, junction=), this log names no map")
    reports = load(map).junctions
    usable = [find(report.id, map) for report in reports if report.usable]
    if not usable:
        why = "; ".join(f"{report.id}: {report.reason}" for report in reports)
        raise MapError(f"map file {map} has no usable junction ({one_line(why, 600)}): give a map of where the log was recorded")
    return usable


def passed(  # noqa: PLR0913 - a log, where, how it is taken, and what it is called
    log: Log,
    junctions: Sequence[Junction],
    intake: Intake,
    shown: Mapping[str, Changes],
    label: str,
    *,
    by_junction: bool = False,
    watch: Watch | None = None,
) -> list[Recording]:
    """Return what a log has of those junctions that somebody passes, with the id of each in its label if `by_junction`.

    Raises:
        RunError: nobody passes any of them; the message says why, as far as the last one tells.
    """
    found: list[Recording] = []
    left_out: Sequence[tuple[str, str]] = ()
    for number, junction in enumerate(junctions, start=1):
        recording = recording_of(log, junction, intake, shown, f"{label} {junction.id}" if by_junction else label)
        left_out = recording.left_out
        found += [recording] if recording.tracks else []
        if watch is not None:
            watch(number, len(junctions))
    if not found:
        raise RunError(_explain_empty(log, junctions, intake, left_out))
    return found


def label_of(log: Log, label: str | None) -> str:
    """Return what the labels of runs begin with: what somebody says, else the name of the file up to its first dot."""
    return one_line(label or log.where.partition(".")[0], 200) or "tracks"


def light_log(log: Log, lights: str | os.PathLike[str] | None) -> Mapping[str, Changes]:
    """Return the colours that signals showed: of a file, else those of the log."""
    return log.lights if lights is None else read_lights(Path(lights))


def unlit(shown: Mapping[str, Changes], junction: Junction) -> str:
    """Return the sentence that none of the lights is at a junction."""
    given, known = (one_line(", ".join(sorted(names)), 300) for names in (shown, signals_at(junction)))
    return f"none of the lights ({given}) is at junction {junction.name!r}, which knows {known}"


def recording_of(log: Log, junction: Junction, intake: Intake, shown: Mapping[str, Changes], label: str) -> Recording:
    """Return what a log has of one junction; without tracks where nobody passes it.

    Raises:
        RunError: lengths are needed and missing, or the junction has no geometry.
    """
    if not junction.drivable:
        raise RunError(f"junction {junction.name!r} holds no geometry, which tracks are matched to: give its map")
    if intake.speed_limit is not None:
        junction = junction.limited(None)
    unsized = [vehicle for vehicle in log.vehicles if _ahead(vehicle, intake) is None]
    matcher = Matcher(junction)
    found: list[tuple[str, Samples, Matched]] = []
    left_out = [*log.refused, *((vehicle.name, _UNSIZED) for vehicle in unsized)]
    for vehicle in log.vehicles:
        if _ahead(vehicle, intake) is None:
            continue
        matches = [STANDS] if len(vehicle.times) < 2 else list(matcher.match(vehicle, *placed(vehicle, intake)))
        if vehicle.kind is Kind.PEDESTRIAN:
            matches = [_WALKS]
        passes = [match for match in matches if isinstance(match, Matched)]
        found += [(_named(vehicle.name, k), vehicle, match) for k, match in enumerate(passes)]
        reasons = [match for match in matches if isinstance(match, str)]
        if reasons and not passes:
            left_out.append((vehicle.name, next((why for why in reasons if why not in (NEVER, STANDS)), reasons[0])))
    accuracy = intake.position_accuracy
    if accuracy is None:
        accuracy = accuracy_of([(vehicle, match) for _, vehicle, match in found])
    noise = intake.speed_accuracy
    if noise is None:
        noise = noise_of([(vehicle, match) for _, vehicle, match in found]) if accuracy > 0.0 else 0.0
    derived = any(vehicle.speed is None for _, vehicle, _ in found)
    return Recording(
        label,
        junction,
        tuple(_tracks(found, junction, intake, float(accuracy), float(noise))),
        lights_at(junction, shown) if shown else {},
        Facts(speed_limit=intake.speed_limit),
        float(accuracy),
        max(float(noise), DERIVED if derived and accuracy > 0.0 else 0.0),
        left_out=tuple(left_out),
    )


def _tracks(
    found: Sequence[tuple[str, Samples, Matched]], junction: Junction, intake: Intake, accuracy: float, noise: float
) -> Iterable[Track]:
    taken = {vehicle.name for _, vehicle, _ in found}
    late = delay_of([(vehicle, match) for _, vehicle, match in found]) if accuracy > 0.0 else 0.0
    for name, vehicle, match in found:
        own = name
        while own != vehicle.name and own in taken:  # a vehicle of the log is called so
            own += "'"
        taken.add(own)
        agent = Agent(own, junction.movements[match.way.entrance, match.way.exit], vehicle.kind, vehicle.size or intake.size)
        points, _ = placed(vehicle, intake)
        yield track_of(agent, vehicle, match, points, vehicle.heading, accuracy, late, noise)


def placed(vehicle: Samples, intake: Intake) -> tuple[_Values, _Values]:
    """Return the middle of the front bumper of a vehicle [m], and where it heads [rad], of every sample."""
    heading = directions(vehicle.points) if vehicle.heading is None else vehicle.heading
    points = vehicle.points + np.asarray(intake.offset, dtype=np.float64)
    ahead = _ahead(vehicle, intake) or 0.0
    return points + ahead * np.column_stack((np.cos(heading), np.sin(heading))), heading


def _ahead(vehicle: Samples, intake: Intake) -> float | None:
    """Return the distance from the recorded point of a vehicle to its front [m]; None where the log states no length."""
    share, size = _AHEAD[intake.point], vehicle.size or intake.size
    if vehicle.ahead is not None or not share:
        return vehicle.ahead or 0.0
    return None if size is None else share * size[0]


def _named(name: str, number: int) -> str:
    return name if number == 0 else f"{name}#{number + 1}"


def _explain_empty(log: Log, junctions: Sequence[Junction], intake: Intake, left_out: Sequence[tuple[str, str]]) -> str:
    """Return why nobody passes any of the junctions, and what to do about it."""
    who = f"junction {junctions[0].name!r}" if len(junctions) == 1 else f"any of the {len(junctions)} junctions"
    told = f"nobody in {log.where} passes {who}"
    if not log.vehicles:
        return f"{told}: {left_out[0][1]}" if left_out else f"{told}: it has no vehicles"
    points = np.vstack([vehicle.points for vehicle in log.vehicles]) + np.asarray(intake.offset)
    centres = [Matcher(junction).centre for junction in junctions]
    nearest = min(float(np.hypot(*(points - centre).T).min()) for centre in centres)
    if nearest > _ELSEWHERE:
        (x, y), (far_x, far_y) = centres[0], np.median(points, axis=0)
        apart = math.dist((x, y), (far_x, far_y))
        return (
            f"{told}: its tracks are around ({far_x:.0f}, {far_y:.0f}), {apart:,.0f} m from the junction at ({x:.0f}, {y:.0f}): "
            "--offset=X,Y (offset=) moves them to the origin of the map"
        )
    why, count = Counter(reason for _, reason in left_out).most_common(1)[0]
    return f"{told}: {count} of {len(left_out)} vehicles are left out because {why}"


_ELSEWHERE = 30.0
"""Nobody comes closer to the centre of a junction than this [m]: the tracks are in another place."""
