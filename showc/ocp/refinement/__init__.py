"""The loops that solve, audit and refine until a tolerance is met."""
