"""When the legs of missions are released, so that predicted flights keep apart.

:mod:`showc.schedule.layout` lays out the missions of a fleet;
:mod:`showc.schedule.encodings` chooses how each leg is flown.
"""
