"""Patterns from files: valid files, and all refusals."""

import tracemalloc
import zlib

import cv2
import numpy as np
import pytest

from starling.patterns import InputError, load, quasirandom
from tests.oracles.pattern_statistics import measure

FOV = {"fov_x_deg": 60.0, "fov_y_deg": 40.0}


def png(image):
    return cv2.imencode(".png", image)[1].tobytes()


def chunk(kind, data):
    body = kind + data
    return len(data).to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")


def made_png(data, *, width=64, height=48, colour=0, bits=8, interlaced=0, extra=b""):
    sides = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    header = sides + bytes([bits, colour, 0, 0, interlaced])
    signature = b"\x89PNG\r\n\x1a\n"
    return signature + chunk(b"IHDR", header) + extra + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_values_are_preserved_up_to_scale(tmp_path, dtype):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (48, 64)).astype(dtype)
    (tmp_path / "grey.png").write_bytes(png(image))
    pattern = load(tmp_path / "grey.png", **FOV)
    np.testing.assert_allclose(pattern.image, image / image.mean(), rtol=1e-6)
    assert pattern.dots is None
    assert pattern.name == "image grey.png"


def test_a_generated_pattern_survives_the_file(tmp_path):
    pattern = quasirandom(**FOV, width_px=480)
    scaled = np.rint(pattern.image / pattern.image.max() * 65535).astype(np.uint16)
    (tmp_path / "dots.png").write_bytes(png(scaled))
    measured = measure(load(str(tmp_path / "dots.png"), **FOV).image, **FOV)
    assert measured.dots == pytest.approx(len(pattern.dots), rel=0.02)
    assert measured.fwhm_mrad == pytest.approx(pattern.fwhm_mrad, rel=0.03)


GREY = np.full((48, 64), 9, np.uint8)
COLOUR = np.full((48, 64, 3), 9, np.uint8)
ROWS = bytes(48 * 65 - 1) + b"\x09"
BAD_FILTER = b"\x09" * (48 * 65)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (png(COLOUR), r"must be grey with 8 or 16 bits, no alpha; got .*colour type 2, 8 bits"),
        (png(np.full((48, 64, 4), 9, np.uint8)), r"must be grey .*colour type 6"),
        (made_png(zlib.compress(ROWS), extra=chunk(b"tRNS", b"\0\0")), r"must be grey .* no alpha"),
        (made_png(zlib.compress(ROWS), bits=4), r"must be grey .*colour type 0, 4 bits"),
        (png(GREY)[:-20], r"must be an intact PNG; got .*\. Export it again\."),
        (png(GREY)[:9], r"must be an intact PNG"),
        (png(GREY).replace(b"IDAT", b"IDAx"), r"must be an intact PNG"),
        (made_png(b"garbage"), r"must be an intact PNG"),
        (made_png(zlib.compress(ROWS[:500])), r"must be an intact PNG"),
        (made_png(zlib.compress(BAD_FILTER)), r"must be an intact PNG"),
        (b"\x89PNG\r\n\x1a\n" + chunk(b"IEND", b""), r"must be an intact PNG"),
        (b"P5 64 48 255 ", r"pattern file must be a PNG; got .*\. Convert it to a grey PNG\."),
        (b"", r"pattern file must be a PNG"),
        (png(GREY[:20]), r"must have sides of 32 to 8192 px; got .* 64x20\."),
        (made_png(b"", width=9000), r"must have sides of 32 to 8192 px; got .* 9000x48\."),
        (png(GREY * 0), r"must hold some light; got .*, all zero\."),
    ],
)
def test_refused_files(tmp_path, content, message):
    path = tmp_path / "file.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        load(path, **FOV)


def test_refused_paths(tmp_path):
    with pytest.raises(InputError, match=r"must be readable; got .*\(No such file or directory\)"):
        load(tmp_path / "none.png", **FOV)
    with pytest.raises(InputError, match=r"must be readable; got .*\(Is a directory\)"):
        load(tmp_path, **FOV)


def test_refused_field(tmp_path):
    (tmp_path / "grey.png").write_bytes(png(GREY))
    with pytest.raises(InputError, match=r"fov_y_deg must be in \[1, 150\]; got 0\."):
        load(tmp_path / "grey.png", fov_x_deg=60.0, fov_y_deg=0.0)


ADAM7 = (
    (0, 0, 8, 8),
    (4, 0, 8, 8),
    (0, 4, 4, 8),
    (2, 0, 4, 4),
    (0, 2, 2, 4),
    (1, 0, 2, 2),
    (0, 1, 1, 2),
)


def test_interlaced_images_are_read(tmp_path):
    image = np.random.default_rng(0).integers(0, 255, (33, 35), np.uint8)
    passes = [image[y::dy, x::dx] for x, y, dx, dy in ADAM7]
    rows = b"".join(b"\0" + row.tobytes() for part in passes for row in part)
    data = made_png(zlib.compress(rows), width=35, height=33, interlaced=1)
    (tmp_path / "x.png").write_bytes(data)
    pattern = load(tmp_path / "x.png", **FOV)
    np.testing.assert_allclose(pattern.image, image / image.mean(), rtol=1e-6)


def test_decoders_see_the_necessary_chunks_only(tmp_path, capfd):
    """libpng prints a message for each of these chunks, which does no harm to the pixels."""
    strange = b"".join(chunk(kind, b"\xff" * 5) for kind in (b"iCCP", b"eXIf", b"gAMA", b"PLTE"))
    (tmp_path / "x.png").write_bytes(made_png(zlib.compress(ROWS) + b"more", extra=strange))
    load(tmp_path / "x.png", **FOV)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "pixels", [zlib.compress(ROWS)[:-4], zlib.compress(ROWS + b"\0"), zlib.compress(bytes(10**8))]
)
def test_damaged_streams_are_refused_in_little_memory(tmp_path, pixels):
    """A stream without its checksum, one byte too long, and one of 100 MB in 100 kB."""
    (tmp_path / "x.png").write_bytes(made_png(pixels))
    tracemalloc.start()
    with pytest.raises(InputError, match="must be an intact PNG"):
        load(tmp_path / "x.png", **FOV)
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()
