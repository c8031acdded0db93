"""Training toolkit of lull: from EXR files to weights. Scripts run as `python -m training.<name>`."""
