"""The recorded build: events to a rerun recording, and the page that shows it."""
