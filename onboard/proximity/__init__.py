"""Nearest points of depth pictures for the limiter, and which directions were seen at all."""
