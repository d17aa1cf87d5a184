"""Warp kernels from nodes and slopes to a height per pixel that is smooth (C1).

The reduced Clough-Tocher element: each facet is cut at its centroid into three cubic Bezier
patches fixed by height and slope at the corners; the slope across an edge varies linearly along
it, so neighbours meet with one slope. Reference: Clough and Tocher 1965; Lai and Schumaker, Spline
Functions on Triangulations, 2007, section 6.3. Quadratic surfaces are reproduced exactly.
"""

import warp as wp

from sim.contact.indenter_distance import Body, Poses
from sim.optics.height.slope_kernel import FOLLOWS, Canvas, Gel, is_part, underside
from sim.scene.triangle_distance import BESIDE

_EDGE_TOLERANCE = wp.constant(wp.float64(1.0e-9))
_WEIGHT_LEAST = wp.constant(wp.float64(1.0e-36))
_LENGTH_LEAST_M2 = wp.constant(wp.float64(1.0e-30))
# Height of what no facet covers, and the floor of facets that have none [m].
BARE_M = wp.constant(wp.float64(1.0e9))
_Corners = wp.types.matrix(shape=(3, 2), dtype=wp.float64)


@wp.struct
class View:
    """Pixels of a camera: pad = towards (pixel - centre), pixel = back pad + centre."""

    columns: wp.int32
    rows: wp.int32
    centre: wp.vec2d
    towards: wp.mat22d
    back: wp.mat22d


@wp.struct
class Patches:
    """Bezier coefficients of a facet, see ``_patches``."""

    corner: wp.vec3d
    after: wp.vec3d
    before: wp.vec3d
    inward: wp.vec3d
    edge: wp.vec3d
    spoke: wp.vec3d
    centroid: wp.float64


@wp.func
def _patches(at: _Corners, heights: wp.vec3d, slopes: _Corners):
    """Return the coefficients on edges from corner i to the next, and towards the centroid."""
    one, half = wp.float64(1.0), wp.float64(0.5)
    third = one / wp.float64(3.0)
    centroid = (at[0] + at[1] + at[2]) * third
    made = Patches()
    made.corner = heights
    feet = wp.vec3d()
    for i in range(3):
        n = (i + 1) % 3
        along, inward = at[n] - at[i], centroid - at[i]
        made.after[i] = heights[i] + wp.dot(slopes[i], along) * third
        made.before[i] = heights[n] - wp.dot(slopes[n], along) * third
        made.inward[i] = heights[i] + wp.dot(slopes[i], inward) * third
        feet[i] = wp.dot(inward, along) / wp.max(wp.dot(along, along), _LENGTH_LEAST_M2)
    for i in range(3):
        # The derivative along the edge's normal is linear.
        n = (i + 1) % 3
        near, far = one - feet[i], feet[i]
        at_start = made.inward[i] - near * heights[i] - far * made.after[i]
        at_end = made.inward[n] - near * made.before[i] - far * heights[n]
        made.edge[i] = near * made.after[i] + far * made.before[i] + half * (at_start + at_end)
    for i in range(3):
        made.spoke[i] = (made.inward[i] + made.edge[i] + made.edge[(i + 2) % 3]) * third
    made.centroid = (made.spoke[0] + made.spoke[1] + made.spoke[2]) * third
    return made


@wp.func
def _height_on(p: Patches, at: wp.vec3d):
    """Return the height at barycentric coordinates."""
    s = 0
    if at[1] < at[0]:
        s = 1
    if at[2] < wp.min(at[0], at[1]):
        s = 2
    i, j = (s + 1) % 3, (s + 2) % 3
    three, six = wp.float64(3.0), wp.float64(6.0)
    a, b, c = at[i] - at[s], at[j] - at[s], three * at[s]
    height = a * a * (a * p.corner[i] + three * (b * p.after[i] + c * p.inward[i]))
    height += b * b * (b * p.corner[j] + three * (a * p.before[i] + c * p.inward[j]))
    height += c * c * (c * p.centroid + three * (a * p.spoke[i] + b * p.spoke[j]))
    return height + six * a * b * c * p.edge[i]


@wp.func
def _pixel(place: wp.float64, least: int, most: int):
    return int(wp.clamp(place, wp.float64(least), wp.float64(most)))


