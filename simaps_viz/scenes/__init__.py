"""The embedded scene: a furnished place of our own making, ray cast to posed RGB-D frames with exact instances."""
