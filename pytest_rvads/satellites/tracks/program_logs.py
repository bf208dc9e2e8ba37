"""Reads tracks in the logs of programs: SUMO, CARLA, bags of ROS 1 and ROS 2, ground truth of ASAM OSI, and CommonRoad scenarios.

SUMO writes floating car data as XML by ``--fcd-output``. A trajectory log of autoware-carla-scenario has a record of JSON per
line, in CARLA's left-handed frame. A row of a bag, or of an MCAP or trace file of OSI, is a message. Bags can be read if this
package is installed with its extra ``rosbag``, and OSI can be read with the extra ``osi``. A CommonRoad scenario (``.xml``,
versions 2018b and 2020a) is also the map of its recorded vehicles.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.tracks.csvfile import is_fcd_table, read_csv
from pytest_rvads.satellites.tracks.lightlog import changes_of, limit_lights
from pytest_rvads.satellites.tracks.samples import FIELDS, Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.support.decoding import decode, typed
from pytest_rvads.support.errors import RunError, needs
from pytest_rvads.support.storage import number_in, read_xml
from pytest_rvads.support.wording import one_line

_FCD_PERSON = 0.215, 0.478
"""Length and width of a person of SUMO's class ``pedestrian`` (SUMO, Vehicle Type Parameter Defaults) [m]."""


