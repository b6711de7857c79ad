"""stub"""


def render_leg(*a): ...
