"""Output to the terminal: answers, progress, logs."""