@wp.kernel(enable_backward=False)
def draw_facets(gel: Gel, view: View, first_part: wp.int32, lanes: wp.int32, canvas: Canvas):
    """Draw the facets of parts, some threads to each: the lowest sheet of a fold is seen.

    Where a node follows the indenter it has the indenter's slope; elsewhere, and at the indenter's
    rim, that of the free gel. Beside the contact the gel only rises; slopes of a wall's narrow
    parts, which come last, would draw pixels far below it, and those cast shadows.
    """
    env, number, lane = wp.tid()
    facets = gel.facets.shape[0]
    part, facet = first_part + number / facets, number % facets
    if not is_part(canvas, env, part):
        return
    at, px, corner_slopes = _Corners(), _Corners(), _Corners()
    z = wp.vec3d()
    touching = 0
    for c in range(3):
        node = gel.parts[part, gel.facets[facet, c]]
        x = canvas.nodes[env, node]
        at[c] = wp.vec2d(x[0], x[1])
        px[c] = view.back * at[c] + view.centre
        z[c] = x[2]
        state = canvas.states[env, node]
        touching += wp.where(state > 0, 1, 0)
        if state == FOLLOWS:
            corner_slopes[c] = canvas.slopes[env, node]
        else:
            total = canvas.sums[env, node]
            corner_slopes[c] = wp.vec2d(total[0], total[1]) / wp.max(total[2], _WEIGHT_LEAST)
    u, v = px[0] - px[2], px[1] - px[2]
    area = u[0] * v[1] - u[1] * v[0]
    if area == wp.float64(0.0) or not wp.isfinite(area + z[0] + z[1] + z[2]):
        return
    beyond = wp.vec2d(_EDGE_TOLERANCE, _EDGE_TOLERANCE)
    low = wp.min(wp.min(px[0], px[1]), px[2]) - beyond
    high = wp.max(wp.max(px[0], px[1]), px[2]) + beyond
    first_column = _pixel(wp.ceil(low[0]), 0, view.columns)
    last_column = _pixel(wp.floor(high[0]), -1, view.columns - 1)
    first_row = _pixel(wp.ceil(low[1]), 0, view.rows)
    last_row = _pixel(wp.floor(high[1]), -1, view.rows - 1)
    width = last_column - first_column + 1
    count = width * (last_row - first_row + 1)
    if width <= 0 or lane >= count:
        return
    floor = -BARE_M
    if touching > 0 or first_part > 0:
        floor = wp.min(wp.min(z[0], z[1]), z[2])
    patches = _patches(at, z, corner_slopes)
    per_area = wp.float64(1.0) / area
    for n in range(lane, count, lanes):
        row, column = first_row + n / width, first_column + n % width
        d = wp.vec2d(wp.float64(column), wp.float64(row)) - px[2]
        first = (d[0] * v[1] - d[1] * v[0]) * per_area
        second = (d[1] * u[0] - d[0] * u[1]) * per_area
        place = wp.vec3d(first, second, wp.float64(1.0) - first - second)
        if wp.min(wp.min(place[0], place[1]), place[2]) >= -_EDGE_TOLERANCE:
            pixel = row * view.columns + column
            wp.atomic_min(canvas.heights, env, pixel, wp.max(_height_on(patches, place), floor))
            if touching == 3:
                canvas.pressed[env, pixel] = wp.uint8(1)


@wp.kernel(enable_backward=False, module="unique")
def fill_bare(view: View, by_columns: wp.bool, canvas: Canvas):
    """Give bare pixels the height of the nearest covered one of their column, or of their row.

    Nothing changes where all of it is bare.
    """
    env, line = wp.tid()
    count = wp.where(by_columns, view.rows, view.columns)
    step = wp.where(by_columns, view.columns, 1)
    first = wp.where(by_columns, line, line * view.columns)
    before = wp.int32(-1)
    for k in range(count + 1):
        if k == count or canvas.heights[env, first + wp.min(k, count - 1) * step] < BARE_M:
            for n in range(before + 1, k):
                nearest = k
                if k == count or (before >= 0 and n - before <= k - n):
                    nearest = before
                if nearest >= 0:
                    height = canvas.heights[env, first + nearest * step]
                    canvas.heights[env, first + n * step] = height
            before = k


@wp.kernel(enable_backward=False, module="unique")
def bound_heights(
    gel: Gel,
    view: View,
    bodies: wp.array(dtype=Body),
    poses: Poses,
    # Data in:
    canvas: Canvas,
    # Data out, where there is room for it:
    dent_out: wp.array3d(dtype=wp.float32),
    loaded_out: wp.array2d(dtype=wp.float64),
    contact_out: wp.array2d(dtype=wp.uint8),
):
    """Bound the gel by the indenter: under it where facets are pressed; NaN if all is bare."""
    env, row, column = wp.tid()
    pixel = row * view.columns + column
    height = canvas.heights[env, pixel]
    if height >= BARE_M:
        height = wp.float64(wp.nan)
    place = view.towards * (wp.vec2d(wp.float64(column), wp.float64(row)) - view.centre)
    ceiling = underside(bodies, poses, gel.standoff, env, place[0], place[1])
    if ceiling < BESIDE and not wp.isnan(height):
        height = wp.where(
            canvas.pressed[env, pixel] == wp.uint8(1), ceiling, wp.min(height, ceiling)
        )
    if dent_out.shape[0] > 0:
        dent_out[env, row, column] = wp.float32(canvas.rest[pixel] - height)
    if loaded_out.shape[0] > 0:
        loaded_out[env, pixel] = height
        touches = ceiling < BESIDE and ceiling - height <= gel.gap
        contact_out[env, pixel] = wp.where(touches, wp.uint8(1), wp.uint8(0))
