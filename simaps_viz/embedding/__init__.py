"""Free words on a map: the user's own network that embeds pictures and words in one space, in ONNX."""
