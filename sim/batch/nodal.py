"""Nodal values of a batch on the device, by unknown and environment.

The environment comes last, so that neighbouring threads touch neighbouring numbers.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

from typing import Any

import warp as wp


@wp.func
def unknown(values: wp.array2d(dtype=Any), row: wp.int32, environment: wp.int32) -> wp.float64:
    """Return a nodal value; rows below zero are fixed and stand for zero."""
    value = wp.float64(0.0)
    if row >= 0:
        value = wp.float64(values[row, environment])
    return value


@wp.func
def node_vector(
    values: wp.array2d(dtype=Any),
    rows: wp.array2d(dtype=wp.int32),
    node: wp.int32,
    environment: wp.int32,
) -> wp.vec3d:
    """Return a node's vector."""
    return wp.vec3d(
        unknown(values, rows[node, 0], environment),
        unknown(values, rows[node, 1], environment),
        unknown(values, rows[node, 2], environment),
    )


@wp.func
def add_vector(
    values_out: wp.array2d(dtype=wp.float64),
    rows: wp.array2d(dtype=wp.int32),
    node: wp.int32,
    environment: wp.int32,
    vector: wp.vec3d,
):
    """Add to a node's vector where it is free."""
    for axis in range(3):
        row = rows[node, axis]
        if row >= 0:
            wp.atomic_add(values_out, row, environment, vector[axis])
