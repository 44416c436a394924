"""Light by Cycles and by our renderer, which share only meshes, materials and the pattern.

**Rationale.** Both renderers compute the light of a table with matt, coated and metal objects. The
camera is an ideal D435 of 320 x 180 pixels that are not square. Blender is taken from
`STARLING_BLENDER`, or from `.blender`, where `tools/blender.sh` installs it.

**Expected behaviour.** Depth, bodies and the projector's frame agree except at silhouettes. Levels
of matt and metal surfaces under projectors and sky agree within 1 and 3 %. Coated surfaces agree
within 2 % under the sky. Under a projector, Cycles' are up to 5 % darker: its coat takes its share
only from the outgoing light, which changes the angular distribution. Dots lie at the same places.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from starling.diagnosis.validation.adapters import cycles_light, light_sets
from starling.patterns.errors import InputError
from starling.sim.effects import setting
from starling.sim.scene import sources
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

ROOT = Path(__file__).parents[2]
BLENDER = Path(os.environ.get("STARLING_BLENDER", ROOT / ".blender" / "bin" / "python"))
SCENE = "tabletop:1"
SAMPLES = 32
TILE_PX = 40
Arrays = dict[str, np.ndarray]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not BLENDER.exists(), reason=f"no Blender at {BLENDER}: run tools/blender.sh"
    ),
]


def nominal() -> Sensor:
    """Return an ideal D435 of 320 x 180 with an off-centre axis and non-square pixels."""
    ideal, _ = setting.ideal(presets.load("d435"), builtin.wall(1.0))
    size = [("width", 320), ("height", 180), ("fx_px", 162.0), ("fy_px", 158.0)]
    return with_values(ideal, [*size, ("cx_px", 163.2), ("cy_px", 86.7)])


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Arrays, Arrays]:
    """Return the arrays of `light.npz` by Cycles and by our renderer."""
    folder = tmp_path_factory.mktemp("cycles")
    light_sets.write(folder / "ours", [SCENE], nominal())
    try:
        cycles_light.cycles_light(
            folder / "ours", folder / "theirs", blender=BLENDER, samples=SAMPLES, threads=2
        )
    except InputError as error:
        if "import" in str(error) or "module" in str(error):
            pytest.skip(f"Blender does not load here: {error}")
        raise
    theirs, ours = (
        dict(np.load(folder / name / SCENE.replace(":", "-") / light_sets.LIGHT))
        for name in ("theirs", "ours")
    )
    return theirs, ours


@pytest.fixture(scope="module")
def kinds() -> dict[str, list[int]]:
    """Return body numbers by kind of material."""
    by_kind: dict[str, list[int]] = {}
    for number, body in enumerate(sources.load(SCENE, nominal()).bodies, 1):
        by_kind.setdefault(body.material.kind, []).append(number)
    return by_kind


def inside(both: tuple[Arrays, Arrays], side: str, numbers: list[int]) -> np.ndarray:
    """Return pixels at which, with all neighbours, both renderers see these bodies."""
    theirs, ours = both
    same = theirs[f"{side}_body"] == ours[f"{side}_body"]
    return ndimage.binary_erosion(same & np.isin(ours[f"{side}_body"], numbers), np.ones((3, 3)))


@pytest.mark.parametrize("side", ["left", "right"])
def test_geometry_is_the_same(both, side):
    theirs, ours = both
    assert (theirs[f"{side}_body"] == ours[f"{side}_body"]).mean() > 0.999
    missed_m = np.abs(theirs[f"{side}_depth_m"] - ours[f"{side}_depth_m"])
    assert np.quantile(missed_m, 0.999) < 1e-3
    for name in ("px", "py"):
        missed = np.abs(theirs[f"{side}_{name}"] - ours[f"{side}_{name}"])
        assert np.quantile(missed, 0.999) < 1e-4


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("kind", "name", "tolerance"),
    [
        ("diffuse", "laser", 0.01),
        ("diffuse", "even", 0.01),
        ("diffuse", "other", 0.01),
        ("diffuse", "ambient", 0.01),
        ("metal", "even", 0.03),
        ("metal", "ambient", 0.03),
        ("glossy", "laser", 0.05),
        ("glossy", "even", 0.05),
        ("glossy", "ambient", 0.02),
    ],
)
def test_levels_are_the_same(both, kinds, side, kind, name, tolerance):
    theirs, ours = (light[f"{side}_{name}_e"] for light in both)
    mask = inside(both, side, kinds[kind])
    assert mask.sum() > 100
    assert theirs[mask].mean() == pytest.approx(ours[mask].mean(), rel=tolerance)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", ["laser", "other"])
def test_dots_lie_at_the_same_places(both, kinds, side, name):
    """The shift between both images is small in every tile, and its median is smaller."""
    theirs, ours = (light[f"{side}_{name}_e"].astype(np.float64) for light in both)
    mask = inside(both, side, kinds["diffuse"])
    shifts = []
    for y in range(0, theirs.shape[0] - TILE_PX + 1, TILE_PX):
        for x in range(0, theirs.shape[1] - TILE_PX + 1, TILE_PX):
            tile = np.s_[y : y + TILE_PX, x : x + TILE_PX]
            lit = mask[tile] & (ours[tile] > 0)
            if lit.mean() > 0.5:
                shifts.append(shift_px(theirs[tile], ours[tile], lit))
    shifts_px = np.array(shifts)
    assert len(shifts_px) > 8
    assert np.abs(np.median(shifts_px, axis=0)).max() < 0.02
    assert np.abs(shifts_px).max() < 0.1


def shift_px(image: np.ndarray, reference: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Where the correlation of an image with a shifted other peaks (x, y) [px], to first order.

    Least squares of their difference, gain left free, on the other's slopes.
    """
    down, across = np.gradient(reference)
    columns = np.stack([-across[where], -down[where], reference[where]], axis=1)
    return np.linalg.lstsq(columns, image[where], rcond=None)[0][:2]
