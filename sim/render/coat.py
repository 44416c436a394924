"""A clear coat over a diffuse base: the base albedo for a given reflectance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Reflectance = float | NDArray[np.float32]  # A number, or a texture of it.

IOR = 1.49  # Refractive index of polymers and glazes.
# Mitsuba 3.9's nonlinear `roughplastic` of this index at normal incidence, integrated over outgoing
# directions: share reflected by the coat, share transmitted in and out once, share reflected
# internally. Rough coats lose the light that microfacets mask.
_ALPHA = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)
_COAT = (0.0387, 0.0387, 0.0386, 0.0383, 0.0378, 0.037, 0.0344, 0.031, 0.0273, 0.0235, 0.0171)
_THROUGH = (0.3943, 0.3945, 0.3953, 0.3962, 0.3963, 0.3953, 0.3903, 0.3816, 0.3698, 0.3558, 0.324)
_INSIDE = (0.5803, 0.5787, 0.5698, 0.5455, 0.5145, 0.48, 0.4087, 0.3425, 0.2848, 0.2363, 0.1633)


def base_albedo(reflectance: Reflectance, alpha: float) -> Reflectance:
    """Albedo of the diffuse base of a coated surface with a given reflectance.

    The reflectance is R = s + a d / (1 - f d): base albedo d, coat reflectance s, transmission in
    and out a, internal reflectance f. Unreachable reflectances get an albedo of 0 or 1.

    Source: Saunderson, Calculation of the color of pigmented plastics, J. Opt. Soc. Am. 32 (1942),
    eq. 2, solved for d.
    """
    coat, through, inside = (np.interp(alpha, _ALPHA, row) for row in (_COAT, _THROUGH, _INSIDE))
    rest = np.maximum(np.asarray(reflectance, np.float64) - coat, 0.0)
    albedo = np.minimum(rest / (through + inside * rest), 1.0)
    return albedo.astype(np.float32) if albedo.ndim else float(albedo)
