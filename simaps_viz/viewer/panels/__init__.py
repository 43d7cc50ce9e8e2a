"""The panels of the page, one a file, with their words and what they ask for."""
