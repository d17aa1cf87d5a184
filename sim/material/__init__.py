"""The gel's elasticity: laws, element kernels, relaxation."""
