"""showc.solve."""
