"""The paper's arithmetic on its own numbers."""

from __future__ import annotations

from sim.studies.paper.claims import checks


def test_a_closed_surface_has_the_faces_that_its_vertices_ask_for() -> None:
    """Euler's formula, which the paper's 712 faces and 358 vertices meet."""
    faces = checks()[0]
    assert faces.agrees
    assert not faces._replace(stated=faces.stated + 1.0).agrees


def test_physics_does_not_fit_in_one_environments_frame() -> None:
    """88.92 ms are more than a frame at 33.40 frames/s, and less than one at 9.25."""
    alone, sixty = checks()[-2:]
    assert not alone.agrees
    assert sixty.agrees
