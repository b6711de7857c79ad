"""showc.mission."""
