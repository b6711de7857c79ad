"""The pipeline: stages joined, results placed."""
