"""What is written to a terminal: answers, progress, logs."""
