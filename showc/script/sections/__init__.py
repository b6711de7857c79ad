"""The sections of a script, each built into its part of the show."""
