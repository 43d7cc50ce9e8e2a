"""Attacks on the servers of a workbench, each a function with a name; nothing here leaves this machine."""
