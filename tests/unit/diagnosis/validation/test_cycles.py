"""Render jobs for Cycles, radiometry, and conversion of its images; without Blender."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera.cycles import job
from starling.diagnosis.validation.camera.cycles.job import Job, JobBody, JobProjector, Sky
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal

WIDTH, HEIGHT = 6, 4
BASELINE_M = 0.05


def pose(x: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return matrix


def triangle(kind: str = "diffuse", normals: np.ndarray | None = None) -> JobBody:
    return JobBody(
        name="sheet",
        vertices=np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1]], np.float32),
        faces=np.array([[0, 1, 2]], np.uint32),
        normals=normals,
        kind=kind,
        reflectance=0.5,
        roughness=0.1,
        ior=1.5,
    )


def small_job() -> Job:
    def lamp(x: float, channels: int) -> JobProjector:
        light = np.ones((8, 10, channels), np.float32)
        return JobProjector(
            world_from_projector=pose(x), half_tangents=(1.0, 0.8), intensity_w_sr=light
        )

    return Job(
        width=WIDTH,
        height=HEIGHT,
        focal_px=(4.0, 5.0),
        centre_px=(2.5, 1.0),
        cameras={"left": pose(), "right": pose(BASELINE_M)},
        bodies=(triangle(), triangle(normals=np.ones((3, 3), np.float32))),
        projectors={"own-0": lamp(0.03, 2), "own-1": lamp(0.04, 2), "other-0": lamp(0.2, 1)},
        left_from_projector=pose(0.03),
        sky=Sky(irradiance_w_m2=2.0, gradient=0.5, up=(0.0, -1.0, 0.0)),
        electrons=10.0,
        power_w=0.5,
    )


def rendered(folder: Path) -> Path:
    """Write images of a wall at 2 m that fills all but the first column."""
    folder.mkdir()

    def save(name: str, *channels: float) -> None:
        image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
        image[:, 1:, : len(channels)] = channels
        np.save(folder / f"{name}.npy", image)

    for side in ("left", "right"):
        save(f"{side}_own-0", 3.0, 1.0)
        save(f"{side}_own-1", 4.0, 2.0)
        save(f"{side}_other-0", 5.0)
        save(f"{side}_ambient", 6.0)
        save(f"{side}_geometry", 2.0, 7.0, 1.0)
    return folder


def test_a_job_is_written_to_plain_files(tmp_path):
    job.write(small_job(), tmp_path / "job", samples=16, seed=3)
    table = json.loads((tmp_path / "job" / "job.json").read_text())
    assert (table["samples"], table["seed"]) == (16, 3)
    flat, smooth = table["bodies"]
    assert (flat["number"], smooth["number"]) == (1, 2)
    assert flat["normals"] is None
    assert np.load(tmp_path / "job" / smooth["normals"]).shape == (3, 3)
    np.testing.assert_array_equal(np.load(tmp_path / "job" / flat["vertices"]), triangle().vertices)
    projector = table["projectors"]["own-0"]
    assert np.load(tmp_path / "job" / projector["intensity_w_sr"]).shape == (8, 10, 2)
    assert table["cameras"]["right"][0][3] == BASELINE_M


@pytest.mark.parametrize(
    ("samples", "seed", "words"),
    [(0, 0, "samples must be >= 1; got 0"), (1, -1, "seed must be >= 0; got -1")],
)
def test_invalid_samples_and_seeds_are_refused(samples, seed, words, tmp_path):
    with pytest.raises(WithheldError, match=words):
        job.write(small_job(), tmp_path, samples=samples, seed=seed)


def test_an_unsupported_material_is_refused():
    words = "kind of sheet must be one that the render job supports"
    with pytest.raises(WithheldError, match=words):
        triangle("glass")


def test_images_are_converted_to_electrons(tmp_path):
    job.write(small_job(), tmp_path / "job", samples=1, seed=0)
    arrays = job.arrays(tmp_path / "job", rendered(tmp_path / "rendered"))
    for side in ("left", "right"):
        expected = {"laser": 7 * 10 * 0.5, "even": 3 * 10 * 0.5, "other": 5 * 10, "ambient": 30}
        for name, value in expected.items():
            image = arrays[f"{side}_{name}_e"]
            assert image.shape == (HEIGHT, WIDTH)
            assert (image[:, 0] == 0).all() and image[0, 1] == pytest.approx(value)
        assert np.isnan(arrays[f"{side}_depth_m"][:, 0]).all()
        assert (arrays[f"{side}_depth_m"][:, 1:] == 2).all()
        assert arrays[f"{side}_body"].dtype == np.uint32
        assert set(arrays[f"{side}_body"].ravel()) == {0, 7}


def test_tangents_in_the_frame_of_the_projector(tmp_path):
    """x / z of pixel 5 at 2 m is (5 - 2.5) / 4 in the left camera, plus the offset over z."""
    job.write(small_job(), tmp_path / "job", samples=1, seed=0)
    arrays = job.arrays(tmp_path / "job", rendered(tmp_path / "rendered"))
    assert arrays["left_px"][0, 5] == pytest.approx(2.5 / 4 - 0.03 / 2)
    assert arrays["right_px"][0, 5] == pytest.approx(2.5 / 4 + (BASELINE_M - 0.03) / 2)
    assert arrays["left_py"][3, 5] == pytest.approx((3 - 1.0) / 5)
    assert np.isnan(arrays["left_px"][:, 0]).all()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "left_own-0 must be a readable array"),
        (np.zeros((2, 2, 3)), r"left_own-0 must be of shape (4, 6, 3); got (2, 2, 3)"),
        (np.full((HEIGHT, WIDTH, 3), np.nan), "left_own-0 must be finite and >= 0"),
    ],
)
def test_invalid_images_are_refused(value, words, tmp_path):
    job.write(small_job(), tmp_path / "job", samples=1, seed=0)
    images = rendered(tmp_path / "rendered")
    (images / "left_own-0.npy").unlink()
    if value is not None:
        np.save(images / "left_own-0.npy", value)
    with pytest.raises(WithheldError, match=re.escape(words)):
        job.arrays(tmp_path / "job", images)


def test_intensity_integrates_to_the_power():
    """Integrate over solid angle, dA / (1 + t^2)^(3/2) on the tangent plane."""
    rng = np.random.default_rng(0)
    half = (1.0, 0.6)
    intensity = job.intensity_w_sr(rng.random((60, 100)), half, 2.0)
    x, y = (np.arange(100) + 0.5) / 50 - 1, ((np.arange(60) + 0.5) / 30 - 1) * 0.6
    solid = (2 / 100) * (1.2 / 60) / (1 + x[None, :] ** 2 + y[:, None] ** 2) ** 1.5
    assert float((intensity * solid).sum()) == pytest.approx(2.0, rel=1e-6)


def test_electrons_by_hand(camera: Nominal):
    """pi / (4 N^2) times area times time over the photon energy, with 30 % quantum efficiency."""
    photon_j = 6.626e-34 * 2.998e8 / 850e-9
    by_hand = np.pi / 16 * (3e-6) ** 2 * 0.01 / photon_j * 0.3
    assert job.electrons_per_radiance(camera, 1.0) == pytest.approx(by_hand, rel=1e-3)
    half = job.electrons_per_radiance(camera, 0.5)
    assert half == pytest.approx(by_hand / 2, rel=1e-3)
