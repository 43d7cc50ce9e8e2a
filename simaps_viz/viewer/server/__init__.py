"""The HTTP server in front of viser: it checks addresses, tokens and messages, and bounds their size."""
