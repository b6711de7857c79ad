"""Links to vehicles: load missions, stream a solved flight, compare what was flown.

Import :mod:`showc.vehicle_link.upload`, :mod:`showc.vehicle_link.stream` and
:mod:`showc.vehicle_link.compare`; each needs the network or a log of its own.
"""
