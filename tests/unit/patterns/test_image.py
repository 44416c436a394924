"""Patterns from files: valid files, and all refusals."""

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
