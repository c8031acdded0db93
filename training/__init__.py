"""Training toolkit of lull: from EXR files to weights. Run as `python -m training.<name>`."""
