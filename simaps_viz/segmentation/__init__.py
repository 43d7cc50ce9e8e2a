"""Networks that segment frames, run by onnxruntime; what they give is kept, so that no frame is looked at twice."""

import os

# From version 1.29 on onnxruntime reports to its makers, unless this is set before it is imported.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
