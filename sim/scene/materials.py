"""A library of near-infrared materials: reflectance at 850 nm, visible colour, and source.

`reflectance` is hemispherical. For metals and mirrors it is the Fresnel reflectance at normal
incidence, from the index at 850 nm. `rgb` is linear sRGB under D65. All roughnesses are assumed.
The source of other numbers without a published measurement is "assumed". docs/materials.md has
the same table, with 830 and 940 nm where measured.
"""

from __future__ import annotations

from dataclasses import dataclass

from starling.patterns import errors
from starling.sim.scene.scene import Kind, Material

_Rgb = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class Entry:
    """A material and the source of its reflectance."""

    material: Material
    source: str


def normal_reflectance(n: float, k: float) -> float:
    """Fresnel reflectance at normal incidence of index n + ik in air.

    Raises:
        InputError: if n is not above 0, or k is below 0.

    Source: Born and Wolf, Principles of Optics, 7th ed., sec. 14.2.
    """
    errors.positive("n", n)
    errors.in_interval("k", k, 0.0, 1e3)
    return ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)


_SPLIB = "USGS splib07a"  # Kokaly et al. 2017.
_ECOSTRESS = "ECOSTRESS library 1.0 (Meerdink et al. 2019), sample"
_BLACK = "assumed: carbon black absorbs a few per cent short of all, visible or not"


def _matt(name: str, reflectance: float, rgb: _Rgb, source: str) -> Entry:
    return Entry(material=Material(name=name, reflectance=reflectance, rgb=rgb), source=source)


def _glossy(name: str, reflectance: float, roughness: float, rgb: _Rgb, source: str) -> Entry:
    surface = Material(
        name=name, kind="glossy", reflectance=reflectance, roughness=roughness, rgb=rgb
    )
    return Entry(material=surface, source=source)


def _metal(
    name: str, n: float, k: float, roughness: float, rgb: _Rgb, source: str, kind: Kind = "metal"
) -> Entry:
    surface = Material(
        name=name, kind=kind, reflectance=normal_reflectance(n, k), roughness=roughness, rgb=rgb
    )
    return Entry(material=surface, source=f"Fresnel, n + ik = {n:g} + {k:g}i: {source}")


def _glass(name: str, ior: float, source: str) -> Entry:
    one_face = normal_reflectance(ior, 0.0)
    surface = Material(name=name, kind="glass", reflectance=one_face, ior=ior)
    return Entry(material=surface, source=f"n = {ior:g}: {source}")


_RAKIC = "Rakic, Appl. Opt. 34 (1995) 4755"
_JOHNSON_FE = "iron, Johnson and Christy, Phys. Rev. B 9 (1974) 5056"
_JOHNSON_CU = "Johnson and Christy, Phys. Rev. B 6 (1972) 4370"
_JACQUEZ = "assumed; pigment matters below 1 um (Jacquez et al., J. Appl. Physiol. 8 (1955) 297)"
_CHART = "rgb of the ColorChecker's patch of that name (Ohta 1997)"

