"""Simulation of active-stereo depth cameras: infrared pair, depth, and reasons for holes."""

from starling.patterns.errors import InputError as InputError
