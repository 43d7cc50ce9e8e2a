"""Check whether a sequence is usable and find its faults: neighbouring frames have to see the same surfaces."""
