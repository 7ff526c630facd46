"""The terms of the energy of a step: weight, springs, elasticity, contact at surface samples."""
