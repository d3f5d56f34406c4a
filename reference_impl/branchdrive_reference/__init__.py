"""Reference world of BranchDrive: simulator, privileged expert and two-pass collector.

Needs the extra ``branchdrive[sim]``; the core package `branchdrive` never imports this one.
"""
