"""The missions beside a log, proved from their bytes.

``language`` is what may stand in a mission, ``folder`` holds every file against the
script, ``legs`` and ``law`` say what an autopilot makes of the rows, ``separation`` and
``flight`` prove what keeps them apart, in time and inside.
"""
