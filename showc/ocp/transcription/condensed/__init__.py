"""Cascades with their inner unknowns eliminated, one stage a mesh interval."""
