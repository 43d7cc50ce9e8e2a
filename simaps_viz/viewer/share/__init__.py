"""Files to send to somebody: a map, its growth, and a robot that drives on it."""
