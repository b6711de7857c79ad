"""showc.plan."""
