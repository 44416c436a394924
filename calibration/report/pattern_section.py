"""The report's section on a recovered pattern, as HTML."""

from __future__ import annotations

import math

import numpy as np

from starling.calibration.pattern import emission, emitter_model
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.report.pictures import UNKNOWN, draw_pattern
from starling.sim.report.elements import (
    PLUS_MINUS,
    TIMES,
    colour_bar,
    counted,
    figure,
    grid,
    number,
    table,
)


def section(recovered: RecoveredPattern) -> str:
    """Show the pattern, its coverage, its standard deviation and its emitters."""
    image = recovered.image
    drawn = draw_pattern(image)
    covered = image.views > 0
    half_x_deg, half_y_deg = (
        math.degrees(math.asin(min(half, 1.0))) for half in (image.grid.half_a, image.grid.half_b)
    )
    sds = image.sd[covered & np.isfinite(image.sd)]
    median_sd = float(np.median(sds)) if sds.size else math.nan
    unknown = "rgb({}, {}, {})".format(*UNKNOWN)
    swatch = f'<span class="swatch" style="background:{unknown}"></span> not covered by any view'
    pictures = [
        figure(drawn.value, f"<b>Recovered pattern</b>, as seen from one emitter; {swatch}."),
        figure(drawn.zoomed, "<b>Around the axis</b>, enlarged.", sharp=True),
        figure(
            drawn.coverage,
            "<b>Coverage</b>: number of views in each direction."
            + colour_bar(drawn.scale, "0", f"{drawn.most_views:.0f}"),
        ),
        figure(
            drawn.sd,
            "<b>Uncertainty</b>: standard deviation in each direction. The pattern itself has a "
            "standard deviation of about 1."
            + colour_bar(drawn.scale, *(f"{limit:.2g}" for limit in drawn.sd_limits)),
        ),
    ]
    return (
        f"<p>The pattern was recovered over direction cosines up to {PLUS_MINUS}{half_x_deg:.1f} "
        f"degrees horizontally and {PLUS_MINUS}{half_y_deg:.1f} degrees vertically. Views cover "
        f"{covered.mean():.1%} of the directions; the median standard deviation there is "
        f"{number(median_sd, '.2g')}.</p>"
        f"{grid(pictures)}{_emitters(recovered)}"
    )


def _emitters(recovered: RecoveredPattern) -> str:
    fitted = recovered.fitted
    head = ["Emitter", "x [mm]", "y [mm]", "z [mm]", "Share of light"]
    head += ["Pitch [mrad]", "Angle [deg]", "Dot sigma [mrad]", "Dots in the field"]
    rows = []
    for index, (emitter, share) in enumerate(
        zip(fitted.model.emitters, fitted.shares, strict=True)
    ):
        prefix = emitter_model.emitter_prefix(index)
        sds = (fitted.sd(f"{prefix}position.{axis}") for axis in emission.PLACE)
        positions = [
            f"{number(1e3 * value, '.3f')} {PLUS_MINUS} {number(1e3 * sd, '.3f')}"
            for value, sd in zip(emitter.position_m, sds, strict=True)
        ]
        source = emitter.source
        dots = ["an image", "", "", ""]
        if isinstance(source, Lattice):
            dots = _lattice(source, recovered)
        rows.append([str(index), *positions, f"{share:.1%}", *dots])
    text = (
        f"The pattern is {counted(len(recovered.lattices), 'lattice')} of dots, each from its own "
        "emitter. The lattices of separate emitters shift against each other with distance."
        if recovered.lattices
        else "No dot lattice stands out in the pattern's spectrum, so the pattern is an image."
    )
    return f"<h3>Emitters and dots</h3><p>{text}</p>{table(head, rows)}"


def _lattice(source: Lattice, recovered: RecoveredPattern) -> list[str]:
    """Return the pitches of a lattice, the angle between them, dot width and dot count."""
    first, second = source.pitch.T
    pitches = [float(np.linalg.norm(vector)) for vector in (first, second)]
    cosine = float(first @ second) / (pitches[0] * pitches[1])
    angle = math.degrees(math.acos(min(max(cosine, -1), 1)))
    grid = recovered.image.grid
    return [
        f" {TIMES} ".join(f"{1e3 * pitch:.2f}" for pitch in pitches),
        f"{angle:.1f}",
        f"{1e3 * source.sigma:.2f}",
        str(len(source.dots(grid.half_a, grid.half_b))),
    ]