def read_fcd(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles and persons in floating car data of SUMO; a row in messages is a line of the file.

    A person can have the id of a vehicle, so the name of a person is its id after the word ``person``. A position is the middle
    of the front, and an angle is given in degrees clockwise from north. A file has the sizes of vehicles only if SUMO was started
    with ``--fcd-output.attributes``.
    """
    if is_fcd_table(path):
        return read_csv(path, columns, strict=strict, watch=watch, preset="fcd")
    if columns:
        raise RunError(f"{path.name}: floating car data of SUMO have fixed attributes, leave --columns out")
    with opened(path, watch) as source:
        reader = _FcdReader(Gather(source.where, {"speed": "speed", "heading": "angle", "size": "length"}, strict=strict))
        read_xml(source.chunks(), "floating car data of SUMO", reader.take)
        if not reader.has_root:
            raise RunError(
                f"{source.where}: <fcd-export> is missing, expected floating car data of SUMO, written by --fcd-output"
            )
        return reader.gather.log()


class _FcdReader:
    """Adds the vehicles of a file element by element, so that files larger than the memory can be read."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self.has_root = False
        self._time = math.nan
        self._time_text = ""

    def take(self, tag: str, attributes: dict[str, str], row: int) -> None:
        if tag == "vehicle":
            # The kind is recognised by a word in the class or in the name of the type.
            label = f"{attributes.get('vClass', '')} {attributes.get('type', '')}"
            self._add(attributes.get("id", ""), label, attributes, row)
        elif tag == "person" and not attributes.get("vehicle"):  # nobody walks inside of a vehicle
            self._add(f"person {attributes.get('id', '')}", Kind.PEDESTRIAN, attributes, row)
        elif tag == "timestep":
            self._time_text = attributes.get("time", "")
            self._time = number_in(self._time_text)
        elif tag == "fcd-export":
            self.has_root = True

    def _add(self, name: str, kind: Kind | str, attributes: dict[str, str], row: int) -> None:
        if math.isnan(self._time):
            self.gather.refuse(name, row, "time", f"{self._time_text!r:.60} is no time")
        numbers = [self._time]
        for column in ("x", "y", "angle", "speed"):
            text = attributes.get(column)
            try:
                numbers.append(math.nan if text is None else float(text))
            except ValueError:
                numbers.append(math.nan)
                if kind is not Kind.PEDESTRIAN or column in ("x", "y"):
                    self.gather.refuse(name, row, column, f"{text!r:.60} is no number")
        numbers[3] = math.radians(90.0 - numbers[3])
        if not self.gather.add(name, row, tuple(numbers)):
            return
        size = None
        if "length" in attributes and "width" in attributes:
            try:
                size = float(attributes["length"]), float(attributes["width"])
            except ValueError:
                lengths = f"{attributes['length']!r:.40} and {attributes['width']!r:.40}"
                if kind is not Kind.PEDESTRIAN:
                    self.gather.refuse(name, row, "size", f"{lengths} are no length and width, expected numbers in metres")
        if kind is Kind.PEDESTRIAN and not (size and size[0] >= 0.0):
            size = _FCD_PERSON
        self.gather.describe(name, size, kind, 0.0 if kind is Kind.PEDESTRIAN else None)


_CARLA_COLUMNS = {"x": "actors", "y": "actors", "heading": "actors", "speed": "actors", "time": "t", "size": "extent"}
_CARLA_COLOURS = {"Green": Colour.GREEN, "Yellow": Colour.YELLOW, "Red": Colour.RED}
_CarlaState = tuple[int, float, float, float, float, float, float, float, float, float]
"""State of an actor: id; x, y, z [m]; roll, pitch, yaw [deg]; velocity in x, y, z [m/s]."""


def read_carla(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles and lights of a CARLA log in the frame of its OpenDRIVE map: the signs of y and yaw are reversed."""
    if columns:
        raise RunError(f"{path.name}: a trajectory log has fixed fields, leave --columns out")
    with opened(path, watch) as source:
        reader = _CarlaReader(Gather(source.where, _CARLA_COLUMNS, strict=strict))
        for row, line in enumerate(source.lines(), start=1):
            if row == 1 and b"CARLA_RECORDER" in line[:40]:
                raise RunError(
                    f"{source.where} is a file of CARLA's recorder, which only CARLA can read, expected a trajectory log of "
                    "autoware-carla-scenario, with a record of JSON per line: replay the file in CARLA and log the replay so"
                )
            if line.strip():
                reader.take(row, decode(line, dict[str, Any], f"{source.where}: row {row}", RunError))
        reader.gather.lights = changes_of(reader.colours)
        return reader.gather.log()


class _CarlaReader:
    """Adds the vehicles and lights of a file record by record."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self.colours: dict[str, list[tuple[float, Colour]]] = {}
        self._changes = 0
        self._ids: dict[str, str] = {}
        self._actors: dict[int, tuple[tuple[float, float], Kind, float]] = {}
        """By id of an actor: length and width [m], kind, and distance from the recorded point to the front [m]."""

    def take(self, row: int, record: dict[str, Any]) -> None:
        where = f"{self.gather.where}: row {row}"
        kind = record.get("type")
        if kind == "actor":
            number = typed(record.get("id"), int, f"{where}, column id", RunError)
            half = typed(record.get("extent"), list[float], f"{where}, column extent", RunError)
            centre = typed(record.get("center"), list[float], f"{where}, column center", RunError)
            if len(half) != 3 or len(centre) != 3:
                raise RunError(f"{where}: extent and center must have three numbers each, got {half!r:.60} and {centre!r:.60}")
            blueprint = typed(record.get("type_id"), str, f"{where}, column type_id", RunError)
            self._actors[number] = (2 * half[0], 2 * half[1]), kind_of(blueprint), centre[0] + half[0]
        elif kind == "traffic_light":
            self._ids[str(record.get("id"))] = typed(record.get("opendrive_id"), str, f"{where}, column opendrive_id", RunError)
        if kind != "tick":
            return
        time = typed(record.get("t"), float, f"{where}, column t", RunError)
        states = typed(record.get("actors"), list[_CarlaState], f"{where}, column actors", RunError)
        for number, x, y, _, _, _, yaw, vx, vy, _ in states:
            if number not in self._actors:
                self.gather.refuse(str(number), row, "actors", f"actor {number} has no record before this row")
            heading = math.radians(-yaw)
            forward = vx * math.cos(heading) - vy * math.sin(heading)
            if self.gather.add(str(number), row, (time, x, -y, heading, forward)) and number in self._actors:
                self.gather.describe(str(number), *self._actors[number])
        lights = typed(record.get("lights") or {}, dict[str, str], f"{where}, column lights", RunError)
        for light, state in lights.items():
            if name := self._ids.get(light):
                colour, before = _CARLA_COLOURS.get(state, Colour.NONE), self.colours.setdefault(name, [])
                if not before or before[-1][1] is not colour:
                    before.append((time, colour))
                    self._changes += 1
                    limit_lights(self._changes, len(self.colours), where)


_OSI_COLUMNS = {"x": "base.position", "y": "base.position", "heading": "base.orientation", "speed": "base.velocity"}
_OSI_PEDESTRIAN, _OSI_ANIMAL = 3, 4
"""Values of ``MovingObject.Type`` of OSI."""
_OSI_TRUCKS = frozenset({5, 6, 7, 8, 11, 16})
"""Values of ``VehicleClassification.Type`` of OSI: delivery van, heavy truck, semitractor, semitrailer, trailer, bus."""
_OSI_BICYCLE = 10


def read_osi(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:  # noqa: ARG001 - the library tells no progress
    """Return the moving objects except animals in the messages ``GroundTruth`` of OSI, also inside of ``SensorView``."""
    if columns:
        raise RunError(f"{path.name}: OSI has fixed fields, leave --columns out")
    try:
        import betterosi
    except ImportError:
        raise RunError(needs(f"{path}: reading OSI", "betterosi", "osi")) from None
    if not path.is_file():
        raise RunError(f"{path}: can't be read: it is no file")
    gather = Gather(path.name, _OSI_COLUMNS, strict=strict)
    row = 0
    try:
        # The library derives the type of a trace file from name or content.
        for row, truth in enumerate(betterosi.read(str(path), return_ground_truth=True), start=1):
            if truth.timestamp is None:
                raise RunError(f"{path}: row {row} has no timestamp, expected one in every ground truth")
            time = truth.timestamp.seconds + truth.timestamp.nanos * 1e-9
            for item in truth.moving_object:
                _add_osi_object(gather, row, time, item)
    except RunError:
        raise
    except Exception as error:  # an unknown library may raise any error
        raise RunError(f"{path}: row {row + 1} can't be read as OSI: {one_line(str(error) or type(error).__name__)}") from error
    return gather.log()


def _add_osi_object(gather: Gather, row: int, time: float, item: Any) -> None:
    """Add a moving object of OSI to the vehicles; its recorded point is the centre of its box."""
    if int(item.type) == _OSI_ANIMAL:
        return
    if item.id is None:
        gather.refuse("", row, "id", "a moving object has no id")
        return
    name, base = str(item.id.value), item.base
    if base is None or base.position is None:
        gather.refuse(name, row, "x", "it has no position")
        return
    heading = base.orientation.yaw if base.orientation is not None else math.nan
    speed = math.nan
    if base.velocity is not None:
        speed = math.hypot(base.velocity.x, base.velocity.y)
        if base.orientation is not None:
            speed = base.velocity.x * math.cos(heading) + base.velocity.y * math.sin(heading)
    if gather.add(name, row, (time, base.position.x, base.position.y, heading, speed)):
        size = base.dimension
        has = size is not None and size.length > 0.0 and size.width > 0.0
        kind = Kind.PEDESTRIAN
        if int(item.type) != _OSI_PEDESTRIAN:
            number = -1 if item.vehicle_classification is None else int(item.vehicle_classification.type)
            kind = Kind.CYCLIST if number == _OSI_BICYCLE else Kind.TRUCK if number in _OSI_TRUCKS else Kind.CAR
        gather.describe(name, (size.length, size.width) if has else None, kind)


_ROS_COLUMNS = {"x": "pose", "y": "pose", "heading": "pose", "speed": "twist", "time": "header.stamp"}
_ODOMETRY = ("nav_msgs/msg/Odometry",)
_OBJECT_LISTS = ("TrackedObjects", "PredictedObjects")
"""Endings of the types of messages, defined by Autoware, that hold objects which a perception system has detected."""
_ROS_LABELS = {0: "unknown", 1: "car", 2: "truck", 3: "bus", 4: "trailer", 5: "motorcycle", 6: "bicycle", 7: "pedestrian"}


def read_rosbag(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a bag: one per topic of type ``nav_msgs/Odometry``, and one per object id in ``TrackedObjects``.

    By convention of ROS, odometry refers to ``base_link``, which is the middle of the rear axle. Odometry has no size.
    """
    if columns:
        raise RunError(f"{path.name}: messages have fixed fields, leave --columns out")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise RunError(needs(f"{path}: reading bags", "rosbags", "rosbag")) from None
    gather = Gather(path.name, _ROS_COLUMNS, strict=strict)
    row = 0
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            connections = [c for c in reader.connections if c.msgtype in _ODOMETRY or c.msgtype.endswith(_OBJECT_LISTS)]
            if not connections:
                types = ", ".join(sorted({c.msgtype for c in reader.connections}))
                raise RunError(f"{path}: expected nav_msgs/Odometry or TrackedObjects in the bag, got {types[:300] or 'nothing'}")
            for row, (connection, _, raw) in enumerate(reader.messages(connections=connections), start=1):
                message = reader.deserialize(raw, connection.msgtype)
                time = float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)
                if connection.msgtype in _ODOMETRY:
                    name = connection.topic.strip("/") or "odometry"
                    speed = float(message.twist.twist.linear.x)
                    gather.add(name, row, (time, *_ros_pose(message.pose.pose), speed))
                else:
                    _add_ros_objects(gather, row, time, message.objects)
                if watch is not None and row % 1000 == 0:
                    watch(min(row, reader.message_count), reader.message_count)
    except RunError:
        raise
    except Exception as error:  # an unknown library may raise any error
        raise RunError(f"{path}: row {row + 1} can't be read as a bag: {one_line(str(error) or type(error).__name__)}") from error
    return gather.log()


def _add_ros_objects(gather: Gather, row: int, time: float, objects: Any) -> None:
    """Add the detected objects of a message to the vehicles; the recorded point of an object is the centre of its box."""
    for item in objects:
        name = bytes(item.object_id.uuid).hex()
        state = item.kinematics
        pose, twist = (
            (state.pose_with_covariance.pose, state.twist_with_covariance.twist)
            if hasattr(state, "pose_with_covariance")
            else (state.initial_pose_with_covariance.pose, state.initial_twist_with_covariance.twist)
        )
        if gather.add(name, row, (time, *_ros_pose(pose), float(twist.linear.x))):
            size = item.shape.dimensions
            label = item.classification[0].label if len(item.classification) else 0
            ahead = size.x / 2 if size.x > 0.0 else None
            gather.describe(name, (size.x, size.y) if size.x > 0.0 < size.y else None, kind_of(_ROS_LABELS.get(label, "")), ahead)


def _ros_pose(pose: Any) -> tuple[float, float, float]:
    """Return x and y [m] and heading [rad] of a pose of ROS."""
    q = pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    return float(pose.position.x), float(pose.position.y), heading


_COLUMNS = {"x": "position", "y": "position", "heading": "orientation", "speed": "velocity", "size": "shape"}
_NUMBERS = ("time/exact", "position/point/x", "position/point/y", "orientation/exact", "velocity/exact")
"""Elements of a state that hold the numbers of a sample, in the order of `FIELDS`."""
_SHAPE = ("shape/rectangle/length", "shape/rectangle/width", "shape/circle/radius")


def is_commonroad(path: Path) -> bool:
    """Return whether a file is a CommonRoad scenario, given by the first kilobytes of the file."""
    with opened(path) as source:
        return b"<commonRoad" in next(source.chunks(), b"")


def read_commonroad_tracks(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the dynamic obstacles of a CommonRoad scenario; the scenario is the map of the log, unless it is packed.

    A position is the centre of a vehicle; a row in messages is the line of a state. A vehicle is left out if it has no
    trajectory, or if a time, position or orientation is an interval or an area.
    """
    if columns:
        raise RunError(f"{path.name}: a CommonRoad scenario has fixed elements, leave --columns out")
    with opened(path, watch) as source:
        reader = _Reader(Gather(source.where, _COLUMNS, strict=strict))
        read_xml(source.chunks(), "a CommonRoad scenario", reader.start, reader.end, reader.take_text)
        return replace(reader.gather.log(), map=None if path.suffix.lower() == ".gz" else path)  # maps are not packed


class _Reader:
    """Adds the dynamic obstacles of a file element by element."""

    def __init__(self, gather: Gather) -> None:
        self.gather = gather
        self._path: list[str] = []
        self._step, self._name, self._row = 0.0, "", 0
        self._text, self._texts = "", dict[str, str]()
        """Text of the open element; texts of the open obstacle and of its open state by element."""
        self._states = array("d")
        """Row and numbers of each state of the open obstacle."""

    def start(self, tag: str, attributes: dict[str, str], row: int) -> None:
        self._path.append(tag)
        self._text = ""
        if len(self._path) == 1:
            self._step = number_in(attributes.get("timeStepSize", ""))
            if tag != "commonRoad" or not 0.0 < self._step < math.inf:
                what = one_line(f"<{tag} timeStepSize={attributes.get('timeStepSize', '')!r:.20}>", 80)
                raise RunError(f"{self.gather.where}: row {row}: got {what}, expected <commonRoad> with a positive timeStepSize")
        elif len(self._path) == 2:
            self._name, self._row, self._texts, self._states = attributes.get("id", ""), row, {}, array("d")
        elif tag in ("initialState", "state"):
            self._row = row

    def take_text(self, text: str) -> None:
        self._text = (self._text + text)[:100]  # longer than any number

    def end(self, tag: str) -> None:
        parents = self._path[2:]
        if self._path[1:2] in (["dynamicObstacle"], ["obstacle"]):
            element = "/".join(part for part in parents if part not in ("initialState", "trajectory", "state"))
            if element in (*_NUMBERS, *_SHAPE, "type", "role"):
                self._texts[element] = self._text.strip()
            elif tag in ("initialState", "state"):
                self._states.extend((self._row, *(number_in(self._texts.pop(name, "")) for name in _NUMBERS)))
            elif not parents and self._texts.get("role") != "static":
                self._add_vehicle()
        self._path.pop()

    def _add_vehicle(self) -> None:
        table = np.array(self._states).reshape(-1, 1 + len(_NUMBERS))
        rows, samples = table[:, 0].astype(np.int64), table[:, 1:]
        if len(rows) < 2:
            self.gather.refuse(self._name, self._row, "x", "the obstacle has no trajectory, expected states")
            return
        kind = kind_of(self._texts.get("type", ""))
        for k, field in np.argwhere(np.isnan(samples[:, : 3 if kind is Kind.PEDESTRIAN else 4]))[:1]:
            why = "it is missing or not exact, expected a number or a point"
            self.gather.refuse(self._name, int(rows[k]), FIELDS[field], why)
        samples[:, 0] *= self._step
        if np.isnan(samples[:, 4]).any():  # only the initial state must have a velocity
            samples[:, 4] = np.nan
        length, width, radius = (number_in(self._texts.get(name, "")) for name in _SHAPE)
        size = (length, width) if math.isnan(radius) else (2.0 * radius, 2.0 * radius)
        before, to_describe = self.gather.extend(self._name, rows, samples)
        for k in to_describe.tolist():
            self.gather.describe(self._name, None if math.isnan(sum(size)) else size, self._texts.get("type", ""), at=before + k)
