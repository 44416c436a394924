"""Export to a data set of LeRobot, format v3.0, with images in its tables.

    data/chunk-000/file-000.parquet             images and numbers of every frame
    meta/info.json, stats.json, tasks.parquet   features, cameras, statistics, tasks
    meta/episodes/chunk-000/file-000.parquet    length, place and statistics of every episode

Each room becomes an episode, with its frames in order of time. `timestamp` is the frame's index
over `fps`, as LeRobot demands. If all frames have times in `frame.json`, `device_time_s`
counts them from the first frame of the episode, whose time is `device_start_s`.

Source: LeRobot 0.6.1, `datasets/dataset_writer.py`, `dataset_metadata.py`, `feature_utils.py`.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.captures.capture import CaptureSet
from starling.sim.captures.exchange.lerobot import images, statistics, tables
from starling.sim.captures.exchange.lerobot.images import ImageStream
from starling.sim.captures.exchange.lerobot.statistics import Histogram, Statistics
from starling.sim.captures.exchange.stream import TimedFrame, by_room, in_time_order

_FPS = 30  # Of frames without time stamps.
_VIDEO_MB = 200  # The format demands it, though there are no videos.
_NUMBERS = {
    **{"device_time_s": "float64", "timestamp": "float32", "frame_index": "int64"},
    **{"episode_index": "int64", "index": "int64", "task_index": "int64"},
}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Episode:
    """The frames of a room."""

    index: int
    first: int  # Index of the first frame in the data set.
    task: str
    task_index: int
    frames: Sequence[TimedFrame]


def export(captures: CaptureSet, path: Path, *, task: str = "") -> int:
    """Write a capture set.

    Args:
        captures: captures of one camera.
        path: folder of the data set.
        task: task of all frames; empty takes the name of the room.

    Returns:
        Number of written frames.

    Raises:
        InputError: if cameras differ, no image is in all frames, sizes or types differ, or
            `pyarrow` is not installed.
    """
    tables.refuse_missing_library()
    captures.refuse_mixed()
    streams = images.common(captures.scenes)
    episodes = _episodes(captures, task)
    start = episodes[0].frames[0]
    samples = images.read(start.scene, start.number, streams)
    fps = _fps(episodes)
    has_times = _have_times(episodes)
    numbers = [_numbers(episode, fps, has_times=has_times) for episode in episodes]
    features = {
        **{s.key: images.feature(s, samples[s.key], captures.info) for s in streams},
        **{name: {"dtype": _NUMBERS[name], "shape": [1], "names": None} for name in numbers[0]},
    }
    whole = _histograms(streams, samples, captures.info.depth_unit_m)
    rows = []
    with tables.DataFiles(path / "data", features) as files:
        for episode, columns in zip(episodes, numbers, strict=True):
            place = files.start_episode()
            seen = _histograms(streams, samples, captures.info.depth_unit_m)
            for index, timed in enumerate(episode.frames):
                shown = _read(timed, streams, samples)
                for key, image in shown.items():
                    seen[key].add(images.levels(image, captures.info.depth_unit_m))
                cells = {name: values[index] for name, values in columns.items()}
                files.write({**_encoded(shown, streams, index), **cells})
            for key, histogram in seen.items():
                whole[key].merge(histogram)
            rows.append(_episode_row(episode, place, _statistics(seen, columns)))
    joined = {name: [v for part in numbers for v in part[name]] for name in numbers[0]}
    _write_meta(path / "meta", features, fps, rows, episodes, _statistics(whole, joined))
    return len(joined["index"])


def _episodes(captures: CaptureSet, task: str) -> list[_Episode]:
    """Return an episode for each room."""
    rooms = by_room(captures.scenes)
    tasks = list(dict.fromkeys(task or room for room in rooms))
    episodes, first = [], 0
    for index, (room, scenes) in enumerate(rooms.items()):
        name, frames = task or room, in_time_order(scenes)
        episodes.append(
            _Episode(
                index=index, first=first, task=name, task_index=tasks.index(name), frames=frames
            )
        )
        first += len(frames)
    return episodes


def _fps(episodes: Sequence[_Episode]) -> int:
    """Return frames per second, at least 1, by the median step of time."""
    steps = [
        after.time_s - before.time_s
        for episode in episodes
        for before, after in itertools.pairwise(episode.frames)
    ]
    return max(1, round(1 / float(np.median(steps)))) if steps else _FPS


def _have_times(episodes: Sequence[_Episode]) -> bool:
    """Return whether the times of all frames are those that their records state."""
    return all(
        timed.scene.record(timed.number).get("timestamp") == timed.time_s
        for episode in episodes
        for timed in episode.frames
    )


def _numbers(episode: _Episode, fps: int, *, has_times: bool) -> dict[str, list[Any]]:
    """Return the numbers of all frames by feature."""
    count = len(episode.frames)
    numbers: dict[str, list[Any]] = {
        "timestamp": [index / fps for index in range(count)],
        "frame_index": list(range(count)),
        "episode_index": [episode.index] * count,
        "index": list(range(episode.first, episode.first + count)),
        "task_index": [episode.task_index] * count,
    }
    if not has_times:
        return numbers
    start_s = episode.frames[0].time_s
    return {"device_time_s": [timed.time_s - start_s for timed in episode.frames], **numbers}


def _histograms(
    streams: Sequence[ImageStream], samples: Mapping[str, NDArray[Any]], unit_m: float
) -> dict[str, Histogram]:
    return {
        stream.key: Histogram(
            samples[stream.key].shape[2],
            images.value_of_level(samples[stream.key], unit_m, is_depth=stream.is_depth),
        )
        for stream in streams
    }


def _read(
    timed: TimedFrame, streams: Sequence[ImageStream], samples: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Read the images of a frame, of the same sizes and types as in the first frame."""
    shown = images.read(timed.scene, timed.number, streams)
    for stream in streams:
        image, sample = shown[stream.key], samples[stream.key]
        if (image.shape, image.dtype) != (sample.shape, sample.dtype):
            height, width, _ = sample.shape
            rule = f"must be {width}x{height} of {sample.dtype} as in the first frame"
            got = f"{image.shape[1]}x{image.shape[0]} of {image.dtype}"
            name = f"{stream.file}.png of frame {timed.number} of {timed.scene.name}"
            raise refuse(name, rule, got, "Export the scenes one by one.")
    return shown


