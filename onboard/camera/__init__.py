"""Pictures: the simulated camera, a video file or an image folder; raw for readers on board, JPEG for the ground."""
