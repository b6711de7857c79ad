"""Documents of unknown origin, read within bounds: archives, JSON, numbers, glTF."""
