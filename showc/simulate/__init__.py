"""Simulation: the flight in wind, with rotors that lag and an estimator that errs."""
