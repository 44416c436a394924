"""frame.exr: lossless round trip, readable by the OpenEXR library, damage is refused."""

from __future__ import annotations

import dataclasses
import errno
import os
import resource
import signal
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.captures import exr
from starling.sim.console.output import OutputFolder
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.stereo.depth import DepthMap


def _frame(shape: tuple[int, int] = (37, 20), seed: int = 0) -> tuple[Layers, DepthMap]:
    rng = np.random.default_rng(seed)

    def view() -> ViewLayers:
        names = ("projector_direct", "projector_indirect", "ambient", "other", "depth_m")
        body = rng.integers(0, 9, shape, np.uint32)
        return ViewLayers(**{name: rng.random(shape, np.float32) for name in names}, body=body)

    reason = rng.integers(0, 14, shape).astype(np.uint32)
    depth_m = np.where(reason == 0, rng.random(shape, np.float32), np.float32(np.nan))
    truth = Truth(
        depth_m=depth_m,
        normal=rng.normal(size=(*shape, 3)).astype(np.float16).astype(np.float32),
        material=rng.integers(0, 99, shape).astype(np.uint32),
        right_sees=rng.random(shape) > 0.5,
        lit=rng.random(shape) > 0.5,
    )
    depth = DepthMap(disparity_px=depth_m * 7, depth_m=depth_m, valid=reason == 0, reason=reason)
    return Layers(left=view(), right=view(), truth=truth), depth


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def test_round_trip_is_bit_identical(tmp_path: Path) -> None:
    layers, depth = _frame()
    exr.write(tmp_path / "f.exr", layers, depth)
    back, depth_back = exr.read(tmp_path / "f.exr")
    for side in ("left", "right"):
        fields = {field.name for field in dataclasses.fields(ViewLayers)} - {"bands"}  # Not kept.
        for name in fields:
            assert _same(getattr(getattr(layers, side), name), getattr(getattr(back, side), name))
    for name in ("depth_m", "normal", "material", "right_sees", "lit"):
        assert _same(getattr(layers.truth, name), getattr(back.truth, name))
    for name in ("disparity_px", "depth_m", "valid", "reason"):
        assert _same(getattr(depth, name), getattr(depth_back, name))


def test_the_library_reads_parts_types_and_units(tmp_path: Path) -> None:
    exr.write(tmp_path / "f.exr", *_frame())
    with OpenEXR.File(str(tmp_path / "f.exr"), separate_channels=True) as file:
        kinds = {
            part.name(): {name: str(c.pixels.dtype) for name, c in part.channels.items()}
            for part in file.parts
        }
        headers = {part.name(): dict(part.header) for part in file.parts}
    assert list(kinds) == ["left", "right", "truth", "depth"]
    assert kinds["left"].pop("body") == "uint32"
    assert set(kinds["left"].values()) == {"float32"}
    assert {kinds["truth"][f"normal.{axis}"] for axis in "xyz"} == {"float16"}
    assert kinds["truth"]["material"] == kinds["depth"]["reason"] == "uint32"
    assert headers["left"]["unit ambient"] == "W m^-2 sr^-1 for 1 W m^-2"
    assert headers["depth"]["unit depth_m"].startswith("m, z along")
    assert "3 OCCLUDED" in headers["depth"]["unit reason"]


def _whole(tmp_path: Path) -> bytes:
    exr.write(tmp_path / "whole.exr", *_frame())
    return (tmp_path / "whole.exr").read_bytes()


