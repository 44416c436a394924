"""A few near-infrared materials; reflectances at 850 nm are rounded and assumed."""

from __future__ import annotations

from sim.scene import Material

PAPER = Material(name="paper", reflectance=0.75)
WALL_PAINT = Material(name="wall paint", reflectance=0.65)
WOOD = Material(name="wood", reflectance=0.55)
CARDBOARD = Material(name="cardboard", reflectance=0.5)
DYED_CLOTH = Material(name="black dyed cloth", reflectance=0.4)  # Dyes are clear in the infrared.
CARBON_BLACK = Material(name="carbon black", reflectance=0.03)
RUBBER = Material(name="rubber", reflectance=0.05)
GLAZED_CERAMIC = Material(name="glazed ceramic", kind="glossy", reflectance=0.6, roughness=0.08)
PLASTIC = Material(name="plastic", kind="glossy", reflectance=0.5, roughness=0.15)
DARK_PLASTIC = Material(name="dark plastic", kind="glossy", reflectance=0.06, roughness=0.1)
BRUSHED_STEEL = Material(name="brushed steel", kind="metal", reflectance=0.65, roughness=0.25)
POLISHED_ALUMINIUM = Material(
    name="polished aluminium", kind="metal", reflectance=0.85, roughness=0.08
)
