"""Solved shows in the formats that other systems fly or draw."""
