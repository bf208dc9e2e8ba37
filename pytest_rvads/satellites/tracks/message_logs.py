"""Tracks in logs of messages: bags of ROS 1 and ROS 2, and ground truth of ASAM OSI in MCAP or trace files.

The extra ``rosbag`` of the package reads bags, and the extra ``osi`` reads OSI. The rows of these logs are messages.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import one_line

__all__ = ["read_osi", "read_rosbag"]


_OSI_COLUMNS = {"x": "base.position", "y": "base.position", "heading": "base.orientation", "speed": "base.velocity"}
_OSI_PEDESTRIAN, _OSI_ANIMAL = 3, 4
"""Values of ``MovingObject.Type`` of OSI."""
_OSI_TRUCKS = frozenset({5, 6, 7, 8, 11, 16})
"""Values of ``VehicleClassification.Type`` of OSI: delivery van, heavy truck, semitractor, semitrailer, trailer, bus."""
_OSI_BICYCLE = 10


def read_osi(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:  # noqa: ARG001 - the library tells no progress
    """Return the moving objects of ground truths, which may be parts of sensor views.

    Raises:
        RunError: the file can't be read, or the extra is not installed.
    """
    if columns:
        raise RunError(f"{path.name}: OSI has fixed fields, leave --columns out")
    gather = Gather(path.name, _OSI_COLUMNS, strict=strict)
    row = 0
    try:
        for row, truth in enumerate(_osi_truths(path), start=1):
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


def _osi_truths(path: Path) -> Iterator[Any]:
    try:
        import betterosi
    except ImportError:
        raise RunError(f"{path}: reading OSI needs an extra: install pytest-rvads[osi]") from None
    if not path.is_file():
        raise RunError(f"{path}: can't be read: it is no file")
    yield from betterosi.read(str(path), return_ground_truth=True)  # derives the type of a trace file from name or content


def _add_osi_object(gather: Gather, row: int, time: float, item: Any) -> None:
    """Add a moving object; the recorded point is the centre of its box."""
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
        gather.describe(name, (size.length, size.width) if has else None, _osi_kind(item))


def _osi_kind(item: Any) -> Kind:
    if int(item.type) in (_OSI_PEDESTRIAN, _OSI_ANIMAL):
        return Kind.PEDESTRIAN
    classification = item.vehicle_classification
    number = -1 if classification is None else int(classification.type)
    return Kind.CYCLIST if number == _OSI_BICYCLE else Kind.TRUCK if number in _OSI_TRUCKS else Kind.CAR


_ROS_COLUMNS = {"x": "pose", "y": "pose", "heading": "pose", "speed": "twist", "time": "header.stamp"}
_ODOMETRY = ("nav_msgs/msg/Odometry",)
_OBJECT_LISTS = ("TrackedObjects", "PredictedObjects")
"""Endings of the types of messages that hold objects of perception; Autoware has these types."""
_ROS_LABELS = {0: "unknown", 1: "car", 2: "truck", 3: "bus", 4: "trailer", 5: "motorcycle", 6: "bicycle", 7: "pedestrian"}


def read_rosbag(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a bag: a vehicle per topic of ``nav_msgs/Odometry``, and a vehicle per id in ``TrackedObjects``.

    By convention of ROS, odometry refers to ``base_link``, which is the middle of the rear axle. Odometry has no size.

    Raises:
        RunError: the bag can't be read, has no message of these types, or the extra is not installed.
    """
    if columns:
        raise RunError(f"{path.name}: messages have fixed fields, leave --columns out")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise RunError(f"{path}: reading bags needs an extra: install pytest-rvads[rosbag]") from None
    gather = Gather(path.name, _ROS_COLUMNS, strict=strict)
    row = 0
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            connections = [c for c in reader.connections if c.msgtype in _ODOMETRY or c.msgtype.endswith(_OBJECT_LISTS)]
            if not connections:
                listed = ", ".join(sorted({c.msgtype for c in reader.connections}))
                raise RunError(
                    f"{path}: expected nav_msgs/Odometry or TrackedObjects in the bag, got {listed[:300] or 'nothing'}"
                )
            for row, (connection, _, raw) in enumerate(reader.messages(connections=connections), start=1):
                message = reader.deserialize(raw, connection.msgtype)
                if connection.msgtype in _ODOMETRY:
                    _add_odometry(gather, row, connection.topic, message)
                else:
                    _add_ros_objects(gather, row, message)
                if watch is not None and row % 1000 == 0:
                    watch(min(row, reader.message_count), reader.message_count)
    except RunError:
        raise
    except Exception as error:  # an unknown library may raise any error
        raise RunError(f"{path}: row {row + 1} can't be read as a bag: {one_line(str(error) or type(error).__name__)}") from error
    return gather.log()


def _add_odometry(gather: Gather, row: int, topic: str, message: Any) -> None:
    """Add a message of odometry; the topic names the vehicle."""
    name = topic.strip("/") or "odometry"
    gather.add(name, row, (_ros_time(message), *_ros_pose(message.pose.pose), float(message.twist.twist.linear.x)))


def _add_ros_objects(gather: Gather, row: int, message: Any) -> None:
    """Add objects of perception; the recorded point of an object is the centre of its box."""
    time = _ros_time(message)
    for item in message.objects:
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


def _ros_time(message: Any) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)


def _ros_pose(pose: Any) -> tuple[float, float, float]:
    """Return x and y [m] and heading [rad] of a pose."""
    q = pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    return float(pose.position.x), float(pose.position.y), heading
