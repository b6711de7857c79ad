"""Where the work is done, and what of it is kept."""
