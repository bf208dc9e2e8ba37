"""Tracks in bags of ROS 2, and of ROS 1: odometry and tracked objects; the extra ``rosbag`` reads them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pytest_rvads.errors import RunError
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.wording import one_line

__all__ = ["read_rosbag"]

_COLUMNS = {"x": "pose", "y": "pose", "heading": "pose", "speed": "twist", "time": "header.stamp"}
_ALONE = ("nav_msgs/msg/Odometry",)
_MANY = ("TrackedObjects", "PredictedObjects")
"""Last parts of types of messages that hold objects of perception, as Autoware has them."""
_LABELS = {0: "unknown", 1: "car", 2: "truck", 3: "bus", 4: "trailer", 5: "motorcycle", 6: "bicycle", 7: "pedestrian"}


def read_rosbag(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a bag: one per topic of ``nav_msgs/Odometry``, and the objects of ``TrackedObjects`` by their ids.

    Odometry is of the rear axle, as ``base_link`` is by convention, and has no size. Rows are messages.

    Raises:
        RunError: it can't be read, has none of these, or the extra is not installed.
    """
    if columns:
        raise RunError(f"{path.name}: the fields of messages are known, leave --columns out")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise RunError(f"{path}: bags are read by an extra: install pytest-rvads[rosbag]") from None
    gather = Gather(path.name, _COLUMNS, strict=strict)
    row = 0
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            wanted = [c for c in reader.connections if c.msgtype in _ALONE or c.msgtype.endswith(_MANY)]
            if not wanted:
                listed = ", ".join(sorted({c.msgtype for c in reader.connections}))
                raise RunError(f"{path}: it has no nav_msgs/Odometry and no TrackedObjects, it has {listed[:300] or 'nothing'}")
            for row, (connection, _, raw) in enumerate(reader.messages(connections=wanted), start=1):
                message = reader.deserialize(raw, connection.msgtype)
                if connection.msgtype in _ALONE:
                    _alone(gather, row, connection.topic, message)
                else:
                    _many(gather, row, message)
                if watch is not None and row % 1000 == 0:
                    watch(min(row, reader.message_count), reader.message_count)
    except RunError:
        raise
    except Exception as error:  # of a library that we do not know
        raise RunError(f"{path}: row {row + 1} can't be read as a bag: {one_line(str(error) or type(error).__name__)}") from error
    return gather.log()


def _alone(gather: Gather, row: int, topic: str, message: Any) -> None:
    """Add the odometry of a vehicle, which is called after its topic."""
    name = topic.strip("/") or "odometry"
    gather.add(name, row, (_time(message), *_pose(message.pose.pose), float(message.twist.twist.linear.x)))


def _many(gather: Gather, row: int, message: Any) -> None:
    """Add objects of perception; their places are the centres of their boxes."""
    time = _time(message)
    for item in message.objects:
        name = bytes(item.object_id.uuid).hex()
        state = item.kinematics
        pose, twist = (
            (state.pose_with_covariance.pose, state.twist_with_covariance.twist)
            if hasattr(state, "pose_with_covariance")
            else (state.initial_pose_with_covariance.pose, state.initial_twist_with_covariance.twist)
        )
        if gather.add(name, row, (time, *_pose(pose), float(twist.linear.x))):
            size = item.shape.dimensions
            label = item.classification[0].label if len(item.classification) else 0
            ahead = size.x / 2 if size.x > 0.0 else None
            gather.describe(name, (size.x, size.y) if size.x > 0.0 < size.y else None, kind_of(_LABELS.get(label, "")), ahead)


def _time(message: Any) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)


def _pose(pose: Any) -> tuple[float, float, float]:
    """Return x and y [m] and heading [rad] of a pose."""
    q = pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    return float(pose.position.x), float(pose.position.y), heading
