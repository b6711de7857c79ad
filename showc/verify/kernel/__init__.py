"""The theorems: everything that is proved about a flight, from its numbers alone.

Each module begins with its statement, the proof, its error bound and the source.
Nothing but numpy and the log's own messages is imported here.
"""
