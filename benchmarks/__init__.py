"""Benchmarks: one file for each hot path and each paper; `outrider bench --list` names them."""
