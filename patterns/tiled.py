"""Tiled patterns: one random sub-pattern repeated over the field, as in the first Kinect."""

from __future__ import annotations

import math

import numpy as np

from starling.patterns.dots import check_count, check_width, relative_powers
from starling.patterns.errors import in_interval, seeded_generator, whole_number
from starling.patterns.field import Field, directions_from_cosines
from starling.patterns.pattern import Pattern


def tiled(
    *,
    fov_x_deg: float = 57.0,
    fov_y_deg: float = 43.0,
    width_px: int = 1920,
    tiles_x: int = 3,
    tiles_y: int = 3,
    sites_x: int = 211,
    sites_y: int = 165,
    lit_share: float = 0.11,
    centre_gain: float = 8.0,
    tile_spread: float = 0.15,
    fwhm_mrad: float = 1.75,
    power_spread: float = 0.2,
    background: float = 0.2,
    seed: int = 0,
) -> Pattern:
    """Generate a tile of lit and dark grid sites, repeated tiles_x by tiles_y times.

    Lit sites never touch, corners included. The middle of each tile has a bright dot. The grid
    is even in direction cosines, which gives the pincushion seen in photographs of the Kinect's
    pattern. Tiles share positions and dot powers, but not brightness. The light is near 830 nm
    (Hacking the Kinect, ch. 2).

    Source: A. Reichinger, "Kinect pattern uncovered", 2011. It describes 3 x 3 sub-patterns of 211
    x 165 spots on an orthogonal grid, lit or dark. The central spot is much brighter. Tiles differ
    in brightness, and the grid has pincushion distortion. The field of 57 x 43 deg is the infrared
    camera's. A projector next to the camera needs a wider field
    (docs/decisions/0015-structured-light.md). Assumed: lit_share, centre_gain, tile_spread,
    fwhm_mrad (2 px of the 1280-px-wide imager), power_spread, background, and the no-touch rule. No
    site is copied from the device.

    Args:
        fov_x_deg: Full horizontal field [deg], filled by the tiles along the middle row.
        fov_y_deg: Full vertical field [deg].
        width_px: Image width [px].
        tiles_x: Tiles side by side, 1 to 9.
        tiles_y: Tiles on top of each other, 1 to 9.
        sites_x: Grid sites per tile along x, 8 to 1024.
        sites_y: Grid sites per tile along y.
        lit_share: Share of sites that are lit, in [0.001, 0.15].
        centre_gain: Power of a tile's middle dot over an ordinary dot's, in [1, 100].
        tile_spread: Standard deviation / mean of the tiles' brightness.
        fwhm_mrad: Spot width [mrad].
        power_spread: Standard deviation / mean of dot powers within a tile.
        background: Share of light not in dots.
        seed: Fixes sites and powers.

    Raises:
        InputError: if a parameter is out of range.
    """
    field = Field(fov_x_deg, fov_y_deg)
    check_width(fwhm_mrad, field.shape(width_px), field)
    tiles_x, tiles_y = (
        whole_number("tiles_x", tiles_x, 1, 9),
        whole_number("tiles_y", tiles_y, 1, 9),
    )
    sites_x, sites_y = (
        whole_number("sites_x", sites_x, 8, 1024),
        whole_number("sites_y", sites_y, 8, 1024),
    )
    in_interval("lit_share", lit_share, 0.001, 0.15, "Lit sites must not touch.")
    in_interval("centre_gain", centre_gain, 1.0, 100.0)
    in_interval("tile_spread", tile_spread, 0.0, 1.0)
    sites = tiles_x * tiles_y * sites_x * sites_y
    check_count(math.ceil(sites * lit_share), "Lower lit_share, tiles or sites.")
    rng = seeded_generator(seed)
    row, column = _lit_sites(sites_y, sites_x, lit_share, rng)
    power = relative_powers(len(row), power_spread, rng)
    power[0] = centre_gain  # _lit_sites puts the middle first.
    brightness = relative_powers(tiles_x * tiles_y, tile_spread, rng)
    tile_row, tile_column = np.divmod(np.arange(tiles_x * tiles_y), tiles_x)
    total_x, total_y = tiles_x * sites_x, tiles_y * sites_y
    column = (tile_column[:, None] * sites_x + column[None]).ravel()
    row = (tile_row[:, None] * sites_y + row[None]).ravel()
    # Outermost sites sit half a pitch inside the field's edge.
    a = ((column + 0.5) / total_x * 2 - 1) * math.sin(math.radians(fov_x_deg) / 2)
    b = ((row + 0.5) / total_y * 2 - 1) * math.sin(math.radians(fov_y_deg) / 2)
    powers = (brightness[:, None] * power[None]).ravel()
    keep = 1 - a * a - b * b > 1e-3  # The same test as in directions_from_cosines.
    x, y = directions_from_cosines(a, b)
    return Pattern.from_dots(
        x,
        y,
        powers[keep],
        field=field,
        width_px=width_px,
        fwhm_mrad=fwhm_mrad,
        background=background,
        name=f"tiled {tiles_x}x{tiles_y}, {sites_x}x{sites_y} sites, seed {seed}",
    )


def _lit_sites(
    rows: int, columns: int, share: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of lit sites, the middle first; none touch, also across tile borders."""
    wanted = max(1, round(share * rows * columns))
    free = np.ones((rows, columns), dtype=bool)
    middle = (rows // 2) * columns + columns // 2
    order = rng.permutation(rows * columns)
    lit = []
    for site in [middle, *order.tolist()]:
        row, column = divmod(site, columns)
        if not free[row, column]:
            continue
        lit.append((row, column))
        if len(lit) == wanted:
            break
        for near_row in (row - 1, row, (row + 1) % rows):
            for near_column in (column - 1, column, (column + 1) % columns):
                free[near_row, near_column] = False
    sites = np.array(lit)
    return sites[:, 0], sites[:, 1]
