"""Pictures of a logged show: a page that plays it, a report, drawings of its legs."""

from showc.view.leg import render_leg
from showc.view.page import render_page
from showc.view.report import render_report

__all__ = ["render_leg", "render_page", "render_report"]
