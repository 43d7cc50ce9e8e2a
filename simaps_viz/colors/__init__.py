"""Colours of classes and instances."""
