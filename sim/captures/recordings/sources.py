"""Opens a recording of any known format."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from starling.patterns import errors, regular_file
from starling.sim.captures import depth_file
from starling.sim.captures import info as capture_info
from starling.sim.captures.recordings import image_folder, ros_topics, tum_folder, viewer_bag
from starling.sim.captures.recordings.logs import mcap_log, ros1_log, sqlite_log
from starling.sim.captures.recordings.logs.message_log import MessageLog
from starling.sim.captures.recordings.recording import Recording
from starling.sim.geometry.pinhole import Pinhole

_OPENERS = {
    ".bag": ros1_log.open_log,
    ".db3": sqlite_log.open_log,
    ".mcap": mcap_log.open_log,
}
_ROS2 = (".db3", ".mcap")


def open_source(path: Path, streams: Mapping[str, str], camera: Pinhole | None) -> Recording:
    """Open a recording; images are read on demand.

    Args:
        path: bag, MCAP file, or a folder: ROS 2 bag, TUM sequence, or images.
        streams: topics of a bag, or file patterns of a folder, by stream.
        camera: intrinsics of TUM sequences, which have none.

    Raises:
        InputError: if the format is unknown, or as its reader.
    """
    if not path.exists():
        raise errors.refuse("source", "must exist", path, "Give a recording or a folder of images.")
    if regular_file.is_pipe_or_device(path):
        advice = "Copy it into a file."
        raise errors.refuse("source", "must be no pipe or device", path, advice)
    if (path / capture_info.FILE).is_file():
        rule, advice = "must be no capture set", "It needs no import: give it to the verbs."
        raise errors.refuse("source", rule, path, advice)
    if path.is_dir():
        path = _bag_folder(path)
        files = _bag_files(path)
        if files:
            return _of_log(_open(files), path, streams)
        if tum_folder.is_sequence(path) and not streams:
            return tum_folder.read(path, camera)
        return image_folder.read(path, streams)
    suffix = path.suffix.lower()
    if suffix == ".zstd" or suffix not in _OPENERS:
        rule = f"must be a folder or a file of {', '.join(_OPENERS)}"
        advice = "Decompress it: unzstd FILE." if suffix == ".zstd" else "Give the recording."
        raise errors.refuse("source", rule, path, advice)
    return _of_log(_open([path]), path, streams)


def _bag_folder(folder: Path) -> Path:
    """Return the only sub-folder that holds a bag, else the folder itself.

    Raises:
        InputError: if several sub-folders hold bags.
    """
    if _bag_files(folder):
        return folder
    bags = [held for held in sorted(folder.iterdir()) if held.is_dir() and _bag_files(held)]
    if len(bags) > 1:
        names = ", ".join(bag.name for bag in bags)
        raise errors.refuse("source", "must hold one bag", names, "Give the folder of one.")
    return bags[0] if bags else folder


def _bag_files(folder: Path) -> list[Path]:
    """Return the files of a ROS 2 bag in their order.

    Raises:
        InputError: if they are compressed as a whole.
    """
    files = [file for file in folder.iterdir() if file.suffix.lower() in _ROS2]
    packed = [file for file in folder.iterdir() if file.name.lower().endswith(".zstd")]
    if packed and not files:
        rule, advice = "must not be compressed as a whole", "Decompress it: unzstd FILE."
        raise errors.refuse("source", rule, packed[0], advice)
    return sorted(files, key=depth_file.order)


def _open(files: Sequence[Path]) -> MessageLog:
    logs = [_OPENERS[file.suffix.lower()](file) for file in files]
    return logs[0] if len(logs) == 1 else sqlite_log.joined(logs)


def _of_log(log: MessageLog, path: Path, streams: Mapping[str, str]) -> Recording:
    if not log.entries:
        advice = "Is it a recording that was never closed?"
        raise errors.refuse("source", "must hold messages", path, advice)
    if viewer_bag.is_viewer(log) and not streams:
        return viewer_bag.read(log, path)
    recording = ros_topics.read(log, path, streams)
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        note = "metadata.yaml is missing; the recorder did not end"
        return dataclasses.replace(recording, notes=(*recording.notes, note))
    return recording
