"""From a problem and a mesh to a sparse nonlinear program, and back to polynomials."""
