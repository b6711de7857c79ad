"""From a problem and a mesh to a nonlinear program, in two forms."""
