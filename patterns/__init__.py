"""Dot patterns as arrays: generators that state their statistics, loading, measuring."""

from patterns.dots import draw as draw
from patterns.errors import InputError as InputError
from patterns.field import Field as Field
from patterns.image import load as load
from patterns.lattice import lattice as lattice
from patterns.pattern import Pattern as Pattern
from patterns.quasirandom import quasirandom as quasirandom
from patterns.statistics import Statistics as Statistics
from patterns.statistics import measure as measure
from patterns.statistics import state as state
from patterns.tiled import tiled as tiled
from patterns.uniform import uniform as uniform
from patterns.uniqueness import unique_share as unique_share
