"""The effect table: every named departure from an ideal camera, one row each.

Simulation, calibration and diagnosis all read it. A row moves fields of the sensor or the scene;
it is no plugin: what the fields do stands in the stages. At its neutral a row is the identity.
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
    """All rows, in the order in which they act."""
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
    """Return the row of a name.

    Raises:
        InputError: unknown effect (the nearest name comes first).
    """
    rows = {row.name: row for row in table()}
    errors.one_of("effect", name, rows)
    return rows[name]
