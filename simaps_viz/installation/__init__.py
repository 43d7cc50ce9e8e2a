"""Checks of the installation and the machine it is on, one function each; none raises."""
