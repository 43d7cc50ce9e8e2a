"""The three-dimensional scene: nodes of viser."""
