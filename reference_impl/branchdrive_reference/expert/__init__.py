"""The privileged expert, PDM-Lite-like: the slowest of its hazards sets the speed, pure pursuit the steering.

It sees the whole state, drives the nominal rollout, and keeps deciding while an intervention overrides it.
"""
