"""The language of scripts: the key table, values with units, and the reader."""
