"""Measure depth on a flat target by room light, reflectance and laser power.

    python benchmarks/simulation/target_light.py d455 --mode 1280x720 --distance 4

Data sheets leave these conditions open. The table lists the figures of `starling sensors check` at
one distance, and the maximum distance: half of the reachable area has depth there.
"""

from __future__ import annotations

import argparse

from starling.sim.commands.check_sensors import planes
from starling.sim.commands.check_sensors.measurement import range_end_m
from starling.sim.commands.check_sensors.planes import FlatTarget
from starling.sim.scene import spectra
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

ROOMS_W_M2 = (0.0, 0.02, planes.ROOM_W_M2)
REFLECTANCES = (planes.REFLECTANCE, 0.8)
OFFICE_LX = 500.0
POWERS = (1.0, 2.4)  # Laser power over the preset's; the D400 family has at most 360 of 150 mW.
HEAD = "| room light [W m^-2] | reflectance | laser power [W] "
HEAD += "| accuracy [%] | bias [%] | RMS [%] | fill [%] | maximum distance [m] |"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sensor", help="preset or sensor file")
    parser.add_argument("--mode", default="", help="image size, such as 1280x720")
    parser.add_argument("--distance", type=float, default=2.0, help="of the target [m]")
    arguments = parser.parse_args()
    sensor = planes.strip(presets.load(arguments.sensor, mode=arguments.mode))
    print(f"{HEAD}\n{'|---' * 8}|")
    for power in POWERS:
        bright = with_values(sensor, [("projector.power_w", power * sensor.projector.power_w)])
        for reflectance in REFLECTANCES:
            for room_w_m2 in (*ROOMS_W_M2, office_w_m2(sensor)):
                print(row(bright, arguments.distance, reflectance, room_w_m2), flush=True)


def office_w_m2(sensor: Sensor) -> float:
    """Return the light of white LEDs in an office, at the laser's wavelength."""
    band = spectra.Band.from_imager(sensor.left, sensor.projector)
    return spectra.ambient_w_m2("led", illuminance_lx=OFFICE_LX, band=band)


def row(sensor: Sensor, distance_m: float, reflectance: float, room_w_m2: float) -> str:
    """Measure a camera under these conditions; return a row of the table."""

    def target(z_m: float) -> FlatTarget:
        return FlatTarget(distance_m=z_m, reflectance=reflectance, room_w_m2=room_w_m2)

    def has_depth(z_m: float) -> bool:
        return planes.fill_of_reachable(sensor, target(z_m)) >= 50

    figures = planes.measure(sensor, target(distance_m))
    farthest_m = range_end_m(has_depth, distance_m, outward=1.25)
    conditions = (room_w_m2, reflectance, sensor.projector.power_w)
    errors = (figures.accuracy_pct, figures.bias_pct, figures.plane_rms_pct)
    values = (*conditions, *errors, figures.fill_pct, farthest_m)
    return f"| {' | '.join(f'{value:.3g}' for value in values)} |"


if __name__ == "__main__":
    main()
