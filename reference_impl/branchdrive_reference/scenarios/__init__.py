"""What is staged on a route: scenario types with their triggers, and the ambient population."""
