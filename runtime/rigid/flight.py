"""A rigid body in free flight over one step, and the incremental potential whose minimum is that flight.

Without contact the body keeps its velocity v and its angular momentum L about the centre: c^ = c + h v, and R^ = exp(h
[w]) R with the spin w = I_m^-1 L at the middle of the step, R_m = exp(h [w] / 2) R (the implicit midpoint rule on
rotations). Where the body is too slender or too fast for it, the step takes several such parts (`free_rotation.py`). L
is then conserved exactly, energy to second order and without drift; in the plane, and if all moments of inertia are
equal, the rotation is exact.

A step minimises, in addition to the contact energies,

    m/(2 h^2) |c - c^|^2 + 1/(2 h^2) tr((R - R^) J (R - R^)^T) - m g . c,

J being the second moment of mass. Under the variation R -> exp([w]) R the second term is (tr J - tr(exp([w]) M)) / h^2
with M = R J R^^T, and its derivatives are exact:

    gradient_k = -tr(E_k M) / h^2,      Hessian_kl = -tr((E_k E_l + E_l E_k) M) / (2 h^2).

At the minimum this gradient equals the torque T of all contacts, so v' = (c' - c)/h and L' = L + h T: the forces and
torques at the end of the step change the momenta, as in backward Euler, with no other dissipation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.rigid.free_rotation import free_rotation
from softprint.runtime.rigid.mass import MassProperties
from softprint.runtime.rigid.twist import generators, second_generators, twist_size


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """velocity (dim,) of the centre of mass [m/s]; momentum: angular, about that centre, in the world [kg m^2/s], one
    number in 2D, three in 3D."""

    velocity: Array
    momentum: Array

    @classmethod
    def spinning(cls, mass: MassProperties, pose: RigidPose, velocity: Array, spin: Array) -> RigidMotion:
        """The motion of a given velocity and spin, the angular velocity: (1,) in 2D, (3,) in 3D [rad/s]."""
        return cls(velocity, world_inertia(mass, pose.rotation) @ spin)

    def spin(self, mass: MassProperties, pose: RigidPose) -> Array:
        """Angular velocity [rad/s]."""
        return np.asarray(np.linalg.solve(world_inertia(mass, pose.rotation), self.momentum))

    def energy(self, mass: MassProperties, pose: RigidPose) -> float:
        """Kinetic [J]."""
        moving = mass.mass * float(self.velocity @ self.velocity)
        return 0.5 * (moving + float(self.momentum @ self.spin(mass, pose)))


def world_inertia(mass: MassProperties, rotation: Array) -> Array:
    """(n_spin, n_spin) [kg m^2] of the body rotated by rotation (dim, dim)."""
    return mass.inertia if mass.dim == 2 else rotation @ mass.inertia @ rotation.T


def centre_of(mass: MassProperties, pose: RigidPose) -> Array:
    """c (dim,) [m] in the world."""
    return pose.rotation @ mass.centre + pose.translation


def moved(mass: MassProperties, pose: RigidPose, twist: Array) -> RigidPose:
    """The pose after a twist (n_twist,) about the centre of mass."""
    dim = mass.dim
    rotation = rotation_exponential(twist[dim:]) @ pose.rotation
    # One step of Newton's method for the nearest rotation, so that round-off does not accumulate.
    rotation = 1.5 * rotation - 0.5 * rotation @ rotation.T @ rotation
    centre = centre_of(mass, pose) + twist[:dim]
    return RigidPose.known(rotation, centre - rotation @ mass.centre)


class FreeFlight:
    """One body over a step of time_step h [s] from pose and motion, under gravity (dim,) [m/s^2]."""

    def __init__(
        self, mass: MassProperties, pose: RigidPose, motion: RigidMotion, time_step: float, gravity: Array
    ) -> None:
        self.mass, self._start, self._motion, self._h = mass, pose, motion, time_step
        self._weight = mass.mass * gravity
        self._centre = centre_of(mass, pose)
        self._turns = free_rotation(mass.inertia, pose.rotation, motion.momentum, time_step)
        self._rotated = self._rotation_after(1.0)

    def _rotation_after(self, share: float) -> Array:
        """(dim, dim) after a share of the step without torque."""
        rotation, left = self._start.rotation, share * self._h
        for duration, spin in self._turns:
            rotation = rotation_exponential(min(left, duration) * spin) @ rotation
            left -= duration
            if left <= 0.0:
                break
        return rotation

    @property
    def inert(self) -> float:
        """m / h^2 [N/m]: the inertial force for each metre of deviation from the flight."""
        return self.mass.mass / self._h**2

    @property
    def step(self) -> Array:
        """The twist (n_twist,) of the step by momentum alone; its rotation is the sum of those of all parts."""
        turned = sum(duration * spin for duration, spin in self._turns)
        return np.concatenate([self._h * self._motion.velocity, turned])

    def carried_on(self, share: float = 1.0) -> RigidPose:
        """The pose after a share of the step without any force, not even weight."""
        rotation = self._rotation_after(share)
        centre = self._centre + share * self._h * self._motion.velocity
        return RigidPose.known(rotation, centre - rotation @ self.mass.centre)

    def energies(self, pose: RigidPose) -> tuple[float, float]:
        """Incremental inertia and weight [J] at the end of the step."""
        m, h = self.mass.mass, self._h
        centre = centre_of(self.mass, pose)
        off, off_rotation = centre - self._expected, pose.rotation - self._rotated
        inertia = m * float(off @ off) + float(np.vdot(off_rotation @ self.mass.second_moment, off_rotation))
        return inertia / (2.0 * h**2), -float(self._weight @ centre)

    @property
    def _expected(self) -> Array:
        """c^."""
        return self._centre + self._h * self._motion.velocity

    def linearise(self, pose: RigidPose) -> tuple[Array, Array]:
        """Gradient (n_twist,) and Hessian (n_twist, n_twist) of the energies by a twist about the centre of mass."""
        dim, h, m = self.mass.dim, self._h, self.mass.mass
        gradient, hessian = np.empty(twist_size(dim)), np.zeros((twist_size(dim),) * 2)
        gradient[:dim] = m * (centre_of(self.mass, pose) - self._expected) / h**2 - self._weight
        hessian[:dim, :dim] = m / h**2 * np.eye(dim)
        gradient[dim:] = self._torque(pose.rotation)
        M = pose.rotation @ self.mass.second_moment @ self._rotated.T
        hessian[dim:, dim:] = -np.einsum("klab,ba->kl", second_generators(dim), M) / h**2
        return gradient, hessian

    def _torque(self, rotation: Array) -> Array:
        """T (n_spin,) [N m] that deflects the body's rotation from its flight."""
        M = rotation @ self.mass.second_moment @ self._rotated.T
        return -np.einsum("kab,ba->k", generators(self.mass.dim), M) / self._h**2

    def motion_at(self, pose: RigidPose) -> RigidMotion:
        """v' and L' of a step that ends at the pose."""
        velocity = (centre_of(self.mass, pose) - self._centre) / self._h
        return RigidMotion(velocity, self._motion.momentum + self._h * self._torque(pose.rotation))
