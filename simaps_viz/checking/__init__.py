"""Is a sequence usable, and if not, what is wrong with it: neighbouring frames have to see the same surfaces."""
