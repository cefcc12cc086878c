"""What runs on the ground station."""
