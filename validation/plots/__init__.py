"""The pictures of the pages on the two papers."""
