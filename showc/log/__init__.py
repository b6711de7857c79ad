"""showc.log."""
