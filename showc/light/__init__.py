"""showc.light."""
