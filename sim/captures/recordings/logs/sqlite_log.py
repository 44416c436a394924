"""SQLite databases of ROS 2 bags; a damaged one gives the messages before the damage.

Source: ros2/rosbag2, `rosbag2_storage_sqlite3`: tables `topics` and `messages`.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from starling.patterns import errors
from starling.sim.captures.recordings.logs.mcap_log import unzstd
from starling.sim.captures.recordings.logs.message_log import (
    LoggedMessage,
    LostMessageError,
    MessageLog,
)

_ZSTD = b"\x28\xb5\x2f\xfd"  # First bytes of compressed messages.


def open_log(path: Path) -> MessageLog:
    """Index a database.

    Raises:
        InputError: if the file is no database of a bag.
    """
    entries: list[LoggedMessage] = []
    damage = ""
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
    # A cut file is shorter than its header says; without this, SQLite reads nothing of it.
    connection.execute("PRAGMA writable_schema = ON")
    try:
        topics = {
            number: (name, kind)
            for number, name, kind in connection.execute("SELECT id, name, type FROM topics")
        }
    except sqlite3.Error as error:
        advice = "Is it the .db3 file of a ROS 2 bag?"
        raise errors.refuse("source", "must be a ROS 2 bag", f"{path}: {error}", advice) from error
    try:
        for number, topic, time_ns in connection.execute(
            "SELECT id, topic_id, timestamp FROM messages ORDER BY id"
        ):
            entries.append(
                LoggedMessage(*topics[topic], time_ns, partial(_data, connection, number))
            )
    except (sqlite3.Error, KeyError) as error:
        damage = f"it is damaged after {len(entries)} messages: {error}"
    entries.sort(key=lambda entry: entry.time_ns)
    return MessageLog(entries=entries, is_ros1=False, damage=damage)


def _data(connection: sqlite3.Connection, number: int) -> bytes:
    query = "SELECT data FROM messages WHERE id = ?"
    try:
        (data,) = connection.execute(query, (number,)).fetchone()
    except (sqlite3.Error, TypeError) as error:
        raise LostMessageError(str(error)) from error
    return unzstd(data) if data.startswith(_ZSTD) else bytes(data)


def joined(logs: Sequence[MessageLog]) -> MessageLog:
    """Join the files of a split bag."""
    entries = [entry for log in logs for entry in log.entries]
    damage = "; ".join(log.damage for log in logs if log.damage)
    return MessageLog(entries=entries, is_ros1=logs[0].is_ros1, damage=damage)
