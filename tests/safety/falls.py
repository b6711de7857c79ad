"""Falls flown step by step, as an oracle."""

import numpy as np

from showc.vehicle.power import SEA_LEVEL

MASS = 0.625


def landings(velocity, height, wind, drag_area, step=0.005):
    """Ground points (n, 2) of falls, by Heun's method on the velocity itself."""
    drag = 0.5 * SEA_LEVEL * drag_area / MASS
    speed = velocity.astype(float).copy()
    place = np.zeros_like(speed)
    place[:, 2] = height
    air = np.column_stack([wind, np.zeros(len(wind))])

    def push(v):
        own = v - air
        size = np.linalg.norm(own, axis=1)
        return np.array([0.0, 0.0, -9.81]) - (drag * size)[:, None] * own

    found = np.full((len(speed), 2), np.nan)
    while np.isnan(found).any():
        first = push(speed)
        second = push(speed + step * first)
        after = place + step * (speed + 0.5 * step * first)
        down = (after[:, 2] <= 0.0) & np.isnan(found[:, 0])
        share = place[:, 2] / np.maximum(place[:, 2] - after[:, 2], 1e-12)
        found[down] = (place + share[:, None] * (after - place))[down, :2]
        speed, place = speed + 0.5 * step * (first + second), after
    return found
