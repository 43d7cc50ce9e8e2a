"""Spoken commands and robot programs: words to a program, a program to steps, phrases to instances."""
