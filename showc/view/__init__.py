"""showc.view."""
