"""The part of a report that shows a recovered pattern, as HTML."""

from __future__ import annotations

import math

import numpy as np

from starling.calibration.pattern import emission, emitter_model
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.report import pictures as report_pictures
from starling.sim.report.elements import PLUS_MINUS, TIMES, bar, counted, figure, number, table


def section(recovered: Recovered) -> str:
    """Show the pattern, where it was seen, how well it is known, and its emitters."""
    image = recovered.image
    drawn = report_pictures.of_pattern(image)
    looked = image.views > 0
    across, down = (
        math.degrees(math.asin(min(half, 1.0))) for half in (image.grid.half_a, image.grid.half_b)
    )
    deviation = image.sd[looked & np.isfinite(image.sd)]
    median = float(np.median(deviation)) if deviation.size else math.nan
    unknown = "rgb({}, {}, {})".format(*report_pictures.UNKNOWN)
    swatch = f'<span class="swatch" style="background:{unknown}"></span> no view looked there'
    pictures = [
        figure(drawn.value, f"<b>Recovered pattern</b>, as from one emitter; {swatch}."),
        figure(drawn.zoomed, "<b>About its axis</b>, enlarged.", zoomed=True),
        figure(
            drawn.coverage,
            "<b>Coverage</b>: views that looked in each direction."
            + bar(drawn.scale, "0", f"{drawn.most_views:.0f}"),
        ),
        figure(
            drawn.sd,
            "<b>Uncertainty</b>: standard deviation in each direction, where the pattern itself "
            "deviates by about 1."
            + bar(drawn.scale, *(f"{limit:.2g}" for limit in drawn.sd_limits)),
        ),
    ]
    return (
        f"<p>Recovered over direction cosines to {PLUS_MINUS}{across:.1f} degrees across and "
        f"{PLUS_MINUS}{down:.1f} down. {looked.mean():.1%} of the directions were seen; their "
        f"median standard deviation is {number(median, '.2g')}.</p>"
        f'<div class="pictures">{"".join(pictures)}</div>{_emitters(recovered)}'
    )


def _emitters(recovered: Recovered) -> str:
    fitted = recovered.fitted
    head = ["Emitter", "x [mm]", "y [mm]", "z [mm]", "Share of light"]
    head += ["Pitch [mrad]", "Angle [deg]", "Dot sigma [mrad]", "Dots in the field"]
    rows = []
    for place, (emitter, share) in enumerate(
        zip(fitted.model.emitters, fitted.shares, strict=True)
    ):
        own = emitter_model.of_emitter(place)
        sds = (fitted.sd(f"{own}position.{axis}") for axis in emission.PLACE)
        positions = [
            f"{number(1e3 * value, '.3f')} {PLUS_MINUS} {number(1e3 * sd, '.3f')}"
            for value, sd in zip(emitter.position_m, sds, strict=True)
        ]
        source = emitter.source
        dots = ["an image", "", "", ""]
        if isinstance(source, Lattice):
            dots = _lattice(source, recovered)
        rows.append([str(place), *positions, f"{share:.1%}", *dots])
    text = (
        f"The pattern is {counted(len(recovered.lattices), 'lattice')} of dots, each from its own "
        "emitter. Emitters side by side make patterns that slide against each other with distance."
        if recovered.lattices
        else "No dot lattice stands out of the pattern's spectrum, so it is kept as an image."
    )
    return f"<h3>Emitters and dots</h3><p>{text}</p>{table(head, rows)}"


def _lattice(source: Lattice, recovered: Recovered) -> list[str]:
    """Pitches, the angle that they enclose, width and number of a lattice's dots."""
    first, second = source.pitch.T
    pitches = [float(np.linalg.norm(one)) for one in (first, second)]
    cosine = float(first @ second) / (pitches[0] * pitches[1])
    angle = math.degrees(math.acos(min(max(cosine, -1), 1)))
    grid = recovered.image.grid
    return [
        f" {TIMES} ".join(f"{1e3 * pitch:.2f}" for pitch in pitches),
        f"{angle:.1f}",
        f"{1e3 * source.sigma:.2f}",
        str(len(source.dots(grid.half_a, grid.half_b))),
    ]
