"""Pictures of a logged show: a page that plays it, a report, drawings of its legs."""

from showc.view.leg import render_leg
from showc.view.page import render_page
from showc.view.report import render_report
from showc.view.safety import render_safety
from showc.view.solution import render_solution

__all__ = [
    "render_leg",
    "render_page",
    "render_report",
    "render_safety",
    "render_solution",
]
