"""Measuring: how good the instances are, how fast the stages."""
