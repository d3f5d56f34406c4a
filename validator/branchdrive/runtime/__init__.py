"""Processes and what they share: executors, workers, interrupts, locks, and what is needed of the machine."""
