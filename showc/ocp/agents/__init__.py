"""Several systems of one kind in the least common time, apart from each other."""
