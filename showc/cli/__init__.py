"""showc.cli."""
