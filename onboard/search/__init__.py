"""Flying over an area line by line, to look for people there."""
