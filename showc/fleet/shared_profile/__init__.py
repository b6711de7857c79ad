"""One profile for a whole fleet: straight flights in closed form."""
