"""Grey PNG files: read without conversion, refused if incomplete."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.captures import png


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_round_trip(tmp_path: Path, kind: type) -> None:
    image = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (7, 9)).astype(kind)
    (tmp_path / "x.png").write_bytes(png.encode(image))
    back = png.read(tmp_path / "x.png", "x")
    assert back.dtype == kind
    np.testing.assert_array_equal(back, image)


@pytest.mark.parametrize(
    "image",
    [np.zeros((2, 2), np.float32), np.zeros((2, 2, 3), np.uint8), np.zeros((0, 4), np.uint8)],
)
def test_only_grey_is_written(image: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"image must be \(h, w\) of 8 or 16 bits"):
        png.encode(image)


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def _file(width: int, height: int, pixels: bytes, header_end: bytes = b"\0" * 5) -> bytes:
    header = struct.pack(">II", width, height) + header_end
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        [_chunk(b"IHDR", header), _chunk(b"IDAT", pixels), _chunk(b"IEND", b"")]
    )


_GREY_8 = bytes([8, 0, 0, 0, 0])
_WHOLE = png.encode(np.arange(200, dtype=np.uint8).reshape(10, 20))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "x must be a PNG file; got .*, an empty file"),
        (b"JFIF", "x must be a PNG file; got"),
        (_WHOLE[:-20], "x must be a whole PNG file; got .*, a file cut short"),
        (_WHOLE[:50], "a file cut short"),
        (_WHOLE[:60] + b"?" + _WHOLE[61:], "a wrong checksum"),
        (_WHOLE[:8] + _WHOLE[33:], "no image header"),
        (_file(0, 4, b"", _GREY_8), "x must be 1 to 16384 pixels wide and high; got .*, 0x4"),
        (_file(4, 99999, b"", _GREY_8), "x must be 1 to 16384 pixels"),
        (_file(4, 4, b"", bytes([1, 0, 0, 0, 0])), "x must be a grey PNG .*, 1-bit grey"),
        (
            _file(4, 4, b"", bytes([8, 4, 0, 0, 0])),
            "x must be a grey PNG .*, 8-bit grey with alpha",
        ),
        (_file(4, 4, zlib.compress(b"\0" * 7), _GREY_8), "too little pixel data"),
        (_file(4, 4, b"not deflate", _GREY_8), "too little pixel data"),
        (_file(4, 4, zlib.compress(b"\0" * 20), bytes([8, 0, 1, 0, 0])), "does not decode"),
    ],
)
def test_damage_is_refused(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "x.png").write_bytes(data)
    with pytest.raises(InputError, match=message):
        png.read(tmp_path / "x.png", "x")


def test_decoder_error_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise png.cv2.error("too large")

    (tmp_path / "x.png").write_bytes(_WHOLE)
    monkeypatch.setattr(png.cv2, "imdecode", fail)
    with pytest.raises(InputError, match="does not decode"):
        png.read(tmp_path / "x.png", "x")


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x must be a readable PNG file; .*No such file"):
        png.read(tmp_path / "x.png", "x")


@given(position=st.integers(0, len(_WHOLE) - 1), value=st.integers(0, 255), cut=st.integers(0, 80))
def test_any_damage_is_refused_or_harmless(
    tmp_path_factory: pytest.TempPathFactory, position: int, value: int, cut: int
) -> None:
    """A checksum detects a changed byte; otherwise the read image equals the written one."""
    data = bytearray(_WHOLE)
    data[position] = value
    path = tmp_path_factory.mktemp("png") / "x.png"
    path.write_bytes(data[: len(data) - cut])
    try:
        image = png.read(path, "x")
    except InputError as error:
        assert "\n" not in str(error)
    else:
        np.testing.assert_array_equal(image, np.arange(200, dtype=np.uint8).reshape(10, 20))


def test_a_transparent_colour_is_refused(tmp_path: Path) -> None:
    data = _WHOLE[:33] + _chunk(b"tRNS", b"\0\7") + _WHOLE[33:]
    (tmp_path / "x.png").write_bytes(data)
    with pytest.raises(InputError, match=r"x must be a whole PNG file; .*a transparent colour"):
        png.read(tmp_path / "x.png", "x")


def test_pictures_of_any_kind_are_read(tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    picture = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    path.write_bytes(png.encode_colour(picture))
    np.testing.assert_array_equal(png.read_picture(path, "rgb"), picture)
    path.write_bytes(png.encode(picture[..., 0].astype(np.uint16)))
    np.testing.assert_array_equal(png.read_picture(path, "rgb"), picture[..., 0])
    assert png.read_picture(path, "rgb", colour=True).shape == (4, 5, 3)
    alpha = np.dstack([picture[..., ::-1], picture[..., 0]])
    path.write_bytes(png.cv2.imencode(".png", alpha)[1].tobytes())
    np.testing.assert_array_equal(png.read_picture(path, "rgb"), picture)


@pytest.mark.parametrize("data", [b"", b"none", _WHOLE[:-20], _file(99999, 99999, b"", _GREY_8)])
def test_damaged_pictures_are_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.png").write_bytes(data)
    with pytest.raises(InputError, match="rgb must be a readable image; got"):
        png.read_picture(tmp_path / "x.png", "rgb")


@pytest.mark.parametrize("suffix", [".bmp", ".tiff", ".hdr"])
def test_damaged_pictures_print_nothing(
    tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture[str]
) -> None:
    kind = np.float32 if suffix == ".hdr" else np.uint8
    data = png.cv2.imencode(suffix, np.ones((40, 50, 3), kind))[1].tobytes()
    path = tmp_path / f"x{suffix}"
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"rgb must be a readable image; got .*Copy it again"):
        png.read_picture(path, "rgb", colour=True)
    assert capfd.readouterr() == ("", "")


def test_empty_pictures_are_named(tmp_path: Path) -> None:
    (tmp_path / "x.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"got .*x.png, an empty file. Copy it again"):
        png.read_picture(tmp_path / "x.png", "rgb")


@pytest.mark.parametrize("suffix", [".hdr", ".pfm", ".tiff"])
@pytest.mark.parametrize("colour", [False, True])
def test_linear_pictures_are_refused(tmp_path: Path, suffix: str, colour: bool) -> None:
    path = tmp_path / f"x{suffix}"
    path.write_bytes(png.cv2.imencode(suffix, np.ones((4, 5, 3), np.float32))[1].tobytes())
    with pytest.raises(InputError, match=r"rgb must be a picture of 8 or 16 bits; got .*float32"):
        png.read_picture(path, "rgb", colour=colour)


def test_header_with_more_pixels_than_memory_is_refused(tmp_path: Path) -> None:
    most = 2**31 - 1
    (tmp_path / "x.png").write_bytes(
        _file(most, most, zlib.compress(b"\0"), bytes([16, 6, 0, 0, 0]))
    )
    with pytest.raises(InputError, match="too little pixel data"):
        png.read_picture(tmp_path / "x.png", "x")
