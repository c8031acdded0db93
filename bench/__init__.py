"""Comparisons with the real Open Image Denoise in one run: make peer, bench-peer, chart."""