_ENTRIES = (
    # People and clothes. Many dyes that look black are transparent in the near infrared.
    _matt(
        "light skin",
        0.61,
        (0.56, 0.31, 0.22),
        f"Bashkatov et al., J. Phys. D 38 (2005) 2543, fig. 3, digitised; {_CHART}",
    ),
    _matt("dark skin", 0.45, (0.18, 0.08, 0.05), f"{_JACQUEZ}; {_CHART}"),
    _matt("cotton", 0.64, (0.62, 0.59, 0.61), f"{_SPLIB} GDS437, white"),
    _matt("burlap", 0.53, (0.22, 0.15, 0.07), f"{_SPLIB} GDS430, brown"),
    _matt("black dyed cloth", 0.35, (0.13, 0.13, 0.14), f"{_SPLIB} GDS436, black coated nylon"),
    _matt("red nylon", 0.53, (0.31, 0.02, 0.03), f"{_SPLIB} GDS431, ripstop"),
    _matt("blue nylon", 0.64, (0.02, 0.14, 0.43), f"{_SPLIB} GDS433, ripstop"),
    # Rooms and furniture.
    _matt("paper", 0.81, (0.80, 0.80, 0.78), f"{_SPLIB} PAPR1, cotton bond; rgb assumed"),
    _matt("cardboard", 0.5, (0.35, 0.24, 0.14), "assumed"),
    _matt("wood", 0.63, (0.45, 0.32, 0.21), f"{_SPLIB} GDS363, new pine"),
    _matt("painted wood", 0.65, (0.70, 0.70, 0.67), "assumed, as wall paint"),
    _matt("wall paint", 0.65, (0.70, 0.70, 0.67), "assumed, off-white"),
    _matt("plaster", 0.57, (0.56, 0.52, 0.45), f"{_SPLIB} WTC01-37A, concrete or plaster"),
    _matt("brick", 0.17, (0.18, 0.07, 0.05), f"{_SPLIB} GDS349, red paving"),
    _matt("rubber", 0.06, (0.06, 0.06, 0.06), f"{_ECOSTRESS} 0833UUURBR, black roofing"),
    _matt("carbon black", 0.03, (0.03, 0.03, 0.03), _BLACK),
    _glossy("glazed ceramic", 0.6, 0.08, (0.65, 0.65, 0.62), "assumed"),
    # Plastics.
    _glossy("white plastic", 0.70, 0.15, (0.67, 0.66, 0.61), f"{_SPLIB} GDS338, white PVC"),
    _glossy("plastic", 0.5, 0.15, (0.20, 0.30, 0.45), "assumed, coloured"),
    _glossy("dark plastic", 0.06, 0.1, (0.04, 0.04, 0.04), f"{_BLACK} (and the polymer scatters)"),
    _glossy(
        "dyed black plastic",
        0.4,
        0.1,
        (0.04, 0.04, 0.04),
        "assumed; such blacks exist to be sorted by near infrared (Compounding World 11/2022, 30)",
    ),
    # Metals.
    _metal("polished aluminium", 2.588, 8.169, 0.08, (0.91, 0.92, 0.92), _RAKIC),
    _metal("brushed steel", 2.948, 3.459, 0.25, (0.53, 0.51, 0.49), _JOHNSON_FE),
    _metal("copper", 0.276, 5.42, 0.15, (0.93, 0.62, 0.52), _JOHNSON_CU),
    _metal("mirror", 2.588, 8.169, 0.01, (0.91, 0.92, 0.92), f"aluminium, {_RAKIC}", kind="mirror"),
    _matt("rust", 0.16, (0.14, 0.08, 0.05), f"{_SPLIB} GDS378, rusted tin can"),
    # Transparent materials.
    _glass("glass", 1.516, "soda-lime, Rubin, Solar Energy Mater. 12 (1985) 275"),
    _glass("water", 1.329, "Hale and Querry, Appl. Opt. 12 (1973) 555"),
    # Outdoors.
    _matt("leaf", 0.48, (0.08, 0.10, 0.05), f"{_SPLIB} Aspen-1, green, top"),
    _matt("dry grass", 0.31, (0.22, 0.16, 0.08), f"{_SPLIB} GDS480, golden"),
    _matt("asphalt", 0.13, (0.10, 0.08, 0.07), f"{_SPLIB} GDS376, old black road"),
    _matt("concrete", 0.31, (0.32, 0.28, 0.22), f"{_SPLIB} GDS375, light grey road"),
)

LIBRARY = {entry.material.name: entry for entry in _ENTRIES}


def names() -> list[str]:
    """List the materials."""
    return sorted(LIBRARY)


def named(name: str) -> Material:
    """Return a material by name.

    Raises:
        InputError: if the name is unknown; the message lists the known names, nearest first.

    Example:
        >>> named("cotton").reflectance
        0.64
    """
    return entry(name).material


def entry(name: str) -> Entry:
    """Return a material with its source (errors as `named`)."""
    errors.one_of("material", name, LIBRARY)
    return LIBRARY[name]


PAPER = named("paper")
WALL_PAINT = named("wall paint")
WOOD = named("wood")
CARDBOARD = named("cardboard")
DYED_CLOTH = named("black dyed cloth")
CARBON_BLACK = named("carbon black")
RUBBER = named("rubber")
GLAZED_CERAMIC = named("glazed ceramic")
PLASTIC = named("plastic")
DARK_PLASTIC = named("dark plastic")
BRUSHED_STEEL = named("brushed steel")
POLISHED_ALUMINIUM = named("polished aluminium")
