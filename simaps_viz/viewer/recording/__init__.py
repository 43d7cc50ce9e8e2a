"""The recorded build docked beside the map: the same frame in both, and clicks."""
