"""One file that shows a map, its making and a ride to somebody who has none of this."""
