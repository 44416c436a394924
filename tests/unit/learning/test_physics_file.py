"""Cache files of simulated physics."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from starling.learning.data.example import Physics
from starling.learning.data.physics import read_physics, write_physics
from starling.learning.methods import model_file
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import step_scene

NAMES = tuple(field.name for field in dataclasses.fields(Physics))


def synthetic_physics(number: int = 0) -> Physics:
    physics = step_scene(number).physics
    assert physics is not None
    return physics


def test_physics_is_read_bit_for_bit(tmp_path):
    for number in (0, 1):
        write_physics(tmp_path / "kept", f"scene-{number}", synthetic_physics(number))
    for number in (0, 1):
        result = read_physics(tmp_path / "kept", f"scene-{number}")
        assert result is not None
        assert type(result.draws) is int and result.draws == 8
        assert np.isnan(synthetic_physics(number).disparity_px).any()
        for name in NAMES[:1] + NAMES[2:]:
            image, remaining = getattr(synthetic_physics(number), name), getattr(result, name)
            assert_array_equal(remaining, image)
            assert remaining.dtype == image.dtype


def test_a_missing_file_is_none(tmp_path):
    assert read_physics(tmp_path / "nowhere", "scene") is None
    write_physics(tmp_path, "scene", synthetic_physics())
    assert read_physics(tmp_path, "other") is None


def test_a_newer_file_replaces_an_older_one(tmp_path):
    write_physics(tmp_path, "scene", synthetic_physics(0))
    write_physics(tmp_path, "scene", synthetic_physics(1))
    result = read_physics(tmp_path, "scene")
    assert result is not None
    assert_array_equal(result.ndp, synthetic_physics(1).ndp)
    assert [path.name for path in tmp_path.iterdir()] == ["scene.npz"]


def test_damaged_or_older_files_are_refused_in_one_line(tmp_path):
    write_physics(tmp_path, "scene", synthetic_physics())
    path = model_file.path_of(tmp_path, "scene")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match=r"^simulation must be whole .*scene\.npz\. Delete it"):
        read_physics(tmp_path, "scene")
    arrays = {name: np.asarray(getattr(synthetic_physics(), name)) for name in NAMES}
    model_file.write(tmp_path, "scene", 99, arrays)
    with pytest.raises(InputError, match="simulation must be whole and of this version"):
        read_physics(tmp_path, "scene")
    del arrays["reason"]
    model_file.write(tmp_path, "scene", 3, arrays)
    with pytest.raises(InputError, match="simulation must be whole and of this version"):
        read_physics(tmp_path, "scene")


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match=r"^out must be writable; got .*scene\.npz"):
        write_physics(tmp_path / "file", "scene", synthetic_physics())


def test_images_of_other_kinds_or_sizes_are_refused(tmp_path):
    arrays = {name: np.asarray(getattr(synthetic_physics(), name)) for name in NAMES}
    for name, damaged, message in (
        ("draws", np.ones(2, int), "must be whole"),
        ("reason", arrays["ndp"], "must be whole"),
        ("ndp", arrays["ndp"][:, 1:], "images of one size"),
    ):
        model_file.write(tmp_path, "scene", 3, {**arrays, name: damaged})
        with pytest.raises(InputError, match=message):
            read_physics(tmp_path, "scene")
