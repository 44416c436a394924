"""`starling import`: from a recording to a capture set."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures import frame_record, png
from starling.sim.captures import info as capture_info
from starling.sim.captures.exchange.stream import parse_camera
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.recordings import (
    findings,
    frame_images,
    oak_calibration,
    sources,
    statement,
    timing,
    tum_folder,
)
from starling.sim.captures.recordings.logs.message_log import LostMessageError
from starling.sim.captures.recordings.recording import RecordedFrame, Recording
from starling.sim.captures.recordings.statement import Geometry, GivenFacts
from starling.sim.console import names, progress, record
from starling.sim.console.output import RECORD, Folder, OutputFolder, refuse_own_input

_FILES = {"left": "ir_left", "right": "ir_right", "depth": "depth", "colour": "rgb"}
_FILES |= {"left_off": "ir_left_off", "right_off": "ir_right_off", "truth": "truth"}


@dataclass(frozen=True, kw_only=True, slots=True)
class FrameChoice:
    """Which frames are imported, and what they show."""

    moving: bool = False  # Each frame is a scene; otherwise all are repeats of one.
    every: int = 1
    most: int = 0  # 0: all.
    scene: str = ""  # Name of the scene and its room; empty: the source's.
    licence: str = "not stated"


def import_recording(
    source: Path,
    out: Path,
    *,
    streams: Mapping[str, str] | None = None,
    flags: GivenFacts | None = None,
    camera: str = "",
    choice: FrameChoice | None = None,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Write a recording as a capture set.

    Args:
        source: bag, MCAP file, or a folder: ROS 2 bag, TUM sequence, or images.
        out: folder to create.
        streams: topics or file patterns by stream (see `recording.STREAMS`); {} finds usual ones.
        flags: facts that the source does not state, or that replace its own.
        camera: `fx fy cx cy width height` [px] of a TUM sequence; empty uses its own.
        choice: frames to import.
        force: replace an earlier folder.
        track: wraps the loop over frames.

    Returns:
        `{"out", "kind", "frames", "scenes", "size", "camera", "baseline_m", "depth_unit_m",
        "emitter", "sensor", "streams", "seen", "clock", "left_out", "damage", "notes",
        "seconds"}`. `seen` has the figures of `starling.sim.captures.recordings.findings`.

    Raises:
        InputError: if the recording cannot be read, is contradictory or lacks a fact; the message
            names the flag. Also if the folder cannot be written; no partial output remains.
    """
    started = time.perf_counter()
    flags, choice = flags or GivenFacts(), choice or FrameChoice()
    refuse_own_input(out, source)
    pinhole = parse_camera(camera, "--camera") if camera else None
    recording = sources.open_source(source, streams or {}, pinhole)
    if pinhole is not None and recording.kind != tum_folder.KIND:
        rule, advice = f"must be given with a {tum_folder.KIND}", "Give --calibration FILE."
        raise errors.refuse("--camera", rule, recording.kind, advice)
    if not flags.calibration and recording.camera is None and source.is_dir():
        oak = oak_calibration.find(source)
        if oak is not None:
            flags = dataclasses.replace(flags, calibration=(oak,))
    recording = _chosen(recording, choice)
    first = _first(recording)
    base = "left" if "left" in first else "depth"
    height, width = first[base].shape[:2]
    shape = (height, width)
    known = statement.geometry(recording, flags, (width, height))
    streams_seen = {name for frame in recording.frames for name in frame.images}
    depths = [name for name in ("depth", "truth") if name in streams_seen]
    if known.rectification is not None and "depth" in depths:
        note = "device depth is left out: its view is not that of --rectify"
        recording = dataclasses.replace(recording, notes=(*recording.notes, note))
        depths.remove("depth")
    unit_m = statement.depth_unit_m(recording, flags, has_depth=bool(depths))
    step_m = _step_m(recording, depths, unit_m)
    sampled = [
        frame_images.read(frame, shape, f"frame {number}", known.rectification)
        for number, frame in _samples(recording)
    ]
    seen = findings.findings(sampled, known, unit_m, step_m)
    emitter = statement.emitter(recording, flags, seen["dots"])
    findings.refuse_or_warn(
        seen,
        emitter,
        is_rectified=known.rectification is not None,
        is_moving=choice.moving,
    )
    info = CaptureInfo(
        sensor=statement.sensor_name(recording, flags),
        **dataclasses.asdict(known.camera),
        baseline_m=known.baseline_m,
        depth_unit_m=step_m,
        source=f"{recording.kind}: {source.name}",
        licence=choice.licence,
        notes="imported by starling import",
        projector=emitter,
        black_level_dn=recording.black_level_dn
        if flags.black_level_dn is None
        else flags.black_level_dn,
        colour=recording.colour,
        colour_from_left=_rows(recording.colour_from_left),
    )
    if recording.damage:
        warnings.warn(f"{source}: {recording.damage}; what is whole is imported.", stacklevel=2)
    room = names.file_name(choice.scene or source.stem or "scene")
    with OutputFolder(out, force=force) as folder:
        written = _Written()
        _write(recording, info, room, choice, known, unit_m, folder, written, track)
        if not written.frames:
            got, advice = f"{written.lost} damaged ones", "Record it again."
            raise errors.refuse("source", "must have a whole frame", got, advice)
        times_s = [frame.time_s for frame in recording.frames if frame.time_s is not None]
        figures = {
            "kind": recording.kind,
            "frames": written.frames,
            "scenes": len(written.scenes),
            "size": f"{width}x{height}",
            "camera": {key: getattr(info, key) for key in ("fx_px", "fy_px", "cx_px", "cy_px")},
            "baseline_m": info.baseline_m,
            "depth_unit_m": step_m if depths else None,
            "emitter": emitter,
            "sensor": info.sensor,
            "streams": ", ".join(name for name in _FILES if name in streams_seen),
            "seen": seen,
            "clock": dataclasses.asdict(timing.clock(times_s)),
            "left_out": {
                "unpaired": recording.unpaired,
                "emitter_off": written.unlit,
                "damaged": written.lost + recording.lost,
            },
            "damage": recording.damage or None,
            "notes": list(recording.notes),
        }
        folder.write(capture_info.FILE, capture_info.dumps(info))
        arguments = {
            "source": str(source),
            "streams": dict(streams or {}),
            "camera": camera,
            **{key: _plain(value) for key, value in dataclasses.asdict(flags).items()},
            **dataclasses.asdict(choice),
        }
        folder.write(RECORD, record.of_run("import", arguments, figures))
    for note in recording.notes:
        warnings.warn(f"{source}: {note}.", stacklevel=2)
    return {"out": str(folder.path), **figures, "seconds": round(time.perf_counter() - started, 3)}


