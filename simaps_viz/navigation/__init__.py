"""Planning over the free cells of a map, and a simulated robot that drives a program."""
