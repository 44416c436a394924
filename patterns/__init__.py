"""Dot patterns as arrays: generators and image files."""

from starling.patterns.dots import draw as draw
from starling.patterns.errors import InputError as InputError
from starling.patterns.field import Field as Field
from starling.patterns.image import load as load
from starling.patterns.lattice import lattice as lattice
from starling.patterns.pattern import Pattern as Pattern
from starling.patterns.random_dots import quasirandom as quasirandom
from starling.patterns.random_dots import uniform as uniform
from starling.patterns.tiled import tiled as tiled