def _plain(value: Any) -> Any:
    return [str(path) for path in value] if isinstance(value, tuple) else value


def _chosen(recording: Recording, choice: FrameChoice) -> Recording:
    """Return the frames that are imported."""
    errors.in_interval("--every", choice.every, 1, 10**6)
    errors.in_interval("--most-frames", choice.most, 0, 10**6)
    frames = recording.frames[:: choice.every]
    frames = frames[: choice.most] if choice.most else frames
    if not frames:
        advice = "Record the streams together."
        rule = "must have frames with all streams"
        raise errors.refuse("source", rule, f"none in {recording.path}", advice)
    return dataclasses.replace(recording, frames=frames)


def _first(recording: Recording) -> dict[str, NDArray[Any]]:
    """Return the left image, or the depth, of the first whole frame."""
    for frame in recording.frames:
        name = "left" if "left" in frame.images else "depth"
        try:
            return {name: frame.images[name]()}
        except LostMessageError:
            continue
    rule = "must have a whole frame"
    raise errors.refuse("source", rule, f"none in {recording.path}", "Record it again.")


def _samples(recording: Recording) -> Iterator[tuple[int, RecordedFrame]]:
    """Yield the first, middle and last frame that are whole; prefer those with dots."""
    lit = [pair for pair in enumerate(recording.frames) if pair[1].is_lit is not False]
    numbered = lit or list(enumerate(recording.frames))
    for place in sorted({0, len(numbered) // 2, len(numbered) - 1}):
        try:
            for read in numbered[place][1].images.values():
                read()
        except LostMessageError:
            continue
        yield numbered[place]


def _step_m(recording: Recording, depths: Sequence[str], unit_m: float) -> float:
    """Return the step of the set's depth codes [m]; floating-point depth is read for it."""
    largest: dict[str, float] = {}
    is_float = False
    for frame in recording.frames:
        for name in depths:
            try:
                image = frame.images[name]()
            except (LostMessageError, KeyError):
                continue
            is_float = is_float or image.dtype.kind == "f"
            largest[name] = max(largest.get(name, 0.0), frame_images.largest_depth(image))
        if not is_float and all(name in largest for name in depths):
            break  # Whole numbers of 16 bits stay as they are.
    return frame_images.depth_step_m(
        largest, unit_m, is_float=is_float, stated_m=recording.depth_step_m
    )


def _rows(pose: Any) -> Any:
    return None if pose is None else tuple(tuple(map(float, row)) for row in np.asarray(pose))


@dataclass(slots=True)
class _Written:
    """Counts of the written frames."""

    frames: int = 0
    unlit: int = 0
    lost: int = 0
    scenes: set[str] = dataclasses.field(default_factory=set)


def _write(
    recording: Recording,
    info: CaptureInfo,
    room: str,
    choice: FrameChoice,
    known: Geometry,
    unit_m: float,
    folder: Folder,
    written: _Written,
    track: progress.Progress,
) -> None:
    """Write the frames; unlit images belong to the lit frame before them."""
    alternates = info.projector == "on and off"
    place, pending = "", True  # Folder of the last lit frame, and whether it lacks unlit images.
    for number, frame in enumerate(track(recording.frames, "frame")):
        try:
            maps = known.rectification
            images = frame_images.read(frame, info.shape, f"frame {number}", maps)
        except LostMessageError:
            written.lost += 1
            continue
        if alternates and frame.is_lit is False:
            if choice.moving or not place or not pending:
                written.unlit += 1
                continue
            for name in ("left", "right"):
                if name in images:
                    folder.write(f"{place}/{_FILES[name]}_off.png", png.encode(images[name]))
            pending = False
            continue
        scene = f"{room}-{number:06d}" if choice.moving else room
        place, pending = f"{scene}/{0 if choice.moving else written.frames}", True
        if scene not in written.scenes:
            folder.write(f"{scene}/room", room + "\n")
            written.scenes.add(scene)
            if "truth" in images:
                code = frame_images.codes(images["truth"], unit_m, info.depth_unit_m)
                folder.write(f"{scene}/truth.png", png.encode(code))
        _write_images(images, place, unit_m, info, folder)
        folder.write(f"{place}/{frame_record.FILE}", record.dumps(_facts(frame)))
        written.frames += 1


def _write_images(
    images: Mapping[str, NDArray[Any]], place: str, unit_m: float, info: CaptureInfo, folder: Folder
) -> None:
    for name, image in images.items():
        file = f"{place}/{_FILES[name]}.png"
        if name == "colour":
            if info.colour is not None and image.shape[:2] != (
                info.colour.height,
                info.colour.width,
            ):
                rule = f"must be {info.colour.width}x{info.colour.height} as its camera_info"
                got = f"{image.shape[1]}x{image.shape[0]}"
                raise errors.refuse(f"colour of {place}", rule, got, "Record both alike.")
            folder.write(file, png.encode_colour(image))
        elif name == "depth":
            code = frame_images.codes(image, unit_m, info.depth_unit_m)
            folder.write(file, png.encode(code))
        elif name != "truth":
            folder.write(file, png.encode(image))


def _facts(frame: RecordedFrame) -> dict[str, Any]:
    facts: dict[str, Any] = {"counts": "repeats", **frame.facts}
    if frame.time_s is not None and frame.time_s >= 0:
        facts["timestamp"] = frame.time_s
    return facts
