"""The workbench with everything behind it: maps, recordings, live builds, comparisons, sharing."""
