"""The effect table: one row for every named departure from an ideal camera.

Simulation, calibration and diagnosis read it. A row sets fields of the sensor or the scene; the
pipeline stages implement what the fields do. At its neutral value a row has no effect.
"""

from __future__ import annotations

from functools import cache

from starling.patterns import errors
from starling.sim.effects.effect import Effect as Effect
from starling.sim.effects.effect import Parameter as Parameter
from starling.sim.effects.effect import Stage as Stage
from starling.sim.effects.effect import Value as Value
from starling.sim.effects.effect import written as written


@cache
def table() -> tuple[Effect, ...]:
    """Return all rows, in the order of the pipeline stages."""
    from starling.sim.effects import imager, light, matcher, optics, post, scene, surfaces

    return (
        *scene.ROWS,
        *surfaces.ROWS,
        *light.ROWS,
        *optics.ROWS,
        *imager.ROWS,
        *matcher.ROWS,
        *post.ROWS,
    )


def named(name: str) -> Effect:
    """Return the row with a name.

    Raises:
        InputError: if the effect is unknown; the message starts with the most similar name.
    """
    rows = {row.name: row for row in table()}
    errors.one_of("effect", name, rows)
    return rows[name]
