"""Dot patterns as arrays: generators, image files and statistics."""

from starling.patterns.dots import draw as draw
from starling.patterns.errors import InputError as InputError
from starling.patterns.field import Field as Field
from starling.patterns.generators.lattice import lattice as lattice
from starling.patterns.generators.quasirandom import quasirandom as quasirandom
from starling.patterns.generators.tiled import tiled as tiled
from starling.patterns.generators.uniform import uniform as uniform
from starling.patterns.image import load as load
from starling.patterns.pattern import Pattern as Pattern
from starling.patterns.statistics import Statistics as Statistics
from starling.patterns.statistics import measure as measure
from starling.patterns.statistics import stated_statistics as stated_statistics
from starling.patterns.uniqueness import unique_share as unique_share
