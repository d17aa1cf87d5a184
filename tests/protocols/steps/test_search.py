"""A search that ends where it must, and says why."""

from __future__ import annotations

import pytest

from drivers.emulators.faults import parse_fault
from protocols.guard.breach import BreachError
from protocols.guard.force import Contact
from protocols.steps.motion import approach
from protocols.steps.press import BEYOND_M, search_contact
from protocols.steps.window import take_tare
from tests.protocols.conftest import breach

SHORT = (
    'robot.home=["0 mm", "-400 mm", "203 mm"]',
    'protocol.approach_height="1.1 mm"',
    'protocol.air_press_height="1.5 mm"',
    'protocol.tare_duration="0.4 s"',
)


def above_the_gel(laboratory, *overrides, silent_fault="", **world):
    """Return a laboratory whose arm stands above the gel, tared; the cell lies from the start."""
    lab = laboratory(*SHORT, *overrides, bias=(0.0,) * 6, **world)
    if silent_fault:
        lab.world.begin(parse_fault(f"force_sensor:{silent_fault}"))
    lab.cycle.force_guard.set_zero(take_tare(lab.cycle))
    lab.cycle.force_guard.contact = Contact.NONE
    approach(lab.cycle)
    return lab


def test_the_gel_is_found_where_it_is(laboratory):
    """0.4 mm higher than the configuration says, to 30 um."""
    lab = above_the_gel(laboratory, surface_offset_m=0.4e-3)
    assert search_contact(lab.cycle) == pytest.approx(0.2004, abs=30e-6)


def test_a_force_of_the_wrong_sign_ends_the_search_at_the_first_threshold(laboratory):
    """The setting is named, with the value that it should have."""
    lab = above_the_gel(laboratory, silent_fault="sign")
    with pytest.raises(BreachError, match="compression_sign 1: the force went to -0") as caught:
        search_contact(lab.cycle)
    assert "compression_sign = -1" in caught.value.remedy
    assert lab.world.force_n < 0.3


def test_a_force_sideways_ends_the_search_and_names_the_axes(laboratory):
    """Fx and Fz swapped, by a decoupling matrix of another cell."""
    lab = above_the_gel(laboratory, silent_fault="swap-axes")
    with pytest.raises(BreachError, match="N sideways and") as caught:
        search_contact(lab.cycle)
    assert caught.value.limit == "witness.sideways"
    assert "axes are swapped" in caught.value.remedy
    assert lab.world.force_n < 0.6


def test_the_floor_is_the_lowest_place_where_the_gel_can_be(laboratory):
    """The surface is known to 0.3 mm: it is not looked for further below."""
    lab = above_the_gel(laboratory, 'sensor.surface_uncertainty="0.3 mm"', surface_offset_m=-2e-3)
    with breach("sensor.surface_uncertainty", match="nothing was touched"):
        search_contact(lab.cycle)
    assert lab.world.pose.position[2] == pytest.approx(0.2 - 0.3e-3 - BEYOND_M, abs=50e-6)


def test_a_height_that_was_found_before_is_the_floor(laboratory):
    """After a first trial the gel is known better than the configuration says."""
    lab = above_the_gel(laboratory, surface_offset_m=-0.5e-3)
    lab.cycle.contact_z_m = 0.2002
    with breach("witness.contact_height"):
        search_contact(lab.cycle)
