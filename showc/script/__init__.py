"""showc.script."""
