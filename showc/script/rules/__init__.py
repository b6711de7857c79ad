"""Rules that a show must keep: geometry, timing, operations, legibility, missions."""
