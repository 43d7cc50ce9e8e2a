"""From frames to a map file: the pipeline, its log, several processes, the cache."""
