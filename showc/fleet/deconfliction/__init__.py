"""Where drones come too near, and flights of all drones that keep apart."""
