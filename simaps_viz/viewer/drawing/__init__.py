"""What is drawn: the map, its objects, marks and pictures, and where the camera looks from."""
