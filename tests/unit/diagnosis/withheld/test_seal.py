"""What a seal is of."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from starling.diagnosis.validation.protocol import seal


def test_a_sensor_is_its_file_and_the_pictures_that_it_names(tmp_path: Path) -> None:
    sensor, picture = tmp_path / "sensor.toml", tmp_path / "my" / "emitter-0.png"
    picture.parent.mkdir()
    picture.write_bytes(b"dots")
    sensor.write_text('pattern = "my/emitter-0.png"\n')
    first = seal.of_sensor(sensor)
    picture.write_bytes(b"other dots")
    other = seal.of_sensor(sensor)
    sensor.write_text('pattern = "my/emitter-0.png"  # \n')
    assert len({first, other, seal.of_sensor(sensor)}) == 3
    assert seal.of_sensor(Path("d415")) == "d415"


def test_versions_are_those_that_run() -> None:
    told = seal.versions()
    assert told["numpy"] == np.__version__ and set(told) == {"python", "cv2", "numpy", "scipy"}
