"""Maps that grow while frames come from a robot: sources of frames, their time and pose, and what is sent back."""
