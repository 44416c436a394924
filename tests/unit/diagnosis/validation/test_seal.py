"""Digests of the seal."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from starling.diagnosis.validation.protocol import seal


def test_a_sensor_digest_includes_its_pattern_images(tmp_path: Path) -> None:
    sensor, picture = tmp_path / "sensor.toml", tmp_path / "my" / "emitter-0.png"
    picture.parent.mkdir()
    picture.write_bytes(b"dots")
    sensor.write_text('pattern = "my/emitter-0.png"\n')
    first = seal.sensor_digest(sensor)
    picture.write_bytes(b"other dots")
    changed = seal.sensor_digest(sensor)
    sensor.write_text('pattern = "my/emitter-0.png"  # \n')
    assert len({first, changed, seal.sensor_digest(sensor)}) == 3
    assert seal.sensor_digest(Path("d415")) == "d415"


def test_versions_are_the_installed_ones() -> None:
    versions = seal.versions()
    assert versions["numpy"] == np.__version__ and set(versions) == {
        "python",
        "cv2",
        "numpy",
        "scipy",
    }
