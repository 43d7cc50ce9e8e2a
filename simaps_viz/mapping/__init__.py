"""Frames to a Semantic Instance Map, stage by stage."""
