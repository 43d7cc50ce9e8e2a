"""Maps in the formats of other programs; one file a format, `formats.export_map` is the way in."""
