"""Networks that segment frames, run by onnxruntime; what they give is kept, so that no frame is looked at twice."""
