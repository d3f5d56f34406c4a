"""What a collected dataset contains: its population, outcomes by scenario type, and fidelity of its replays."""
