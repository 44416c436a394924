"""Scene and sensor to infrared pair to depth, with a reason for every missing pixel."""

from starling.patterns.errors import InputError as InputError
