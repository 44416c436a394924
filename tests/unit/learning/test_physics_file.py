"""Simulated physics on disk: it comes back as it was, or not at all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from starling.learning.data import physics_file
from starling.learning.data.example import Physics
from starling.learning.methods import model_file
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import step_scene

NAMES = tuple(field.name for field in dataclasses.fields(Physics))


def made(number: int = 0) -> Physics:
    physics = step_scene(number).physics
    assert physics is not None
    return physics


def test_physics_comes_back_bit_for_bit(tmp_path):
    for number in (0, 1):
        physics_file.write(tmp_path / "kept", f"scene-{number}", made(number))
    for number in (0, 1):
        found = physics_file.read(tmp_path / "kept", f"scene-{number}")
        assert found is not None
        assert type(found.draws) is int and found.draws == 8
        assert np.isnan(made(number).disparity_px).any()
        for name in NAMES[:1] + NAMES[2:]:
            image, kept = getattr(made(number), name), getattr(found, name)
            assert_array_equal(kept, image)
            assert kept.dtype == image.dtype


def test_what_was_never_kept_is_none(tmp_path):
    assert physics_file.read(tmp_path / "nowhere", "scene") is None
    physics_file.write(tmp_path, "scene", made())
    assert physics_file.read(tmp_path, "other") is None


def test_a_newer_one_takes_the_older_s_place(tmp_path):
    physics_file.write(tmp_path, "scene", made(0))
    physics_file.write(tmp_path, "scene", made(1))
    found = physics_file.read(tmp_path, "scene")
    assert found is not None
    assert_array_equal(found.ndp, made(1).ndp)
    assert [path.name for path in tmp_path.iterdir()] == ["scene.npz"]


def test_damaged_or_older_files_are_refused_in_one_line(tmp_path):
    physics_file.write(tmp_path, "scene", made())
    path = model_file.path_of(tmp_path, "scene")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match=r"^model must be whole; got .*scene\.npz\. It is damaged"):
        physics_file.read(tmp_path, "scene")
    arrays = {name: np.asarray(getattr(made(), name)) for name in NAMES}
    model_file.write(tmp_path, "scene", 99, arrays)
    with pytest.raises(InputError, match="must be scene of version 3; got scene of version 99"):
        physics_file.read(tmp_path, "scene")
    del arrays["reason"]
    model_file.write(tmp_path, "scene", 3, arrays)
    with pytest.raises(InputError, match=r"model must be whole; got .* without reason\."):
        physics_file.read(tmp_path, "scene")


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match=r"^out must be writable; got .*scene\.npz"):
        physics_file.write(tmp_path / "file", "scene", made())
