"""Other people's maps, re-implemented for comparison: same frames in, same kind of map out."""
