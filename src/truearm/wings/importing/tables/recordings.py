"""Tables from recordings of ROS: rosbag2 (a folder, .db3 or .mcap) and bags of ROS 1, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from truearm.errors import InputError, extra_module
from truearm.wings.importing.tables.named_arrays import MAX_CELLS, choose_part, columns_of_records, table_of_columns
from truearm.wings.importing.tables.table import Table, TableForm, unreadable
from truearm.wings.importing.tables.units import name_without_unit, unit_in_name


def _joints(message: Any) -> dict[str, float]:
    """Angles [rad] by joint name, and loads where there are some."""
    if len(message.position) != len(message.name):
        return {}
    record = {f"{name}/position [rad]": float(v) for name, v in zip(message.name, message.position, strict=True)}
    if len(message.effort) == len(message.name):
        record |= {f"{name}/effort [Nm]": float(v) for name, v in zip(message.name, message.effort, strict=True)}
    return record


def _point(at: Any) -> dict[str, float]:
    return {f"{axis} [m]": float(getattr(at, axis)) for axis in "xyz"}


def _pose(at: Any, turned: Any) -> dict[str, float]:
    return _point(at) | {f"quat_{axis}": float(getattr(turned, axis)) for axis in "wxyz"}


# What a message holds, by its type; the definitions are ROS's own, not those in the file, which may say anything.
_MESSAGES: dict[str, Callable[[Any], dict[str, float]]] = {
    "sensor_msgs/msg/JointState": _joints,
    "geometry_msgs/msg/PointStamped": lambda m: _point(m.point),
    "geometry_msgs/msg/PoseStamped": lambda m: _pose(m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: _pose(m.transform.translation, m.transform.rotation),
}


def read_recording(path: Path, form: TableForm) -> Table:
    """Read one topic of a recording: joint angles by name [rad], or points and poses [m], with their time [s].

    Raises
    ------
    InputError
        If rosbags is missing, the recording is damaged, or several topics may be meant: `TableForm.part` names one.
    """
    needs, hint = "recordings need the package rosbags", "pip install 'truearm[ros]', or save the topic as CSV"
    ros1, ros2, typesys = (
        extra_module(f"rosbags.{name}", needs, hint, file=path) for name in ("rosbag1", "rosbag2", "typesys")
    )
    is_ros1 = path.suffix == ".bag"
    types = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if is_ros1 else typesys.Stores.ROS2_HUMBLE)
    decode = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
    try:
        with (ros1.Reader if is_ros1 else ros2.Reader)(path) as bag:
            topics = {c.topic: c for c in bag.connections if c.msgtype in _MESSAGES and c.msgcount}
            if not topics:
                kinds = ", ".join(kind.rpartition("/")[2] for kind in _MESSAGES)
                raise InputError(f"expected a topic of {kinds}, got none with messages", file=path)
            joints = [name for name, c in topics.items() if c.msgtype.endswith("JointState")]
            topic = choose_part(joints if len(joints) == 1 and form.part is None else list(topics), form, "topic", path)
            messages = ((stamp, decode(raw, one.msgtype)) for one, stamp, raw in bag.messages([topics[topic]]))
            rows = list(_rows(messages, _MESSAGES[topics[topic].msgtype], path))
    except InputError:
        raise
    except Exception as error:  # of rosbags, SQLite, zstd, lz4: each has its own
        hint = "`ros2 bag reindex` mends a recording that was cut off"
        raise unreadable(path, "a recording", error, hint) from None
    return _table(rows, topic, len(topics), path)


def _rows(
    messages: Iterator[tuple[int, Any]], of_message: Callable[[Any], dict[str, float]], path: Path
) -> Iterator[dict[str, float]]:
    """A record a message; its own time stamp [s], or that of the recording where it has none."""
    cells = 0
    for stamp, message in messages:
        own = message.header.stamp
        time = own.sec + 1e-9 * own.nanosec
        record = of_message(message)
        cells += len(record)
        if cells > MAX_CELLS:
            hint = "record fewer joints or less time"
            raise InputError(f"expected at most {MAX_CELLS} numbers", file=path, hint=hint)
        if record:
            yield {"time [s]": time or 1e-9 * stamp, **record}


def _table(rows: list[dict[str, float]], topic: str, n_topics: int, path: Path) -> Table:
    """The table of those messages that have the most values: a gripper may send its own under the same topic."""
    fullest = max((row.keys() for row in rows), key=len, default={}.keys())
    kept = np.flatnonzero([row.keys() == fullest for row in rows])
    columns = columns_of_records([rows[i] for i in kept], path)
    assumed = [f"topic {topic}" + (f" of {n_topics}" if n_topics > 1 else "")]
    if len(kept) < len(rows):
        assumed.append(f"{len(rows) - len(kept)} messages of other joints ignored")
    values = [(name_without_unit(name), column) for name, column in columns]
    units = [unit_in_name(name) for name, _ in columns]
    return table_of_columns(values, units=units, lines=kept + 1, file=path, assumed=assumed)