def _encoded(
    shown: Mapping[str, NDArray[Any]], streams: Sequence[ImageStream], index: int
) -> dict[str, Any]:
    """Return the cells of the images of a frame."""
    return {
        stream.key: {
            "bytes": images.encode(shown[stream.key], is_depth=stream.is_depth),
            "path": f"frame-{index:06d}.{'tiff' if stream.is_depth else 'png'}",
        }
        for stream in streams
    }


def _statistics(
    histograms: Mapping[str, Histogram], numbers: Mapping[str, Sequence[float]]
) -> dict[str, Statistics]:
    return {
        **{key: histogram.statistics() for key, histogram in histograms.items()},
        **{name: statistics.of_numbers(values) for name, values in numbers.items()},
    }


def _episode_row(
    episode: _Episode, place: Mapping[str, int], figures: Mapping[str, Statistics]
) -> dict[str, Any]:
    return {
        "episode_index": episode.index,
        "tasks": [episode.task],
        "length": len(episode.frames),
        **{f"data/{name}": number for name, number in place.items()},
        "dataset_from_index": episode.first,
        "dataset_to_index": episode.first + len(episode.frames),
        **{
            f"stats/{key}/{name}": value
            for key, table in figures.items()
            for name, value in table.items()
        },
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        **({"device_start_s": episode.frames[0].time_s} if "device_time_s" in figures else {}),
    }


def _write_meta(
    folder: Path,
    features: Mapping[str, Any],
    fps: int,
    rows: Sequence[dict[str, Any]],
    episodes: Sequence[_Episode],
    figures: Mapping[str, Statistics],
) -> None:
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    info = {
        "codebase_version": "v3.0",
        "fps": fps,
        "features": features,
        "total_episodes": len(episodes),
        "total_frames": sum(len(episode.frames) for episode in episodes),
        "total_tasks": len(tasks),
        "chunks_size": tables.CHUNK_FILES,
        "data_files_size_in_mb": tables.FILE_MB,
        "video_files_size_in_mb": _VIDEO_MB,
        "data_path": f"data/{tables.PLACE}",
        "video_path": None,
        "robot_type": None,
        "splits": {"train": f"0:{len(episodes)}"},
    }
    place = tables.PLACE.format(chunk_index=0, file_index=0)
    tables.write_episodes(folder / "episodes" / place, rows)
    tables.write_tasks(folder / "tasks.parquet", tasks)
    for name, table in (("info", info), ("stats", figures)):
        (folder / f"{name}.json").write_text(json.dumps(table, indent=4), encoding="utf-8")
