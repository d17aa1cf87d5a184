"""Compressible neo-Hookean law with split energy, for axisymmetric deformation.

psi = mu/2 (J^(-2/3) Ic - 3) + K/2 (J - 1)^2 (Bonet and Wood 2008, section 6.5). Not the replay's
law: the two share their small-strain limit and nothing else.

A deformation gradient is five numbers in the order rr, rz, zr, zz, hoop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class NeoHookean:
    """Material with Young's modulus one: forces scale with the true modulus.

    Attributes:
        poisson: Poisson's ratio at small strain.
    """

    poisson: float

    @property
    def shear(self) -> float:
        """Shear modulus, as a multiple of Young's modulus."""
        return 0.5 / (1.0 + self.poisson)

    @property
    def bulk(self) -> float:
        """Bulk modulus, as a multiple of Young's modulus."""
        return 1.0 / (3.0 * (1.0 - 2.0 * self.poisson))

    def energy(self, gradient: FloatArray) -> FloatArray:
        """Return the energy density, shape [...]; inf where the element is turned inside out."""
        jacobian = _jacobian(gradient)
        valid = jacobian > 0.0
        j = np.where(valid, jacobian, 1.0)
        ic = np.sum(gradient**2, axis=-1)
        energy = 0.5 * self.shear * (j ** (-2 / 3) * ic - 3.0) + 0.5 * self.bulk * (j - 1.0) ** 2
        checked: FloatArray = np.where(valid, energy, np.inf)
        return checked

    def stress(self, gradient: FloatArray) -> FloatArray:
        """Return the first Piola-Kirchhoff stress, shape [..., 5]."""
        j = _jacobian(gradient)[..., None]
        ic = np.sum(gradient**2, axis=-1, keepdims=True)
        pressure = -self.shear / 3.0 * j ** (-5 / 3) * ic + self.bulk * (j - 1.0)
        stress: FloatArray = self.shear * j ** (-2 / 3) * gradient + pressure * _cofactor(gradient)
        return stress

    def tangent(self, gradient: FloatArray) -> FloatArray:
        """Return the derivative of the stress, shape [..., 5, 5]."""
        j = _jacobian(gradient)[..., None, None]
        ic = np.sum(gradient**2, axis=-1)[..., None, None]
        cofactor = _cofactor(gradient)
        mixed = gradient[..., :, None] * cofactor[..., None, :]
        square = cofactor[..., :, None] * cofactor[..., None, :]
        pressure = -self.shear / 3.0 * j ** (-5 / 3) * ic + self.bulk * (j - 1.0)
        tangent: FloatArray = (
            self.shear * j ** (-2 / 3) * np.eye(5)
            - 2 / 3 * self.shear * j ** (-5 / 3) * (mixed + np.swapaxes(mixed, -1, -2))
            + (5 / 9 * self.shear * j ** (-8 / 3) * ic + self.bulk) * square
            + pressure * _cofactor_derivative(gradient)
        )
        return tangent

    def turning_tangent(self, gradient: FloatArray) -> FloatArray:
        """Return the derivative of the stress by what leaves the (r, z) plane, shape [..., 4, 4].

        In the order r hoop, hoop r, hoop z, z hoop: zero themselves in an axisymmetric state, and
        coupled to none of its five.
        """
        rr, rz, zr, zz, _ = np.moveaxis(gradient, -1, 0)
        j = _jacobian(gradient)
        ic = np.sum(gradient**2, axis=-1)
        pressure = -self.shear / 3.0 * j ** (-5 / 3) * ic + self.bulk * (j - 1.0)
        tangent: FloatArray = (self.shear * j ** (-2 / 3))[..., None, None] * np.eye(4)
        for row, column, value in ((0, 1, -zz), (0, 2, zr), (3, 1, rz), (3, 2, -rr)):
            tangent[..., row, column] = tangent[..., column, row] = pressure * value
        return tangent


def _jacobian(gradient: FloatArray) -> FloatArray:
    rr, rz, zr, zz, hoop = np.moveaxis(gradient, -1, 0)
    jacobian: FloatArray = hoop * (rr * zz - rz * zr)
    return jacobian


def _cofactor(gradient: FloatArray) -> FloatArray:
    rr, rz, zr, zz, hoop = np.moveaxis(gradient, -1, 0)
    return np.stack([hoop * zz, -hoop * zr, -hoop * rz, hoop * rr, rr * zz - rz * zr], axis=-1)


def _cofactor_derivative(gradient: FloatArray) -> FloatArray:
    rr, rz, zr, zz, hoop = np.moveaxis(gradient, -1, 0)
    second = np.zeros((*gradient.shape, 5))
    for row, column, value in (
        (0, 3, hoop),
        (1, 2, -hoop),
        (0, 4, zz),
        (1, 4, -zr),
        (2, 4, -rz),
        (3, 4, rr),
    ):
        second[..., row, column] = value
        second[..., column, row] = value
    return second
