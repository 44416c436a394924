"""A body's material and finish as a Mitsuba BSDF."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.render import backend
from starling.sim.scene.scene import Body, Finish, Material

Dict = dict[str, Any]

Reflectance = float | NDArray[np.float32]  # A number, or a texture of it.
IOR = 1.49  # Refractive index of polymers and glazes.
# Mitsuba 3.9's nonlinear `roughplastic` of this index at normal incidence, integrated over outgoing
# directions: share reflected by the coat, share transmitted in and out once, share reflected
# internally. Rough coats lose the light that microfacets mask.
_ALPHA = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)
_COAT = (0.0387, 0.0387, 0.0386, 0.0383, 0.0378, 0.037, 0.0344, 0.031, 0.0273, 0.0235, 0.0171)
_THROUGH = (0.3943, 0.3945, 0.3953, 0.3962, 0.3963, 0.3953, 0.3903, 0.3816, 0.3698, 0.3558, 0.324)
_INSIDE = (0.5803, 0.5787, 0.5698, 0.5455, 0.5145, 0.48, 0.4087, 0.3425, 0.2848, 0.2363, 0.1633)


def from_body(body: Body, finish: Finish) -> Dict:
    """BSDF dict of a body with its material and finish.

    Blends with shares of 0 or 1 are omitted, so that both limits are exactly the pure materials.
    The finish changes only the reflectance of mirrors, and nothing of glass.
    """
    return _with_transparency(_twosided(_blend(body, finish)), body, finish)


def albedo_bsdf(body: Body, finish: Finish) -> Dict | None:
    """BSDF dict whose diffuse reflectance is the body's reflectance.

    Mitsuba has no diffuse reflectance of blends and metals, and ignores the coat of coated
    surfaces. None if the body's own BSDF already reports its reflectance.
    """
    if not is_shiny(body, finish):
        return None
    value = _spectrum(_value(body, finish), body.repeats)
    return _twosided({"type": "diffuse", "reflectance": value})


def ambient_share(body: Body, largest: float) -> Dict:
    """BSDF dict whose diffuse reflectance is the body's ambient share over the largest.

    The division is needed because Mitsuba limits reflectance to 1.
    """
    share = body.ambient_share
    value = 1 / largest if share is None else share / np.float32(largest)
    return _twosided({"type": "diffuse", "reflectance": _spectrum(value, body.repeats)})


def is_shiny(body: Body, finish: Finish) -> bool:
    """Whether a body is coated or metallic, at least in part."""
    shiny_finish = finish_applies(body, finish) and (finish.gloss > 0 or finish.metal > 0)
    return shiny_finish or body.material.kind in ("glossy", "metal")


def grey_bitmap(image: NDArray[np.float32], *, repeats: bool = False) -> Dict:
    """Texture dict of a linear grey image; uv (0, 0) is the corner of pixel (0, 0)."""
    mi = backend.mitsuba()
    channels = 1 if backend.is_jit() else 3
    data = np.repeat(np.ascontiguousarray(image, np.float32)[..., None], channels, axis=2)
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(data),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat" if repeats else "clamp",
    }


def finish_applies(body: Body, finish: Finish) -> bool:
    """Whether the finish's shares apply to a body."""
    return finish.touches(body.name) and body.material.kind not in ("mirror", "glass")


def _value(body: Body, finish: Finish) -> Reflectance:
    """Reflectance of a body with its finish: a number, or a texture."""
    scale = finish.reflectance_scale if finish.touches(body.name) else 1.0
    if body.texture is None or body.material.kind == "mirror":
        return (
            body.material.reflectance if scale == 1 else min(body.material.reflectance * scale, 1.0)
        )
    if scale == 1:
        return body.texture
    return np.minimum(body.texture * np.float32(scale), np.float32(1))


def _blend(body: Body, finish: Finish) -> Dict:
    value = _value(body, finish)
    repeats = body.repeats
    surface = _plain(body.material, value, repeats)
    if not finish_applies(body, finish):
        return surface
    surface = _share(finish.gloss, surface, _coated(value, finish.roughness, repeats))
    return _share(finish.metal, surface, _metal(value, finish.roughness, repeats))


def _share(share: float, below: Dict, above: Dict) -> Dict:
    if share in (0, 1):
        return above if share else below
    return {"type": "blendbsdf", "weight": share, "below": below, "over": above}


def _plain(material: Material, value: Reflectance, repeats: bool) -> Dict:
    """BSDF of a material on the front side."""
    if material.kind == "diffuse":
        return {"type": "diffuse", "reflectance": _spectrum(value, repeats)}
    if material.kind == "glossy":
        return _coated(value, material.roughness, repeats)
    if material.kind == "metal":
        return _metal(value, material.roughness, repeats)
    if material.kind == "mirror":
        return {"type": "conductor", "specular_reflectance": _spectrum(value, repeats)}
    return {"type": "dielectric", "int_ior": material.ior, "ext_ior": 1.0}


def _coated(value: Reflectance, roughness: float, repeats: bool) -> Dict:
    return {
        "type": "roughplastic",
        "distribution": "ggx",
        "alpha": roughness,
        "int_ior": IOR,
        "diffuse_reflectance": _spectrum(base_albedo(value, roughness), repeats),
        "nonlinear": True,
    }


def _metal(value: Reflectance, roughness: float, repeats: bool) -> Dict:
    return {
        "type": "principled",
        "metallic": 1.0,
        "base_color": _spectrum(value, repeats),
        "roughness": roughness**0.5,  # The model squares it to alpha.
    }


def _twosided(bsdf: Dict) -> Dict:
    if bsdf["type"] == "dielectric":  # A dielectric's sides differ.
        return bsdf
    return {"type": "twosided", "bsdf": bsdf}


def _with_transparency(bsdf: Dict, body: Body, finish: Finish) -> Dict:
    """Add the finish's straight transmission."""
    if finish.transparency == 0 or not finish_applies(body, finish):
        return bsdf
    return {"type": "mask", "opacity": 1 - finish.transparency, "bsdf": bsdf}


def _spectrum(value: Reflectance, repeats: bool) -> Dict:
    if isinstance(value, np.ndarray):
        return grey_bitmap(value, repeats=repeats)
    return {"type": "spectrum", "value": value}


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
