"""Shows in the formats of others: read within bounds, judged as they are written."""
