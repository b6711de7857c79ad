"""showc.ocp."""
