"""showc.verify."""
