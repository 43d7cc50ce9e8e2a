"""Semantic Instance Maps from posed RGB-D."""
