"""Compiled kernels of the warp: disparity rows seen from other places, and their light.

Imagers and emitters stand on the baseline, so a row stays a row in every view. A view at k
baselines sees disparity d of column x at column x - k d.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from starling.sim.render.emission import NEAREST_M

_f4 = np.float32
SLACK_SHARE = _f4(1.002)  # A surface hides those behind it by more than this share,
SLACK_PX = _f4(0.35)  # and this disparity [px]; rasterisation errs by less.
NEAREST_EMITTER_M = _f4(1e-4)  # Least distance from an emitter [m]; prevents division by zero.
INSET_PX = _f4(2)  # Reflectance of hidden surfaces is taken this far from the edge [px].
_FULL_BLUR_M = _f4(NEAREST_M)  # Defocus on closer surfaces is that at this distance.


@nb.njit(nogil=True, cache=True, error_model="numpy")
def warp_row(disparity, k, margin, jump_px, out, source):  # pragma: no cover - compiled
    """Rasterise a row of disparities into the view at `k` baselines; the nearest surface wins.

    Neighbours within `jump_px` belong to one surface, which is linear between them. The outermost
    pixel of a surface extends by half a pixel.

    Args:
        disparity: (w,) [px], 0 without a surface.
        k: place of the view [baselines].
        margin: columns of `out` to the left of the view's first column.
        jump_px: largest difference of neighbours on one surface [px].
        out: (n,) is filled with disparities, 0 where nothing is seen.
        source: (n,) is filled with the columns that are seen.
    """
    w, n = disparity.shape[0], out.shape[0]
    out[:] = 0
    source[:] = -1
    for x in range(w):
        value_px = disparity[x]
        if value_px <= 0:
            continue
        left = _f4(x) - k * value_px + margin
        following = disparity[x + 1] if x + 1 < w else _f4(0)
        joined = following > 0 and abs(following - value_px) <= jump_px
        if joined:
            right = _f4(x + 1) - k * following + margin
            if right > left:
                slope = _f4(1) / (right - left)
                for i in range(max(int(np.ceil(left)), 0), min(int(np.floor(right)), n - 1) + 1):
                    share = (_f4(i) - left) * slope
                    value = value_px + share * (following - value_px)
                    if value > out[i]:
                        out[i], source[i] = value, _f4(x) + share
        before = disparity[x - 1] if x > 0 else _f4(0)
        if not joined or before <= 0 or abs(before - value_px) > jump_px:
            i = int(np.floor(left + _f4(0.5)))
            if 0 <= i < n and value_px > out[i]:
                out[i], source[i] = value_px, _f4(x)


@nb.njit(nogil=True, cache=True)
def fill_row(out, source, nearer, nearer_source):  # pragma: no cover - compiled
    """Continue the farther neighbour over unknown columns, in place.

    Args:
        out: (n,) disparities [px], 0 where unknown.
        source: (n,) columns of the left view.
        nearer, nearer_source: (n,) are filled with those of the nearer neighbour.
    """
    n, x = out.shape[0], 0
    while x < n:
        if out[x] > 0:
            x += 1
            continue
        end = x
        while end < n and out[end] <= 0:
            end += 1
        before = out[x - 1] if x > 0 else _f4(0)
        after = out[end] if end < n else _f4(0)
        if before <= 0 and after <= 0:
            return
        from_left = after <= 0 or 0 < before <= after
        left = source[x - 1] - INSET_PX if x > 0 else _f4(0)
        right = source[end] + INSET_PX if end < n else _f4(n)
        out[x:end], nearer[x:end] = (before, after) if from_left else (after, before)
        source[x:end], nearer_source[x:end] = (left, right) if from_left else (right, left)
        x = end


@nb.njit(nogil=True, cache=True, inline="always")
def _slope(before, value_px, after):  # pragma: no cover - compiled
    """Difference to the neighbour that is nearer in disparity; 0 without neighbours."""
    back = value_px - before if before > 0 else _f4(np.inf)
    ahead = after - value_px if after > 0 else _f4(np.inf)
    slope = back if abs(back) < abs(ahead) else ahead
    return slope if abs(slope) < _f4(np.inf) else _f4(0)


@nb.njit(nogil=True, cache=True, error_model="numpy")
def normals(disparity, first, last, camera, out):  # pragma: no cover - compiled
    """Fill rows `first` to `last` of `out` (h, w, 3) with unit normals.

    Disparity is linear on planes. For gradient (gx, gy) the normal is proportional to
    (gx fx, gy fy, d - gx (x - cx) - gy (y - cy)), up to its sign.

    Args:
        disparity: (h, w) [px], 0 without a surface.
        first, last: rows.
        camera: fx, fy, cx, cy [px] as float32.
        out: normals that point to the camera; NaN without a surface.
    """
    h, w = disparity.shape
    fx, fy, cx, cy = camera
    # Without branches, conversions of indices and unknown strides the loop is vectorised.
    outside, padded = np.zeros(w, np.float32), np.zeros(w + 2, np.float32)
    across, flat = np.arange(w).astype(np.float32) - cx, out.reshape(h, 3 * w)
    for y in range(first, last):
        above = disparity[y - 1] if y > 0 else outside
        below = disparity[y + 1] if y + 1 < h else outside
        row, down, normal = disparity[y], _f4(y) - cy, flat[y]
        padded[1 : w + 1] = row
        for x in range(w):
            value_px = row[x]
            gx = _slope(padded[x], value_px, padded[x + 2])
            gy = _slope(above[x], value_px, below[x])
            a, b, c = gx * fx, gy * fy, value_px - gx * across[x] - gy * down
            scale = _f4(-1) / np.sqrt(a * a + b * b + c * c)
            scale = scale if value_px > 0 else _f4(np.nan)
            normal[3 * x], normal[3 * x + 1], normal[3 * x + 2] = a * scale, b * scale, c * scale


@nb.njit(nogil=True, cache=True, inline="always")
def _pixel(image, y, x):  # pragma: no cover - compiled
    """Bilinear interpolation, with the border repeated."""
    h, w = image.shape
    j, i = int(np.floor(y)), int(np.floor(x))
    v, u = y - _f4(j), x - _f4(i)
    top, bottom = image[min(max(j, 0), h - 1)], image[min(max(j + 1, 0), h - 1)]
    i0, i1 = min(max(i, 0), w - 1), min(max(i + 1, 0), w - 1)
    upper = top[i0] + u * (top[i1] - top[i0])
    return upper + v * (bottom[i0] + u * (bottom[i1] - bottom[i0]) - upper)


@nb.njit(nogil=True, cache=True, error_model="numpy")
def light_rows(
    disparity, normal, first, last, view, camera, focal_baseline, emitter, pattern, hidden, out, lit
):  # pragma: no cover - compiled
    """Add an emitter's irradiance to rows of a view, for surfaces of disparity > 0.

    Args:
        disparity: (h, w) of the view [px], 0 without a surface.
        normal: (h, w, 3) from `normals`.
        first, last: rows.
        view: place of the view [baselines] and the baseline [m].
        camera: fx, fy, cx, cy [px].
        focal_baseline: f b [px m].
        emitter: origin (3), rotation by columns (9), half tangents (2), scale of the pattern, and
            its place for shadows [baselines], all in the left frame.
        pattern: levels (n, th, tw) of irradiance at unit distance, the nearness in focus, the
            relative width, and the logarithm of the levels' ratio; see `emission.Defocus`.
        hidden: (h, n) disparities that the emitter sees, and its left margin [px].
        out: (h, w) irradiance [W m^-2], added to.
        lit: (h, w) set where the emitter's light arrives.
    """
    fx, fy, cx, cy = camera
    place, baseline = view
    levels, focus, width, log_ratio = pattern
    seen, margin = hidden
    count, th, tw = levels.shape
    e = emitter
    ox, oy, oz = e[0] - place * baseline, e[1], e[2]
    half_x, half_y, scale, from_emitter = e[12], e[13], e[14], e[15]
    across, along = _f4(0.5) * _f4(tw) / half_x, _f4(0.5) * _f4(th) / half_y
    mid_x, mid_y = _f4(0.5) * _f4(tw) - _f4(0.5), _f4(0.5) * _f4(th) - _f4(0.5)
    ratio = np.exp(log_ratio)
    for y in range(first, last):
        ty = (_f4(y) - cy) / fy
        shadow = seen[y]
        for x in range(disparity.shape[1]):
            d = disparity[y, x]
            if d <= 0:
                continue
            z = focal_baseline / d
            px, py, pz = (_f4(x) - cx) / fx * z - ox, ty * z - oy, z - oz
            lx = e[3] * px + e[6] * py + e[9] * pz
            ly = e[4] * px + e[7] * py + e[10] * pz
            lz = e[5] * px + e[8] * py + e[11] * pz
            nx, ny, nz = lx, ly, lz
            if scale != 1:
                nx, ny = lx / scale, ly / scale
                nz = np.sqrt(max(lx * lx + ly * ly + lz * lz - nx * nx - ny * ny, _f4(0)))
            if lz < NEAREST_EMITTER_M or nz < NEAREST_EMITTER_M:
                continue
            slope_x, slope_y = nx / nz, ny / nz
            if abs(slope_x) > half_x or abs(slope_y) > half_y:
                continue
            column = _f4(x) + (place - from_emitter) * d + margin
            i = min(max(int(np.floor(column)), 0), shadow.shape[0] - 2)
            if min(shadow[i], shadow[i + 1]) > d * SLACK_SHARE + SLACK_PX:
                continue
            tx, tv = slope_x * across + mid_x, slope_y * along + mid_y
            if count == 1:
                irradiance = _pixel(levels[0], tv, tx)
            else:
                blur = width * (_f4(1) / max(lz, _FULL_BLUR_M) - focus)
                variance = _f4(1) + blur * blur
                below = np.floor(np.log(variance) / log_ratio)
                share = (variance * np.exp(-below * log_ratio) - _f4(1)) / (ratio - _f4(1))
                level = min(below + min(max(share, _f4(0)), _f4(1)), _f4(count - 1))
                n = min(int(level), count - 2)
                irradiance = _pixel(levels[n], tv, tx)
                irradiance += (level - _f4(n)) * (_pixel(levels[n + 1], tv, tx) - irradiance)
            irradiance /= lz * lz
            if scale != 1:
                widening = lz / nz * (lz / nz) / scale
                irradiance *= widening * widening
            a, b, c = normal[y, x, 0], normal[y, x, 1], normal[y, x, 2]
            out[y, x] += irradiance * abs(a * px + b * py + c * pz) / lz
            lit[y, x] = True


@nb.njit(nogil=True, cache=True, error_model="numpy")
def radiance_rows(
    disparity, normal, reflectance, first, last, focal_baseline, sky, irradiance, ambient, depth
):  # pragma: no cover - compiled
    """Fill rows of a view with the radiance of matt surfaces, and their depth.

    Args:
        disparity, normal, reflectance: (h, w) of the view; see `normals`.
        first, last: rows.
        focal_baseline: f b [px m].
        sky: gradient of the ambient light times the direction of the zenith (3,).
        irradiance: (h, w) of the dots [W m^-2], turned into their radiance.
        ambient: (h, w) radiance under ambient light of 1 W m^-2.
        depth: (h, w) z [m], NaN without a surface.
    """
    gx, gy, gz = sky
    for y in range(first, last):
        for x in range(disparity.shape[1]):
            d = disparity[y, x]
            share = reflectance[y, x] * _f4(1 / np.pi)
            irradiance[y, x] *= share
            tilt = normal[y, x, 0] * gx + normal[y, x, 1] * gy + normal[y, x, 2] * gz
            ambient[y, x] = share * (_f4(1) + tilt) if d > 0 else _f4(0)
            depth[y, x] = focal_baseline / d if d > 0 else _f4(np.nan)


@nb.njit(nogil=True, cache=True)
def inner_rows(disparity, reflectance, jump_px, first, last, out):  # pragma: no cover - compiled
    """Fill rows of `out` (h, w) with reflectance that does not mix two surfaces.

    A pixel beside a jump takes the reflectance of the pixel on its other side, if that is on the
    same surface. Renderers average the colours within a pixel, but not its depth.

    Args:
        disparity, reflectance: (h, w).
        jump_px: largest difference of neighbours on one surface [px].
        first, last: rows.
    """
    h, w = disparity.shape
    for y in range(first, last):
        row = disparity[y]
        above, below = disparity[max(y - 1, 0)], disparity[min(y + 1, h - 1)]
        for x in range(w):
            d = row[x]
            west, east = row[max(x - 1, 0)], row[min(x + 1, w - 1)]
            to_west, to_east = abs(west - d) <= jump_px, abs(east - d) <= jump_px
            to_above, to_below = abs(above[x] - d) <= jump_px, abs(below[x] - d) <= jump_px
            i, j = x, y
            if to_west != to_east:
                i = x - 1 if to_west else x + 1
            elif to_above != to_below:
                j = y - 1 if to_above else y + 1
            out[y, x] = reflectance[j, i]


@nb.njit(nogil=True, cache=True)
def emitter_rows(disparity, place, margin, jump_px, first, last, out):  # pragma: no cover
    """Fill rows of `out` (h, n) with the disparities that an emitter sees; see `warp_row`."""
    source = np.empty(out.shape[1], np.float32)
    for y in range(first, last):
        warp_row(disparity[y], place, margin, jump_px, out[y], source)


@nb.njit(nogil=True, cache=True)
def right_rows(
    disparity, reflectance, rendered, warping, jump_px, first, last, out, out_reflectance, seen
):  # pragma: no cover - compiled
    """Fill rows of the right view: disparity, reflectance, and the left points that it sees.

    Args:
        disparity, reflectance: (h, w) of the left view.
        rendered: (h, w) disparities of the right view, used unless `warping`.
        warping: whether to warp the left view.
        jump_px: as in `warp_row`.
        first, last: rows.
        out, out_reflectance: (h, w) of the right view.
        seen: (h, w) of the left view.
    """
    w = disparity.shape[1]
    source, warped = np.empty(w, np.float32), np.empty(w, np.float32)
    nearer, nearer_source = np.empty(w, np.float32), np.empty(w, np.float32)
    for y in range(first, last):
        row = out[y]
        warp_row(disparity[y], _f4(1), _f4(0), jump_px, warped, source)
        nearer[:] = 0
        fill_row(warped, source, nearer, nearer_source)
        row[:] = warped if warping else rendered[y]
        for x in range(w):
            place = source[x]
            if not warping and nearer[x] > 0 and abs(row[x] - nearer[x]) < abs(row[x] - warped[x]):
                place = nearer_source[x]
            place = min(max(place, _f4(0)), _f4(w - 1))
            column = min(int(place), w - 2)
            share = place - _f4(column)
            step_px = abs(disparity[y, column + 1] - disparity[y, column])
            if step_px > jump_px:  # Surfaces do not mix.
                share = np.rint(share)
            value = reflectance[y, column]
            out_reflectance[y, x] = value + share * (reflectance[y, column + 1] - value)
        for x in range(w):
            d = disparity[y, x]
            if d <= 0:
                continue
            i = int(np.floor(_f4(x) - d + _f4(0.5)))
            if i < 0 or i >= w:
                continue
            nearest = min(row[max(i - 1, 0)], row[i], row[min(i + 1, w - 1)])
            seen[y, x] = nearest <= d * SLACK_SHARE + SLACK_PX
