"""Controls linear on each interval, on meshes graded by what they cost."""
