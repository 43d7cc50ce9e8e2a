"""A map that is watched while it is built: how often it is shown, and on which page."""
