"""Plane geometry: angles, boxes and polylines with arc length. Frame: x forward/east, y left/north, yaw CCW."""
