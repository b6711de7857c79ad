"""Where drones come too near, and flights of all drones that keep apart.

``repair`` decides the separation of a transition. ``independent`` flies each drone on
its own, and ``conflicts`` finds the pairs that come too near. ``untangling`` changes
all flights together; ``bending`` solves single drones again behind ``walls``.
``widened`` and ``layered`` are flights in closed form, on one ``clock``, that always
keep apart.
"""
