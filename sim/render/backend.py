"""Selection of Mitsuba's variant and of its LLVM library."""

from __future__ import annotations

import glob
import os
import platform
import re
import warnings
from functools import cache
from typing import Any

from starling.patterns import errors
from starling.sim.console import record

VARIANTS = ("cuda_ad_mono", "llvm_ad_mono", "scalar_rgb")
_OLDEST_LLVM = 16  # 15 aborts the process on AVX-512 machines; Dr.Jit refuses 14.
_PATTERNS = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
)


class BackendError(RuntimeError):
    """No Mitsuba variant is usable, or the variant does not support the request."""


class ScalarFallbackWarning(UserWarning):
    """No libLLVM was found: rendering is slow, without just-in-time compilation."""


def llvm_libraries() -> dict[str, int]:
    """Find the machine's LLVM libraries: path to major version, newest first."""
    libraries: dict[str, int] = {}
    for pattern in _PATTERNS:
        for path in glob.glob(pattern):
            version = re.search(r"libLLVM[-.](?:so\.|dylib\.)?(\d+)", os.path.basename(path))
            if version and os.path.realpath(path) not in map(os.path.realpath, libraries):
                libraries[path] = int(version[1])
    return dict(sorted(libraries.items(), key=lambda item: -item[1]))


def llvm_library() -> str | None:
    """Return the library for Dr.Jit: the user's choice, else the newest supported one."""
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        return chosen
    return next((path for path, major in llvm_libraries().items() if major >= _OLDEST_LLVM), None)


@cache
def mitsuba() -> Any:
    """Import Mitsuba and set its variant, once per process.

    `STARLING_VARIANT` forces one of `VARIANTS`. Otherwise the order is GPU, LLVM, and the scalar
    variant with a `ScalarFallbackWarning`.

    Raises:
        InputError: if `STARLING_VARIANT` is not a known variant.
        BackendError: if the forced variant cannot run here.
    """
    library = llvm_library()
    if library:  # Must be set before the first import of Dr.Jit.
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    import drjit as dr
    import mitsuba as mi

    forced = os.environ.get("STARLING_VARIANT")
    if forced:
        errors.one_of("STARLING_VARIANT", forced, VARIANTS)
    usable = {
        "cuda_ad_mono": lambda: bool(dr.has_backend(dr.JitBackend.CUDA)),
        "llvm_ad_mono": lambda: bool(library) and bool(dr.has_backend(dr.JitBackend.LLVM)),
        "scalar_rgb": lambda: True,
    }
    if forced and not usable[forced]():
        raise BackendError(
            f"STARLING_VARIANT must name a variant that runs here; got {forced}. "
            "Unset it, or install libllvm19 (LLVM) or an NVIDIA driver (CUDA)."
        )
    variant = forced or next(name for name in VARIANTS if usable[name]())
    if variant == "scalar_rgb" and not forced:
        warnings.warn(
            "no libLLVM >= 16 was found; rendering goes on in scalar_rgb, many times slower. "
            "Install libllvm19 or set DRJIT_LIBLLVM_PATH.",
            ScalarFallbackWarning,
            stacklevel=2,
        )
    mi.set_variant(variant)
    # Mitsuba would write warnings to standard output, which is reserved for results.
    mi.set_log_level(mi.LogLevel.Error)
    return mi


def drjit() -> Any:
    """Import Dr.Jit after its LLVM library is set."""
    mitsuba()
    import drjit as dr

    return dr


def is_jit() -> bool:
    """Whether the variant compiles kernels and can differentiate."""
    return "_ad_" in str(mitsuba().variant())


def report() -> dict[str, Any]:
    """Report variant, LLVM, GPU and relevant versions of this machine."""
    mi, dr = mitsuba(), drjit()
    return {
        "variant": str(mi.variant()),
        "llvm": llvm_library(),
        "llvm_found": llvm_libraries(),
        "gpu": bool(dr.has_backend(dr.JitBackend.CUDA)),
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": record.versions(),
    }


def renderer() -> dict[str, Any]:
    """Return Mitsuba's variant and the major version of LLVM, None if unused or unknown."""
    variant = str(mitsuba().variant())
    if not variant.startswith("llvm"):
        return {"variant": variant, "llvm": None}
    used = os.path.realpath(llvm_library() or "")
    majors = {os.path.realpath(path): major for path, major in llvm_libraries().items()}
    return {"variant": variant, "llvm": majors.get(used)}