def test_truncated_files_are_refused(tmp_path: Path) -> None:
    data, path = _whole(tmp_path), tmp_path / "cut.exr"
    for length in [*range(0, len(data), 997), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match="EXR file must be a whole OpenEXR file; got"):
            exr.read(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "f.exr"
    with pytest.raises(InputError, match=r"EXR file must be readable; .*No such file"):
        exr.read(path)
    for data, defect in {b"": "an empty file", b"PNG": "no OpenEXR file"}.items():
        path.write_bytes(data)
        with pytest.raises(InputError, match=defect):
            exr.read(path)
    image = np.zeros((4, 4), np.float32)
    for compression, parts, defect in (
        (OpenEXR.ZIP_COMPRESSION, 1, "a file of a single part"),
        (OpenEXR.PIZ_COMPRESSION, 2, "another kind than ZIP scan lines"),
        (OpenEXR.ZIP_COMPRESSION, 2, "must have the parts left, right, truth, depth; .*without"),
    ):
        _write_parts(path, [(f"p{n}", {"x": image}) for n in range(parts)], compression)
        with pytest.raises(InputError, match=defect):
            exr.read(path)


def _write_parts(path: Path, parts: list, compression: object = OpenEXR.ZIP_COMPRESSION) -> None:
    window = (np.array([0, 0], np.int32), np.array([3, 3], np.int32))  # Must be equal in parts.
    header = {"type": OpenEXR.scanlineimage, "compression": compression, "displayWindow": window}
    OpenEXR.File([OpenEXR.Part(dict(header), dict(c), name) for name, c in parts]).write(str(path))


def _patched(data: bytes, name: bytes, offset: int, value: int) -> bytes:
    """Overwrite a 32-bit number at an offset behind the first occurrence of a name."""
    position = data.index(name) + len(name) + offset
    return data[:position] + value.to_bytes(4, "little", signed=True) + data[position + 4 :]


@pytest.mark.parametrize(
    ("name", "offset", "value", "defect"),
    [
        (b"dataWindow\0box2i\0", 4 + 8, 99_999, "a size of 100000x37"),
        (b"dataWindow\0box2i\0", 4 + 8, -9, "a size of -8x37"),
        (b"chunkCount\0int\0", 4, 7, "a wrong number of chunks"),
        (b"ambient\0", 8, 2, "subsampled channels"),
        (b"ambient\0", 0, 9, "cut short or damaged"),
        # The library skips an attribute of another type, and prints what it then misses.
        (
            b"dataWindow\0bo",
            0,
            int.from_bytes(b"z2i\0", "little"),
            "a damaged attribute dataWindow",
        ),
    ],
)
def test_damaged_headers_are_refused(
    tmp_path: Path, name: bytes, offset: int, value: int, defect: str
) -> None:
    (tmp_path / "f.exr").write_bytes(_patched(_whole(tmp_path), name, offset, value))
    with pytest.raises(InputError, match=defect):
        exr.read(tmp_path / "f.exr")


def test_damaged_chunks_are_refused(tmp_path: Path) -> None:
    """The first chunk follows the headers and the tables of offsets; the last one is packed."""
    data = _whole(tmp_path)
    path = tmp_path / "f.exr"
    parts, tables = exr._headers(data)
    first = tables + 8 * sum(part.chunks for part in parts)
    (last,) = struct.unpack_from("<Q", data, first - 8)
    (packed,) = struct.unpack_from("<i", data, last + 8)
    short = zlib.compress(b"")
    for position, change, defect in (
        (first, struct.pack("<i", 3), "a chunk that is out of place"),
        (first + 8, struct.pack("<i", 10_000), "a chunk that is too long"),
        (first + 8, struct.pack("<i", 10**8), "cut short"),
        (last + 12, b"no zlib", "damaged pixel data"),
        (last + 12, short, "too little pixel data"),
    ):
        path.write_bytes(data[:position] + change + data[position + len(change) :])
        with pytest.raises(InputError, match=defect):
            exr.read(path)
    assert packed > len(short)


def test_missing_channel_and_unequal_parts_are_refused(tmp_path: Path) -> None:
    path, parts = tmp_path / "f.exr", []
    exr.write(path, *_frame((4, 4)))
    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part in file.parts:
            parts.append((part.name(), {n: c.pixels.copy() for n, c in part.channels.items()}))
    smaller = [(parts[0][0], {n: c[:3].copy() for n, c in parts[0][1].items()}), *parts[1:]]
    _write_parts(path, smaller)
    with pytest.raises(InputError, match="must hold parts of one size"):
        exr.read(path)
    del parts[0][1]["ambient"]
    _write_parts(path, parts)
    with pytest.raises(InputError, match="must have the channel ambient of float32 in part left"):
        exr.read(path)


def test_library_errors_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("some new compression")

    path = tmp_path / "f.exr"
    exr.write(path, *_frame())
    monkeypatch.setattr(OpenEXR, "File", fail)
    with pytest.raises(InputError, match=r"EXR file must be readable; .*some new compression"):
        exr.read(path)


def test_full_disk_is_an_error(tmp_path: Path) -> None:
    """A real limit on the file's size: the library must not leave a short file unnoticed."""
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, old[1]))
        with pytest.raises(InputError, match="out must be"), OutputFolder(tmp_path / "o") as out:
            out.write_by("a/0/frame.exr", lambda path: exr.write(path, *_frame()))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
        signal.signal(signal.SIGXFSZ, handler)
    assert not list(tmp_path.iterdir())


def test_silently_truncated_file_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut(data: bytes, *, pixels: bool) -> None:
        raise exr.DamagedError("cut short")

    monkeypatch.setattr(exr, "check_structure", cut)
    with pytest.raises(OSError, match="cut short") as error:
        exr.write(tmp_path / "f.exr", *_frame())
    assert error.value.errno == errno.ENOSPC


_DATA: list[bytes] = []


@given(data=st.data())
def test_changed_bytes_are_refused_or_harmless(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("exr")
    if not _DATA:
        _DATA.append(_whole(folder))
    changed = bytearray(_DATA[0])
    # Half of the changes go to the headers and tables, where they do most harm.
    end = data.draw(st.sampled_from([3000, len(changed)]))
    for _ in range(data.draw(st.integers(1, 4))):
        changed[data.draw(st.integers(0, end - 1))] = data.draw(st.integers(0, 255))
    (folder / "f.exr").write_bytes(changed)
    try:
        layers, _ = exr.read(folder / "f.exr")
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert layers.truth.depth_m.shape == (37, 20)


def test_a_path_that_is_not_utf8_is_written_and_read(tmp_path: Path) -> None:
    """The library takes UTF-8 only; folders of older archives have other names."""
    layers, depth = _frame()
    path = tmp_path / os.fsdecode(b"caf\xe9") / "frame.exr"
    path.parent.mkdir()
    exr.write(path, layers, depth)
    exr.write(tmp_path / "frame.exr", layers, depth)
    assert path.read_bytes() == (tmp_path / "frame.exr").read_bytes()
    assert _same(exr.read(path)[1].depth_m, depth.depth_m)
    assert [each.name for each in path.parent.iterdir()] == ["frame.exr"]
