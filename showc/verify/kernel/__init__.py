"""The theorems: everything that is proved about a flight, from its numbers alone.

Nothing but numpy and the log's own messages is imported here.
"""
