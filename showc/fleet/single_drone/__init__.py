"""One drone on one leg: in the least time, or in a given time near a reference."""
