"""Builds on many machines: shards of a sequence are gathered anywhere, and their steps joined here."""
