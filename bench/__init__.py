"""Comparisons with the real Open Image Denoise, measured in one run. `make peer`, `make bench-peer`."""
