"""Readers of recorded and rendered sequences; each yields frames in this package's frames and units."""
