"""The robot on the page: its ride, and a camera that goes along."""
