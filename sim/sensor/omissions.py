"""Parts of a sensor that its file leaves out, and what holds in their place."""

from __future__ import annotations

from starling.sim.sensor.sensor_file import SensorFile


def line(file: SensorFile) -> str:
    """Name the parts that neither a sensor file nor its base gives; empty if it gives all."""
    light, post = file.sensor.projector, file.sensor.post
    parts = {
        "noise": (("left.shot_noise", "left.read_noise_e"), "an ideal imager"),
        "lens blur": (("left.lens.blur_px", "left.lens.defocus_px_m"), "a sharp lens"),
        "projector": (("projector",), f"pattern {light.pattern}, {light.power_w * 1e3:g} mW"),
        "matcher": (("matcher",), "d4xx"),
        "range": (("post.near_m", "post.far_m"), f"{post.near_m:g} to {post.far_m:g} m"),
    }
    listed = [
        f"no {name} ({instead})"
        for name, (paths, instead) in parts.items()
        if file.written.isdisjoint(paths)
    ]
    return f"it gives {', '.join(listed)}." if listed else ""
